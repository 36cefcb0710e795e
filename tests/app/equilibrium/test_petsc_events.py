from petsc4py import PETSc

from benchmarks.probe import events


def solve_once() -> None:
    """Factorise 2 I, analysis included, and solve."""
    matrix = PETSc.Mat().createAIJ([5, 5], nnz=1, comm=PETSc.COMM_SELF)
    matrix.setUp()
    for i in range(5):
        matrix.setValue(i, i, 2.0)
    matrix.assemble()
    ksp = PETSc.KSP().create(PETSc.COMM_SELF)
    ksp.setType("preonly")
    ksp.getPC().setType("lu")
    ksp.setOperators(matrix)
    x, b = matrix.createVecs()
    b.set(1.0)
    ksp.solve(b, x)
    assert x.norm() > 0.0


def test_the_events_named_are_heard_as_they_begin_and_end():
    heard = []
    names = {"MatLUFactorSym": "analysis", "MatLUFactorNum": "numbers", "PCSetUp": "set-up"}
    with events(names, heard.append, lambda: heard.append("end")):
        solve_once()
    assert heard == ["set-up", "analysis", "end", "numbers", "end", "end"]
