"""Verification of sliding: the friction law at points and in a block, forces of other codes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tribox.app.friction_map.material_tests import Curve, compute_map
from tribox.app.friction_map.setup import map_setup
from tribox.app.simulation.history import Row
from tribox.app.verify.result import Check, Line, Panel, Verification, compare, solve
from tribox.forms.closed_forms.homogeneous_sliding import effective_viscosity

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
    checks = [
        Check(f"F(V) at D = {curve.film * 1e9:.0f} nm, max over V", _deviation(curve), 1e-6)
        for curve in result.by_film
    ]
    checks += [
        Check(f"F(V) at p = {curve.pressure * 1e-6:.1f} MPa, max over V", _deviation(curve), 1e-6)
        for curve in result.by_load
    ]
    return Verification(
        "friction-law",
        "friction map at material points, steady sliding",
        "The law is stepped at constant speed until its traction stays the same, and compared with "
        "(1 − α) µ p + α η_b V/D outside the transition at V*.",
        tuple(checks),
        (
            Panel(
                "speed V (m/s)",
                "traction (kPa)",
                tuple(line for curve in result.by_film for line in _curves(curve)),
                log=True,
            ),
        ),
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


def film_sliding(overrides: Sequence[str] = ()) -> Verification:
    """A layer sliding on a film, its effective viscosity against the closed form."""
    case, simulation = solve("sfa", [*QUICK_LAYER, *overrides])
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


def penalty(overrides: Sequence[str] = ()) -> Verification:
    """The pressed force as the penalty grows: its error falls as one over the penalty."""
    exact, errors, depths = REFERENCE[1][0], [], []
    for factor in PENALTY_FACTORS:
        options = [f"contact.0.penalty_factor={factor}", *overrides]
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
