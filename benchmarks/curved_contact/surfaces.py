"""Photographs of a run, and where two bodies touch, found from their deformed surfaces alone.

What the contact itself says of its extent is what is measured, so it is not asked.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize, minimize_scalar

from benchmarks.verify.result import Floats
from tribox.app.build.model import Model
from tribox.app.implicit.stepper import StepResult
from tribox.app.simulation.contact_resultants import turned_right
from tribox.app.simulation.history import Row
from tribox.app.simulation.run_state import Interval, Observer, RunState
from tribox.forms.contact.pressure import nodal_pressure
from tribox.geometry.surfaces.body_facets import facet_nodes
from tribox.geometry.surfaces.facets import Ints

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
