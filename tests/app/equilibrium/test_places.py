"""Places in the undeformed bodies, found and put into words."""

import dolfinx
import dolfinx.fem.petsc
import numpy as np
import pytest
import ufl
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.equilibrium import bodies, matrix_values
from tribox.app.equilibrium.bodies import CellPlaces
from tribox.app.equilibrium.equilibrium import load_residuals
from tribox.app.equilibrium.matrix_values import (
    PlacesOfPart,
    own_block,
    values_in_place,
)
from tribox.app.equilibrium.pattern import Pattern, cell_matrix
from tribox.app.equilibrium.unknowns import NodalLoad, place_of_largest, place_text
from tribox.forms.bodies.loads import FollowerPressure


def test_places_are_read_without_roundoff():
    assert place_text((6e-4, 2.776e-21)) == "(0.0006, 0) m"
    assert place_text((0.0, 0.0)) == "(0, 0) m"


def test_the_place_of_the_largest_number():
    mesh = dolfinx.mesh.create_rectangle(MPI.COMM_SELF, [[0.0, 0.0], [2.0, 1.0]], (4, 3))
    space = dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (2,)))
    where = space.tabulate_dof_coordinates()[:, :2]
    for component in (0, 1):
        values = np.zeros(where.shape)
        values[:, component] = np.exp(-((where - [1.5, 1.0]) ** 2).sum(axis=1))
        assert place_of_largest(values.reshape(-1), space) == pytest.approx((1.5, 1.0))


# -- Element matrices added where they lie, against PETSc's own addition ---------------------------


def matrix_of(mesh):
    """A displacement space and a matrix with its pattern, on the ranks of the mesh."""
    dim = mesh.geometry.dim
    space = dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (dim,)))
    A = cell_matrix(space)
    A.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, True)
    return space, A


def add_all(places, A, matrices):
    """Add element matrices (c, a, i, b, j) of all cells; a compiled loop does this at once."""
    columns = places.starts[..., None] + np.arange(matrices.shape[-1])
    if len(places.starts):
        with places.values(A) as values:
            values += np.bincount(
                columns.reshape(-1), matrices[places.inside].reshape(-1), minlength=len(values)
            )
    places.add_outside(A, matrices[~places.inside])


def difference(mesh, every=1, condensed=None):
    """Largest difference between both ways of adding, each done twice, and of what is inside."""
    space, A = matrix_of(mesh)
    if condensed is not None:
        numbers = condensed(A.getLGMap()[0].indices)
        lgmap = PETSc.LGMap().create(numbers, bsize=1, comm=mesh.comm)
        A.setLGMap(lgmap, lgmap)
        A.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, False)
    dim, count = mesh.geometry.dim, mesh.topology.index_map(mesh.topology.dim).size_local
    nodes = np.asarray(space.dofmap.list)[:count:every]
    shape = (len(nodes), nodes.shape[1], dim)
    values = np.random.default_rng(mesh.comm.rank).uniform(-1, 1, (*shape, *shape[1:]))
    for _ in range(2):
        for cell, matrix in zip(nodes, values, strict=True):
            unknowns = (cell[:, None] * dim + np.arange(dim)).reshape(-1).astype(PETSc.IntType)
            block = matrix.reshape(len(unknowns), -1)
            A.setValuesLocal(unknowns, unknowns, block, addv=PETSc.InsertMode.ADD_VALUES)
    A.assemble()
    wanted = A.copy()
    A.zeroEntries()
    places = CellPlaces(A, nodes, dim)
    for _ in range(2):
        add_all(places, A, values)
    A.assemble()
    A.axpy(-1.0, wanted)
    inside = mesh.comm.allreduce(int(places.inside.sum())), mesh.comm.allreduce(len(nodes))
    return A.norm(PETSc.NormType.INFINITY) / wanted.norm(PETSc.NormType.INFINITY), inside


def test_places_in_a_pattern_that_is_widened_are_as_if_looked_up_anew():
    mesh = dolfinx.mesh.create_box(MPI.COMM_SELF, [[0, 0, 0], [1, 1, 1]], [4, 3, 3])
    space, A = matrix_of(mesh)
    nodes = np.asarray(space.dofmap.list)
    places = CellPlaces(A, nodes, 3)
    count, rng = A.getSize()[0], np.random.default_rng(1)
    wide = A.copy()
    wide.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, False)
    for row in rng.integers(0, count, count // 3):
        wide.setValue(row, rng.integers(0, count), 0.0, addv=PETSc.InsertMode.ADD_VALUES)
    wide.assemble()
    wanted = CellPlaces(wide, nodes, 3)
    assert not np.array_equal(places.starts, wanted.starts)
    moved = CellPlaces(wide, nodes, 3, places)
    np.testing.assert_array_equal(moved.starts, wanted.starts)
    np.testing.assert_array_equal(moved.inside, wanted.inside)
    np.testing.assert_array_equal(moved.dense, wanted.dense)


def rectangle(comm, cell="quadrilateral"):
    return dolfinx.mesh.create_rectangle(
        comm, [[0, 0], [1, 1]], [5, 4], dolfinx.mesh.CellType[cell]
    )


@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
def test_a_body_that_is_part_of_the_mesh(cell):
    apart, (inside, cells) = difference(rectangle(MPI.COMM_SELF, cell), every=2)
    assert apart < 1e-15
    assert inside == cells


def test_unknowns_that_follow_another():
    """The cells of a platen are outside: their columns are not in order."""

    def onto_the_first(numbers):
        return np.where(np.isin(numbers, [7, 13, 21]), 1, numbers).astype(PETSc.IntType)

    apart, (inside, cells) = difference(rectangle(MPI.COMM_SELF), condensed=onto_the_first)
    assert apart < 1e-15
    assert 0 < inside < cells


def test_places_that_cannot_be_had_are_left_to_petsc(monkeypatch):
    for module in (bodies, matrix_values):
        monkeypatch.setattr(module, "is_direct", lambda A: False)
    apart, (inside, _) = difference(rectangle(MPI.COMM_SELF))
    assert apart < 1e-15
    assert inside == 0


def test_an_entry_without_room_is_an_error():
    space, _ = matrix_of(rectangle(MPI.COMM_SELF))
    nodes = np.asarray(space.dofmap.list)
    with pytest.raises(RuntimeError, match="not in the matrix's pattern"):
        CellPlaces(cell_matrix(space, np.arange(len(nodes) - 1, dtype=np.int32)), nodes, 2)


def both_meshes(comm, directory):
    box = dolfinx.mesh.create_box(
        comm, [[0, 0, 0], [1, 1, 1]], [3, 4, 2], dolfinx.mesh.CellType.hexahedron
    )
    apart = [difference(mesh) for mesh in (rectangle(comm), box)]
    space = dolfinx.fem.functionspace(box, ("Lagrange", 1, (3,)))
    return {"difference": apart, "part": taken_out(space)}


@pytest.mark.mpi(both_meshes, 2, 3)
def test_rows_and_columns_of_other_ranks(on_ranks):
    for ranks in (1, 2, 3):
        for apart, (inside, cells) in on_ranks(both_meshes, ranks)["difference"]:
            assert apart < 1e-15
            assert 0 < inside < cells if ranks > 1 else inside == cells


# -- A part of a matrix taken out by places, and the matrix laid out anew with more entries --------


def coupled(comm, size, apart):
    """This rank's pairs of global nodes, and of unknowns; ``apart``: none of two even nodes."""
    nodes = np.random.default_rng((comm.rank, apart)).integers(size, size=(40, 2))
    nodes = nodes[~(apart & np.all(nodes % 2 == 0, axis=1))]
    return nodes, np.array([[3 * nodes[0, 0] + 1, (3 * nodes[0, 1] + 7) % (3 * size)]])


def expected(space, comm, pairs):
    """All rows of a pattern, dense: what a form over all cells has, and what was added on top."""
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    cells = dolfinx.fem.petsc.assemble_matrix(dolfinx.fem.form(ufl.inner(u, v) * ufl.dx))
    cells.assemble()
    out = dense(cells)
    for nodes, entries in comm.allgather(pairs):
        for one, other in np.concatenate([nodes, nodes[:, ::-1]]):
            out[3 * one : 3 * one + 3, 3 * other : 3 * other + 3] = True
        out[entries[:, 0], entries[:, 1]] = True
    return out


def dense(A):
    """Where a matrix has entries, in rows of all ranks."""
    (first, end), (indptr, columns, _) = A.getOwnershipRange(), A.getValuesCSR()
    mine = np.zeros((end - first, A.getSize()[1]), dtype=bool)
    mine[np.repeat(np.arange(end - first), np.diff(indptr)), columns] = True
    return np.concatenate(A.comm.tompi4py().allgather(mine))


def taken_out(space):
    """Differences from what PETSc makes, and whether a part with too few entries is found."""
    pattern, comm = Pattern(space), space.mesh.comm
    pattern.add_cells()
    A, add = pattern.matrix(), PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN
    with values_in_place(A) as values:
        values[:] = np.random.default_rng(comm.rank).uniform(size=len(values))
    first, end = A.getOwnershipRange()
    even = np.array([row for row in range(first, end) if row // 3 % 2 == 0])
    rows = PETSc.IS().createGeneral(even.astype(PETSc.IntType), comm=comm)
    part, places = A.createSubMatrix(rows, rows), PlacesOfPart(even - first, even - first)
    few = even[: 3 * A.comm.rank + 1]  # a part with fewer rows than columns
    few_rows = PETSc.IS().createGeneral(few.astype(PETSc.IntType), comm=comm)
    strip, places_of_strip = (
        A.createSubMatrix(few_rows, rows),
        PlacesOfPart(few - first, even - first),
    )
    assert places_of_strip.find(A, strip)

    def difference(rows_of_part=rows, part=part, places=places):
        part.zeroEntries()
        places.take(A, part)
        wanted = A.createSubMatrix(rows_of_part, rows)
        wanted.axpy(-1.0, part, add)
        return wanted.norm()

    out = {"found": places.find(A, part), "apart": [difference()]}
    out["apart"].append(difference(few_rows, strip, places_of_strip))
    before, size = A.copy(), A.getSize()[0] // 3
    beside, within = (coupled(comm, size, apart) for apart in (True, False))
    out["same"] = [np.array_equal(dense(A), expected(space, comm, (beside[0][:0], beside[1][:0])))]
    pattern.add_nodes(beside[0])
    pattern.add_entries(beside[1])
    pattern.lay_out(A)
    out["same"].append(np.array_equal(dense(A), expected(space, comm, beside)))
    A.axpy(2.0, before, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
    out["again"] = places.find(A, part)
    out["apart"].append(difference())
    pattern.add_nodes(within[0])
    pattern.lay_out(A)
    return {**out, "fewer": places.find(A, part)}


@pytest.mark.mpi(both_meshes, 2, 3)
def test_a_part_is_taken_out_and_a_matrix_widened_as_petsc_does(on_ranks):
    for ranks in (1, 2, 3):
        found = on_ranks(both_meshes, ranks)["part"]
        assert found == {
            **{"found": True, "same": [True, True], "again": True},
            **{"fewer": False, "apart": [0.0, 0.0, 0.0]},
        }


def test_values_are_changed_in_place():
    _, A = matrix_of(rectangle(MPI.COMM_SELF))
    before = A.stateGet()
    with values_in_place(A) as values:
        values[:] = np.arange(len(values))
    assert A.stateGet() > before  # or a solver would keep its factors
    np.testing.assert_array_equal(own_block(A).getValuesCSR()[2], np.arange(len(values)))


# -- Forces on single unknowns: in the residual, in the loads, and scaled by their factor ----------


def test_nodal_loads_enter_the_residual_beside_those_with_forms(pair):
    blocks = pair()
    x = blocks.displaced(lambda X: 0.1 * X, lambda X: -0.05 * X)
    side = FollowerPressure(blocks.u, blocks.named.facets("elastomer_left"))
    force = NodalLoad(np.array([3, 8], dtype=np.int32), np.array([2.0, -0.5]))
    f = x.duplicate()
    without = blocks.problem(None)
    without.residual(None, x, f)
    bare, reference = f.array_r.copy(), without.reference_force
    problem = blocks.problem(None, loads=[side], nodal_loads=[force])
    side.set(0.3)
    force.factor = 4.0
    problem.residual(None, x, f)
    form, nodal = load_residuals(problem)
    expected = np.zeros(problem.owned)
    expected[[3, 8]] = [8.0, -2.0]
    np.testing.assert_array_equal(-nodal[: problem.owned], expected)
    np.testing.assert_allclose(f.array_r - bare, form + nodal, atol=1e-14)
    np.testing.assert_allclose(problem.load_forces(), -form - nodal, atol=1e-14)
    # Bodies that nothing but loads acts on are judged by these.
    assert reference == 0.0
    assert problem.reference_force == pytest.approx(np.linalg.norm(form + nodal))
    force.factor = 0.0
    side.set(0.0)
    problem.residual(None, x, f)
    np.testing.assert_array_equal(f.array_r, bare)
