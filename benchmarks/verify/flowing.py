"""Metals that flow: a thick tube under inner pressure, bars drawn to their largest load."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import basix.ufl
import dolfinx
import numpy as np
from mpi4py import MPI

from benchmarks.verify.metal_bar import inner_pressure, load_maximum, stress_at
from benchmarks.verify.result import Check, Line, Panel, Verification, apart, compare, solve
from tribox.app.case.generators import PlacedBlocksGeometry
from tribox.app.equilibrium.constraints import Platen, Prescribed, component_dofs
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.implicit.newton import ImplicitOptions
from tribox.app.implicit.stepper import ImplicitStepper
from tribox.forms.bodies.elastoplastic import ElastoPlastic
from tribox.forms.bodies.hardening import Backstress, Hardening, Swift, Voce
from tribox.forms.bodies.kinematics import Section
from tribox.forms.bodies.loads import FollowerPressure, Load
from tribox.forms.bodies.materials import Material, young_and_poisson
from tribox.forms.bodies.memory_solid import make_solid
from tribox.forms.bodies.solid import DEGREE, Formulation
from tribox.geometry.compat import cell_nodes, mesh_of_cells
from tribox.geometry.surfaces.facets import Floats, Ints

# -- A body of metal by itself for verification: a grid put into any shape, its sides, its steps ---

SIDES = (("left", "right"), ("bottom", "top"), ("back", "front"))
"""Names of the sides of a grid, where its coordinates are 0 and 1."""
STOP = 1e-9  # residual norm of a step, relative to its forces


@dataclass(frozen=True, slots=True)
class Shape:
    """A grid of quadrilaterals or hexahedra put into a shape."""

    counts: tuple[int, ...]  # elements along each axis
    # from points (n, i) of the unit square or cube to their places (n, i), m
    place: Callable[[Floats], Floats]
    section: Section = "plane-strain"  # what the grid stands for
    formulation: Formulation = "q1-sri"  # of the elements


class FlowingBody:
    """One body on one rank, to be held and loaded by its sides.

    Attributes:
        u: displacement, m; X: (n, i), m, undeformed places of its nodes.
        solid: the body; section: what the grid stands for.
    """

    def __init__(self, shape: Shape, material: Material) -> None:
        """Make mesh and forms."""
        mesh = _unit_grid(shape.counts)
        dim = len(shape.counts)
        self._facets = {
            name: dolfinx.mesh.locate_entities_boundary(
                mesh, dim - 1, lambda x, k=axis, at=end: np.isclose(x[k], at)
            )
            for axis in range(dim)
            for end, name in enumerate(SIDES[axis])
        }
        mesh.geometry.x[:, :dim] = shape.place(mesh.geometry.x[:, :dim])
        degree, self.section = DEGREE[shape.formulation], shape.section
        space = dolfinx.fem.functionspace(mesh, ("Lagrange", degree, (dim,)))
        self.u = dolfinx.fem.Function(space)
        self.X: Floats = space.tabulate_dof_coordinates()[:, :dim]
        cells = np.arange(mesh.topology.index_map(dim).size_local, dtype=np.int32)
        self.solid = make_solid(
            "metal", self.u, cells, material, shape.formulation, section=shape.section
        )

    def facets(self, side: str) -> Ints:
        """Facets of a side."""
        return self._facets[side]

    def nodes(self, side: str) -> Ints:
        """Nodes of a side."""
        return component_dofs(self.u.function_space, self.facets(side), 0) // self.X.shape[1]

    def held(self, side: str, component: int) -> Prescribed:
        """A displacement component of a side, prescribed: zero until it is set."""
        return Prescribed.on(self.u, self.facets(side), component)

    def stepper(
        self,
        prescribed: Sequence[Prescribed],
        loads: Sequence[Load] = (),
        platens: Sequence[Platen] = (),
    ) -> ImplicitStepper:
        """What solves its steps."""
        problem = Equilibrium(self.u, [self.solid], [], prescribed, platens, loads)
        return ImplicitStepper(problem, ImplicitOptions(STOP))

    @property
    def moved(self) -> Floats:
        """Displacements (n, i), m, of its nodes at the last evaluation."""
        return self.u.x.array.reshape(self.X.shape)


def _unit_grid(counts: Sequence[int]) -> dolfinx.mesh.Mesh:
    """A grid on the unit square or cube, with the coordinate element that meshes of gmsh have."""
    dim = len(counts)
    cell = "hexahedron" if dim == 3 else "quadrilateral"
    make = dolfinx.mesh.create_box if dim == 3 else dolfinx.mesh.create_rectangle
    corners = [[0.0] * dim, [1.0] * dim]
    made = make(MPI.COMM_SELF, corners, list(counts), dolfinx.mesh.CellType[cell])
    variant = basix.LagrangeVariant.equispaced
    element = basix.ufl.element("Lagrange", cell, 1, lagrange_variant=variant, shape=(dim,))
    nodes = cell_nodes(made).astype(np.int64)
    places = made.geometry.x[:, :dim]
    return mesh_of_cells(MPI.COMM_SELF, nodes, places, element)


def rectangle(low: tuple[float, ...], high: tuple[float, ...]) -> Callable[[Floats], Floats]:
    """Places of a rectangle or box between two corners, m."""
    start, size = np.array(low), np.array(high) - np.array(low)
    return lambda x: start + x * size


# -- Metals that flow: a thick tube under inner pressure, bars drawn to their largest load ---------

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
        return apart(self.pressure, self.exact)


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
        # Over the bore's deformed area.
        pressure.append(force / (2.0 * np.pi * (INNER + moved) * slab))
    return _tube(displacement, np.array(pressure), material)


def quarter_of_tube(
    material: ElastoPlastic,
    elements: tuple[int, int] = (12, 12),
    formulation: Formulation = "q1-sri",
    pressures: Floats | None = None,
) -> Tube:
    """A quarter of the section in plane strain, blown up by a pressure that follows the surface.

    ``elements``: through the wall and around; ``pressures``: Pa; default: the closed form's at
    ``GROWTH``.
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

    ``counts``: elements; the bar lies along the last axis. ``section``: "axisymmetric" or "3D".
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
            compare(f"{name}: largest force / area", top[1], stress, 5e-3, "MPa"),
            compare(f"{name}: strain there", np.log(top[0]), float(np.log(stretch)), 5e-3),
            Check(f"{name}: force all the way", apart(bar.stress, exact), 1e-3),
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


# -- Verification of metal pressed by a rigid tool: a billet upset without friction ----------------

FRICTIONLESS = 'contact.0.friction={law="frictionless"}'
COARSE = ("geometry.blocks.billet.elements=[4, 3]", "stage.0.steps=10")
WAYS: dict[str, tuple[str, ...]] = {
    "4 × 3 elements, 10 steps": COARSE,
    "4 × 3 elements, 40 steps": COARSE[:1],
    "a tenth of the penalty": (*COARSE, "contact.0.penalty_factor=3"),
    "ten times the penalty": (*COARSE, "contact.0.penalty_factor=300"),
}


@dataclass(frozen=True, slots=True)
class Billet:
    """A billet that was upset: a value for each step."""

    travelled: Floats  # of the die, over the height before, subtracted from 1
    stretch: Floats  # height over that before; less travelled, where the die penetrates
    force: Floats  # N, of the die
    young: float  # E, Pa
    hardening: Hardening  # yield stress
    area: float  # m², before

    def exact(self, stretch: Floats) -> Floats:
        """Force of the closed form, N."""
        return -self.area * stress_at(stretch, self.young, self.hardening, pressed=True)


def billet(overrides: Sequence[str] = ()) -> Billet:
    """Upset the billet of ``cases/forming/upsetting.toml`` without friction."""
    case, simulation = solve("forming/upsetting", (FRICTIONLESS, *overrides))
    geometry = case.geometry
    assert isinstance(geometry, PlacedBlocksGeometry)
    (block,) = geometry.blocks.values()
    height = block.y[1] - block.y[0]
    tool = next(iter(case.tools.values()))
    assert tool.displacement is not None
    down = tool.displacement.y
    assert down is not None and not isinstance(down, str)
    rows = simulation.rows
    travelled = np.array([1.0 + down(row.time) / height for row in rows])
    (solid,) = simulation.model.problem.solids
    material = solid.material
    assert isinstance(material, ElastoPlastic)
    return Billet(
        travelled=travelled,
        stretch=travelled + np.array([row.max_penetration for row in rows]) / height,
        force=np.array([row.normal_force for row in rows]),
        young=young_and_poisson(material.shear_modulus, material.bulk_modulus)[0],
        hardening=material.hardening,
        area=np.pi * block.x[1] ** 2,
    )


def upset() -> Verification:
    """Force of the die over the height, by step sizes and penalties."""
    shipped = billet(("stage.0.steps=10",))
    at_travel = shipped.exact(shipped.travelled)
    checks = [
        Check("force over the die's travel, as shipped", apart(shipped.force, at_travel), 1e-3)
    ]
    fine = np.linspace(0.9999, shipped.stretch[-1], 100)
    lines = [_line("closed form", fine, shipped.exact(fine), exact=True)]
    lines.append(_line("as shipped", shipped.travelled, shipped.force))
    for name, overrides in WAYS.items():
        found = billet(overrides)
        error = apart(found.force, found.exact(found.stretch))
        checks.append(Check(f"force over the height, {name}", error, 1e-3))
        lines.append(_line(name, found.stretch, found.force))
    return Verification(
        "upset",
        "billet upset between rigid planes without friction",
        "`cases/forming/upsetting.toml` without friction: every point of the billet is in uniaxial "
        "compression. The force is compared at the travel of the die with the mesh of the case, "
        "and at the height of the billet, the travel less the penetration, with a coarser one. "
        "Errors are the largest of all steps.",
        tuple(checks),
        (Panel("reduction of height (%)", "force (kN)", tuple(lines)),),
    )


def _line(name: str, stretch: Floats, force: Floats, exact: bool = False) -> Line:
    return Line(name, 100.0 * (1.0 - stretch), 1e-3 * force, exact)
