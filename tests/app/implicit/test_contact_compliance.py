"""The kept bodies' compliance gives what eliminating all of their unknowns gives."""

import numpy as np
import pytest
import scipy.sparse
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tribox.app.implicit.condensed_bodies import ContactCompliance


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


def test_a_spring_between_two_points_is_in_series_with_the_body():
    """Contact of stiffness k on a point of compliance F: together k / (1 + k F)."""
    k, F = 40.0, 0.2
    parts = [scipy.sparse.csr_matrix([[value]]) for value in (-k, -k, k)]
    made = ContactCompliance.of(np.array([[F]]), *parts)
    assert k - made.stiffness()[0, 0] == pytest.approx(k / (1.0 + k * F), rel=1e-14)
