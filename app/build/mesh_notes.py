"""What may surprise once mesh and case are put together: lines for the person who runs it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import dolfinx
import numpy as np

from tribox.app.build.boundary_conditions import ON_AXIS, Loads
from tribox.app.build.mesh import bodies_sharing_nodes, bonded_groups
from tribox.app.case.bodies import ElastoPlasticBody
from tribox.app.case.boundary import COMPONENTS
from tribox.app.case.case import Case
from tribox.app.case.geometry import GeneratedGeometry
from tribox.app.case.stage import solver_of
from tribox.app.case.time_tables import TimeTable
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.supports import connected, free_bodies, loose_directions, sprung_dofs
from tribox.app.equilibrium.unknowns import Prescribed, box_of
from tribox.forms.bodies.loads import Foundation
from tribox.forms.bodies.materials import young_and_poisson
from tribox.forms.bodies.solid import Solid
from tribox.geometry.compat import cell_nodes, entity_nodes
from tribox.geometry.meshes.mesh import NamedMesh
from tribox.geometry.meshes.partition import metis_is_available

SRI = 'formulation = "q1-sri"'


class Locking(NamedTuple):
    """A linear cell: K/G from which it is said to lock, its plural, errors measured, a cure."""

    ratio: float
    plural: str
    measured: str
    cure: str


# Errors are those of the force under a given approach: at the ratio some 5 % where cells
# are twice as coarse. Tetrahedra that do not lock (K/G = 2.6) err by 5 %.
LINEAR = {
    "triangle": Locking(
        10.0,
        "triangles",
        "a pressed cylinder, 20 across the contact, by 7 % at K/G = 25, 10 % at 50, 20 % at 1000",
        f'cell = "quadrilateral" with {SRI}, or formulation = "q2"',
    ),
    "tetrahedron": Locking(
        8.0,
        "tetrahedra",
        "a pressed ball, 8 across the contact, by 10 % at K/G = 10, 19 % at 25, 32 % at 50",
        f'cell = "hexahedron" with {SRI}, or formulation = "q2"',
    ),
    "quadrilateral": Locking(
        10.0,
        "quadrilaterals of full integration",
        "a pressed cylinder, 20 across the contact, by 5 % at K/G = 25, 10 % at 50, 127 % at 1000",
        SRI,
    ),
    "hexahedron": Locking(
        8.0,
        "hexahedra of full integration",
        "a pressed ball, 8 across the contact, by 3 % at K/G = 10, 7 % at 25, 12 % at 50",
        SRI,
    ),
}
LOCKING = 25.0  # K/G of a body that flows, from which quadratic elements are said to lock
SLENDER = 8.0  # length over thickness from which on a body in the plane is one that may bend
HELD = 0.25  # share of what is around it that is held from which on it does not
BOX = 0.1  # share that a body's volume is off that of the box of its moments, to be one
WELL_BENT = "at least four, no longer than a quarter of it, or "
BENDING = 0.1  # share that the stiffness in bending is off by from which on it is told
MANY = 0.5  # share of the cells that are allowed from which they are told
LARGE = 1.0  # extent of a body, m, from which the unit of a mesh that was read is asked for


def notes_on_ranks(case: Case, named: NamedMesh) -> Iterator[str]:
    """A line where contact cannot be shared out evenly among the ranks."""
    wanted = named.mesh.comm.size > 1 and case.solver.partition == "contact"
    if wanted and not metis_is_available():
        yield "METIS (libmetis.so.5) is not installed: slave facets may be on few of the ranks"


def locking_bodies(named: NamedMesh, solids: Sequence[Solid], degree: int) -> Iterator[str]:
    """A line on each body of elements that lock: where the volume hardly changes.

    Linear elements of full integration do so in nearly incompressible bodies and in those that
    flow, triangles and tetrahedra the most; quadratic ones in those that are both.
    """
    cell = named.mesh.topology.cell_name()
    for solid in solids:
        ratio = solid.material.bulk_modulus / solid.material.shear_modulus
        if degree > 1:
            if solid.flows and ratio > LOCKING:
                yield (
                    f"body {solid.name}: quadratic elements of full integration lock with K/G = "
                    f"{ratio:.3g} where it flows (29 % too stiff with six across a thick tube, "
                    '2.5 % with twelve); use formulation = "q1-sri" on quadrilaterals or '
                    "hexahedra, or a lower nu"
                )
        elif solid.flows and not solid.reduced:
            yield (
                f"body {solid.name}: linear elements of full integration lock where a metal flows, "
                'which keeps its volume, and are too stiff; use formulation = "q1-sri" on '
                'quadrilaterals or hexahedra, or formulation = "q2"'
            )
        elif not solid.reduced and ratio > (of_cell := LINEAR[cell]).ratio:
            yield (
                f"body {solid.name}: linear {of_cell.plural} lock with K/G = {ratio:.3g} and are "
                f"too stiff ({of_cell.measured}); use {of_cell.cure}"
            )


class Slender(NamedTuple):
    """A slender body; lengths in m."""

    thickness: float
    cell: float  # of the cells along its sides, root of the mean square
    layers: float  # cells over the thickness
    across: float  # of the cells across the bending; infinite where nothing moves that way


def bending_bodies(case: Case, named: NamedMesh, problem: Equilibrium) -> Iterator[str]:
    """A line on each slender body that linear cells bend too hard or too easily; collective."""
    if problem.space.element.basix_element.degree > 1:
        return
    slender = _in_the_plane if problem.dim == 2 else _in_space
    cell = named.mesh.topology.cell_name()
    for solids, shapes in slender(case, named, problem.solids):
        own = solids[0].material
        _, nu = young_and_poisson(own.shear_modulus, own.bulk_modulus)
        off, shape = min(  # of a bar, the way that is bent better: it may be the one meant
            ((_off_in_bending(shape, nu, cell, solids[0].reduced), shape) for shape in shapes),
            key=lambda found: abs(found[0]),
        )
        if abs(off) > BENDING:
            yield (
                f"body {' with '.join(solid.name for solid in solids)}: where it bends it is some "
                f"{100.0 * abs(off):.0f} % too "
                f"{'stiff' if off > 0.0 else 'soft'}: its linear cells are {shape.cell:.2g} m long,"
                f" {shape.layers:.2g} over a thickness of {shape.thickness:.2g} m; use "
                f'{WELL_BENT if cell != "tetrahedron" else ""}formulation = "q2"'
            )


def _off_in_bending(shape: Slender, nu: float, cell: str, reduced: bool) -> float:
    """Share that the stiffness in pure bending is too large by, or too small.

    A bilinear cell shears by the curvature times its length h, and the stretch across each of n
    layers over the thickness t is constant; in space a beam also bends the other way across, by e
    of the curvature, where it shears by its width b. Of the energies per E/(1 - nu²)

        C - 2 B e + A e²,  C = 1 + (c - 1)/n² + g (h/t)²,  A = 1 + (c - 1)/n² + g (b/t)²,
        B = nu + (d - nu)/n²,  g = (1 - nu)/2,

    c = 2 (1 - nu)/3 and d = c/2 with a reduced volumetric part, and without it (1 - nu)²/(1 - 2 nu)
    and nu (1 - nu)/(1 - 2 nu), the least counts: cantilevers of two layers are as stiff to 8 % of
    the true stiffness, and to 2 % of four. What triangles are off by is fitted to cantilevers (nu =
    0.3 and 0.49, two and four layers), to 4 % of it, and of tetrahedra to a third where gmsh makes
    them, to a half where they divide boxes.
    """
    long, wide, deep = (
        (of / shape.thickness) ** 2
        for of in (shape.cell, shape.across, shape.thickness / shape.layers)
    )
    if cell == "triangle":
        return 1.4 * (1.0 - nu) * long + 1.2 * deep
    if cell == "tetrahedron":
        return 1.3 * long + 2.4 * deep
    layer, cross = (1.0 - nu) ** 2 / (1.0 - 2.0 * nu), nu * (1.0 - nu) / (1.0 - 2.0 * nu)
    if reduced:
        layer, cross = 2.0 * (1.0 - nu) / 3.0, (1.0 - nu) / 3.0
    even, shear = 1.0 + (layer - 1.0) * deep, 0.5 * (1.0 - nu)
    if np.isinf(wide):
        return float(even + shear * long - 1.0)
    least = even + shear * long - (nu + (cross - nu) * deep) ** 2 / (even + shear * wide)
    return float(least / (1.0 - nu**2) - 1.0)


_Shapes = Iterator[tuple[list[Solid], list[Slender]]]


def _in_the_plane(case: Case, named: NamedMesh, solids: Sequence[Solid]) -> _Shapes:
    """Bodies in the plane that are free to bend, with their shapes; collective."""
    held = [b.surface for b in case.boundary if b.holds or b.foundation]
    held += [side for c in case.contact if c.tied for side in (c.slave, c.master)]
    alone = {names[0] for names in bonded_groups(named) if len(names) == 1}
    for solid in solids:
        shape = _slender(named, solid, sorted({*held} & {*named.surfaces}))
        if shape is not None and solid.name in alone:
            yield [solid], [shape]


def _slender(named: NamedMesh, solid: Solid, held: Sequence[str]) -> Slender | None:
    """The shape of a body that is free to bend; None of one that is not slender; collective."""
    mesh, x = named.mesh, named.mesh.geometry.x
    mesh.topology.create_connectivity(1, 2)
    sides = dolfinx.mesh.exterior_facet_indices(mesh.topology)
    cells = mesh.topology.connectivity(1, 2)
    mine = np.array([cells.links(side)[0] for side in sides], dtype=np.int32)
    sides = sides[np.isin(mine, solid.cells)]
    ends = x[entity_nodes(mesh, 1, sides)]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) if len(sides) else np.empty(0)
    fixed = np.isin(sides, np.concatenate([np.empty(0, int), *map(named.facets, held)]))
    if solid.section == "axisymmetric":  # a rod on its axis does not bend
        fixed |= np.abs(ends[..., 0]).max(axis=1, initial=0.0) <= ON_AXIS * length
    corners = x[cell_nodes(mesh)[solid.cells]]
    # Diagonals of a quadrilateral, whose corner 3 lies across from 0; two sides of a triangle.
    one = corners[:, -1] - corners[:, 0]
    other = corners[:, -2] - corners[:, 1 if corners.shape[1] == 4 else 0]
    area = 0.5 * np.abs(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])
    count = len(area) * (1.0 if corners.shape[1] == 4 else 0.5)  # two triangles make a rectangle
    parts = [length.sum(), len(sides), area.sum(), count, (length**3).sum(), length[fixed].sum()]
    around, facets, whole, count, cubes, fast = mesh.comm.allreduce(np.array(parts))
    long, thick = _sides(around, whole)
    if long < SLENDER * thick or fast > HELD * around:
        return None
    layers = _sides(facets, count)[1]
    return Slender(thick, float(np.sqrt(cubes / around)), layers, np.inf)


def _sides(around: float, whole: float) -> tuple[float, float]:
    """Long and short side of the rectangle of a circumference and an area."""
    root = np.sqrt(max(around**2 / 16.0 - whole, 0.0))
    return float(around / 4.0 + root), float(around / 4.0 - root)


def _in_space(case: Case, named: NamedMesh, solids: Sequence[Solid]) -> _Shapes:
    """Straight bodies in space that are free to bend, with the shapes of each; collective.

    Bodies of one material that share nodes, or are tied, bend as one; those of several are left
    out.
    """
    number = {solid.name: k for k, solid in enumerate(solids)}
    tied = [
        {number[name] for side in (c.slave, c.master) for name in named.bodies_of(side)}
        for c in case.contact
        if c.tied and c.master not in case.tools
    ]
    bonded = [{number[name] for name in names} for names in bonded_groups(named)]
    pairs = [(min(one), k) for one in (*tied, *bonded) for k in one]
    held = [b.surface for b in case.boundary if b.holds or b.foundation]
    held += [c.slave for c in case.contact if c.tied and c.master in case.tools]
    for group in connected(len(solids), pairs):
        joined = [solids[k] for k in group]
        kinds = {(s.material.shear_modulus, s.material.bulk_modulus, s.reduced) for s in joined}
        shapes = list(_beams(named, joined, sorted({*held} & {*named.surfaces})))
        if len(kinds) == 1 and shapes:
            yield joined, shapes


def _beams(named: NamedMesh, solids: Sequence[Solid], held: Sequence[str]) -> Iterator[Slender]:
    """The ways in which bodies that are one box may bend along its longest side; collective.

    The box is that of the same second moments, a²/12, and nothing is said where its volume differs.
    """
    mesh, x = named.mesh, named.mesh.geometry.x
    mesh.topology.create_connectivity(2, 3)
    cells = np.concatenate([solid.cells for solid in solids])
    facets = dolfinx.mesh.exterior_facet_indices(mesh.topology)
    behind = mesh.topology.connectivity(2, 3)
    facets = facets[np.isin(behind.array[behind.offsets[facets]], cells)]
    corner = x[cell_nodes(mesh)[cells[cells < mesh.topology.index_map(3).size_local]]]
    box = corner.shape[1] == 8
    edges = corner[:, 1:] - corner[:, :1]
    if box:  # means of four, as bits of a corner's number tell its side
        sides = (np.arange(8) >> np.arange(3)[:, None]) & 1
        edges = np.einsum("ka,cai->cki", 0.5 * sides - 0.25, corner)
    volume = np.abs(np.linalg.det(edges)) / (1.0 if box else 6.0)
    middle = corner.mean(axis=1)
    arm = corner - middle[:, None]
    size = np.einsum("c,cai,caj->ij", volume, arm, arm) / corner.shape[1]
    side = x[entity_nodes(mesh, 2, facets)]
    normal = 0.5 * np.cross(side[:, -1] - side[:, 0], side[:, -2] - side[:, 1 if box else 0])
    normal /= np.sqrt(np.maximum(np.linalg.norm(normal, axis=1), 1e-300))[:, None]
    fixed = np.isin(facets, np.concatenate([np.empty(0, int), *map(named.facets, held)]))
    first, second = volume @ middle, np.einsum("c,ci,cj->ij", volume, middle, middle)
    parts = [size, second, normal.T @ normal, normal[fixed].T @ normal[fixed], first, volume.sum()]
    sums = mesh.comm.allreduce(np.concatenate([np.ravel(part) for part in parts]))
    size, second, around, fast = sums[:36].reshape(4, 3, 3) / sums[-1]
    mean = sums[36:39] / sums[-1]
    # Of the corners of a box of sides h: h²/4; of six tetrahedra in it, h²/4.8.
    inertia = second - np.outer(mean, mean) + size / (3.0 if box else 5.0)
    # Across a square any two axes are principal ones: those of the cells, or of what is held.
    _, axes = np.linalg.eigh(inertia - 1e-3 * (size + np.trace(size) / np.trace(around) * fast))
    squares, cells_squares, around, fast = (
        np.einsum("ik,ij,jk->k", axes, of, axes)
        for of in (12.0 * inertia, (4.0 if box else 4.8) * size, around, fast)
    )
    lengths, cell, share = np.sqrt(squares), np.sqrt(cells_squares), fast / around
    if abs(sums[-1] / lengths.prod() - 1.0) > BOX:
        return
    long = int(np.argmax(lengths - 1e-2 * cell))  # of a square, the way with the shorter cells
    for thick, across in ((long - 1, long - 2), (long - 2, long - 1)):
        t = lengths[thick]
        if lengths[long] >= SLENDER * t and share[thick] <= HELD:
            free = share[across] <= HELD and lengths[across] < SLENDER * t
            yield Slender(t, cell[long], t / cell[thick], cell[across] if free else np.inf)


def many_cells(case: Case, named: NamedMesh) -> Iterator[str]:
    """A line on a mesh whose number of cells is near the most that are allowed."""
    cells = named.cell_count
    if cells > MANY * case.geometry.max_cells:
        yield f"the mesh has {cells} cells; geometry.max_cells allows {case.geometry.max_cells}"


def bonded_bodies(named: NamedMesh) -> Iterator[str]:
    """A line on each two bodies that share nodes; collective."""
    for (first, second), count in bodies_sharing_nodes(named).items():
        yield f"bodies {first} and {second} share {count} nodes: they are bonded there"


def large_mesh(case: Case, named: NamedMesh) -> Iterator[str]:
    """A line on a mesh that was read without a scale and may not be in metres; collective."""
    if isinstance(case.geometry, GeneratedGeometry) or case.geometry.says_unit:
        return
    extent = float(np.ptp(box_of(named.mesh.comm, named.mesh.geometry.x), axis=0).max())
    if extent > LARGE:
        yield (
            f"mesh {case.geometry.mesh}: {extent:.3g} m long; coordinates are taken as metres, "
            'set geometry.scale = "mm" if they are millimetres'
        )


# -- Values that a case may have and that are hardly meant: a bare number in another unit, mostly --

FAR = 10.0  # displacement over the extent of the mesh from which it is told
THIN, THICK = 1e-3, 100.0  # of a slab over the extent of the mesh: one that is meant
ROUGHEST = 5.0  # coefficient of friction that rubber, stickiest of all, stays below by far
YIELD_STRAIN = (1e-5, 0.1)  # yield stress over Young's modulus: of metals from 1e-4 to 2e-2
SOFT_METAL = 1e6  # Pa, Young's modulus, below which one given in MPa was surely meant


def notes_on_slips(case: Case, named: NamedMesh) -> Iterator[str]:
    """A line on each value that is out of proportion; collective."""
    yield from _yield_strains(case)
    yield from _coefficients(case)
    extent = float(np.ptp(box_of(named.mesh.comm, named.mesh.geometry.x), axis=0).max())
    yield from _slab(case, extent)
    for key, program in _displacements(case):
        way = max(map(abs, program.values))
        if way > FAR * extent:
            yield (
                f"{key}: goes as far as {way:.3g} m, {way / extent:.2g} times the extent of the "
                "mesh; a number without a unit is in m"
            )
    for index, key, step in _driven_steps(case):
        if step > extent:
            yield (
                f"stage.{index}.{key}: driven boundaries move {step:.3g} m in one step, "
                f"{step / extent:.2g} times the extent of the mesh; a number without a unit is in m"
            )


def _slab(case: Case, extent: float) -> Iterator[str]:
    """A line on a slab of a thickness that no part of this extent, m, has; 1 m is per metre."""
    slab = case.geometry.slab
    if slab != 1.0 and not THIN * extent <= slab <= THICK * extent:
        yield (
            f"geometry.thickness = {slab:g} m: {slab / extent:.2g} times the extent of the mesh, "
            f"{extent:.3g} m; forces are for this thickness (default: 1 m, forces per metre), and "
            "a number without a unit is in m"
        )


def _coefficients(case: Case) -> Iterator[str]:
    """A line on each coefficient of friction that no pair of bodies has."""
    for index, contact in enumerate(case.contact):
        for key in ("mu", "mu_s"):
            value = getattr(contact.friction, key, 0.0)
            most = max(map(abs, value.values)) if isinstance(value, TimeTable) else value
            if most > ROUGHEST:
                yield (
                    f"contact.{index}.friction.{key} = {most:g}: rubber on dry metal has 1 to 3, "
                    "lubricated 0.05 to 0.3; is it in per cent?"
                )


def _driven_steps(case: Case) -> Iterator[tuple[int, str, float]]:
    """Number of the stage, key and way (m) of a step of every driven stage that is implicit."""
    for index, stage in enumerate(case.stage):
        if stage.slip_step is not None:
            yield index, "slip_step", stage.slip_step
        elif (stage.solver or case.solver.kind) == "explicit":
            continue  # its steps are many to a row
        elif stage.velocity and stage.duration is not None:
            yield index, "velocity", abs(stage.velocity) * stage.duration / stage.steps


def _yield_strains(case: Case) -> Iterator[str]:
    """A line on each body that yields at a strain, or is as soft, as no metal is."""
    least, most = YIELD_STRAIN
    for name, body in case.bodies.items():
        if not isinstance(body, ElastoPlasticBody):
            continue
        stress = float(body.hardening.parameters().stress(np.zeros(1))[0])
        modulus, _ = young_and_poisson(body.shear_modulus, body.bulk_modulus)
        if not least <= stress / modulus <= most:
            yield (
                f"bodies.{name}: yields at {stress:.3g} Pa, {stress / modulus:.2g} of Young's "
                f"modulus, {modulus:.3g} Pa; metals yield at 0.0001 to 0.02 of it, and a number "
                "without a unit is in Pa"
            )
        elif modulus < SOFT_METAL:
            yield (
                f"bodies.{name}: Young's modulus is {modulus:.3g} Pa, and that of soft metals some "
                "1e10 Pa; a number without a unit is in Pa"
            )


def _displacements(case: Case) -> Iterator[tuple[str, TimeTable]]:
    """The programs of displacement of boundaries and tools, by their keys."""
    tables = [(f"boundary.{n}", one.displacement) for n, one in enumerate(case.boundary)]
    tables += [(f"tools.{name}", tool.displacement) for name, tool in case.tools.items()]
    for place, table in tables:
        for component in COMPONENTS if table is not None else ():
            program = getattr(table, component)
            if isinstance(program, TimeTable):
                yield f"{place}.displacement.{component}", program


# -- Notes on the directions in which contact alone supports a body --------------------------------


def notes_on_supports(problem: Equilibrium, touching: bool) -> Iterator[str]:
    """A line on each body and direction that contact alone supports; collective.

    A spring or a foundation is a support. A platen is one where the bodies touch from the start, as
    they are meant to then.
    """
    moved = [p.dofs for p in problem.constraints.aligned if touching]
    for one in loose_directions(problem, np.concatenate([sprung_dofs(problem), *moved])):
        why = f"no boundary prescribes a displacement in {one.direction}"
        if one.kind == "tool":
            why = f"a {'moment' if one.turns else 'force'} drives it in {one.direction}"
        yield f"{one.name}: {why}; only contact holds it there"


# -- Bodies that nothing holds any more once supports have vanished or are released ----------------


def drifting(case: Case, named: NamedMesh, problem: Equilibrium, loads: Loads) -> Iterator[str]:
    """A line on each implicit stage from which on bodies can drift; collective.

    Only cases whose supports change are looked at: of the others other notes say what contact
    alone holds.
    """
    if not any(b.stages for b in case.boundary) and not any(s.release for s in case.stage):
        return
    said = set[tuple[tuple[str, ...], tuple[str, ...]]]()
    for stage in case.stage:
        if solver_of(stage, case.solver.kind) != "implicit":
            continue
        with _supports_of(case, problem, loads, stage.name):
            free = free_bodies(problem)
        for body in free:
            names = body.joined.names
            if (names, body.motions) not in said:
                said.add((names, body.motions))
                touching = any(_touch(case, named, stage.name, name) for name in names)
                yield _line(stage.name, body.name, ", ".join(body.motions), touching)


@contextmanager
def _supports_of(case: Case, problem: Equilibrium, loads: Loads, stage: str) -> Iterator[None]:
    """Let constraints, foundations and ties be those of a stage within the context."""
    changed: list[tuple[Any, str, Any]] = []

    def put(part: Any, name: str, value: object) -> None:
        changed.append((part, name, getattr(part, name)))
        setattr(part, name, value)

    for one in loads.constraints:
        put(one.part, "acts", one.acts(stage))
        if not isinstance(one.part, Prescribed):
            put(one.part, "displacement", 0.0 if one.given(stage) else None)
    for load, surface in zip(loads.forms.loads, loads.forms.surfaces, strict=True):
        tables = [b for b in case.boundary if b.surface == surface and b.foundation]
        if isinstance(load, Foundation):
            springs = [b.foundation for b in tables if b.foundation and b.acts_in(stage)]
            put(load, "strongest", load.strongest)
            amount = np.zeros_like(load.amount)
            if springs:
                amount[-2:] = springs[0].normal, springs[0].tangential
            put(load, "amount", amount)
    for table, term in zip(case.contact, problem.contacts, strict=True):
        put(term, "active", case.acts_in(table, stage))
    try:
        yield
    finally:
        for part, name, value in reversed(changed):
            setattr(part, name, value)


def _line(stage: str, bodies: str, free: str, touching: bool) -> str:
    """What is said of bodies that can drift."""
    what = f"stage {stage}: no boundary holds {bodies} against {free}"
    if touching:
        return f"{what}; only contact does, and weak springs where it opens"
    return (
        f"{what}; springs too weak for any load do; if a load acts, give a [[boundary]] for this "
        "stage, such as displacement = { x = 0 } of a point or surface that carries next to nothing"
    )


def _touch(case: Case, named: NamedMesh, stage: str, body: str) -> bool:
    """Whether a body is in a contact of a stage; collective."""
    surfaces = {
        surface
        for one in case.contact
        if case.acts_in(one, stage)
        for surface in (one.slave, *([] if one.master in case.tools else [one.master]))
    }
    return any([body in named.bodies_of(surface) for surface in sorted(surfaces)])
