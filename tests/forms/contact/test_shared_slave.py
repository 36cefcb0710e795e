"""One slave over several masters: the tangent beside a gap, and what points bring along."""

import dolfinx
import numpy as np
import pytest
from mpi4py import MPI

from tests.contact_boxes import GAP, PENALTY, Scene, box
from tests.grid import coordinate_element
from tests.laws import coulomb, film_map
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.shared_slave import introduce, keep_what_went_over
from tribox.geometry.surfaces.surface import ContactSurface

K_T = 60.0
FAR = (0.0, 1.0, -0.7)  # a die below the others, further away than the length of a facet
APART = [(0.0, 0.52, 0.0), (0.56, 1.0, 0.0)]
MEETING = [(0.0, 0.52, 0.0), (0.52, 1.0, 0.0)]


class Dies(Scene):
    """A pad of five facets on [0.3, 0.8] over dies (left, right, top); as :class:`Scene`.

    In space the dies are deeper than the pad.
    """

    def __init__(self, dies, law, film=0.0, fade=None, height=0.2, dim=2):
        cell = {2: "quadrilateral", 3: "hexahedron"}[dim]
        pad, deep = [[(0.2, 0.6, 2)], [(0.0, 0.8, 2)]] if dim == 3 else [[], []]
        parts = (
            [(0.3, 0.8, 5), *pad, (GAP, 0.5, 1)],
            *([(left, right, 3), *deep, (top - height, top, 1)] for left, right, top in dies),
        )
        parts = [box(cell, *zip(*((n, a, b) for a, b, n in part), strict=True)) for part in parts]
        first = np.cumsum([0, *(len(x) for x, _ in parts)])
        cells = np.concatenate([c + at for (_, c), at in zip(parts, first, strict=False)])
        x = np.concatenate([x for x, _ in parts])
        element = coordinate_element(cell, dim)
        mesh = dolfinx.mesh.create_mesh(MPI.COMM_SELF, cells, x=x, e=element)
        self.dim, self.space = dim, dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (dim,)))
        self.where = self.space.tabulate_dof_coordinates()[:, :dim]
        self.size = self.where.size
        # Each die has nodes of its own, also where it meets the next one: its cells tell them.
        bodies = np.repeat(np.arange(len(parts)), [len(c) for _, c in parts])
        bodies = bodies[mesh.topology.original_cell_index]
        self.terms, more = [], {"fade_length": fade}
        pad = self._facets(mesh, bodies, 0, GAP)
        for number, (_, _, top) in enumerate(dies, 1):
            die = self._facets(mesh, bodies, number, top)
            surface = ContactSurface(self.space, pad, die, 5, **more)
            self.terms.append(ContactTerm(surface, law, PENALTY, film))
        introduce(self.terms)

    @staticmethod
    def _facets(mesh, bodies, number, height):
        dim = mesh.topology.dim
        mesh.topology.create_connectivity(dim - 1, dim)
        found = dolfinx.mesh.locate_entities_boundary(
            mesh, dim - 1, lambda X: np.isclose(X[dim - 1], height, atol=1e-9)
        )
        cells = mesh.topology.connectivity(dim - 1, dim)
        return np.array([f for f in found if bodies[cells.links(f)[0]] == number], dtype=np.int32)

    def trials(self, x):
        return [term.evaluate(x, 1.0) for term in self.terms]

    def commit(self, x):
        for term, trial in zip(self.terms, self.trials(x), strict=True):
            term.commit(trial)

    def _sum(self, part, x):
        out = 0.0
        for self.term in self.terms:
            out = out + part(x)
        return out

    def residual(self, x, dt=1.0, mode=None):
        return self._sum(lambda x: Scene.residual(self, x, dt)[0], x), None

    def tangent(self, x, dt=1.0, mode=None):
        return self._sum(lambda x: Scene.tangent(self, x, dt), x)


def closed(trials):
    return np.array([trial.pressure > 0.0 for trial in trials])


@pytest.mark.parametrize("dies", [APART, MEETING, [*APART, FAR]], ids=["gap", "meet", "far"])
@pytest.mark.parametrize("law", ["stick", "slip", "film"])
def test_tangent_over_two_masters(dies, law):
    """Points fade before the gap, are over it, and have come over from the other master."""
    laws = {"stick": coulomb(50.0), "slip": coulomb(0.2), "film": film_map()}
    scene = Dies(dies, laws[law], film=0.5 if law == "film" else 0.0, fade=0.12)
    scene.commit(scene.vector((0.0, -0.12), 0.03, 0.9))
    x = scene.vector((0.11, -0.14), 0.04, 0.7, 0.01)
    before = np.array([term.state.friction.closed for term in scene.terms])
    trials = scene.trials(x)
    came = closed(trials)[1] & before[0] & ~before[1]
    assert came.any() and closed(trials)[:2].any(axis=1).all()
    assert len(dies) == 2 or not closed(trials)[2].any()
    grows = np.array([t.normal_contact.grows[t.normal_contact.active] for t in trials[:2]], object)
    assert any(g.any() for g in grows) and not all(g.all() for g in grows)
    if dies[1] == APART[1]:
        fading = [(t.projection.share > 0.0) & (t.projection.share < 1.0) for t in trials[:2]]
        assert any(np.any(f & (t.pressure > 0.0)) for f, t in zip(fading, trials, strict=False))
    assert scene.error(x) < 1e-9


def test_tangent_over_two_masters_in_space():
    """The elastic slip that points bring is not carried by what was ahead of them."""
    scene = Dies(APART, coulomb(50.0), dim=3)
    scene.commit(scene.vector((0.0, 0.0, -0.12), 0.03, 0.9))
    x = scene.vector((0.11, 0.05, -0.14), 0.04, 0.7, 0.01)
    before = np.array([term.state.friction.closed for term in scene.terms])
    came = closed(scene.trials(x))[1] & before[0] & ~before[1]
    right = scene.terms[1].state
    assert np.any(right.slip_components[came] != 0.0)
    assert scene.error(x) < 1e-9


def rigid(scene, along, down):
    return scene.moved(lambda x: np.tile([along, 0.0], (len(x), 1)), down)


def test_points_that_come_over_bring_their_elastic_slip():
    """They stuck on the first master, and stick on: the spring has the whole way in it."""
    scene = Dies(MEETING, coulomb(50.0, K_T))
    for along in (0.0, 0.03):
        scene.commit(rigid(scene, along, 0.02))
    left, right = scene.terms
    first = left.state.friction.closed & ~right.state.friction.closed
    trials = scene.trials(rigid(scene, 0.15, 0.02))
    came = first & (trials[1].pressure > 0.0) & (trials[0].pressure == 0.0)
    assert np.count_nonzero(came) > 1
    expected = K_T * np.array([0.15, 0.0]) + np.zeros((np.count_nonzero(came), 2))
    np.testing.assert_allclose(trials[1].response.traction[came], expected, rtol=1e-9, atol=1e-9)
    # The spring's energy is the work of the step and what the first master's spring had in it.
    lost = trials[1].response.dissipation
    assert np.all(np.abs(lost.total - lost.numerical)[came] <= 1e-12)
    half = 0.5 * K_T * 0.12**2  # of one step of 0.12, by the law's implicit rule
    np.testing.assert_allclose(lost.numerical[came], half, rtol=1e-9)
    # What it lost by leaving the first has not gone: only the second is to be asked for it.
    open_before = [t.response.dissipation.opening.copy() for t in trials]
    keep_what_went_over(scene.terms, trials)
    opening = trials[0].response.dissipation.opening
    assert np.all(open_before[0][came] > 0.0) and np.all(opening[came] == 0.0)
    np.testing.assert_array_equal(trials[1].response.dissipation.opening, open_before[1])


def test_points_that_come_over_bring_their_slip_path():
    """What a law weakens with; they have slid all the way but for the spring's give."""
    scene = Dies(MEETING, coulomb(0.2, K_T))
    scene.commit(rigid(scene, 0.0, 0.02))
    scene.commit(rigid(scene, 0.03, 0.02))
    left, right = scene.terms
    first = left.state.friction.closed & ~right.state.friction.closed
    trial = scene.trials(rigid(scene, 0.15, 0.02))[1]
    came = first & (trial.pressure > 0.0)
    assert np.count_nonzero(came) > 1
    give = 0.2 * trial.pressure[came] / K_T
    np.testing.assert_allclose(trial.response.state.slip_path[came], 0.15 - give, rtol=1e-9)


def test_what_opens_over_a_gap_is_lost():
    scene = Dies(APART, coulomb(50.0, K_T))
    scene.commit(rigid(scene, 0.0, 0.02))
    scene.commit(rigid(scene, 0.01, 0.02))
    trials = scene.trials(rigid(scene, 0.05, 0.02))
    was = np.array([term.state.friction.closed for term in scene.terms])
    lost = was[0] & ~closed(trials).any(axis=0)
    assert lost.any()
    before = trials[0].response.dissipation.opening.copy()
    keep_what_went_over(scene.terms, trials)
    np.testing.assert_array_equal(trials[0].response.dissipation.opening[lost], before[lost])
    assert np.all(before[lost] > 0.0)
    # Once: the next master, which they have not come to, has nothing of them.
    assert not trials[1].response.dissipation.opening[lost].any()


def test_a_master_further_off_has_no_share_of_the_slave():
    """A strip between a pad and a die does not share the pad with the die."""
    alone, two = (Dies(dies, coulomb(0.2)) for dies in ([APART[0]], [APART[0], FAR]))
    for scene in (alone, two):
        scene.commit(rigid(scene, 0.0, 0.01))
    assert np.isfinite(two.terms[1].state.gap).all()  # it lies below all of the slave
    ours, theirs = (scene.trials(rigid(scene, 0.0, 0.02))[0] for scene in (two, alone))
    assert (theirs.pressure > 0.0).sum() > 5
    np.testing.assert_allclose(ours.pressure, theirs.pressure, rtol=1e-12)
