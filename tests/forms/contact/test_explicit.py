"""The explicit forms of a contact pair against the contact term of the implicit solution."""

from typing import get_args

import numpy as np
import pytest
from mpi4py import MPI

from tests.conftest import Pair
from tests.contact_boxes import dense_tangent, nodal_forces
from tests.laws import coulomb, film_map
from tribox.forms.contact.explicit import ExplicitContact
from tribox.forms.contact.explicit_compiled import CompiledContact, explicit_contact
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.pressure import PressureKind
from tribox.forms.contact.stiffness import PairStiffness, elastic_stiffness, largest_viscosity
from tribox.forms.friction.coulomb import FrictionlessLaw
from tribox.forms.friction.film import FilmTable
from tribox.geometry.generators.two_blocks import Block, TwoBlocks
from tribox.geometry.meshes.mesh import generate
from tribox.geometry.surfaces.surface import ContactSurface, NodalVector

PENALTY = 50.0


LAWS = {
    "none": (FrictionlessLaw(), 0.0),
    "coulomb": (coulomb(0.3), 0.0),
    "map": (film_map(), 0.5),
    "film over the pressure": (film_map(), FilmTable(((0.0, 0.8), (5.0, 0.3)))),
}


PROJECTION = ("facet", "xi", "foot", "normal", "tangents", "gap", "clamped", "on_surface")
NORMAL = ("gap", "nodal_pressure", "active", "cover")
STATE = (
    *("facet", "xi", "ahead", "slip_components", "slip_length", "gap", "area_ratio"),
    *("share", "sunk"),
)


def compare(mine, theirs, names, step, atol=1e-12):
    for name in names:
        a, b = getattr(mine, name), getattr(theirs, name)
        np.testing.assert_allclose(a, b, rtol=1e-11, atol=atol, err_msg=f"{name}, step {step}")


def uneven(surface, kind):
    """A penalty of its own at each vertex or point."""
    count = surface.vertices.count if kind == "averaged" else len(surface.slave.weight)
    return PENALTY * np.linspace(0.8, 1.25, count)


def bent(size, phase):
    def motion(X):
        along = 0.3 * size * np.cos(2.0 * X[:, 0] - phase)
        return np.stack([along, size * np.sin(4.6 * X[:, 0] + phase)], axis=1)

    return motion


def path():
    """Shifts and bends of the master: closing, sliding over facets and grooves, opening, closing.

    The last but one puts a part of the slave past the end of the master.
    """
    yield (0.0, 0.03), 0.0
    yield (0.01, -0.03), 0.05
    yield (0.05, -0.05), 0.15
    yield (0.12, -0.06), 0.2
    yield (0.02, -0.04), 0.2
    yield (0.02, 0.05), 0.1
    yield (0.03, -0.02), 0.1
    yield (0.75, -0.03), 0.1
    yield (0.70, -0.03), 0.1


def states(blocks):
    for (x, y), size in path():
        common = bent(size, 0.4)
        shift = np.array([x, y])

        def upper(X, shift=shift, common=common):
            return common(X + shift * [1.0, 0.0]) + shift

        yield blocks.displaced(upper, common)


def vectors(blocks):
    space = blocks.u.function_space
    return NodalVector(space, blocks.u.x), NodalVector(space)


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("kind", get_args(PressureKind))
@pytest.mark.parametrize("name", LAWS)
def test_the_same_contact_along_a_path(pair, name, kind, compiled):
    """Positions, projections, slip, elastic slip, law, loads and history of every step.

    Explicit steps are so short that closest points serve as the places opposite.
    """
    blocks = pair(lower=(5, 2))
    law, film = LAWS[name]
    surface = blocks.surface()
    penalty = uneven(surface, kind)
    reference = ContactTerm(surface, law, penalty, film, kind)
    own = ContactTerm(blocks.surface(), law, penalty, film, kind)
    contact = explicit_contact(own) if compiled else explicit_contact(own, False)
    assert isinstance(contact, CompiledContact) == compiled
    u, out = vectors(blocks)
    seen = set()
    for step, x in enumerate(states(blocks)):
        expected = reference.evaluate(x, 0.5)
        u.owned[:] = x.array_r
        out.owned[:] = 1.0
        trial = contact.evaluate(u, 0.5)
        contact.add_forces(out)
        at = expected.projection
        compare(trial.projection, at, PROJECTION, step, 1e-13)
        kinematics = trial.kinematics, expected.kinematics
        compare(*kinematics, ("closed", "slip", "way", "elastic_slip"), step, 1e-13)
        names = ("position", "area_ratio", "pressure", "film", "traction")
        compare(trial, expected, names, step, 1e-11)
        if kind == "averaged":
            reference.cover(expected), own.cover(trial)  # found where it is asked for
            compare(trial.normal_contact, expected.normal_contact, NORMAL, step, 1e-13)
            compare(trial.faded, expected.faded, ("share", "sunk", "lost"), step)
        seen |= {("lost", bool(kind == "averaged" and expected.faded.lost.any()))}
        force = nodal_forces(reference, expected, len(out.owned) // 2).reshape(-1)
        np.testing.assert_allclose(out.owned - 1.0, force, atol=1e-12)
        k = expected.kinematics
        seen |= {("clamped", bool((at.clamped & k.closed).any()))}
        seen |= {("off", bool((~at.on_surface).any()))}
        closes = k.closed & (reference.state.gap > 0.0)
        seen |= {("closes", bool((closes & np.isfinite(reference.state.gap)).any()))}
        seen |= {("closes from nowhere", bool((closes & np.isinf(reference.state.gap)).any()))}
        seen |= {("open beneath a pressure", bool(((expected.pressure > 0) & (at.gap > 0)).any()))}
        expected.slave_tangents = None
        reference.commit(expected)
        contact.commit()
        compare(contact.term.state, reference.state, STATE, step, 1e-11)
    assert {("clamped", True), ("off", True), ("closes", True)} <= seen
    assert ("closes from nowhere", True) in seen
    assert (("lost", True) in seen) == (kind == "averaged")
    assert (("open beneath a pressure", True) in seen) == (kind == "averaged")


def test_points_face_the_image_of_the_master_beyond_a_plane_of_symmetry():
    """In open gaps over a slope the closest points of some lie beyond the plane."""
    boxes = Block(1.0, 0.5, (6, 2)), Block(2.0, 0.5, (7, 2))
    blocks = Pair(generate(TwoBlocks(*boxes, offset=0.0, gap=0.2), MPI.COMM_SELF))
    space, law = blocks.u.function_space, FrictionlessLaw()
    on_plane = np.nonzero(np.isclose(space.tabulate_dof_coordinates()[:, 0], 0.0))[0]
    names = map(blocks.named.facets, ("elastomer_contact", "aluminium_contact"))
    ends = 5, False, None, None, [on_plane, on_plane[:0]]
    slave, master = names
    terms = [ContactTerm(ContactSurface(space, slave, master, *ends), law, PENALTY) for _ in "ab"]
    contact = explicit_contact(terms[1])
    assert isinstance(contact, CompiledContact)
    x = blocks.displaced(np.zeros_like, lambda X: X[:, :1] * [0.0, -0.3])
    u, _ = vectors(blocks)
    u.owned[:] = x.array_r
    expected, trial = terms[0].evaluate(x, 0.5), contact.evaluate(u, 0.5)
    assert expected.projection.clamped.any() and expected.projection.on_surface.all()
    compare(trial.projection, expected.projection, PROJECTION, 0, 1e-13)
    compare(trial.faded, expected.faded, ("share",), 0)


@pytest.mark.parametrize("compiled", [True, False])
def test_its_steps_are_too_short_to_look_for_points_that_come_to_rest_within(pair, compiled):
    """The last step of the path is slow; without an upper bound the elastic slip is all of it."""
    blocks, law = pair(lower=(5, 2)), film_map(V_star=0.5, eta_b=0.01)
    reference = ContactTerm(blocks.surface(), law, PENALTY, 0.5)
    contact = explicit_contact(ContactTerm(blocks.surface(), law, PENALTY, 0.5), compiled)
    u, _ = vectors(blocks)
    for x in states(blocks):
        expected = reference.evaluate(x, 0.5)
        u.owned[:] = x.array_r
        trial = contact.evaluate(u, 0.5)
        before = reference.state.friction
        expected.slave_tangents = None
        reference.commit(expected)
        contact.commit()
    held_back = expected.response.held_back
    assert trial.response.held_back is None and held_back is not None and held_back.max() > 0.05
    left_out = np.linalg.norm(trial.traction - expected.traction, axis=1)
    np.testing.assert_allclose(left_out, held_back, atol=1e-9)
    assert before.speed.max() > 1.0


@pytest.mark.parametrize("compiled", [True, False])
def test_a_penetration_of_roundoff_is_no_contact(pair, compiled):
    """Blocks that just touch: neither the gap's sign nor the partition decides on a pressure."""
    blocks = pair()
    contact = explicit_contact(ContactTerm(blocks.surface(), FrictionlessLaw(), PENALTY), compiled)
    u, _ = vectors(blocks)
    for depth, pressed in ((1e-15, False), (1e-9, True)):
        vec = blocks.displaced(lambda X, d=depth: 0.0 * X - [0.0, d], lambda X: 0.0 * X)
        u.owned[:] = vec.array_r
        trial = contact.evaluate(u, 1.0)
        assert bool((trial.pressure > 0.0).all()) == pressed
        assert trial.kinematics.closed.all()
        assert pressed or not trial.pressure.any()


@pytest.mark.parametrize("compiled", [True, False])
def test_film_correction_in_numbers(pair, compiled):
    """One correction from nothing at a uniform speed, by the formula written out here."""
    blocks = pair()
    law = film_map(alpha=1.0, film_onset_pressure=0.0)
    contact = explicit_contact(ContactTerm(blocks.surface(3), law, PENALTY, 0.5), compiled)
    u, out = vectors(blocks)
    velocity, scratch = NodalVector(blocks.u.function_space), vectors(blocks)[1]
    vec = blocks.displaced(lambda X: 0.0 * X - [0.0, 0.02], lambda X: 0.0 * X)
    u.owned[:] = vec.array_r
    contact.evaluate(u, 0.1)
    contact.commit()
    vec = blocks.displaced(lambda X: 0.0 * X + [0.01, -0.02], lambda X: 0.0 * X)
    u.owned[:] = vec.array_r
    trial = contact.evaluate(u, 0.1)
    contact.refresh_compliance(np.full(len(u.owned), 1.0 / 0.3), scratch)
    contact.hold_film()
    np.testing.assert_allclose(trial.traction, [[0.0, PENALTY * 0.02]] * 12, atol=1e-13)
    c = 5.0 / 0.5
    np.testing.assert_allclose(contact.film, c)
    scratch.owned[:] = 7.0
    speed = blocks.displaced(lambda X: 0.0 * X + [0.3, 0.2], lambda X: 0.0 * X)
    velocity.owned[:] = speed.array_r
    out.owned[:] = 0.0
    contact.correct_film(velocity, 1.0, scratch, 0.0, out)
    expected = c * 0.3 / (1.0 + 0.1 * c * contact.compliance)
    np.testing.assert_allclose(contact.film_traction[:, 0], expected)
    np.testing.assert_allclose(contact.film_traction[:, 1], 0.0, atol=1e-15)
    np.testing.assert_allclose(contact.trial.traction[:, 0], -expected)
    forces = out.owned.reshape(-1, 2)
    np.testing.assert_allclose(forces.sum(axis=0), 0.0, atol=1e-14)
    total = contact.term.surface.slave.weight @ expected
    assert forces[blocks.nodes("elastomer"), 0].sum() == pytest.approx(total)
    parts = contact.trial.response.dissipation
    np.testing.assert_allclose(parts.viscous, expected**2 * 0.1 / c)
    np.testing.assert_allclose(parts.total, expected * 0.01)


@pytest.mark.parametrize("compiled", [True, False])
def test_compliance_bounds_the_impulses_of_all_points_together(pair, compiled):
    """Σ w s τ² ≥ Σ_a (Σ_q w N_a τ)²/m_a for any tractions, and equality in the flat middle."""
    blocks = pair(lower=(5, 2))
    contact = explicit_contact(ContactTerm(blocks.surface(3), FrictionlessLaw(), PENALTY), compiled)
    u, scratch = vectors(blocks)
    u.owned[:] = 0.0
    contact.evaluate(u, 1.0)
    rng = np.random.default_rng(0)
    mass = rng.uniform(0.2, 1.0, len(u.owned) // 2).repeat(2)
    contact.refresh_compliance(1.0 / mass, scratch)
    weight = contact.term.surface.slave.weight
    for _ in range(50):
        tau = np.zeros((len(weight), 2))
        tau[:, 0] = rng.standard_normal(len(weight))
        scratch.owned[:] = 0.0
        contact.spread(tau, scratch)
        together = float(np.sum(scratch.owned**2 / mass))
        assert together <= weight @ (contact.compliance * tau[:, 0] ** 2) * (1.0 + 1e-12)
    assert contact.compliance.min() > 0.0


def test_the_law_tells_its_stiffness_and_its_viscosity(pair):
    blocks = pair()
    onset = {"film_onset_pressure": 1e-3}
    term = ContactTerm(blocks.surface(), film_map(alpha=0.25, **onset), PENALTY, 0.5)
    assert elastic_stiffness(term) == pytest.approx(0.75 * 60.0)
    assert largest_viscosity(term) == pytest.approx(0.25 * 10.0)
    law = film_map(alpha=0.25, V_star=0.1, **onset)
    fast = ContactTerm(blocks.surface(), law, PENALTY, 0.5)
    assert largest_viscosity(fast) == pytest.approx(10.0)
    dry = ContactTerm(blocks.surface(), coulomb(0.3, 7.0), PENALTY)
    assert elastic_stiffness(dry) == pytest.approx(7.0)
    assert largest_viscosity(dry) == 0.0


def test_the_pressures_of_the_probes_are_those_of_each_points_own_facet(pair):
    """The same on a facet of another length with its own penalty, whatever the mean length."""
    law = film_map(alpha=0.25, film_onset_pressure=1e-3, barus=0.1)
    surface = pair().surface()
    found = set()
    for kind, count in (("averaged", surface.vertices.count), ("pointwise", 18)):
        term = ContactTerm(surface, law, np.full(count, PENALTY), 0.5, kind)
        before = largest_viscosity(term)
        term.rule.penalty /= 7.0
        surface.slave.facet_length[:] *= 7.0
        assert largest_viscosity(term) == pytest.approx(before, rel=1e-12)
        surface.slave.facet_length[:] /= 7.0
        found |= {round(before, 12)}
    assert len(found) == 1 and found != {2.5}


def graded(ratio=20.0):
    """Blocks of their own whose facets grow to the right, upper and lower, by ``ratio``."""
    named = generate(
        TwoBlocks(Block(1.0, 0.5, (8, 2)), Block(2.0, 0.5, (9, 2)), 0.47), MPI.COMM_SELF
    )
    x = named.mesh.geometry.x
    x[:, 0] = 2.0 * (ratio ** (x[:, 0] / 2.0) - 1.0) / (ratio - 1.0)
    return Pair(named)


@pytest.mark.parametrize("kind", get_args(PressureKind))
def test_stiffness_of_a_pair_is_nowhere_less_than_that_of_the_contact(kind):
    """On a graded mesh with penalties of each facet's own: K_pair − K_c is not negative."""
    blocks = graded()
    surface = blocks.surface(3)
    averaged = kind == "averaged"
    length = surface.vertices.length if averaged else surface.slave.facet_length
    assert length.max() > 3.0 * length.min()
    term = ContactTerm(surface, FrictionlessLaw(), PENALTY / length, pressure=kind)
    # Touching everywhere: the stiffness of the penalty, without that of pressures that turn.
    x = blocks.displaced(lambda X: 0.0 * X, lambda X: 0.0 * X)
    trial = term.evaluate(x, 1.0)
    assert trial.kinematics.closed.all()
    contact = ExplicitContact(term)
    u, out = vectors(blocks)
    u.owned[:] = x.array_r
    contact.evaluate(u, 1.0)
    stiffness, w = PairStiffness(contact), NodalVector(blocks.u.function_space)
    size = len(u.owned)
    matrix, mass = np.empty((size, size)), np.zeros(size)
    for column in range(size):
        w.owned[:], out.owned[:] = np.arange(size) == column, 0.0
        stiffness.add(w, out)
        matrix[column] = out.owned
    out.owned[:] = 0.0
    contact.spread_weights(0.5, out)
    mass[:] = np.where(out.owned > 0.0, out.owned, np.inf)
    exact = dense_tangent(term, trial, blocks.u.function_space.dofmap.index_map.size_local)
    scale = np.abs(matrix).max()
    assert np.linalg.eigvalsh(matrix - exact).min() > -1e-12 * scale
    # Nor is it much more than it: of the highest frequencies on the nodes' areas.
    root = 1.0 / np.sqrt(mass)
    highest = [np.linalg.eigvalsh(root[:, None] * k * root).max() for k in (matrix, exact)]
    assert highest[0] < 1.5 * highest[1]
