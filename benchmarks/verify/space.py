"""Verification in space on flat surfaces: patch test, sliding in any direction."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.verify.contact import case_modulus, fit_ellipse
from benchmarks.verify.hertz import PointContact, Twist
from benchmarks.verify.result import Check, Floats, Line, Panel, Verification, apart, compare, solve
from tribox.app.case.friction import LawTable
from tribox.app.case.generators import SphereGeometry
from tribox.app.case.time_tables import value_at
from tribox.app.results.contact_points import contact_arrays
from tribox.app.results.fields import StressField
from tribox.app.simulation.simulation import Simulation
from tribox.geometry.compat import cell_nodes


def held(surface: str, what: str) -> str:
    """One boundary of an override, `what` being its other keys in TOML."""
    return f'{{surface="{surface}", {what}}}'


PATCH_PRESSURE = 1e5  # Pa, a fiftieth of the elastomer's modulus
_SIDES = [("left", "x"), ("right", "x"), ("front", "z"), ("back", "z")]
_WALLS = [
    held(f"{body}_{side}", f"displacement={{{axis}=0}}")
    for body in ("elastomer", "aluminium")
    for side, axis in _SIDES
]
_PRESSED = [
    held("bottom", "displacement={y=0}"),
    held("top", f"pressure={PATCH_PRESSURE}"),
    *_WALLS,
]
PATCH = (
    "geometry.lower.width=1 mm",
    "geometry.lower.depth=1 mm",
    'contact.0.friction={law="frictionless"}',
    f"boundary=[{', '.join(_PRESSED)}]",
    'stage=[{name="press", duration=1, steps=1}]',
)
MISMATCHES = ((10, 10), (9, 9), (8, 8), (7, 7), (10, 7), (5, 5), (9, 4))
"""Master facets along x and z under the slave's."""
SLAVE_FACETS = 11


@dataclass(frozen=True, slots=True)
class PatchErrors:
    """Largest errors of a patch test, relative to the pressure p."""

    near: float  # |σ_yy/p + 1| at the centres of cells with a node on the interface
    far: float  # the same in all other cells
    pressure: float  # |t_N/p − 1| at the contact points


def patch_errors(
    upper: Sequence[int], lower: Sequence[int], overrides: Sequence[str] = ()
) -> PatchErrors:
    """Press two boxes of one width and depth, held on all sides, and compare with σ_yy = −p.

    ``upper``, ``lower``: elements of the boxes along x, y, z.
    """
    counts = (f"geometry.upper.elements={list(upper)}", f"geometry.lower.elements={list(lower)}")
    _, simulation = solve("boxes-3d", [*PATCH, *counts, *overrides])
    return stress_errors(simulation, PATCH_PRESSURE)


def stress_errors(simulation: Simulation, pressure: float) -> PatchErrors:
    """Errors of a finished run in which σ_yy = −p (Pa) and the interface lies at y = 0."""
    problem, named = simulation.model.problem, simulation.model.named
    problem.spread(simulation.stepper.x)
    stress = StressField(problem.u, problem.solids).evaluate().stress
    wrong = np.abs(stress[:, 1, 1] / pressure + 1.0)
    height = named.mesh.geometry.x[cell_nodes(named.mesh)][:, :, 1]
    near = (np.abs(height) < 1e-9).any(axis=1)
    at_points = np.abs(problem.trials[0].pressure / pressure - 1.0)
    return PatchErrors(float(wrong[near].max()), float(wrong[~near].max()), float(at_points.max()))


def patch_space() -> Verification:
    """A uniform pressure through a flat interface of boxes whose nodes do not match."""
    checks = []
    for degree, bar in ((5, 0.02), (9, 0.01)):
        found = [
            patch_errors(
                (SLAVE_FACETS, 5, SLAVE_FACETS),
                (along, 3, across),
                [f"contact.0.quadrature_degree={degree}"],
            )
            for along, across in MISMATCHES
        ]
        points = (degree + 1) // 2
        name = f"stress at {points} × {points} points, max error"
        checks += [
            Check(f"{name}, at the interface", max(e.near for e in found), bar),
            Check(f"{name}, elsewhere", max(e.far for e in found), 0.5 * bar),
        ]
    matching = (SLAVE_FACETS, 3, SLAVE_FACETS)
    same = patch_errors(matching, matching, ["contact.0.quadrature_degree=1"])
    worst = max(same.near, same.far)
    checks.append(Check("stress, matching nodes, 1 point, max error", worst, 1e-6))
    under = ", ".join(f"{along} × {across}" for along, across in MISMATCHES)
    return Verification(
        "patch-space",
        "patch test in space",
        f"The boxes of cases/boxes-3d.toml on one another, held on all sides, pressed from above "
        f"with {PATCH_PRESSURE * 1e-6:g} MPa without friction: σ_yy = −p everywhere. "
        f"{SLAVE_FACETS} × {SLAVE_FACETS} slave facets on {under}.",
        tuple(checks),
    )


DIRECTIONS = (0.0, 30.0, 45.0, 90.0)  # degrees from x towards z
QUICK_BOXES = ("geometry.upper.elements=[5, 3, 5]", "geometry.lower.elements=[7, 2, 7]")


def slide(angle: float, overrides: Sequence[str] = ()) -> tuple[Floats, float]:
    """Friction (i,) and normal force, N, of boxes slid in a direction, rad from x towards z."""
    way = f"[{math.cos(angle)!r}, 0, {math.sin(angle)!r}]"
    direction = f"boundary.1.displacement.direction={way}"
    _, simulation = solve("boxes-3d", [direction, *overrides])
    row = simulation.rows[-1]
    return np.array([row.friction_x, row.friction_y, row.friction_z]), row.normal_force


def isotropy() -> Verification:
    """The same friction, whatever the direction of gross sliding."""
    angles = np.radians(DIRECTIONS)
    found = [slide(float(angle), [*QUICK_BOXES]) for angle in angles]
    size = np.array([np.linalg.norm(friction) for friction, _ in found])
    load = np.array([normal for _, normal in found])
    way = np.array([[math.cos(a), 0.0, math.sin(a)] for a in angles])
    off = [float(np.linalg.norm(f / s - w)) for (f, _), s, w in zip(found, size, way, strict=True)]
    named = ", ".join(f"{d:g}" for d in DIRECTIONS)
    return Verification(
        "isotropy",
        "gross sliding in several directions",
        f"cases/boxes-3d.toml, coarse, slid in directions of {named} degrees from x towards z "
        "until all slides. The boxes are square: elastic deformation, which is still dying out at "
        "the end, is askew to a slide in 30 degrees.",
        (
            Check("friction by direction, largest difference", float(np.ptp(size) / size[0]), 1e-6),
            Check("T/(µN), largest error", apart(size, 0.2 * load), 1e-6),
            Check("angle between friction and motion, max (rad)", max(off), 1e-5),
        ),
    )


# -- Verification of a sphere on a block: Hertz's point contact, twist, sliding on its facets ------

# Of the whole body, over what is computed.
WHOLE = {"axisymmetric": 1, "full": 1, "half": 2, "quarter": 4}


# --- Hertz's point contact -----------------------------------------------------------------------

_DOWN = 'y=[["0 s", "0 mm"], ["1 s", "-6.25 um"]]'
# The section has no cuts to be held.
SECTION = (
    'geometry.part="axisymmetric"',
    f"boundary=[{held('bottom', 'displacement={x=0, y=0}')}, "
    f"{held('top', f'displacement={{x=0, {_DOWN}}}')}]",
)
FINE = ("geometry.contact_size=10 um",)


@dataclass(frozen=True, slots=True)
class Pressed:
    """A sphere pressed on a block without friction; forces and energy of the whole bodies."""

    r: Floats  # (q,), m, of the closed contact points
    pressure: Floats  # (q,), Pa, likewise
    rings: bool  # whether the points stand for rings, those of a section of revolution
    exact: PointContact  # Hertz's contact under the computed normal force
    energy: float  # J, strain energy
    size: float  # m, largest width of a facet in contact
    nodes: int  # of the mesh
    penetration: float  # m, largest

    @property
    def fitted(self) -> tuple[float, float]:
        """Contact radius, m, and peak, Pa, of the ellipse that fits best over the area.

        Rings count by their radius: at the axis, where elements of revolution are too soft (the
        pressure is 3.6 % low over the first of eight facets), there is hardly any area.
        """
        return fit_ellipse(self.r, self.pressure, self.r if self.rings else None)


def press_sphere(overrides: Sequence[str] = ()) -> Pressed:
    """Run ``cases/sphere-on-block.toml``.

    Raises:
        ValueError: the contact has reached the end of the finely meshed zone.
    """
    case, simulation = solve("sphere-on-block", overrides)
    geometry, row = case.geometry, simulation.rows[-1]
    assert isinstance(geometry, SphereGeometry)
    # Distances from the axis, m, and pressures, Pa, of the closed points (q,).
    arrays = contact_arrays(simulation.model)
    assert arrays is not None
    position, pressure = arrays["position"], arrays["pressure"]
    across = position[:, 2] if position.shape[1] == 3 else np.zeros(len(position))
    closed = pressure > 0.0
    r, pressure = np.hypot(position[:, 0], across)[closed], pressure[closed]
    if r.max() > 0.5 * geometry.contact_width - geometry.contact_size:
        raise ValueError("the contact reaches the end of the contact zone; widen contact_width")
    whole = WHOLE[geometry.part]
    return Pressed(
        r,
        pressure,
        geometry.part == "axisymmetric",
        PointContact(whole * row.normal_force, geometry.sphere.radius, case_modulus(case)),
        whole * row.strain_energy,
        geometry.contact_size,
        simulation.model.problem.space.dofmap.index_map.size_global,
        row.max_penetration,
    )


def hertz_point(overrides: Sequence[str] = ()) -> Verification:
    """An elastomer sphere on aluminium: a quarter in space and the section of revolution."""
    quarter = press_sphere(["stage.0.steps=1", *overrides])
    section = press_sphere([*SECTION, *FINE, *overrides])
    checks = []
    for name, found in (("quarter", quarter), ("section", section)):
        radius, peak = found.fitted
        exact = found.exact
        checks += [
            compare(f"{name}: radius a", radius, exact.contact_radius, 0.03, "µm"),
            compare(f"{name}: peak pressure p0", peak, exact.peak, 0.03, "kPa"),
        ]
    checks += _apart(quarter, section)
    e = quarter.exact
    a = e.contact_radius
    return Verification(
        "hertz-point",
        "Hertz's point contact, elastomer on aluminium, in space and of revolution",
        f"cases/sphere-on-block.toml, a quarter in space of {quarter.nodes} nodes with "
        f"{a / quarter.size:.0f} elements over a, and the section of revolution of "
        f"{section.nodes} nodes with {section.exact.contact_radius / section.size:.0f}. Under the "
        f"computed load P = {e.load * 1e3:.4g} mN, a/R = {a / e.radius:.3f}; the largest "
        f"penetration is {quarter.penetration * 1e9:.2g} nm. Radius and peak are those of the "
        "ellipse that fits best over the inner 0.8 of the contact. The last checks hold the "
        "quarter, four times, against the section.",
        tuple(checks),
        (_pressure_panel(quarter, section),),
    )


def _apart(quarter: Pressed, section: Pressed) -> Iterator[Check]:
    """The quarter in space against the section of revolution."""
    (a, p0), (b, q0) = quarter.fitted, section.fitted
    for what, one, other, unit in (
        ("force P", quarter.exact.load, section.exact.load, "mN"),
        ("energy", quarter.energy, section.energy, "nJ"),
        ("radius a", a, b, "µm"),
        ("peak p0", p0, q0, "kPa"),
    ):
        yield compare(f"quarter and section: {what}", one, other, 0.02, unit)


def _pressure_panel(quarter: Pressed, section: Pressed) -> Panel:
    a, peak = quarter.exact.contact_radius, quarter.exact.peak
    r = np.sin(np.linspace(0.0, 0.5 * np.pi, 201))
    return Panel(
        "r / a (-)",
        "pressure / p0 (-)",
        (
            Line("Hertz", r, quarter.exact.pressure(r * a) / peak, exact=True),
            Line("quarter in space", quarter.r / a, quarter.pressure / peak),
            Line(
                "section of revolution",
                section.r / section.exact.contact_radius,
                section.pressure / section.exact.peak,
            ),
        ),
    )


# --- twisting ------------------------------------------------------------------------------------

ANGLES = (0.1, 0.2, 0.4, 0.8, 2.0)  # degrees, one after the other
STEPS = 2  # from each to the next: slip within a step is straight, and spreads inwards in it
_TURNS = ", ".join(f'["{2 + k} s", "{angle} deg"]' for k, angle in enumerate(ANGLES))
# The block is a thousand times as stiff as the sphere: its size matters to no digit given here. The
# springs of stick are stiff, so that they take no part of the angle.
TWIST = (
    'geometry.part="full"',
    "geometry.contact_size=65 um",
    "geometry.growth=2",
    'geometry.block={radius="1 mm", height="1 mm"}',
    'contact.0.friction={law="coulomb", mu=0.3, K_T="3e12 Pa/m"}',
    f"boundary=[{held('bottom', 'displacement={x=0, y=0, z=0}')}, "
    + held("top", f'displacement={{{_DOWN}}}, rotation={{axis="y", angle=[["1 s", 0], {_TURNS}]}}')
    + "]",
    'stage=[{name="press", duration=1, steps=1}, '
    f'{{name="twist", duration={len(ANGLES)}, steps={STEPS * len(ANGLES)}}}]',
)


def sphere_twist(overrides: Sequence[str] = ()) -> Verification:
    """A sphere pressed and turned about its axis, from stick to slip."""
    case, simulation = solve("sphere-on-block", [*TWIST, *overrides])
    friction, geometry = case.contact[0].friction, case.geometry
    assert isinstance(friction, LawTable) and friction.law == "coulomb"
    assert isinstance(geometry, SphereGeometry)
    shear = 1.0 / sum(1.0 / body.shear_modulus for body in case.bodies.values())
    mu = value_at(friction.mu, 0.0)
    checks, rows = [], [row for row in simulation.rows if row.stage == "twist"]
    rows = rows[STEPS - 1 :: STEPS]
    for angle, row in zip(np.radians(ANGLES), rows, strict=True):
        contact = PointContact(row.normal_force, geometry.sphere.radius, case_modulus(case))
        twist = Twist(contact, shear, mu)
        name = f"moment at {math.degrees(angle):.1f}° (c/a = {twist.stuck(angle):.2f})"
        checks.append(compare(name, abs(row.twist_moment), twist.moment(angle), 0.03, "N µm"))
    full = contact.full_twist(mu)
    checks.append(compare("last moment, 3π/16 µPa", abs(row.twist_moment), full, 0.02, "N µm"))
    sideways = max(abs(row.tangential_force) / row.normal_force for row in rows)
    checks.append(Check("friction force / normal force, max", sideways, 1e-6))
    moments = np.array([abs(row.twist_moment) for row in rows])
    elements = contact.contact_radius / geometry.contact_size
    return Verification(
        "sphere-twist",
        "sphere pressed and twisted, Lubkin's partial slip",
        f"The sphere of cases/sphere-on-block.toml, whole, {elements:.0f} elements over a, µ = "
        f"{mu:g}, turned about its axis after pressing; c/a is the share of the radius "
        "that sticks by the closed form.",
        tuple(checks),
        (_twist_panel(twist, moments / full, full),),
    )


def _twist_panel(twist: Twist, moments: Floats, full: float) -> Panel:
    """Moments over that of full slip, computed ones and the closed form's."""
    angles = [float(twist.angle(share)) for share in np.linspace(1.0, 1e-3, 200)]
    angles = [angle for angle in angles if angle < 1.2 * math.radians(ANGLES[-1])]
    exact = np.array([twist.moment(angle) for angle in angles]) / full
    return Panel(
        "angle (degrees)",
        "moment / (3π/16 µPa)",
        (
            Line("Lubkin", np.degrees(np.array(angles)), exact, exact=True),
            Line("computed", np.array(ANGLES), moments),
        ),
    )


# --- sliding -------------------------------------------------------------------------------------

_TURN = 'rotation={axis="z", centre=["0 mm", "10 mm", "0 mm"], angle=[["1 s", 0], ["2 s", 0.012]]}'
_UP = 'y=[["0 s", 0], ["1 s", "6.25 um"]]'
# A stiff sphere turns in a soft block that is pressed against it: one facet after the other of the
# master runs through the contact, and nothing else changes.
ROLL = (
    'geometry.part="half"',
    "geometry.contact_width=0.9 mm",
    "geometry.contact_size=80 um",
    "geometry.growth=2",
    'geometry.block={radius="5 mm", height="5 mm"}',
    'bodies.elastomer={material="hencky", E="70 GPa", nu=0.33}',
    'bodies.aluminium={material="neo-hookean", E="5 MPa", nu=0.45}',
    'contact.0.slave="aluminium_contact"',
    'contact.0.master="elastomer_contact"',
    'contact.0.friction={law="coulomb", mu=0.2}',
    f"boundary=[{held('bottom', f'displacement={{x=0, {_UP}, z=0}}')}, "
    f"{held('top', f'displacement={{z=0}}, {_TURN}')}, "
    f"{held('elastomer_symmetry_z', 'displacement={z=0}')}, "
    f"{held('aluminium_symmetry_z', 'displacement={z=0}')}]",
    'stage=[{name="press", duration=1, steps=1}, {name="slide", duration=1, steps=8}]',
)
SMOOTH = 'contact.0.smoothing_angle="30 deg"'


def jumps(values: Floats) -> float:
    """Largest change from one step to the next, over the mean."""
    return float(np.abs(np.diff(values)).max() / abs(values.mean()))


def roll(overrides: Sequence[str] = ()) -> tuple[Floats, Floats]:
    """Normal force and drag (n,), N, of the whole, in gross sliding over a turning sphere."""
    _, simulation = solve("sphere-on-block", [*ROLL, *overrides])
    rows = [row for row in simulation.rows if row.stage == "slide" and row.stick_fraction == 0.0]
    if len(rows) < 4:
        raise ValueError("the sphere does not slide in gross")
    normal, drag = ([getattr(row, k) for row in rows] for k in ("normal_force", "force_x"))
    return 2.0 * np.array(normal), 2.0 * np.abs(np.array(drag))


def curved_sliding() -> Verification:
    """Sliding over a curved master, smooth and faceted."""
    found = {"smooth": roll([SMOOTH]), "faceted": roll()}
    normal, drag = map(jumps, found["smooth"])
    rough = max(map(jumps, found["faceted"]))
    lines = tuple(
        Line(f"drag, {name} master", np.arange(1.0, 1.0 + len(f)), f / n)
        for name, (n, f) in found.items()
    )
    return Verification(
        "curved-sliding",
        "sliding over a curved master",
        "A stiff sphere turns about its centre in a soft block pressed against it (the geometry "
        "of cases/sphere-on-block.toml, half, facets of 80 µm, 3 over the contact's radius), µ = "
        "0.2: in eight steps of 15 µm one and a half facets run through the contact. Jumps are "
        "the largest changes from step to step, over the mean, with the master smoothed; with "
        f"facets as they are the largest jump is {100 * rough:.2g} %.",
        (
            Check("jumps of the normal force, smooth master", normal, 0.02),
            Check("jumps of the drag, smooth master", drag, 0.02),
            Check("largest jump, smooth over faceted", max(normal, drag) / rough, 0.1),
        ),
        (Panel("step", "drag / normal force", lines),),
    )
