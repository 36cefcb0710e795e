"""Metals that flow: a thick tube under inner pressure, bars drawn to their largest load."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tribox.app.equilibrium.constraints import Prescribed
from tribox.app.verify.flowing_body import SIDES, FlowingBody, Shape, rectangle
from tribox.app.verify.result import Check, Floats, Line, Panel, Verification, compare
from tribox.forms.bodies.elastoplastic import ElastoPlastic
from tribox.forms.bodies.hardening import Backstress, Hardening, Swift, Voce
from tribox.forms.bodies.kinematics import Section
from tribox.forms.bodies.loads import FollowerPressure
from tribox.forms.bodies.solid import Formulation
from tribox.forms.closed_forms.metal_bar import load_maximum, stress_at
from tribox.forms.closed_forms.thick_tube import inner_pressure

YOUNG, POISSON = 70e9, 0.33  # Pa, of aluminium


def metal(
    hardening: Hardening,
    young: float = YOUNG,
    poisson: float = POISSON,
    kinematic: tuple[Backstress, ...] = (),
) -> ElastoPlastic:
    """A metal by its E, Pa, and ν."""
    shear, bulk = young / (2.0 * (1.0 + poisson)), young / (3.0 * (1.0 - 2.0 * poisson))
    return ElastoPlastic(shear, bulk, hardening, kinematic=kinematic)


# -- thick tube -----------------------------------------------------------------------------------

INNER, OUTER = 20e-3, 40e-3  # m
TUBE = Voce(yield_stress=60e6, saturation_stress=160e6, exponent=12.0, modulus=100e6)
GROWTH = np.array([0.00025, 0.0005, 0.001, 0.002, 0.004, 0.008, 0.015, 0.03, 0.05, 0.075, 0.1])
"""Displacements of the inner surface over its radius that the tube is looked at."""
FLOWS = 4  # the first of them at which all of the wall flows


@dataclass(frozen=True, slots=True)
class Tube:
    """A thick tube, solved: pressures on its inner surface, Pa, at displacements of it, m."""

    displacement: Floats
    pressure: Floats
    exact: Floats

    @property
    def error(self) -> float:
        """Largest difference of a pressure, over the closed form's."""
        return float(np.abs(self.pressure / self.exact - 1.0).max())


def _tube(displacement: Floats, pressure: Floats, material: ElastoPlastic) -> Tube:
    law, shear = material.hardening.stress, material.shear_modulus
    exact = [inner_pressure(float(d), INNER, OUTER, shear, law) for d in displacement]
    return Tube(displacement, pressure, np.array(exact))


def tube_of_revolution(
    material: ElastoPlastic, elements: int = 12, formulation: Formulation = "q1-sri"
) -> Tube:
    """A slice of a tube whose inner surface is moved outwards; the pressure is its reaction."""
    slab = 1e-3
    place = rectangle((INNER, 0.0), (OUTER, slab))
    body = FlowingBody(Shape((elements, 1), place, "axisymmetric", formulation), material)
    bore = body.held("left", 0)
    stepper = body.stepper([bore, body.held("bottom", 1), body.held("top", 1)])
    displacement, pressure = GROWTH * INNER, []
    for moved in displacement:
        bore.value = moved
        stepper.advance(1.0)
        force = stepper.problem.reaction(bore)
        pressure.append(force / (2.0 * np.pi * (INNER + moved) * slab))
    return _tube(displacement, np.array(pressure), material)


def quarter_of_tube(
    material: ElastoPlastic,
    elements: tuple[int, int] = (12, 12),
    formulation: Formulation = "q1-sri",
    pressures: Floats | None = None,
) -> Tube:
    """A quarter of the section in plane strain, blown up by a pressure that follows the surface.

    Args:
        material: of the tube.
        elements: through the wall and around.
        formulation: of the elements.
        pressures: Pa; default: the closed form's at ``GROWTH``.
    """

    def place(x: Floats) -> Floats:
        radius, angle = INNER + (OUTER - INNER) * x[:, 0], 0.5 * np.pi * x[:, 1]
        return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)

    body = FlowingBody(Shape(elements, place, "plane-strain", formulation), material)
    load = FollowerPressure(body.u, body.facets("left"), body.section)
    stepper = body.stepper([body.held("bottom", 1), body.held("top", 0)], [load])
    bore = body.nodes("left")
    outwards = body.X[bore] / np.linalg.norm(body.X[bore], axis=1)[:, None]
    if pressures is None:
        pressures = _tube(GROWTH * INNER, GROWTH, material).exact
    displacement = []
    for pressure in pressures:
        load.set(float(pressure))
        stepper.advance(1.0)
        displacement.append(np.mean(np.sum(body.moved[bore] * outwards, axis=1)))
    return _tube(np.array(displacement), pressures, material)


def thick_tube() -> Verification:
    """Pressure in a thick tube against its expansion, from the first yield to full flow."""
    # The closed form is that of an incompressible tube.
    material = metal(TUBE, poisson=0.4999)
    found = {
        "section of revolution": tube_of_revolution(material),
        "quarter in plane strain": quarter_of_tube(material),
    }
    aluminium = metal(TUBE)
    compressible = tube_of_revolution(aluminium)
    late = np.abs(compressible.pressure / compressible.exact - 1.0)[FLOWS:].max()
    # Lamé: the pressure of an incompressible tube, less what the wall's volume gives way.
    volume = 1.0 + (1.0 - 2.0 * POISSON) * (INNER / OUTER) ** 2
    early = compressible.pressure[0] * volume / compressible.exact[0]
    checks = (
        *(Check(f"pressure, {name}", tube.error, 0.01) for name, tube in found.items()),
        Check("pressure, ν = 0.33, all of the wall flows", float(late), 0.01),
        Check("pressure, ν = 0.33, elastic (Lamé)", float(abs(early - 1.0)), 0.01),
    )
    grid = np.geomspace(GROWTH[0], GROWTH[-1], 200)
    exact = _tube(grid * INNER, grid, material).exact
    lines = (
        Line("closed form", 100.0 * grid, exact * 1e-6, exact=True),
        *(
            Line(name, 100.0 * tube.displacement / INNER, tube.pressure * 1e-6)
            for name, tube in found.items()
        ),
    )
    return Verification(
        "thick-tube",
        "thick tube of a metal under inner pressure, plane strain",
        f"Radii {INNER * 1e3:g} and {OUTER * 1e3:g} mm, 12 elements through the wall, E = 70 GPa, "
        "ν = 0.4999, Voce's hardening from 60 to 160 MPa. The section of revolution is moved at "
        "its bore, the quarter is loaded by a pressure that follows it. Errors are the largest of "
        "all points. With ν = 0.33 the elastic change of volume counts before all of the wall "
        "flows.",
        checks,
        (Panel("displacement of the bore / its radius (%)", "pressure (MPa)", lines, log=True),),
    )


# -- Considère ------------------------------------------------------------------------------------

SWIFT = Swift(K=180e6, strain0=0.002, n=0.20)
SATURATING = Voce(yield_stress=60e6, saturation_stress=160e6, exponent=12.0)
LENGTH, AREA = 10e-3, 1e-6 * np.pi  # m, m²


@dataclass(frozen=True, slots=True)
class Bar:
    """A bar that was drawn: stretches and forces over the area before, Pa."""

    stretch: Floats
    stress: Floats
    uneven: float

    def maximum(self) -> tuple[float, float]:
        """Stretch and stress where a parabola through the three largest values is largest."""
        k = int(np.clip(np.argmax(self.stress), 1, len(self.stress) - 2))
        a, b, c = np.polyfit(np.log(self.stretch[k - 1 : k + 2]), self.stress[k - 1 : k + 2], 2)
        top = -b / (2.0 * a)
        return float(np.exp(top)), float(np.polyval([a, b, c], top))


def drawn_bar(
    hardening: Hardening,
    counts: tuple[int, ...],
    section: Section,
    strains: Floats,
    formulation: Formulation = "q1-sri",
) -> Bar:
    """A bar, a cylinder or a box, drawn to logarithmic strains (n,).

    Args:
        hardening: of the bar.
        counts: elements; the bar lies along the last axis.
        section: "axisymmetric" or "3D".
        strains: to be reached one after the other.
        formulation: of the elements.
    """
    dim, axis = len(counts), len(counts) - 1
    width = np.sqrt(AREA / np.pi) if dim == 2 else np.sqrt(AREA)
    place = rectangle((0.0,) * dim, (*(width,) * axis, LENGTH))
    body = FlowingBody(Shape(counts, place, section, formulation), metal(hardening))
    end = body.held(SIDES[axis][1], axis)
    sides: list[Prescribed] = [body.held(SIDES[k][0], k) for k in range(dim)]
    if section == "axisymmetric":
        sides[0] = body.held("left", 0)
    stepper = body.stepper([*sides, end])
    stresses = []
    for strain in strains:
        end.value = LENGTH * np.expm1(strain)
        stepper.advance(1.0)
        stresses.append(stepper.problem.reaction(end) / AREA)
    across = body.moved[body.nodes(SIDES[0][1]), 0]
    return Bar(np.exp(strains), np.array(stresses), float(np.ptp(across) / np.abs(across).max()))


def considere() -> Verification:
    """The load maximum of drawn bars, and their force all the way."""
    checks, lines = [], []
    cases: tuple[tuple[str, Hardening, tuple[int, ...], Section, float], ...] = (
        ("Swift, cylinder of one element", SWIFT, (1, 1), "axisymmetric", 0.35),
        ("Voce, box of 2 × 2 × 6", SATURATING, (2, 2, 6), "3D", 0.25),
    )
    for name, law, counts, section, most in cases:
        strains = np.concatenate([[0.0005], np.linspace(0.0, most, 36)[1:]])
        bar = drawn_bar(law, counts, section, strains)
        stretch, stress = load_maximum(YOUNG, law)
        top = bar.maximum()
        exact = stress_at(bar.stretch, YOUNG, law)
        checks += [
            compare(f"{name}: largest force / area", top[1] * 1e-6, stress * 1e-6, 5e-3, "MPa"),
            compare(f"{name}: strain there", np.log(top[0]), float(np.log(stretch)), 5e-3),
            Check(
                f"{name}: force all the way",
                float(np.abs(bar.stress / exact - 1.0).max()),
                1e-3,
            ),
        ]
        fine = np.geomspace(strains[0], most, 200)
        curve = stress_at(np.exp(fine), YOUNG, law)
        lines += [
            Line(f"{name.split(',')[0]}, closed form", fine, curve * 1e-6, exact=True),
            Line(name, strains, bar.stress * 1e-6),
        ]
    return Verification(
        "considere",
        "load maximum of a drawn bar",
        "Bars of E = 70 GPa, ν = 0.33, drawn by one end without a neck in 36 steps; the other end "
        "slides on a plane. The load is largest where the yield stress equals its slope, up to the "
        "elastic strain. The top is that of the parabola through the three largest forces.",
        tuple(checks),
        (Panel("logarithmic strain (-)", "force / area before (MPa)", tuple(lines)),),
    )
