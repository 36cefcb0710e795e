"""The kept bodies' compliance gives what eliminating all of their unknowns gives."""

import numpy as np
import pytest
import scipy.sparse
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from petsc4py import PETSc

from tribox.app.implicit.condensed_bodies import ContactCompliance, KeptCompliance


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
    at = np.nonzero(room)
    return scipy.sparse.csr_matrix((values[room], at), shape=shape)


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


@settings(max_examples=30, deadline=None)
@given(systems, st.integers(0, 2**32 - 1))
def test_the_relief_is_what_the_stiffness_does(system, seed):
    x_s = np.random.default_rng(seed).normal(size=len(system.b_s))
    stiffness = system.made.stiffness()
    relief = system.made.relief(x_s)
    small = 1e-12 * np.linalg.norm(stiffness) * np.linalg.norm(x_s)
    assert np.linalg.norm(relief - stiffness @ x_s) <= small


@settings(max_examples=30, deadline=None)
@given(systems)
def test_only_what_contact_couples_takes_part(system):
    """A place in the pattern that holds a zero is no contact."""
    np.testing.assert_array_equal(system.made.touched, system.felt)
    assert system.made.G.shape == 2 * (len(system.felt),)


def test_without_contact_the_bodies_know_nothing_of_each_other():
    system = System(3, coupled=0)
    assert system.A_sc.nnz and len(system.made.touched) == 0
    assert not system.made.stiffness().any() and not system.made.relief(system.b_s).any()
    none = np.empty(0)
    assert not system.made.pull(none).any() and system.made.load(none, system.b_s).shape == (0,)
    alone = [np.linalg.solve(system.A_ss, system.b_s), np.linalg.solve(system.K, system.b_k)]
    np.testing.assert_allclose(system.solved(), np.concatenate(alone), rtol=1e-12)


def test_a_spring_between_two_points_is_in_series_with_the_body():
    """Contact of stiffness k on a point of compliance F: together k / (1 + k F)."""
    k, F = 40.0, 0.2
    parts = [scipy.sparse.csr_matrix([[value]]) for value in (-k, -k, k)]
    made = ContactCompliance.of(np.array([[F]]), *parts)
    assert k - made.stiffness()[0, 0] == pytest.approx(k / (1.0 + k * F), rel=1e-14)


def test_what_is_singular_has_no_numbers():
    parts = [scipy.sparse.csr_matrix([[value]]) for value in (1.0, 1.0, -5.0)]
    assert np.isnan(ContactCompliance.of(np.array([[0.2]]), *parts).G).all()


@pytest.mark.parametrize("seed", range(3))
def test_the_factorisation_of_kept_bodies_gives_the_same(seed):
    """Of forces inside the bodies only a solve with them tells."""
    system = System(seed)
    surface = np.array([1, 2, 4, 5], dtype=np.int32)
    order = np.concatenate([surface, np.delete(np.arange(6), surface)])
    K = np.zeros((6, 6))
    K[np.ix_(order, order)] = system.K
    matrix = PETSc.Mat().createAIJ((6, 6), csr=[*_csr(K)])
    kept = KeptCompliance(matrix, surface, "kept_")
    assert kept.works
    b = system.b_k[np.argsort(order)]
    np.testing.assert_allclose(kept.solve(b), np.linalg.solve(K, b), rtol=1e-10)
    np.testing.assert_allclose(kept.alone(b, True), np.linalg.solve(K, b)[surface], rtol=1e-10)
    outside = np.zeros(6)
    outside[surface] = b[surface]
    wanted = np.linalg.solve(K, outside)[surface]
    np.testing.assert_allclose(kept.alone(b, False), wanted, rtol=1e-10)
    own = scipy.sparse.csr_matrix(K[np.ix_(surface, surface)])
    made = kept.against(system.A_sc, system.A_cs, system.N + own)
    np.testing.assert_array_equal(made.touched, system.made.touched)
    np.testing.assert_allclose(made.G, system.made.G, rtol=1e-9, atol=1e-12)
    kept.destroy()


def test_bodies_that_nothing_holds_cannot_be_kept():
    K = np.array([[2.0, -2.0, 0.0], [-2.0, 3.0, -1.0], [0.0, -1.0, 1.0]])
    matrix = PETSc.Mat().createAIJ((3, 3), csr=[*_csr(K)])
    kept = KeptCompliance(matrix, np.array([0], dtype=np.int32), "kept_")
    # Rounding may leave a pivot, and then a compliance that is no use to anyone.
    assert not kept.works or np.abs(kept.alone(np.ones(3), False)).max() > 1e10


def _csr(A):
    whole = scipy.sparse.csr_matrix(A)
    return whole.indptr, whole.indices, whole.data
