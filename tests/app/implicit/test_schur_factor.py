"""A factorisation that leaves unknowns over solves with whatever dense matrix couples these."""

import numpy as np
import pytest
import scipy.sparse
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from petsc4py import PETSc

from tribox.app.equilibrium.matrix_values import values_in_place
from tribox.app.implicit.condensed_bodies import ContactCompliance
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


# -- The kept bodies' compliance gives what eliminating all of their unknowns gives ----------------


def positive(rng, n):
    rough = rng.normal(size=(n, n))
    return rough @ rough.T + np.eye(n)


def sparse(rng, shape, columns=None, rows=None):
    """A part of a tangent: of its pattern half is zero, as all is in other rows and columns."""
    values = rng.normal(size=shape) * (rng.random(shape) < 0.6)
    for axis, kept in ((1, columns), (0, rows)):
        if kept is not None:
            values[(slice(None),) * axis + (~kept,)] = 0.0
    room = (values != 0.0) | (rng.random(shape) < 0.3)
    return scipy.sparse.csr_matrix((values[room], np.nonzero(room)), shape=shape)


class System:
    """Others and kept bodies: k unknowns, the first c of contact; s of the others.

    The unknowns that contact couples are some of c, or none.
    """

    def __init__(self, seed, k=6, c=4, s=3, coupled=2, stiffness=1.0):
        rng = np.random.default_rng(seed)
        self.c = np.arange(c)
        self.K, self.A_ss = positive(rng, k), positive(rng, s)
        mine = rng.permutation(np.arange(c) < coupled)
        self.A_sc = stiffness * sparse(rng, (s, c), columns=mine)
        self.A_cs = stiffness * sparse(rng, (c, s), rows=mine)
        felt = (self.A_sc != 0).toarray().any(axis=0) | (self.A_cs != 0).toarray().any(axis=1)
        self.N = stiffness * sparse(rng, (c, c), columns=felt, rows=felt)
        self.felt = np.nonzero(felt)[0]
        self.F = np.linalg.inv(self.K)[:c, :c]
        self.b_s, self.b_k = rng.normal(size=s), rng.normal(size=k)
        parts = (part.copy() for part in (self.A_sc, self.A_cs, self.N))
        self.made = ContactCompliance.of(self.F, *parts)

    def whole(self):
        """The tangent of all, others first."""
        s, c = len(self.b_s), len(self.c)
        A = np.zeros(2 * (s + len(self.b_k),))
        A[:s, :s], A[s:, s:] = self.A_ss, self.K
        A[:s, s : s + c] += self.A_sc
        A[s : s + c, :s] += self.A_cs
        A[s : s + c, s : s + c] += self.N
        return A

    def solved(self):
        """x_s and x_k by the compliance."""
        made, s = self.made, len(self.b_s)
        free = np.linalg.solve(self.K, self.b_k)[self.c][made.touched]
        x_s = np.linalg.solve(self.A_ss - made.stiffness(), self.b_s - made.pull(free))
        forces = self.b_k.copy()
        forces[self.c[made.touched]] -= made.load(free, x_s)
        assert x_s.shape == (s,)
        return np.concatenate([x_s, np.linalg.solve(self.K, forces)])


systems = st.builds(
    System,
    seed=st.integers(0, 2**32 - 1),
    k=st.integers(5, 9),
    c=st.integers(1, 5),
    s=st.integers(1, 6),
    coupled=st.integers(0, 5),
    stiffness=st.sampled_from([1e-3, 1.0, 1e3]),
)


@settings(max_examples=60, deadline=None)
@given(systems)
def test_it_solves_what_block_elimination_solves(system):
    """To rounding, as each of the systems on the way enlarges it."""
    A, b = system.whole(), np.concatenate([system.b_s, system.b_k])
    x = system.solved()
    at = np.ix_(system.felt, system.felt)
    mixed = np.eye(len(system.felt)) + system.F[at] @ system.N.toarray()[at]
    parts = [system.K, system.A_ss - system.made.stiffness(), *[mixed] * bool(mixed.size)]
    worst = np.prod([np.linalg.cond(part) for part in parts])
    assume(worst < 1e7)
    moved = np.linalg.norm(x) + np.linalg.norm(np.linalg.solve(system.K, system.b_k))
    size = np.linalg.norm(A) * moved + np.linalg.norm(b)
    assert np.linalg.norm(A @ x - b) <= 1e-14 * worst * size


def test_a_spring_between_two_points_is_in_series_with_the_body():
    """Contact of stiffness k on a point of compliance F: together k / (1 + k F)."""
    k, F = 40.0, 0.2
    parts = [scipy.sparse.csr_matrix([[value]]) for value in (-k, -k, k)]
    made = ContactCompliance.of(np.array([[F]]), *parts)
    assert k - made.stiffness()[0, 0] == pytest.approx(k / (1.0 + k * F), rel=1e-14)
