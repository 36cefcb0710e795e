"""Verification of contact: Hertz's pressure, partial slip of Cattaneo and Mindlin."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmarks.verify.hertz import LineContact, contact_modulus, relative_radius
from benchmarks.verify.result import Check, Floats, Line, Panel, Verification, compare, solve
from tribox.app.build.model import Model
from tribox.app.case.case import Case
from tribox.app.case.friction import LawTable
from tribox.app.case.generators import CylinderOnBlockGeometry, TwoCylindersGeometry
from tribox.app.case.time_tables import value_at
from tribox.app.friction_map.material_tests import Curve, compute_map
from tribox.app.friction_map.setup import map_setup
from tribox.app.results.contact_points import contact_arrays
from tribox.app.results.point_probes import PointProbes
from tribox.app.simulation.history import Row
from tribox.forms.bodies.materials import young_and_poisson
from tribox.forms.closed_forms import effective_viscosity
from tribox.forms.friction.law import Regime

Reals = NDArray[np.floating[Any]]

BAR = 0.02
FITTED = 0.8  # share of the extent of contact (or stick) over which an ellipse is fitted
EDGE = 0.1  # half-width of the strips around the ends of contact and stick, in half-widths a


@dataclass(frozen=True, slots=True)
class Profile:
    """The closed contact points of a finished run, ordered from left to right."""

    x: Floats  # (q,), m, current, from the centre of pressure
    pressure: Floats  # (q,), Pa
    traction: Floats  # the traction drags the lower body to the right if positive
    sticks: NDArray[np.bool_]  # (q,) whether a point sticks
    exact: LineContact  # Hertz's contact under the computed normal force
    share: float  # Q/(mu P) as computed; 0 without friction
    peak: float  # largest share on the way; more than ``share`` where the load has gone back
    mu: float  # coefficient of friction
    penetration: float  # m, largest
    size: float  # m, mean length of a slave facet in contact
    depth: float  # m, of the shallower body
    # (3, p) depth under the middle, m, and the stresses along and across the surface there, Pa, by
    # the case's first line probe; None without one
    below: Floats | None = None

    @property
    def middle(self) -> NDArray[np.bool_]:
        """(q,) the points away from the ends of contact and stick, where slopes are infinite."""
        a, back = self.exact.half_width, 0.5 * (self.peak - self.share)
        ends = [a, *(self.exact.stick_half_width(share) for share in (self.peak, back))]
        distance = np.abs(np.abs(self.x)[:, None] - np.array(ends)).min(axis=1)
        return (distance > EDGE * a) & (np.abs(self.x) < a)

    @property
    def reversed(self) -> bool:
        """Whether the tangential load has gone back from its peak."""
        return self.share < self.peak

    def exact_traction(self, x: ArrayLike) -> Floats:
        """Pa, by the closed form at x (m, from the middle)."""
        if self.reversed:
            return self.exact.reversed_traction(x, self.peak, self.share, self.mu)
        return self.exact.traction(x, self.share, self.mu)

    @property
    def stick_half_width(self) -> float:
        """m, by the closed form: of first slip, or of the slip back."""
        share = 0.5 * (self.peak - self.share) if self.reversed else self.share
        return self.exact.stick_half_width(share)

    @property
    def within(self) -> NDArray[np.bool_]:
        """(q,) the points within the exact half-width."""
        return np.abs(self.x) < self.exact.half_width


def press(name: str, overrides: Sequence[str] = ()) -> Profile:
    """Run a case of line contact.

    ``name``: of a file in ``cases``, made by one of the line-contact generators.

    Raises:
        ValueError: the contact has reached the end of the finely meshed zone.
    """
    case, simulation = solve(name, overrides)
    arrays = contact_arrays(simulation.model)
    assert arrays is not None
    closed = arrays["pressure"] > 0.0
    if closed[0] or closed[-1]:
        raise ValueError("the contact reaches the end of the contact zone; widen contact_width")
    (term,), (trial,) = simulation.model.problem.contacts, simulation.model.problem.committed
    lengths = term.surface.slave.facet_length[trial.pressure > 0.0]
    row, (radius, depth) = simulation.rows[-1], _radius_and_depth(case)
    load = row.normal_force / case.geometry.slab
    friction = case.contact[0].friction
    assert isinstance(friction, LawTable)
    mu = value_at(friction.mu, 0.0) if friction.law == "coulomb" else 0.0
    shares = [r.tangential_force / (mu * r.normal_force) if mu else 0.0 for r in simulation.rows]
    x, p = arrays["position"][closed, 0], arrays["pressure"][closed]
    return Profile(
        x=x - x @ p / p.sum(),
        pressure=p,
        traction=arrays["tangential_traction"][closed],
        sticks=arrays["regime"][closed] == Regime.STICK,
        exact=LineContact(load, radius, case_modulus(case)),
        share=shares[-1],
        peak=max(shares),
        mu=mu,
        penetration=row.max_penetration,
        size=float(lengths.mean()),
        depth=depth,
        below=_below(simulation.model),
    )


def _below(model: Model) -> Floats | None:
    """Depth and stresses of `Profile.below`."""
    if not model.probes:
        return None
    probes = PointProbes(model, model.probes[:1])
    named = ("reference_y", "cauchy_xx", "cauchy_yy")
    picked = [probes.columns.index(name) for name in named]
    return np.array([[row[i] for i in picked] for row in probes.rows()], dtype=np.float64).T


def _radius_and_depth(case: Case) -> tuple[float, float]:
    """Relative radius of the bodies, and the depth of the shallower one, m."""
    geometry = case.geometry
    if isinstance(geometry, CylinderOnBlockGeometry):
        radius = geometry.cylinder.radius
        return relative_radius(radius), min(radius, geometry.block.height)
    assert isinstance(geometry, TwoCylindersGeometry)
    radii = geometry.upper.radius, geometry.lower.radius
    return relative_radius(*radii), min(radii)


def case_modulus(case: Case) -> float:
    """E* from the shear and bulk moduli of both bodies, Pa."""
    bodies = case.bodies.values()
    return contact_modulus(*(young_and_poisson(b.shear_modulus, b.bulk_modulus) for b in bodies))


def fit_ellipse(x: Floats, values: Floats, area: Floats | None = None) -> tuple[float, float]:
    r"""Half-width and peak of :math:`f_0 \sqrt{1 - x^2/w^2}` through points.

    Least squares on f², which is linear in x², over the inner 0.8 of the points' extent: the
    result does not depend on where within a facet the contact ends.

    Args:
        x: (q,), m, from the middle.
        values: (q,), f.
        area: (q,) that the points stand for, in any unit; None: all the same.

    Returns:
        w in m, and f0.
    """
    used = np.abs(x) < FITTED * np.abs(x).max()
    weight = np.ones(len(x)) if area is None else np.sqrt(area)
    slope, square = np.polyfit(x[used] ** 2, values[used] ** 2, 1, w=weight[used])
    return float(np.sqrt(-square / slope)), float(np.sqrt(square))


def pressure_checks(profile: Profile) -> tuple[Check, ...]:
    """Half-width, peak and profile of the pressure against Hertz's."""
    exact, p = profile.exact, profile.pressure
    width, peak = fit_ellipse(profile.x, p)
    apart = (p - exact.pressure(profile.x)) / exact.peak
    return (
        compare("half-width a", width, exact.half_width, BAR, "µm"),
        compare("peak pressure p0, fitted", peak, exact.peak, BAR, "kPa"),
        compare("largest pressure", p.max(), exact.peak, BAR, "kPa"),
        *_along_profile("pressure", "p0", apart, profile),
    )


def _along_profile(what: str, over: str, apart: Reals, profile: Profile) -> Iterator[Check]:
    """How far values are off the closed form along the contact, over the largest."""
    yield Check(f"{what} profile, rms / {over}", _rms(apart[profile.within]), BAR)
    most = float(np.abs(apart[profile.middle]).max())
    yield Check(f"{what} off the edges, max / {over}", most, BAR)


def _rms(values: Reals) -> float:
    return float(np.sqrt(np.mean(values**2)))


def depth_checks(profile: Profile) -> Iterator[Check]:
    """Stress under the middle of the contact against that of the half-space."""
    if profile.below is None:
        return
    depth, along, across = profile.below
    exact = profile.exact.stress_below(depth)
    mean, shear = 0.5 * (along + across), 0.5 * (along - across)
    for name, found, wanted in (
        ("mean stress", mean, 0.5 * (exact[0] + exact[1])),
        ("shear stress", shear, 0.5 * (exact[0] - exact[1])),
    ):
        apart = (found - wanted) / profile.exact.peak
        yield Check(f"{name} below the middle, rms / p0", _rms(apart), BAR)


def traction_checks(profile: Profile) -> tuple[Check, ...]:
    """Stick half-width and profile of the traction against Cattaneo's and Mindlin's."""
    x, limit, c = profile.x, profile.mu * profile.exact.peak, profile.stick_half_width
    # Where points slide the traction is mu p, or -mu p; what is left to that is an ellipse of
    # half-width c after first slip, and after slip back it is but for the first slip's.
    reserve = profile.mu * profile.pressure - profile.traction
    if profile.reversed:
        first = profile.exact.traction(x, profile.peak, profile.mu)
        reserve = 2.0 * profile.mu * profile.pressure - (first - profile.traction)
    width, _ = fit_ellipse(x[profile.sticks], reserve[profile.sticks])
    apart = (profile.traction - profile.exact_traction(x)) / limit
    return (
        compare("stick half-width c", width, c, BAR, "µm"),
        compare("c by the regime of points", _stuck(profile), c, BAR, "µm"),
        *_along_profile("traction", "(µ p0)", apart, profile),
    )


def _stuck(profile: Profile) -> float:
    """Half the distance between the two changes from stick to slip, m."""
    stuck = np.flatnonzero(profile.sticks)
    first, last = stuck[0], stuck[-1]
    x = profile.x
    return float(0.25 * (x[last] + x[last + 1] - x[first] - x[first - 1]))


def _about(profile: Profile) -> str:
    e = profile.exact
    return (
        f"Under the computed load P' = {e.load:.4g} N/m with R* = {e.radius * 1e3:.4g} mm and "
        f"E* = {e.modulus * 1e-6:.4g} MPa, a/R* = {e.half_width / e.radius:.3f}: strains are of "
        f"the order p0/E* = {e.peak / e.modulus:.3f}, and the bodies are at least "
        f"{profile.depth / e.half_width:.0f} a deep. {e.half_width / profile.size:.0f} elements "
        f"lie over a; the largest penetration is {profile.penetration * 1e9:.2g} nm. Half-width "
        f"and peak are those of the ellipse that fits best over the inner {FITTED:g} of the "
        f'contact (or stick); "off the edges" leaves out the points within {EDGE:g} a of the ends '
        "of contact and stick, where the slopes are infinite."
    )


def _panel(profile: Profile, traction: bool) -> Panel:
    exact = profile.exact
    a = exact.half_width
    x = a * np.sin(np.linspace(-0.5 * np.pi, 0.5 * np.pi, 401))
    lines = [
        Line("pressure / p0, Hertz", x / a, exact.pressure(x) / exact.peak, exact=True),
        Line("pressure / p0, computed", profile.x / a, profile.pressure / exact.peak),
    ]
    if traction:
        limit = profile.mu * exact.peak
        q = profile.exact_traction(x) / limit
        lines += [
            Line("traction / (µ p0), Cattaneo and Mindlin", x / a, q, exact=True),
            Line("traction / (µ p0), computed", profile.x / a, profile.traction / limit),
        ]
    return Panel("x / a (-)", "pressure, traction (-)", tuple(lines))


def _depth_panel(profile: Profile) -> Iterator[Panel]:
    """Stress under the middle of the contact over the depth."""
    if profile.below is None:
        return
    a, peak = profile.exact.half_width, profile.exact.peak
    depth, along, across = profile.below
    z = np.linspace(0.0, depth.max(), 201)
    exact = profile.exact.stress_below(z)
    yield Panel(
        "z / a (-)",
        "stress (-)",
        (
            Line("σ_x / p0, half-space", z / a, exact[0] / peak, exact=True),
            Line("σ_x / p0, computed", depth / a, along / peak),
            Line("σ_z / p0, half-space", z / a, exact[1] / peak, exact=True),
            Line("σ_z / p0, computed", depth / a, across / peak),
        ),
    )


def _line_contact(
    profile: Profile,
    name: str,
    title: str,
    checks: tuple[Check, ...],
    lead: str = "",
    traction: bool = False,
    more: Iterable[Panel] = (),
) -> Verification:
    """What a line contact came to; ``more``: panels beside that of the profiles."""
    panels = _panel(profile, traction), *more
    return Verification(name, title, lead + _about(profile), checks, panels)


def hertz_line(overrides: Sequence[str] = ()) -> Verification:
    """An elastomer cylinder on aluminium."""
    profile = press("hertz-line", overrides)
    title = "Hertz's line contact, elastomer on aluminium"
    checks = *pressure_checks(profile), *depth_checks(profile)
    return _line_contact(profile, "hertz-line", title, checks, more=_depth_panel(profile))


def hertz_two_cylinders() -> Verification:
    """Two like elastomer cylinders."""
    profile = press("hertz-two-cylinders")
    title = "Hertz's line contact, two like cylinders"
    return _line_contact(profile, "hertz-two-cylinders", title, pressure_checks(profile))


def cattaneo_mindlin(overrides: Sequence[str] = ()) -> Verification:
    """Two like cylinders in partial slip."""
    profile = press("cattaneo-mindlin", overrides)
    title = "partial slip of Cattaneo and Mindlin, two like cylinders"
    checks = *pressure_checks(profile), *traction_checks(profile)
    lead = f"Q/(µP) = {profile.share:.4f}. "
    return _line_contact(profile, "cattaneo-mindlin", title, checks, lead, traction=True)


# Sideways by as much as `cattaneo-mindlin`, then halfway back.
THERE_AND_BACK = (
    'boundary.1.displacement.x=[["1 s", "0 um"], ["2 s", "4 um"], ["3 s", "1.5 um"]]',
    'stage=[{name="press", duration=1, steps=16}, {name="shear", duration=1, steps=8}, '
    '{name="back", duration=1, steps=6}]',
)


def mindlin_reversal() -> Verification:
    """Two like cylinders in partial slip, moved partly back."""
    profile = press("cattaneo-mindlin", [*THERE_AND_BACK])
    title = "partial slip moved back, Mindlin and Deresiewicz, two like cylinders"
    lead = (
        f"cases/cattaneo-mindlin.toml, moved back: Q/(µP) has risen to {profile.peak:.4f} and "
        f"fallen to {profile.share:.4f}. "
    )
    checks = traction_checks(profile)
    return _line_contact(profile, "mindlin-reversal", title, checks, lead, traction=True)


# -- Verification of sliding: the friction law at points and in a block, forces of other codes  ---

# Forces in N for a slab of 1 mm by codes that enforce the constraint exactly, by level of
# refinement: normal force after pressing, tangential and normal force at the end.
REFERENCE = {1: (0.9684, 0.1756, 0.8778), 2: (0.9617, 0.1743, 0.8717), 4: (0.9581, 0.1737, 0.8683)}
QUICK_LAYER = (
    "geometry.upper.elements=[60, 2]",
    "geometry.lower.elements=[65, 3]",
    "contact.0.film.thickness=30 nm",
    'stage.1.velocities=["1e-6 m/s", "1e-4 m/s", "2e-3 m/s"]',
)
PENALTY_FACTORS = (3.0, 30.0, 300.0)


def friction_law(overrides: Sequence[str] = ()) -> Verification:
    """The friction map stepped to steady sliding at material points."""
    result = compute_map(map_setup(None, overrides))
    curves = [(f"D = {curve.film * 1e9:.0f} nm", curve) for curve in result.by_film]
    curves += [(f"p = {curve.pressure * 1e-6:.1f} MPa", curve) for curve in result.by_load]
    checks = [Check(f"F(V) at {at}, max over V", _deviation(curve), 1e-6) for at, curve in curves]
    lines = tuple(line for curve in result.by_film for line in _curves(curve))
    return Verification(
        "friction-law",
        "friction map at material points, steady sliding",
        "The law is stepped at constant speed until its traction stays the same, and compared with "
        "(1 − α) µ p + α η_b V/D outside the transition at V*.",
        tuple(checks),
        (Panel("speed V (m/s)", "traction (kPa)", lines, log=True),),
    )


def _deviation(curve: Curve) -> float:
    """Largest relative distance from the closed form; NaN where nothing could be compared."""
    compared = bool(np.all(curve.steady)) and bool(np.isfinite(curve.exact).any())
    return curve.deviation if compared else float("nan")


def _curves(curve: Curve) -> tuple[Line, Line]:
    name = f"D = {curve.film * 1e9:.0f} nm"
    return (
        Line(f"{name}, closed form", curve.speed, curve.exact * 1e-3, exact=True),
        Line(f"{name}, computed", curve.speed, curve.traction * 1e-3),
    )


def film_sliding() -> Verification:
    """A layer sliding on a film, its effective viscosity against the closed form."""
    case, simulation = solve("sfa", [*QUICK_LAYER])
    law, film = case.contact[0].map, case.contact[0].film
    assert law is not None and film is not None
    thickness = film.thicknesses[0]
    # The last step at each velocity is its steady state.
    steady = {row.velocity: row for row in simulation.rows if row.velocity != 0.0}
    checks = []
    for speed, row in steady.items():
        pressure = row.normal_force / row.contact_area
        exact = effective_viscosity(speed, thickness, pressure, row.mu, law)
        name = f"effective viscosity at {speed:g} m/s"
        checks.append(compare(name, row.effective_viscosity, float(exact), 5e-3, "Pa s"))
    return Verification(
        "film-sliding",
        "elastomer layer sliding on a film (cases/sfa.toml, coarse)",
        f"D = {thickness * 1e9:.0f} nm; one speed far below V*, one below and one above. The "
        "closed form is per reference area, the film's stress per current area: 0.12 % of the "
        "viscous part is the stretch of the sliding surface.",
        tuple(checks),
    )


def block_slide(overrides: Sequence[str] = ()) -> Verification:
    """A block pressed and slid, against forces of codes that enforce the constraint exactly."""
    _, simulation = solve("block-slide", overrides)
    rows = simulation.rows
    checks = [
        compare(name, force, exact, 3e-3, "N")
        for (name, force), exact in zip(_forces(rows), REFERENCE[1], strict=True)
    ]
    balance = max(abs(r.energy_error) for r in rows) / max(abs(r.external_work) for r in rows)
    checks.append(Check("energy not accounted for / external work", balance, 1e-3))
    gross = [r.friction_coefficient for r in rows if r.stage == "slide" and r.stick_fraction == 0.0]
    worst = max((abs(f / 0.2 - 1.0) for f in gross), default=np.inf)
    checks.append(Check("T/(µN) in gross sliding, largest error", worst, 1e-5))
    step = np.array([row.step for row in rows])
    pressed = sum(row.stage == "press" for row in rows)
    ends = np.array([pressed, len(rows), len(rows)])
    lines = (
        Line("normal force", step, np.array([row.normal_force for row in rows])),
        Line("drag", step, np.array([row.drag for row in rows])),
        Line("other codes", ends, np.array(REFERENCE[1])),
    )
    return Verification(
        "block-slide",
        "block pressed and slid with Coulomb friction, forces of other codes",
        "cases/block-slide.toml as it is (40 × 20 elements on 61 × 15). Two codes that enforce "
        "the constraint exactly agree on these forces to all digits given.",
        tuple(checks),
        (Panel("step", "force (N)", lines),),
    )


def _forces(rows: Sequence[Row]) -> tuple[tuple[str, float], ...]:
    pressed = [row for row in rows if row.stage == "press"][-1]
    return (
        ("normal force, pressed", pressed.normal_force),
        ("tangential force, end", rows[-1].drag),
        ("normal force, end", rows[-1].normal_force),
    )


def penalty() -> Verification:
    """The pressed force as the penalty grows: its error falls as one over the penalty."""
    exact, errors, depths = REFERENCE[1][0], [], []
    for factor in PENALTY_FACTORS:
        options = [f"contact.0.penalty_factor={factor}"]
        _, simulation = solve("block-slide", [*options, 'stage=[{name="press", duration=1}]'])
        row = simulation.rows[-1]
        errors.append(1.0 - row.normal_force / exact)
        depths.append(row.max_penetration)
    # What is left at infinite penalty (rounding of the reference, give of stick) drops out of
    # differences.
    ratio = (errors[0] - errors[1]) / (errors[1] - errors[2])
    expected = (1.0 / PENALTY_FACTORS[0] - 1.0 / PENALTY_FACTORS[1]) / (
        1.0 / PENALTY_FACTORS[1] - 1.0 / PENALTY_FACTORS[2]
    )
    checks = [
        Check(f"pressed force at penalty_factor = {factor:g}", abs(error), bar)
        for factor, error, bar in zip(PENALTY_FACTORS, errors, (2e-2, 3e-3, 1e-3), strict=True)
    ]
    checks.append(compare("fall of the error from 3 to 30, over that to 300", ratio, expected, 0.2))
    checks.append(compare("penetration at 30 over that at 300", depths[1] / depths[2], 10.0, 0.2))
    falling = 100.0 * abs(errors[0]) * PENALTY_FACTORS[0] / np.array(PENALTY_FACTORS)
    lines = (
        Line("as 1/penalty_factor", np.array(PENALTY_FACTORS), falling, exact=True),
        Line("|error| of the pressed force (%)", np.array(PENALTY_FACTORS), 100.0 * np.abs(errors)),
        Line("penetration (µm)", np.array(PENALTY_FACTORS), 1e6 * np.array(depths)),
    )
    return Verification(
        "penalty",
        "block-slide pressed with a growing penalty",
        "K_A = penalty_factor · max(10 G, M/10)/h. Error and penetration fall as 1/penalty_factor.",
        tuple(checks),
        (Panel("penalty_factor (-)", "error, penetration", lines, log=True),),
    )
