"""Verification of bodies that flow in bending: Cook's membrane, springback of a bent strip."""

from __future__ import annotations

from dataclasses import dataclass

import dolfinx
import numpy as np
import ufl
from petsc4py import PETSc

from benchmarks.verify.flowing import POISSON, YOUNG, FlowingBody, Shape, metal, rectangle
from benchmarks.verify.metal_bar import Strip
from benchmarks.verify.result import Check, Line, Panel, Verification, compare
from tribox.app.equilibrium.constraints import Platen
from tribox.app.implicit.stepper import ImplicitStepper
from tribox.forms.bodies.elastoplastic import ElastoPlastic
from tribox.forms.bodies.hardening import Hardening, Linear, Voce
from tribox.forms.bodies.loads import Load, surface_measure
from tribox.forms.bodies.solid import Formulation
from tribox.geometry.surfaces.facets import Floats, Longs

# -- Cook's membrane ------------------------------------------------------------------------------

MEMBRANE = metal(Voce(0.45e9, 0.715e9, 16.93, 0.12924e9), young=206.9e9, poisson=0.29)
LOAD, HEIGHT = 5e6, 16e-3  # N/m, upwards on the right side; m, its height
PUBLISHED = (6.97e-3, 7.09e-3)  # m


def membrane_tip(
    elements: int, formulation: Formulation, steps: int = 10
) -> tuple[float, list[float]]:
    """Displacement of the upper right corner, upwards, m, and that after each step."""

    def place(x: Floats) -> Floats:
        low = 44.0 * x[:, 0]
        up = 44.0 + 16.0 * x[:, 0]
        return 1e-3 * np.stack([48.0 * x[:, 0], low + x[:, 1] * (up - low)], axis=1)

    shape = Shape((elements, elements), place, "plane-strain", formulation)
    body = FlowingBody(shape, MEMBRANE)
    shear = dead_traction(body, "right")
    stepper = body.stepper([body.held("left", k) for k in (0, 1)], [shear])
    tip = int(np.argmax(body.X.sum(axis=1)))
    path = []
    for step in range(1, steps + 1):
        shear.amount = np.array([0.0, LOAD / HEIGHT * step / steps])
        stepper.advance(1.0)
        path.append(float(body.moved[tip, 1]))
    return path[-1], path


def dead_traction(body: FlowingBody, side: str) -> Load:
    """A force per undeformed area of a side, Pa, that keeps its direction."""
    mesh, facets = body.u.function_space.mesh, body.facets(side)
    value = dolfinx.fem.Constant(mesh, np.zeros(body.X.shape[1], dtype=PETSc.ScalarType))
    test = ufl.TestFunction(body.u.function_space)
    return Load(value, dolfinx.fem.form(-ufl.inner(value, test) * surface_measure(mesh, facets)))


def limit(values: Floats) -> float:
    """What the last three of a series tend to, each step of it the same share of the one before."""
    first, second = np.diff(values[-3:])
    return float(values[-1] + second**2 / (first - second))


def cook(finest: int = 64) -> Verification:
    """Cook's membrane of Simo and Armero with finer and finer meshes of three formulations.

    ``finest``: elements a side of the finest mesh; half of it with ``q2``.
    """
    meshes: dict[Formulation, Longs] = {
        "q1-sri": finest // 2 ** np.arange(4, -1, -1),
        "q2": finest // 2 ** np.arange(5, 0, -1),
        "q1": finest // 2 ** np.arange(4, -1, -1),
    }
    tips = {
        kind: np.array([membrane_tip(int(n), kind)[0] for n in counts])
        for kind, counts in meshes.items()
    }
    middle, half = float(np.mean(PUBLISHED)), 0.5 * float(np.ptp(PUBLISHED))
    checks = []
    for kind in ("q1-sri", "q2"):
        found, bar = tips[kind], half / middle
        name = f"{kind}: tip, finer and finer meshes"
        checks.append(compare(name, limit(found), middle, bar, "mm"))
        name = f"{kind}: tip, {meshes[kind][-1]} elements a side"
        checks.append(compare(name, found[-1], middle, 0.02, "mm"))
    sides = np.array([meshes["q2"][0], finest], dtype=float)
    lines = [
        Line(f"published: {1e3 * value:.2f} mm", sides, np.full(2, 1e3 * value), exact=True)
        for value in PUBLISHED
    ]
    lines += [
        Line(kind, meshes[kind].astype(np.float64), 1e3 * found) for kind, found in tips.items()
    ]
    return Verification(
        "cook-membrane",
        "Cook's membrane of Simo and Armero, a metal in plane strain",
        "A panel with corners (0, 0), (48, 44), (48, 60), (0, 44) mm, held on the left, under "
        "5 kN/mm upwards on the right in 10 steps; E = 206.9 GPa, ν = 0.29, Voce's hardening from "
        "0.45 to 0.715 GPa, δ = 16.93, H = 0.12924 GPa. Compared is the displacement of the upper "
        "right corner with the middle of the published range, 6.97 to 7.09 mm: what the three "
        "finest meshes tend to, within half of that range, and that of the finest mesh. `q1` "
        "locks.",
        tuple(checks),
        (Panel("elements a side", "displacement of the corner (mm)", tuple(lines)),),
    )


# -- springback -----------------------------------------------------------------------------------

THICKNESS, SPAN = 1e-3, 8e-3  # m, of the strip; of its half
ALL = (1.0,) * 6  # of the moment that is left, at a time
ANGLES = (0.08, 0.16, 0.32)  # rad, of the end of the half
STRIPS: dict[str, Hardening] = {
    "ideally plastic": Linear(120e6),
    "Voce": Voce(yield_stress=60e6, saturation_stress=160e6, exponent=12.0, modulus=100e6),
}


@dataclass(frozen=True, slots=True)
class Springback:
    """A strip bent and let go."""

    curvature: float  # 1/m, of its middle under the moment
    released: float  # without it
    moment: float  # N m/m, at the end of bending
    left: float  # moment that is left, over that

    @property
    def ratio(self) -> float:
        """K, the curvature that stays over that under the moment."""
        return self.released / self.curvature


class BentStrip:
    """Half a strip: its middle section moves as one without a force, its end is turned.

    Attributes:
        body: the strip; end: its turned end, by components; stepper: what solves its steps.
        arm: (n,), m, heights of the end's nodes, undeformed.
    """

    def __init__(
        self, material: ElastoPlastic, counts: tuple[int, int], formulation: Formulation
    ) -> None:
        """Make ready: counts of elements along it and through its thickness."""
        half = 0.5 * THICKNESS
        shape = Shape(counts, rectangle((0.0, -half), (SPAN, half)), "plane-strain", formulation)
        self.body = body = FlowingBody(shape, material)
        self.end = [body.held("right", k) for k in (0, 1)]
        middle = Platen(body.held("left", 0).dofs)
        self.stepper: ImplicitStepper = body.stepper(self.end, platens=[middle])
        self.arm = body.X[body.nodes("right"), 1]

    def turn(self, angle: float) -> float:
        """Turn the end to an angle; the moment on it, N m/m."""
        c, s, y = np.cos(angle), np.sin(angle), self.arm
        # Turned so that positive angles pull at the upper side.
        for part, value in zip(self.end, (s * y, (c - 1.0) * y), strict=True):
            part.value = value
        self.stepper.advance(1.0)
        # Work of the end's forces in a turn: ∂x/∂θ = (c y, −s y).
        force = self.stepper.problem.unbalanced
        return float(force[self.end[0].dofs] @ (c * y) - force[self.end[1].dofs] @ (s * y))


def curvature(X: Floats, moved: Floats) -> float:
    """Mean curvature of the quarter next to the middle, by undeformed length, 1/m.

    ``X``: (n, i), m, nodes of the half, undeformed, its middle at x = 0; ``moved``: their
    displacements.
    """
    places = np.unique(np.round(X[:, 0], 12))
    place = places[np.argmin(np.abs(places - 0.5 * SPAN))]
    section = np.abs(X[:, 0] - place) < 1e-9
    x = X[section] + moved[section]
    slope = np.polyfit(x[:, 1], x[:, 0], 1)[0]
    return float(np.arctan(slope) / place)


def springback(
    hardening: Hardening,
    angle: float = 0.16,
    counts: tuple[int, int] = (16, 8),
    formulation: Formulation = "q2",
    steps: int = 20,
) -> Springback:
    """Bend a strip by the angle of its ends, and turn them back until no moment is left.

    ``angle``: rad, of the end of the half; ``counts``: elements along it and through the thickness.
    """
    strip = BentStrip(metal(hardening), counts, formulation)
    moment = 0.0
    for step in range(1, steps + 1):
        moment = strip.turn(angle * step / steps)
    bent = curvature(strip.body.X, strip.body.moved)
    # Of the half in an elastic turn back, E t³/12(1 − ν²) over its length.
    stiffness = YOUNG * THICKNESS**3 / (12.0 * (1.0 - POISSON**2)) / SPAN
    at, left = angle, moment
    for share in (0.5, 0.5, *ALL):  # half of the way first: the plastic tangent leads astray
        if abs(left) < 1e-6 * moment:
            break
        at -= share * left / stiffness
        left = strip.turn(at)
    released = curvature(strip.body.X, strip.body.moved)
    return Springback(bent, released, moment, left / moment)


def pure_bending() -> Verification:
    """Springback of bent strips against integration over fibres."""
    checks: list[Check] = []
    lines: list[Line] = []
    for name, hardening in STRIPS.items():
        fibres = Strip(THICKNESS, YOUNG, POISSON, hardening.stress)
        found = [springback(hardening, angle) for angle in ANGLES]
        at = np.array([THICKNESS * one.curvature for one in found])
        for ratio, one in zip(at, found, strict=True):
            moment, released = fibres.bent(one.curvature)
            of = f"{name}, t/R = {ratio:.3f}: "
            lost = 1.0 - released / one.curvature
            checks.append(compare(of + "1 − K", 1.0 - one.ratio, lost, 0.01))
            checks.append(compare(of + "moment / width", one.moment, moment, 0.01, "N"))
        fine = np.geomspace(0.9 * at[0], 1.1 * at[-1], 16)
        curve = np.array([1.0 - fibres.bent(k)[1] / k for k in fine / THICKNESS])
        lines.append(Line(f"{name}, fibres", fine, curve, exact=True))
        lines.append(Line(name, at, np.array([1.0 - one.ratio for one in found])))
    return Verification(
        "springback",
        "springback of a strip after pure bending",
        f"Half of a strip, {SPAN / THICKNESS:g} thicknesses long, in plane strain: the section in "
        "the middle moves as one without a force, so that the moment is the only one, the end is "
        "turned in 20 steps and turned back until no moment is left; 16 × 8 elements (q2), "
        "E = 70 GPa, ν = 0.33. K is the curvature without the moment over that under it, both of "
        "the quarter next to the middle. The closed form integrates the stresses of fibres.",
        tuple(checks),
        (Panel("thickness / radius (-)", "1 − K (-)", tuple(lines)),),
    )
