"""Verification over curved tools: drag of a film in the plane and in space, and pressures.

Where the bodies touch is read from their deformed surfaces (:func:`extent`), so that the contact's
own word on it is what is verified.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize, minimize_scalar

from tribox.app.build.model import Model
from tribox.app.implicit.stepper import StepResult
from tribox.app.simulation.contact_resultants import turned_right
from tribox.app.simulation.history import Row
from tribox.app.simulation.run_state import Interval, Observer, RunState
from tribox.app.verify.contact import case_modulus, fit_ellipse
from tribox.app.verify.result import Check, Floats, Line, Panel, Verification, compare, solve
from tribox.app.verify.space import held
from tribox.forms.closed_forms.hertz import LineContact, relative_radius
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
    """A film over a round tool, step by step."""

    drag: Floats  # (n,), N/m, computed
    exact: Floats  # (n,), N/m, ∫ η v/D ds over the true extent with the true speed
    half_width: float  # m, of the last step; facets: over it

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
    places = [(frame.nodes[RUBBER], frame.nodes[TOOL]) for frame in slid]
    found = [extent(*both, observer.reference[RUBBER], RADIUS) for both in places]
    times = np.diff([frame.row.time for frame in slid])
    exact = [
        STRESS / SPEED * abs(slip_integral(now, before, here, dt))
        for (before, now), here, dt in zip(pairwise(places), found[1:], times, strict=True)
    ]
    drag = np.array([abs(frame.row.tangential_force) for frame in slid[1:]])
    return Drag(drag / case.geometry.slab, np.array(exact), found[-1].half_width)


def film_over_curve() -> Verification:
    """Drag of a film over a curved tool against what it must be over the true extent."""
    found = {nu: film_drag(nu) for nu in RATIOS}
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


def film_over_sphere() -> Verification:
    """Drag of a film between a sphere and a block against η V/D times the true area."""
    observer = Photographer()
    solve("sphere-on-block", [*SPACE], observer)
    slid = [frame for frame in observer.frames if frame.row.stage == "slide"]
    radius = np.array([disc(f.nodes[RUBBER], np.array([0.0, SPHERE, 0.0]), SPHERE) for f in slid])
    drag = np.array([2.0 * abs(f.row.friction_x) for f in slid])
    exact = STRESS * np.pi * radius**2
    checks = [
        compare(f"drag, step {i}", t, e, 0.03, "mN")
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


def pressed_curve() -> Verification:
    """Nodal pressures of nearly incompressible cylinders against Hertz's."""
    checks, lines = [], []
    for way, (name, options) in WAYS.items():
        found = press_nodes(name, [*options])
        exact, closed = found.exact, found.pressure > 0.0
        a, p0 = exact.half_width, exact.peak
        width, _ = fit_ellipse(found.x[closed], found.pressure[closed])
        peak = float(found.pressure.max())
        checks += [
            compare(f"{way}: half-width a", width, a, 0.01, "µm"),
            compare(f"{way}: largest nodal pressure", peak, p0, 0.015, "kPa"),
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
    """A converged step as it can be seen from outside: nobody's word on who touches whom."""

    row: Row  # of the history
    # (n, i), m, current places of the nodes of each surface of the first pair
    nodes: dict[str, Floats]
    position: Floats  # (q, i), m, current, of the contact points
    weight: Floats  # (q,), m or m², reference
    pressure: Floats  # (q,), Pa, at the points
    nodal: Floats | None  # (v,), Pa, at slave nodes, force over area, None point by point
    at: Floats | None  # (v, i), m, current, those nodes
    # N, Σ w T·r with r the direction to the right of each point's own normal (in space: the length
    # of Σ w T)
    along: float
    load: float  # N, Σ w p


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
        nodes = {name: self.reference[name] + moved[of] for name, of in self._nodes.items()}
        place, pressure = trial.position.copy(), trial.pressure.copy()
        load = float(weight @ trial.pressure)
        self.frames.append(Frame(row, nodes, place, weight, pressure, nodal, at, along, load))

    def cut(self, state: RunState, dt: float, result: StepResult) -> None:
        """Count it."""
        self.cuts += 1


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


# -- Where two bodies touch, found from their deformed surfaces alone ------------------------------
#
# Between the ends of a contact the gap is zero (less a penetration, or, of facets that stand on a
# few points, the chords' height), and a threshold on it finds the ends to a facet at best; beyond
# an end it grows as the distance to the power 3/2, so slowly that a threshold of 1 % of the
# indentation places it 3 % too far out. So the free surface outside is used instead: beyond a line
# contact the gap is Hertz's (Johnson 1985, eq. 4.43 integrated),
#
# .. math:: g = \frac{a^2}{2R} \left[\rho\sqrt{\rho^2-1} - \operatorname{arcosh}\rho\right],
#    \qquad \rho = 1 + (x - x_e)/a,
#
# and beyond the ends of any smooth contact of other bodies too it begins like this. The gap of the
# nodes from about 0.15 to 1.2 half-widths beyond an end is fitted by this function times (c + c'
# (rho-1)), which leaves the place x_e of the end, the amplitude and a slow change of it free. Which
# nodes these are follows from their gap, so that no node inside the contact is among them. They are
# free and bear no contact, so their places are those of the discretised body under the load as a
# whole: the fit neither asks the contact which points are closed nor is sensitive to what happens
# in a facet at the end. The tool's surface is the cubic spline through its nodes.

LEAST, MOST = 0.12, 2.9
"""Gaps between which nodes are fitted, relative to a²/2R: 0.16 to 1.2 a beyond the end."""
ROUGH = 0.05  # gap, relative to a²/2R, up to which a node counts as touching in the first guess


@dataclass(frozen=True, slots=True)
class Extent:
    """A contact in the plane."""

    left: float  # m, x of its left end
    right: float  # m, x of its right end
    length: float  # m, of the rubber's surface between them, current
    reference: float  # m, the same, undeformed

    @property
    def half_width(self) -> float:
        """m, half the distance of the ends in x."""
        return 0.5 * (self.right - self.left)


def beyond_line(rho: Floats) -> Floats:
    """Hertz's gap (n,) beyond a line contact over a²/2R, at x/a = rho (n,) >= 1."""
    return rho * np.sqrt(rho**2 - 1.0) - np.arccosh(rho)


def beyond_point(rho: Floats) -> Floats:
    """Hertz's gap (n,) beyond a point contact times πR/a², at r/a = rho (n,) >= 1."""
    return np.sqrt(rho**2 - 1.0) + (rho**2 - 2.0) * np.arccos(1.0 / rho)


def extent(rubber: Floats, tool: Floats, undeformed: Floats, radius: float) -> Extent:
    """The contact of two surfaces that run from left to right.

    Args:
        rubber: (n, 2), m, current nodes of the surface whose length counts.
        tool: (m, 2), m, current nodes of the other.
        undeformed: (n, 2), m, the first surface's nodes before.
        radius: m, relative radius of the undeformed surfaces.

    Raises:
        ValueError: the surfaces do not touch, or touch up to their ends.
    """
    inside = (rubber[:, 0] > tool[0, 0]) & (rubber[:, 0] < tool[-1, 0])
    x = rubber[inside, 0]
    gap = np.abs(CubicSpline(*tool.T)(x) - rubber[inside, 1])
    left, right = _rough(x, gap, radius)
    for _ in range(4):
        a, middle = 0.5 * (right - left), 0.5 * (right + left)
        unit = 0.5 * a**2 / radius
        used = (gap > LEAST * unit) & (gap < MOST * unit)
        west, east = used & (x < middle), used & (x > middle)
        left = -_end(-x[west], gap[west], a, beyond_line)
        right = _end(x[east], gap[east], a, beyond_line)
    # Length of the surface between two x, now and before.
    at = np.linspace(left, right, 801)
    steps = np.linalg.norm(np.diff(undeformed, axis=0), axis=1)
    s = np.concatenate([[0.0], np.cumsum(steps)])
    here = CubicSpline(rubber[:, 0], rubber[:, 1])(at)
    length = float(np.hypot(np.diff(at), np.diff(here)).sum())
    before = CubicSpline(rubber[:, 0], s)(np.array([left, right]))
    return Extent(left, right, length, float(before[1] - before[0]))


def half_width(
    rubber: Floats, tool: Floats, radius: float, shape: Callable[[Floats], Floats]
) -> float:
    """Half-width, m, of a contact that is symmetric about x = 0, from its right end.

    Args:
        rubber: (n, 2), m, current nodes of one surface, from left to right.
        tool: (m, 2), m, of the other.
        radius: m, relative radius of the undeformed surfaces.
        shape: :func:`beyond_line` or :func:`beyond_point`.

    Raises:
        ValueError: the surfaces do not touch, or one ends too near the contact.
    """
    inside = (rubber[:, 0] >= 0.0) & (rubber[:, 0] < tool[-1, 0])
    x = rubber[inside, 0]
    gap = np.abs(CubicSpline(*tool.T)(x) - rubber[inside, 1])
    unit = gap.max()
    a = float(x[gap < ROUGH * unit].max(initial=0.0))
    for _ in range(6):
        unit = 0.5 * a**2 / radius
        used = (gap > LEAST * unit) & (gap < MOST * unit) & (x > 0.5 * a)
        a = _end(x[used], gap[used], a, shape)
    return a


def disc(rubber: Floats, centre: Floats, radius: float) -> float:
    """Radius, m, of a sphere's circle of contact with a surface below it that was flat.

    All nodes around are fitted at once, with the place of the circle along x free.

    Args:
        rubber: (n, 3), m, current nodes of the surface; y points towards the sphere.
        centre: (3,), m, of the sphere.
        radius: m, of the sphere.

    Raises:
        ValueError: they do not touch, or too few nodes lie beside the contact.
    """
    at = rubber[:, ::2] - centre[::2]
    at, height = at[near := np.hypot(*at.T) < 0.5 * radius], rubber[near, 1]
    gap = centre[1] - np.sqrt(radius**2 - np.sum(at**2, axis=1)) - height
    touching = gap < 0.01 * gap.max()
    if touching.sum() < 3:
        raise ValueError("the surfaces do not touch")
    a, shift = float(np.hypot(*at[touching].T).max()), 0.0
    for _ in range(6):
        unit = 0.5 * a**2 / radius
        # Facets in the middle of the contact stand off by the height of their chords, too.
        used = (gap > LEAST * unit) & (gap < MOST * unit) & (np.hypot(*at.T) > 0.5 * a)
        if used.sum() < 8:
            raise ValueError("too few nodes lie beside the contact for its end to be found")
        a, shift = _circle(at[used], gap[used], a, shift)
    return a


def _circle(at: Floats, gap: Floats, a: float, shift: float) -> tuple[float, float]:
    """Radius and place in x, m, of the circle that free nodes at (n, 2) are beyond."""

    def misfit(of: Floats) -> float:
        rho = np.hypot(at[:, 0] / a - of[1], at[:, 1] / a) / of[0]
        f = beyond_point(np.maximum(rho, 1.0))
        weight = 1.0 / np.sqrt(f + LEAST)  # what lies inside counts little
        basis = np.stack([f, f * (rho - 1.0)], axis=1) * weight[:, None]
        c, *_ = np.linalg.lstsq(basis, gap * weight, rcond=None)
        return float(np.sum((basis @ c - gap * weight) ** 2)) / float(gap.max()) ** 2

    first = np.array([1.0, shift / a])
    found = minimize(misfit, first, method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-14})
    return float(found.x[0]) * a, float(found.x[1]) * a


def _rough(x: Floats, gap: Floats, radius: float) -> tuple[float, float]:
    """Ends of the nodes whose gap is small against a²/2R, m."""
    near = gap < ROUGH * gap.max()
    for _ in range(3):
        if near.sum() < 2:
            raise ValueError("the surfaces do not touch")
        a = 0.5 * float(np.ptp(x[near]))
        near = gap < ROUGH * 0.5 * a**2 / radius
    if near.sum() < 2:
        raise ValueError("the surfaces do not touch")
    return float(x[near][0]), float(x[near][-1])


def _end(x: Floats, gap: Floats, a: float, shape: Callable[[Floats], Floats]) -> float:
    """The end x_e, m, left of free nodes at x (n,), of a contact of half-width ``a`` (m)."""
    if len(x) < 4:
        raise ValueError("too few nodes lie beside the contact for its end to be found")

    def misfit(end: float) -> float:
        rho = 1.0 + (x - end) / a
        f = shape(rho)
        # Errors count in proportion to the root of the gap, which spans a factor of 24.
        basis = np.stack([f, f * (rho - 1.0)], axis=1) / np.sqrt(f)[:, None]
        wanted = gap / np.sqrt(f)
        c, *_ = np.linalg.lstsq(basis, wanted, rcond=None)
        return float(np.sum((basis @ c - wanted) ** 2)) / float(gap.max())

    first = float(x.min())
    bounds = (first - 0.6 * a, first - 1e-3 * a)
    found = minimize_scalar(misfit, bounds=bounds, options={"xatol": 1e-7 * a})
    return float(found.x)


def slip_integral(
    now: tuple[Floats, Floats], before: tuple[Floats, Floats], found: Extent, dt: float
) -> float:
    """∫ v ds over the contact, m²/s: v how fast the tool passes the rubber, along the surface.

    Args:
        now: current nodes of the rubber (n, 2) and of the tool (m, 2), m.
        before: those of the last step.
        found: the contact now.
        dt: s, between both.
    """
    rubber = now[0]
    at = np.linspace(found.left, found.right, 801)
    here = CubicSpline(rubber[:, 0], rubber[:, 1])
    slope = here(at, 1)
    # Both sides at the same x, between their nodes: those of the rubber face none of the tool.
    moved = [
        np.stack([np.interp(at, new[:, 0], (new - old)[:, i]) for i in (0, 1)], axis=1)
        for new, old in zip(now, before, strict=True)
    ]
    tangent = np.stack([np.ones_like(at), slope], axis=1) / np.sqrt(1.0 + slope**2)[:, None]
    speed = np.einsum("ni,ni->n", moved[1] - moved[0], tangent) / dt
    ds = np.sqrt(1.0 + slope**2)
    return float(np.trapezoid(speed * ds, at))
