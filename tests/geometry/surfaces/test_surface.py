"""Contact forces of a surface in the plane do not depend on the ranks."""

import dolfinx
import numpy as np
import pytest
from mpi4py import MPI

from tests.contact_boxes import Scene
from tribox.forms.friction.coulomb import FrictionlessLaw
from tribox.geometry.surfaces import master
from tribox.geometry.surfaces.facets import facet_shape, order_by_place
from tribox.geometry.surfaces.slave_points import CHORDS, SlaveNormals, SlaveVertices

SLAVE, MASTER = "elastomer_contact", "aluminium_contact"


def space_on(named):
    return dolfinx.fem.functionspace(named.mesh, ("Lagrange", 1, (2,)))


# -- A master of which each rank knows a part: the closest points are those on the whole of it -----

WAYS = (0.0, 0.15, 0.2, -0.2)  # of the slave, over facets of 1/40


def found(comm, directory, **options):
    """Places, numbers of facets and gaps while the slave moves on; facets known and on the whole.

    The upper box turns as well, so that its points do not lie on sides of facets.
    """
    monkeypatch = pytest.MonkeyPatch()
    monkeypatch.setattr(master, "REACH", 0.3)  # the slave's facets are large here
    scene = Scene(
        "hex8", FrictionlessLaw(), master=40, fine=True, parallel=comm.size > 1, **options
    )
    monkeypatch.undo()
    surface, known, out = scene.surface, [], []
    for way in WAYS:

        def motion(x, way=way):
            turn = 0.3 * way * np.stack([-x[:, 1], x[:, 0], 0.0 * x[:, 0]], axis=1)
            return turn + np.array([way, 0.3 * way, 0.02 * np.sin(7.0 * way)])

        values = surface.gather(scene.moved(motion, depth=0.01))
        points = surface.slave_positions(values[surface.slave_rows])
        at = surface.project(points, surface.master_positions(values))
        rows = np.column_stack([points, surface.numbers(at.facet), at.gap, at.foot, at.normal])
        every = np.concatenate(comm.allgather(rows))
        out.append(every[order_by_place(every[:, :3])].tolist())
        known.append(comm.allgather(len(surface.master.facets)))
    return out, known, surface.master.extent


def plain(comm, directory):
    """With the facets as they are."""
    return found(comm, directory)


def smooth(comm, directory):
    """With patches over them, and what fades at their ends."""
    return found(comm, directory, smoothing_angle=0.5, fade_length=0.1)


@pytest.mark.mpi(plain, 3)
@pytest.mark.mpi(smooth, 3)
@pytest.mark.parametrize("scene", [plain, smooth])
def test_closest_points_are_those_on_the_whole_surface(on_ranks, scene):
    one, (facets,), extent = on_ranks(scene, 1)[0], on_ranks(scene, 1)[1][0], on_ranks(scene, 1)[2]
    three, known, same = on_ranks(scene, 3)
    assert extent == same
    for here, there in zip(one, three, strict=True):
        here, there = np.array(here), np.array(there)
        assert np.array_equal(here[:, 3], there[:, 3])
        np.testing.assert_allclose(there, here, atol=1e-12)
    assert max(known[0]) < 0.9 * facets, "no rank holds all of it"
    assert np.all(np.diff(known, axis=0) >= 0) and max(np.diff(np.max(known, axis=1))) > 0


# -- Normals of a slave surface in the plane: where they point, and how they change ----------------

PLACES = np.array([0.1, 0.5, 0.8])  # of the points on each facet, from its first vertex


def prepared(position, closed=False, seed=0):
    """Normals over a chain of vertices, the body to its right; facet and place of each point."""
    rng = np.random.default_rng(seed)
    count = len(position)
    start = np.repeat(np.arange(count if closed else count - 1), len(PLACES))
    end, xi = (start + 1) % count, np.tile(PLACES, len(start) // len(PLACES))
    flipped = rng.random(len(start)) < 0.5
    number = rng.permutation(count)  # of the vertices, in any order
    first, second = np.where(flipped, end, start), np.where(flipped, start, end)
    place = np.where(flipped, 1.0 - xi, xi)[:, None]
    vertices = SlaveVertices(
        nodes=np.arange(count),
        position=position[np.argsort(number)],
        of_point=number[np.stack([first, second], axis=1)],
        shape=facet_shape("interval", 1).values(place),
        area=np.ones(count),
        length=np.ones(count),
        shared=np.zeros(count, dtype=bool),
        comm=MPI.COMM_SELF,
    )
    assert flipped.any() and not flipped.all()
    return SlaveNormals(vertices, flipped), vertices, start, xi


def normals_of(position, **options):
    made, vertices, start, xi = prepared(position, **options)
    return made.at(vertices.position[made.around]).normal, start, xi


def left(way):
    way = np.atleast_2d(way)
    return np.stack([-way[:, 1], way[:, 0]], axis=1) / np.linalg.norm(way, axis=1)[:, None]


def test_between_vertices_the_chords_normals_are_mixed():
    """The definition in numbers; at the ends the chord is the last facet."""
    position = np.array([[0.0, 0.0], [1.0, 0.2], [1.7, -0.3], [3.0, 0.1], [3.4, 0.9]])
    normal, start, xi = normals_of(position)
    low, high = np.maximum(np.arange(5) - 1, 0), np.minimum(np.arange(5) + 1, 4)
    nu = left(position[high] - position[low])
    mixed = (1.0 - xi)[:, None] * nu[start] + xi[:, None] * nu[start + 1]
    expected = -mixed / np.linalg.norm(mixed, axis=1)[:, None]
    np.testing.assert_allclose(normal, expected, rtol=0, atol=1e-14)


def test_on_a_closed_round_they_are_radial():
    """A regular polygon: at the middles of its facets exactly."""
    angle = -np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    position = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    normal, start, xi = normals_of(position, closed=True)
    middle = xi == 0.5
    out = position[start] + position[(start + 1) % 12]
    out /= np.linalg.norm(out, axis=1)[:, None]
    np.testing.assert_allclose(normal[middle], -out[middle], rtol=0, atol=1e-14)


@pytest.mark.parametrize("seed", [1, 2])
def test_changes_against_differences(seed):
    rng = np.random.default_rng(seed)
    position = np.stack([np.arange(6.0), np.zeros(6)], axis=1) + rng.uniform(-0.3, 0.3, (6, 2))
    made, vertices, _, _ = prepared(position, seed=seed)
    where = vertices.position[made.around]
    at, way, h = made.at(where), rng.normal(size=where.shape), 3e-6
    slope = (made.at(where + h * way).normal - made.at(where - h * way).normal) / (2.0 * h)
    change = np.einsum("qeij,es,qsj->qi", at.change, CHORDS, way)
    np.testing.assert_allclose(change, slope, rtol=0, atol=1e-9)
    assert np.abs(slope).max() > 0.1
    some = at.of(np.array([3, 1]))
    np.testing.assert_array_equal(some.normal, at.normal[[3, 1]])
    np.testing.assert_array_equal(some.change, at.change[[3, 1]])
