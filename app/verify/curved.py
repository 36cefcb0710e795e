"""Verification over curved tools: drag of a film in the plane and in space, and pressures.

Where the bodies touch is read from their deformed surfaces (:mod:`tribox.app.verify.extent`), so
that the contact's own word on it is what is verified.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tribox.app.build.model import Model
from tribox.app.implicit.stepper import StepResult
from tribox.app.simulation.contact_resultants import turned_right
from tribox.app.simulation.history import Row
from tribox.app.simulation.observer import Interval, Observer
from tribox.app.simulation.run_state import RunState
from tribox.app.verify.contact import case_modulus, fit_ellipse
from tribox.app.verify.extent import Extent, disc, extent, slip_integral
from tribox.app.verify.result import Check, Floats, Line, Panel, Verification, compare
from tribox.app.verify.shipped_case import solve
from tribox.app.verify.space import held
from tribox.forms.closed_forms.hertz_line import LineContact, relative_radius
from tribox.forms.contact.pressure import nodal_pressure
from tribox.geometry.surfaces.body_facets import facet_nodes
from tribox.geometry.surfaces.facets import Ints

RUBBER, TOOL = "aluminium_contact", "elastomer_contact"
"""Surfaces of the film's cases: the names are those of the generators, the upper body is stiff."""
STRESS, FILM, SPEED = 3200.0, 250e-9, 1e-3  # Pa, η V/D; m; m/s
STIFF = 'bodies.elastomer={material="hencky", E="70 GPa", nu=0.33}'
NEWTONIAN = (
    f"contact.0.film={{thickness={FILM}}}",
    'contact.0.friction={law="friction-map", mu_s=0.1, K_T="1e11 Pa/m", alpha=1.0, '
    f'eta_b={STRESS * FILM / SPEED}, D_max={FILM}, V_star="1 mm/s", V_star_at={FILM}}}',
    'contact.0.smoothing_angle="30 deg"',
    f'contact.0.slave="{RUBBER}"',
    f'contact.0.master="{TOOL}"',
)


def soft(nu: float) -> str:
    """The lower body's override: rubber with Poisson's ratio ``nu``."""
    return f'bodies.aluminium={{material="neo-hookean", E="10 MPa", nu={nu}}}'


def stages(press: int, slide: int, way: float) -> str:
    """Override of the stages: press in so many steps, slide ``way`` (m) in so many."""
    return (
        f'stage=[{{name="press", duration=1, steps={press}, rate_dependent=false}}, '
        f'{{name="slide", velocity={SPEED}, duration={way / SPEED}, steps={slide}}}]'
    )


# --- a film in the plane -------------------------------------------------------------------------

RADIUS = 5e-3
RATIOS = (0.495, 0.4999)
_UP = 'y=[["0 s", 0], ["1 s", "0.05 mm"]]'
PLANE = (
    'geometry.cylinder={radius="5 mm", contact_width="3 mm", contact_size="100 um"}',
    # A step is no whole number of facets.
    'geometry.block={width="10 mm", height="2 mm", contact_width="4.4 mm", contact_size="77.6 um"}',
    STIFF,
    *NEWTONIAN,
    f"boundary=[{held('top', 'displacement={x=0, y=0}')}, "
    f"{held('bottom', f'displacement={{x={chr(34)}driven{chr(34)}, {_UP}}}')}]",
    stages(5, 6, 0.6e-3),
    "solver.tolerance=1e-8",
)


@dataclass(frozen=True, slots=True)
class Drag:
    """A film over a round tool, step by step.

    Attributes:
        drag: (n,), N/m, computed.
        exact: (n,), N/m, ∫ η v/D ds over the true extent with the true speed.
        half_width: m, of the last step; facets: over it.
    """

    drag: Floats
    exact: Floats
    half_width: float

    @property
    def ripple(self) -> float:
        """Standard deviation of the drag over its mean."""
        return float(self.drag.std() / self.drag.mean())


def film_drag(nu: float, overrides: Sequence[str] = ()) -> Drag:
    """Slide a round tool of aluminium over rubber through a film that carries everything.

    Raises:
        ValueError: the surfaces do not touch, or too near an end.
    """
    observer = Photographer()
    case, _ = solve("hertz-line", [*PLANE, soft(nu), *overrides], observer)
    slid = [frame for frame in observer.frames if frame.row.stage == "slide"]
    found = [_extent(frame, observer.reference[RUBBER]) for frame in slid]
    viscous = STRESS / SPEED
    exact = [
        viscous * abs(_slip(before, now, here))
        for (before, now), here in zip(pairwise(slid), found[1:], strict=True)
    ]
    drag = np.array([abs(frame.row.tangential_force) for frame in slid[1:]])
    return Drag(drag / case.geometry.slab, np.array(exact), found[-1].half_width)


def _extent(frame: Frame, reference: Floats) -> Extent:
    return extent(frame.nodes[RUBBER], frame.nodes[TOOL], reference, RADIUS)


def _slip(before: Frame, now: Frame, found: Extent) -> float:
    new, old = ((f.nodes[RUBBER], f.nodes[TOOL]) for f in (now, before))
    return slip_integral(new, old, found, now.row.time - before.row.time)


def film_over_curve(overrides: Sequence[str] = ()) -> Verification:
    """Drag of a film over a curved tool against what it must be over the true extent."""
    found = {nu: film_drag(nu, overrides) for nu in RATIOS}
    checks, lines = [], []
    for nu, film in found.items():
        name = f"drag, ν = {nu:g}"
        checks.append(compare(name, film.drag.mean(), film.exact.mean(), 0.01, "N/m"))
        checks.append(Check(f"ripple of the drag, ν = {nu:g}, std / mean", film.ripple, 0.005))
        step = np.arange(2.0, 2.0 + len(film.drag))
        lines.append(Line(f"∫ η v/D ds, ν = {nu:g}", step, film.exact, exact=True))
        lines.append(Line(f"computed, ν = {nu:g}", step, film.drag))
    half = found[RATIOS[0]].half_width
    return Verification(
        "film-over-curve",
        "a film over a round tool",
        "A cylinder of aluminium, R = 5 mm, pressed 0.05 mm into rubber (E = 10 MPa, facets of "
        f"78 µm, {half / 77.6e-6:.0f} over the half-width of {half * 1e6:.0f} µm) and slid through "
        "a film that carries everything: ∫ η v/D ds, with v the speed of one surface along the "
        "other, over the extent that the free surfaces beside the contact tell.",
        tuple(checks),
        (Panel("step", "drag (N/m)", tuple(lines)),),
    )


# --- a film in space -----------------------------------------------------------------------------

SPHERE = 10e-3
_LIFT = 'y=[["0 s", 0], ["1 s", "30 um"]]'
SPACE = (
    'geometry.part="half"',
    'geometry.contact_width="2 mm"',
    'geometry.contact_size="200 um"',
    'geometry.block={radius="5 mm", height="5 mm"}',
    STIFF,
    soft(RATIOS[0]),
    *NEWTONIAN,
    f"boundary=[{held('top', 'displacement={x=0, y=0, z=0}')}, "
    f"{held('bottom', f'displacement={{x={chr(34)}driven{chr(34)}, {_LIFT}, z=0}}')}, "
    f"{held('elastomer_symmetry_z', 'displacement={z=0}')}, "
    f"{held('aluminium_symmetry_z', 'displacement={z=0}')}]",
    stages(2, 3, 0.09e-3),
)


def film_over_sphere(overrides: Sequence[str] = ()) -> Verification:
    """Drag of a film between a sphere and a block against η V/D times the true area."""
    observer = Photographer()
    solve("sphere-on-block", [*SPACE, *overrides], observer)
    slid = [frame for frame in observer.frames if frame.row.stage == "slide"]
    radius = np.array([disc(f.nodes[RUBBER], np.array([0.0, SPHERE, 0.0]), SPHERE) for f in slid])
    drag = np.array([2.0 * abs(f.row.friction_x) for f in slid])
    exact = STRESS * np.pi * radius**2
    checks = [
        compare(f"drag, step {i}", t * 1e3, e * 1e3, 0.03, "mN")
        for i, (t, e) in enumerate(zip(drag, exact, strict=True), start=1)
    ]
    return Verification(
        "film-over-sphere",
        "a film between a sphere and a block",
        "The geometry of cases/sphere-on-block.toml, half of it: a sphere of aluminium pressed "
        "30 µm into rubber (E = 10 MPa, ν = 0.495, facets of 200 µm, "
        f"{radius[-1] / 200e-6:.1f} over the radius of {radius[-1] * 1e6:.0f} µm) and slid through "
        "a film that carries everything: η V/D times the area of the circle that the free surface "
        "around the contact tells.",
        tuple(checks),
    )


# --- pressed -------------------------------------------------------------------------------------

SOFT = ("bodies.elastomer.nu=0.4999", "stage.0.steps=2")
ON_FLAT = (*SOFT, "geometry.contact_size=12 um", "geometry.block.contact_size=16 um")
BY_FORCE = (
    'boundary.1={surface="top", displacement={x=0}, '
    'platen={direction="y", force=[["0 s", 0], ["1 s", "0.032 N"]]}}',
)
TWO = (
    *SOFT,
    "bodies.aluminium.nu=0.4999",
    "geometry.contact_size=12 um",
    "geometry.lower.contact_size=16 um",
    'contact.0.friction={law="frictionless"}',
)
INSIDE = 0.9  # share of the half-width within which all nodes count
WAYS: dict[str, tuple[str, tuple[str, ...]]] = {
    "by displacement": ("hertz-line", ON_FLAT),
    "by force": ("hertz-line", (*ON_FLAT, *BY_FORCE)),
    "two cylinders": ("hertz-two-cylinders", TWO),
}


@dataclass(frozen=True, slots=True)
class Nodal:
    """Nodal pressures of cylinders pressed together; x (v,), m, and pressure (v,), Pa."""

    x: Floats
    pressure: Floats
    exact: LineContact

    def apart(self, share: float) -> float:
        """Largest deviation within a ``share`` of the half-width, over p0."""
        inside = np.abs(self.x) < share * self.exact.half_width
        away = np.abs(self.pressure - self.exact.pressure(self.x))[inside]
        return float(away.max() / self.exact.peak)


def press_nodes(name: str, overrides: Sequence[str] = ()) -> Nodal:
    """Nodal pressures of a case of line contact.

    Raises:
        ValueError: the contact has no nodal pressures.
    """
    observer = Photographer()
    case, _ = solve(name, overrides, observer)
    last = observer.frames[-1]
    if last.nodal is None or last.at is None:
        raise ValueError('the contact has no nodal pressures; pressure = "averaged" has')
    radii = {"hertz-line": (10e-3,), "hertz-two-cylinders": (20e-3, 20e-3)}[name]
    load = last.row.normal_resultant / case.geometry.slab
    exact = LineContact(load, relative_radius(*radii), case_modulus(case))
    order = np.argsort(last.at[:, 0])
    return Nodal(last.at[order, 0], last.nodal[order], exact)


def pressed_curve(overrides: Sequence[str] = ()) -> Verification:
    """Nodal pressures of nearly incompressible cylinders against Hertz's."""
    checks, lines = [], []
    for way, (name, options) in WAYS.items():
        found = press_nodes(name, [*options, *overrides])
        exact, closed = found.exact, found.pressure > 0.0
        a, p0 = exact.half_width, exact.peak
        width, _ = fit_ellipse(found.x[closed], found.pressure[closed])
        peak = float(found.pressure.max())
        checks += [
            compare(f"{way}: half-width a", width * 1e6, a * 1e6, 0.01, "µm"),
            compare(f"{way}: largest nodal pressure", peak * 1e-3, p0 * 1e-3, 0.015, "kPa"),
            Check(f"{way}: nodes within {INSIDE} a, max / p0", found.apart(INSIDE), 0.03),
        ]
        lines.append(Line(way, found.x[closed] / a, found.pressure[closed] / p0))
    x = np.sin(np.linspace(-0.5 * np.pi, 0.5 * np.pi, 201))
    lines.append(Line("Hertz", x, np.sqrt(np.maximum(1.0 - x**2, 0.0)), exact=True))
    return Verification(
        "pressed-curve",
        "nearly incompressible cylinders, nodal pressures",
        "cases/hertz-line.toml with ν = 0.4999 and facets of 12 µm on 16 µm, pressed by "
        "displacement and by a platen's force from the first touch, and two like cylinders "
        "(cases/hertz-two-cylinders.toml) with ν = 0.4999, where nodes do not match either.",
        tuple(checks),
        (Panel("x / a (-)", "nodal pressure / p0 (-)", tuple(lines)),),
    )


# -- Photographs of a run: after each step the places of both surfaces, and what the contact says


@dataclass(frozen=True, slots=True)
class Frame:
    """A converged step as it can be seen from outside: nobody's word on who touches whom.

    Attributes:
        row: of the history.
        nodes: (n, i), m, current places of the nodes of each surface of the first pair.
        position: (q, i), m, current, of the contact points; weight: (q,), m or m², reference.
        pressure: (q,), Pa, at the points; nodal: (v,), Pa, at slave nodes, force over area, None
            point by point; at: (v, i), m, current, those nodes.
        along: N, Σ w T·r with r the direction to the right of each point's own normal (in space:
            the length of Σ w T); load: N, Σ w p.
    """

    row: Row
    nodes: dict[str, Floats]
    position: Floats
    weight: Floats
    pressure: Floats
    nodal: Floats | None
    at: Floats | None
    along: float
    load: float


class Photographer(Observer):
    """Keeps a frame of each step of a run on one rank.

    Attributes:
        frames: of the steps so far.
        reference: (n, i), m, undeformed places of the nodes of each surface of the first pair, in
            the plane from left to right; empty before the first step.
        cuts: failed attempts.
    """

    def __init__(self) -> None:
        self.frames: list[Frame] = []
        self.reference: dict[str, Floats] = {}
        self.cuts = 0
        self._nodes: dict[str, Ints] = {}

    def step(self, state: RunState, row: Row, result: StepResult | Interval) -> None:
        """Keep what can be seen of the step."""
        if not self.reference:
            self._nodes, self.reference = surfaces_of(state.model)
        self.frames.append(self._frame(state, row))

    def cut(self, state: RunState, dt: float, result: StepResult) -> None:
        """Count it."""
        self.cuts += 1

    def _frame(self, state: RunState, row: Row) -> Frame:
        problem, thickness = state.model.problem, state.model.thickness
        dim = problem.dim
        moved = state.stepper.x.array_r.reshape(-1, dim)
        surface, trial = problem.contacts[0].surface, problem.committed[0]
        weight = surface.slave.weight * thickness
        friction, normal = trial.response.traction, trial.kinematics.normal
        if dim == 2:
            along = float(weight @ np.einsum("qi,qi->q", friction, turned_right(normal)))
        else:
            along = float(np.linalg.norm(weight @ friction))
        nodal, at = None, None
        if trial.nodal_pressure is not None:
            nodal = nodal_pressure(surface, trial.pressure)
            vertices = surface.vertices.nodes
            at = problem.space.tabulate_dof_coordinates()[vertices, :dim] + moved[vertices]
        return Frame(
            row=row,
            nodes={name: self.reference[name] + moved[of] for name, of in self._nodes.items()},
            position=trial.position.copy(),
            weight=weight,
            pressure=trial.pressure.copy(),
            nodal=nodal,
            at=at,
            along=along,
            load=float(weight @ trial.pressure),
        )


def surfaces_of(model: Model) -> tuple[dict[str, Ints], dict[str, Floats]]:
    """Nodes of both surfaces of the first pair, in the plane from left to right; their places."""
    space, dim = model.problem.space, model.problem.dim
    places = space.tabulate_dof_coordinates()[:, :dim]
    table = model.case.contact[0]
    nodes = {}
    for name in (table.slave, table.master):
        found = np.unique(facet_nodes(space, model.named.facets(name)))
        nodes[name] = found[np.argsort(places[found, 0], kind="stable")]
    return nodes, {name: places[found] for name, found in nodes.items()}
