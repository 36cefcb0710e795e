"""A factorisation that leaves unknowns over solves with whatever dense matrix couples these."""

import numpy as np
import pytest
import scipy.sparse
from petsc4py import PETSc

from tribox.app.equilibrium.matrix_values import values_in_place
from tribox.app.implicit.factor import SchurFactor

SIZE = 40
LEFT = np.array([0, 7, 8, 21, 39], dtype=np.int32)
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
