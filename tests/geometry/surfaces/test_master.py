"""A master of which each rank knows a part: the closest points are those on the whole of it."""

import numpy as np
import pytest

from tests.contact_boxes import Scene
from tribox.forms.friction.coulomb import FrictionlessLaw
from tribox.geometry.surfaces import master
from tribox.geometry.surfaces.facets import order_by_place

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
