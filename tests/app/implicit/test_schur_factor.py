"""A factorisation that leaves unknowns over solves with whatever dense matrix couples these."""

import numpy as np
import pytest
import scipy.sparse
from petsc4py import PETSc

from tribox.app.equilibrium.matrix_values import values_in_place
from tribox.app.implicit import factor as schur_factor
from tribox.app.implicit.factor import SchurFactor

SIZE = 40
LEFT = np.array([0, 7, 8, 21, 39], dtype=np.int32)
INNER = np.delete(np.arange(SIZE), LEFT)
RHS = np.random.default_rng(5).normal(size=SIZE)


def stiffness(seed=0):
    """A symmetric positive matrix, with few entries."""
    rng = np.random.default_rng(seed)
    rough = scipy.sparse.random_array((SIZE, SIZE), density=0.1, rng=rng).toarray()
    return rough @ rough.T + np.eye(SIZE)


def petsc(A):
    sparse = scipy.sparse.csr_matrix(A)
    return PETSc.Mat().createAIJ(A.shape, csr=(sparse.indptr, sparse.indices, sparse.data))


def factor_of(A, left=LEFT):
    """Not yet made, and its matrix."""
    matrix = petsc(A)
    return SchurFactor(matrix, left, "left_over_"), matrix


def complement(A, left=LEFT):
    inner = np.delete(np.arange(SIZE), left)
    part = np.linalg.solve(A[np.ix_(inner, inner)], A[np.ix_(inner, left)])
    return A[np.ix_(left, left)] - A[np.ix_(left, inner)] @ part


def with_dense(A, dense):
    """A matrix whose Schur complement is ``dense``."""
    out = A.copy()
    out[np.ix_(LEFT, LEFT)] += dense - complement(A)
    return out


def unsymmetric(seed=1):
    return 5.0 * np.eye(len(LEFT)) + np.random.default_rng(seed).normal(size=2 * LEFT.shape)


def agrees(factor, A):
    np.testing.assert_allclose(factor.solve(RHS), np.linalg.solve(A, RHS), rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("left", [LEFT, LEFT[:1], np.arange(SIZE - 1, dtype=np.int32)])
def test_with_its_own_complement_it_solves_with_the_matrix(left):
    A = stiffness()
    factor, _ = factor_of(A, left)
    assert factor.make()
    np.testing.assert_allclose(factor.complement, complement(A, left), rtol=1e-12, atol=1e-12)
    assert factor.exchange(factor.complement)
    agrees(factor, A)


def test_the_dense_part_may_be_exchanged_for_one_that_is_not_symmetric():
    A = stiffness()
    factor, _ = factor_of(A)
    assert factor.make()
    own = factor.complement.copy()
    for seed in (1, 2):
        dense = unsymmetric(seed)
        assert factor.exchange(dense)
        agrees(factor, with_dense(A, dense))
        agrees(factor, with_dense(A, dense))
    np.testing.assert_array_equal(factor.complement, own)


def test_other_values_are_factorised_whatever_the_dense_part_was():
    """The same values give the same bits again."""
    A, scale = stiffness(), np.linspace(1.0, 3.0, SIZE)
    B = scale[:, None] * A * scale
    factor, matrix = factor_of(A)
    assert factor.make() and factor.exchange(unsymmetric())
    first, of_first = factor.solve(RHS).copy(), factor.complement.copy()
    with values_in_place(matrix) as values:
        values[:] = scipy.sparse.csr_matrix(B).data
    assert factor.make() and factor.exchange(factor.complement)
    agrees(factor, B)
    with values_in_place(matrix) as values:
        values[:] = scipy.sparse.csr_matrix(A).data
    assert factor.make() and factor.exchange(unsymmetric())
    np.testing.assert_array_equal(factor.complement, of_first)
    np.testing.assert_array_equal(factor.solve(RHS), first)


def test_what_is_left_may_be_singular_until_it_is_exchanged():
    """As a prescribed unknown of contact is, without its diagonal."""
    A = stiffness()
    A[LEFT[1]] = A[:, LEFT[1]] = 0.0
    A[LEFT[1], INNER[0]] = A[INNER[0], LEFT[1]] = 0.0
    factor, _ = factor_of(A)
    assert factor.make()
    assert not factor.exchange(factor.complement)
    assert not factor.exchange(np.zeros(2 * LEFT.shape))
    dense = unsymmetric()
    assert factor.exchange(dense)
    agrees(factor, with_dense(A, dense))


def test_a_singular_matrix_is_told_and_others_follow():
    A = stiffness()
    factor, matrix = factor_of(A)
    with values_in_place(matrix) as values:
        values[:] = 0.0
    assert not factor.make()
    with values_in_place(matrix) as values:
        values[:] = scipy.sparse.csr_matrix(A).data
    assert factor.make() and factor.exchange(factor.complement)
    agrees(factor, A)


def test_options_for_mumps_reach_it():
    options = PETSc.Options("left_over_")
    options["mat_mumps_icntl_14"] = 37
    factor, _ = factor_of(stiffness())
    assert factor.make()
    assert factor._inner.getMumpsIcntl(14) == 37
    options.delValue("mat_mumps_icntl_14")


def test_both_triangles_are_there_whichever_of_them_is_given():
    """MUMPS leaves one of them empty, which one depends on its version."""
    whole = unsymmetric() + unsymmetric().T
    for given in (whole, np.tril(whole), np.triu(whole)):
        np.testing.assert_array_equal(schur_factor._mirrored(given), whole)


def test_without_its_functions_petsc_is_not_asked(monkeypatch):
    assert schur_factor.is_at_hand()
    monkeypatch.setattr(schur_factor, "_petsc", lambda: None)
    assert not schur_factor.is_at_hand()
