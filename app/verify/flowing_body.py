"""A body of metal by itself for verification: a grid put into any shape, its sides, its steps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import basix.ufl
import dolfinx
import numpy as np
from mpi4py import MPI

from tribox.app.equilibrium.constraints import Platen, Prescribed, component_dofs
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.implicit.options import ImplicitOptions
from tribox.app.implicit.stepper import ImplicitStepper
from tribox.forms.bodies.kinematics import Section
from tribox.forms.bodies.loads import Load
from tribox.forms.bodies.materials import Material
from tribox.forms.bodies.memory_solid import make_solid
from tribox.forms.bodies.solid import DEGREE, Formulation
from tribox.geometry.compat import cell_nodes, mesh_of_cells
from tribox.geometry.surfaces.facets import Floats, Ints

SIDES = (("left", "right"), ("bottom", "top"), ("back", "front"))
"""Names of the sides of a grid, where its coordinates are 0 and 1."""
STOP = 1e-9  # residual norm of a step, relative to its forces


@dataclass(frozen=True, slots=True)
class Shape:
    """A grid of quadrilaterals or hexahedra put into a shape.

    Attributes:
        counts: elements along each axis.
        place: from points (n, i) of the unit square or cube to their places (n, i), m.
        section: what the grid stands for.
        formulation: of the elements.
    """

    counts: tuple[int, ...]
    place: Callable[[Floats], Floats]
    section: Section = "plane-strain"
    formulation: Formulation = "q1-sri"


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
