"""The whole tangent against finite differences in every regime, term by term."""

from dataclasses import dataclass, replace

import dolfinx
import numpy as np
import pytest
from petsc4py import PETSc

from tests.grid import grid
from tests.laws import FILM, coulomb, film_map
from tribox.app.equilibrium.constraints import Platen, Prescribed
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.step_mode import DEFAULT_STEP, StepMode
from tribox.forms.bodies.loads import FollowerPressure
from tribox.forms.bodies.materials import NeoHookean
from tribox.forms.bodies.solid import Solid
from tribox.forms.contact.state import ContactMode
from tribox.forms.friction.coulomb import FrictionlessLaw
from tribox.forms.friction.film import FilmTable
from tribox.forms.friction.law import Regime
from tribox.forms.friction.stribeck import StribeckLaw, StribeckParameters


@dataclass(frozen=True)
class Setting:
    """A law, and how far the slave has been moved: sideways and down, before and now."""

    law: object
    film: object = 0.0
    before: tuple[float, float] = (0.01, -0.06)
    now: tuple[float, float] = (0.04, -0.08)
    degree: int = 5
    bend: float = 0.08
    rate_dependent: bool = True
    pressure: str = "averaged"

    @property
    def step(self):
        """A step of one second."""
        return StepMode(1.0, (ContactMode(rate_dependent=self.rate_dependent),))


STRIBECK = StribeckLaw(
    StribeckParameters(mu_s=0.3, mu_d=0.2, V_s=0.1, delta=1.5, viscous=2.0, K_T=60.0)
)
SLIDE = (0.16, -0.08)
THIN = film_map(tau_0=0.5, zeta=0.1, critical_rate=0.2, thinning_exponent=0.5, barus=0.1)
BY_REGIME = {
    Regime.STICK: {
        "stick": Setting(coulomb(50.0)),
        "stick of the map": Setting(film_map(mu_s=50.0, mu_d=40.0), FILM),
        "onset": Setting(coulomb(0.9)),
        "closing": Setting(coulomb(50.0), before=(0.0, 0.02), now=(0.06, -0.05)),
    },
    Regime.SLIP: {
        "slip": Setting(coulomb(0.2), now=SLIDE),
        "no friction": Setting(FrictionlessLaw(), now=SLIDE),
        "dry slip of the map": Setting(film_map(), 0.0, now=SLIDE),
        "stribeck": Setting(STRIBECK, now=SLIDE),
        "onset, sliding part": Setting(coulomb(0.9)),
        "groove": Setting(coulomb(0.2), now=SLIDE, degree=20, bend=0.3, before=(0.0, -0.1)),
        "partly open": Setting(coulomb(0.3), now=(0.12, -0.003), degree=9),
    },
    Regime.MIXED: {
        "mixed": Setting(film_map(), FILM, now=SLIDE),
        "mixed, literal flow rule": Setting(film_map(flow_rule="literal"), FILM, now=SLIDE),
        "in the transition": Setting(film_map(V_star=0.11, transition_width=0.6), FILM, now=SLIDE),
        "whole film at once": Setting(film_map(film_onset_pressure=0.0), FILM, now=SLIDE),
        "over pressure": Setting(film_map(), FilmTable(((0.0, 0.8), (20.0, 0.3))), now=SLIDE),
        "film with a rheology": Setting(THIN, FILM, now=SLIDE),
        "rates off": Setting(film_map(), FILM, rate_dependent=False),
    },
    Regime.VISCOUS: {
        "viscous by speed": Setting(film_map(V_star=1e-3), FILM, now=SLIDE),
        "viscous by thickness": Setting(film_map(), 1.5, now=SLIDE),
    },
    Regime.OPEN: {
        "open part": Setting(film_map(), FILM, now=(0.12, -0.003), degree=9),
        "open": Setting(coulomb(0.2), now=(0.0, 0.3)),
    },
}
SETTINGS = {name: (one, kind) for kind, of in BY_REGIME.items() for name, one in of.items()}
for name in ("stick", "slip", "mixed", "groove", "closing", "partly open", "open part"):
    setting, kind = SETTINGS[name]
    SETTINGS[f"{name}, pointwise"] = replace(setting, pressure="pointwise"), kind


def wave(bend, phase, turn):
    """A smooth motion of both bodies that bends the surface between them and turns it."""

    def motion(X):
        x, y = X[:, 0], X[:, 1]
        up = bend * np.sin(2.6 * x + phase) * (1.0 - 0.4 * y)
        along = 0.3 * bend * np.cos(2.1 * x - phase) + 0.2 * bend * y
        turned = (X - [1.0, 0.0]) @ turn.T + [1.0, 0.0] - X
        return np.stack([along, up], axis=1) @ (np.eye(2) + turn).T + turned

    return motion


def rotation(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def ripple(seed):
    """A small smooth motion of random phases, another one for each body."""
    phases = np.random.default_rng(seed).uniform(0.0, 6.0, (2, 2, 2))

    def motion(body):
        return lambda X: (
            0.004 * np.sin(np.einsum("nj,ij->ni", X, 2.0 + phases[body]) + phases[body, :, 0])
        )

    return motion


def state(pair, setting, shift, phase, angle, seed):
    """Unknowns of both bodies bent together, the upper one shifted in the turned frame."""
    common, small = wave(setting.bend, phase, rotation(angle)), ripple(seed)
    # The shift is along the turned surface, then the common wave acts at the shifted place.
    there = np.array(shift)
    return pair.displaced(
        lambda X: common(X + there) + there + small(0)(X), lambda X: common(X) + small(1)(X)
    )


def prepared(pair, setting, **parts):
    """The problem with a history of one step, the current unknowns, and its matrix."""
    parts |= {"film": setting.film, "degree": setting.degree, "pressure": setting.pressure}
    problem = pair().problem(setting.law, **parts)
    (term,) = problem.contacts
    before = state(pair(), setting, setting.before, 0.4, 0.1, 1)
    term.commit(term.evaluate(before, 1.0, *setting.step.modes))
    x = state(pair(), setting, setting.now, 0.9, 0.35, 2)
    return problem, x, problem.new_matrix(x)


def unbalanced(problem, x, step=DEFAULT_STEP):
    problem.residual(None, x, problem.new_vector(), step)
    return problem.unbalanced.copy()


def contact_dofs(problem):
    surface = problem.contacts[0].surface
    nodes = np.concatenate([surface.slave.nodes.reshape(-1), surface.master.nodes])
    return np.unique(nodes[:, None] * 2 + np.arange(2))


@dataclass
class Slopes:
    """Directional derivatives of the residual, by differences: (m, n) for m directions."""

    directions: np.ndarray
    values: np.ndarray
    near: np.ndarray

    def error(self, problem, x, A, step=DEFAULT_STEP):
        """Largest error of the tangent at ``x``, relative, of all unknowns or near the contact."""
        for term in problem.contacts:
            term._last = None
        problem.assemble_tangent(x, A, step)
        d, image = x.duplicate(), x.duplicate()
        worst = 0.0
        for direction, exact in zip(self.directions, self.values, strict=True):
            d.array[:] = direction
            A.mult(d, image)
            apart = np.abs(image.array_r - exact)
            worst = max(
                worst,
                apart.max() / np.abs(exact).max(),
                apart[self.near].max() / np.abs(exact[self.near]).max(),
            )
        return worst


def differences(problem, x, step=DEFAULT_STEP, count=4, h=1e-6):
    """Central differences of the out-of-balance forces in random directions."""
    directions = np.random.default_rng(7).normal(size=(count, x.getSize()))
    values = np.empty_like(directions)
    moved = x.duplicate()
    for direction, value in zip(directions, values, strict=True):
        sides = []
        for sign in (1.0, -1.0):
            moved.array[:] = x.array_r + sign * h * direction
            sides.append(unbalanced(problem, moved, step))
        value[:] = (sides[0] - sides[1]) / (2.0 * h)
    return Slopes(directions, values, contact_dofs(problem))


@pytest.mark.parametrize("name", SETTINGS)
def test_whole_tangent_against_finite_differences(pair, name):
    setting, regime = SETTINGS[name]
    problem, x, A = prepared(pair, setting)
    error = differences(problem, x, setting.step).error(problem, x, A, setting.step)
    (trial,) = problem.trials
    regimes = trial.response.regime
    assert np.count_nonzero(regimes == regime) >= 5, np.bincount(regimes)
    if regime != Regime.OPEN:
        # A history that matters, on a master that is kinked, under load.
        history = not isinstance(setting.law, FrictionlessLaw) and setting.before[1] < 0.0
        alive = np.linalg.norm(trial.kinematics.elastic_slip, axis=1) > 1e-3
        assert history == bool(alive[regimes == regime].any())
        assert trial.pressure.max() > 0.1
        assert (
            np.ptp(np.arctan2(trial.kinematics.normal[:, 0], trial.kinematics.normal[:, 1])) > 0.1
        )
    assert error < 1e-6


def test_settings_hold_what_they_are_named_after(pair):
    found = {}
    for name in ("groove", "closing", "partly open", "partly open, pointwise"):
        problem, x, _ = prepared(pair, SETTINGS[name][0])
        unbalanced(problem, x)
        found[name] = problem.trials[0], problem.contacts[0].state
    trial, _ = found["groove"]
    assert np.count_nonzero(trial.projection.clamped & trial.kinematics.closed) >= 5
    trial, state = found["closing"]
    assert np.count_nonzero((state.gap > 0.0) & trial.kinematics.closed) >= 5
    for name in ("partly open", "partly open, pointwise"):
        trial, _ = found[name]
        assert 5 <= np.count_nonzero(trial.kinematics.closed) <= len(trial.pressure) - 5
    trial, _ = found["partly open"]
    # Points with a gap under a pressure that their neighbours make.
    assert np.count_nonzero(trial.pressure[trial.projection.gap > 0.0]) >= 2


def test_tangent_with_held_edges_platen_and_pressure(pair):
    """The matrix that Newton solves with, in directions that keep what is prescribed."""
    blocks = pair()
    x0 = state(blocks, SETTINGS["slip"][0], SLIDE, 0.9, 0.35, 2)
    side = FollowerPressure(blocks.u, blocks.named.facets("elastomer_left"))
    side.set(0.7)
    top = Platen(blocks.held("top", 1).dofs, force=-0.4)
    held = [blocks.held("bottom", 0), blocks.held("bottom", 1), blocks.held("top", 0)]
    problem, x, A = prepared(
        pair, SETTINGS["slip"][0], prescribed=held, platens=[top], loads=[side]
    )
    np.testing.assert_array_equal(x.array_r, x0.array_r)
    f, d, image = x.duplicate(), x.duplicate(), x.duplicate()
    problem.jacobian(None, x, A, A)
    rng = np.random.default_rng(3)
    h = 1e-6
    for _ in range(3):
        direction = rng.normal(size=x.getSize())
        direction[problem.constrained_dofs()] = 0.0
        direction[top.dofs] = direction[top.all_dofs[0]]
        sides = []
        for sign in (1.0, -1.0):
            d.array[:] = x.array_r + sign * h * direction
            problem.residual(None, d, f)
            sides.append(f.array_r.copy())
        exact = (sides[0] - sides[1]) / (2.0 * h)
        d.array[:] = direction
        A.mult(d, image)
        assert np.abs(image.array_r - exact).max() < 1e-6 * np.abs(exact).max()
        # The follower's stiffness is in there, and large enough to be missed.
        side.set(0.0)
        problem.jacobian(None, x, A, A)
        A.mult(d, image)
        assert np.abs(image.array_r - exact).max() > 1e-4 * np.abs(exact).max()
        side.set(0.7)
        problem.jacobian(None, x, A, A)


def test_evaluations_leave_no_trace(pair):
    """History is a value of the converged step: residual and tangent may be asked for at will."""
    problem, x, A = prepared(pair, SETTINGS["mixed"][0])
    (term,) = problem.contacts
    kept = term.state
    first = unbalanced(problem, x)
    away = x.copy()
    away.array[:] += 0.01 * np.random.default_rng(0).normal(size=away.getSize())
    unbalanced(problem, away)
    problem.assemble_tangent(away, A)
    assert term.state is kept
    np.testing.assert_array_equal(unbalanced(problem, x), first)


def test_contact_forces_balance(pair):
    """The residual of bodies that nothing holds has no resultant: action equals reaction."""
    problem, x, _ = prepared(pair, SETTINGS["mixed"][0])
    forces = unbalanced(problem, x).reshape(-1, 2)
    slave = forces[np.unique(problem.contacts[0].surface.slave.nodes)].sum(axis=0)
    assert np.abs(slave).max() > 0.1
    np.testing.assert_allclose(forces.sum(axis=0), 0.0, atol=1e-13)


# -- What rounding leaves of the residual, against Newton's method carried on without end ----------

SECTIONS = {
    "plane-strain": ("quadrilateral", (6, 6)),
    "axisymmetric": ("quadrilateral", (6, 6)),
    "3D": ("hexahedron", (3, 3, 3)),
}


def body(
    section: str, inner: float = 0.0, width: float = 1.0
) -> tuple[dolfinx.fem.Function, Solid]:
    """A square or cube; ``inner``: the radius of its left side, where that is no axis.

    Its sides are 1 long; ``width``: of those along x.
    """
    kind, counts = SECTIONS[section]
    mesh = grid(kind, counts, [1.0] * len(counts))
    mesh.geometry.x[:, 0] = width * mesh.geometry.x[:, 0] + inner
    dim = len(counts)
    u = dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (dim,))))
    cells = np.arange(mesh.topology.index_map(dim).size_local, dtype=np.int32)
    return u, Solid("body", u, cells, NeoHookean(1.0, 5.0), "q1", section=section)


def squeezed(section: str, moved: float, width: float = 1.0) -> Equilibrium:
    """The body with its ends held; all of it moved up, and squeezed by 5 %."""
    u, solid = body(section, width=width)
    mesh, dim = u.function_space.mesh, u.function_space.dofmap.index_map_bs
    held = []
    for end in (0.0, 1.0):
        facets = dolfinx.mesh.locate_entities_boundary(
            mesh, dim - 1, lambda x, end=end: np.abs(x[1] - end) < 1e-9
        )
        held += Prescribed.components(u, facets)
        held[-dim + 1].value = moved - 0.05 * end
    if section == "axisymmetric":
        axis = dolfinx.mesh.locate_entities_boundary(mesh, 1, lambda x: x[0] < 1e-9)
        held.append(Prescribed.on(u, axis, 0))
    return Equilibrium(u, [solid], [], held)


def endless(problem: Equilibrium, x: PETSc.Vec, iterations: int) -> list[float]:
    """Residual norms over the floor, of Newton's iterations from ``x``, which goes along."""
    f, step = problem.new_vector(), problem.new_vector()
    A = problem.new_matrix(x)
    ksp = PETSc.KSP().create(problem.comm)
    ksp.setType("preonly")
    ksp.getPC().setType("lu")
    norms = []
    for _ in range(iterations):
        problem.residual(None, x, f)
        norms.append(f.norm() / problem.roundoff)
        problem.jacobian(None, x, A, A)
        ksp.setOperators(A)
        ksp.solve(f, step)
        x.axpy(-1.0, step)
    return norms


@pytest.mark.parametrize("moved", [0.0, 100.0])
@pytest.mark.parametrize("section", SECTIONS)
def test_roundoff_is_what_newton_ends_at(section, moved):
    """Neither less, or no iteration would end, nor ten times more."""
    problem = squeezed(section, moved)
    x = problem.new_vector()
    height = problem.space.tabulate_dof_coordinates()[:, 1]
    x.array.reshape(-1, problem.dim)[:, 1] = moved - 0.05 * height
    norms = endless(problem, x, 10)
    assert norms[0] > 1e3
    assert 0.1 < np.median(norms[5:]) and max(norms[5:]) < 1.0, norms


@pytest.mark.parametrize("section", SECTIONS)
def test_long_cells_round_more_than_their_volume_says(section):
    """Beside a fine contact cells are long: a floor by their volume was never reached."""
    problem = squeezed(section, 0.0, width=1.0 / 30.0)
    x = problem.new_vector()
    x.array.reshape(-1, problem.dim)[:, 1] = -0.05 * problem.space.tabulate_dof_coordinates()[:, 1]
    norms = endless(problem, x, 10)
    assert norms[0] > 1e3
    assert 0.05 < np.median(norms[5:]) and max(norms[5:]) < 1.0, norms


@pytest.mark.parametrize("section", ["plane-strain", "3D"])
def test_a_body_that_is_let_go_far_away_is_solved(section):
    """Turned too: no force is left, and rounding of the way is more than that of a body at rest."""
    problem = squeezed(section, 0.0)
    x, f = problem.new_vector(), problem.new_vector()
    place, way = problem.space.tabulate_dof_coordinates(), x.array.reshape(-1, problem.dim)
    way[:, 0] = (np.cos(1.0) - 1.0) * place[:, 0] - np.sin(1.0) * place[:, 1]
    way[:, 1] = np.sin(1.0) * place[:, 0] + (np.cos(1.0) - 1.0) * place[:, 1] + 100.0
    for one in problem.constraints.prescribed:
        one.acts = False
    problem.rounding.let_go = set(problem.rounding.names)
    problem.residual(None, x, f)
    assert problem.roundoff < f.norm() < problem.roundoff_beside(1.0) < 1e-6


def test_roundoff_is_that_of_the_deformed_body():
    """A tube widened 8 times is a sixth as thick, where the same errors are larger forces."""
    u, solid = body("axisymmetric", inner=2.5)
    mesh = u.function_space.mesh
    sides = [
        dolfinx.mesh.locate_entities_boundary(mesh, 1, lambda x, i=i, at=at: np.isclose(x[i], at))
        for i, at in ((0, 2.5), (1, 0.0), (1, 1.0))
    ]
    held = [Prescribed.on(u, side, i) for side, i in zip(sides, (0, 1, 1), strict=True)]
    problem = Equilibrium(u, [solid], [], held)
    held[0].value = 17.5
    x, radius = problem.new_vector(), problem.space.tabulate_dof_coordinates()[:, 0]
    x.array[::2] = np.sqrt(radius**2 + 20.0**2 - 2.5**2) - radius  # at a volume that stays
    norms = endless(problem, x, 20)
    assert norms[0] > 1e3
    assert 0.1 < np.median(norms[10:]) and max(norms[10:]) < 1.0, norms


@pytest.mark.parametrize(
    ("way", "reached"), [(0.0, True), (10.0, True), (1e9, False), (np.inf, False), (np.nan, False)]
)
def test_places_where_only_rounding_is_left_are_out_of_reach(way, reached):
    """Divergent iterations had come to rest 5e9 m away, where rounding hid all forces."""
    problem = squeezed("plane-strain", 0.0)
    x = problem.new_vector()
    x.array[1] = way
    assert problem.rounding.is_within_reach(x) is reached
