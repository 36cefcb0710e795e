"""The bulk of a tangent solves with the contact of another."""

import numpy as np
import scipy.sparse
from petsc4py import PETSc

from tests.app.implicit.test_schur_factor import LEFT, RHS, SIZE, petsc, stiffness, unsymmetric
from tribox.app.equilibrium.matrix_values import values_in_place
from tribox.app.implicit.condensed_bodies import Followers, KeptBulk

NONE = Followers(np.empty(0, dtype=np.int32), np.empty(0, dtype=np.int32))
AT = np.ix_(LEFT, LEFT)


def with_contact(A, dense):
    out = A.copy()
    out[AT] = dense
    return out


def test_contact_is_exchanged_and_the_bulk_stays():
    """What the block has at the surface's unknowns is no part of the bulk."""
    A = stiffness()
    bulk = KeptBulk(LEFT, NONE, "bulk_")
    assert bulk.worn and bulk.factorise(petsc(A)) and not bulk.worn
    for seed in (1, 2):
        assert bulk.complete(unsymmetric(seed))
        wanted = np.linalg.solve(with_contact(A, unsymmetric(seed)), RHS)
        np.testing.assert_allclose(bulk.solve(RHS), wanted, rtol=1e-9, atol=1e-11)
    assert bulk.factorised == 1


def test_room_for_contact_that_is_new_changes_nothing():
    """The pattern of the block has grown among the surface's unknowns."""
    A = stiffness()
    bare = with_contact(A, np.diag(np.diag(A[AT])))
    bulk = KeptBulk(LEFT, NONE, "bulk_")
    assert bulk.factorise(petsc(bare)) and bulk.complete(unsymmetric())
    first = bulk.solve(RHS)
    assert bulk.factorise(petsc(with_contact(A, unsymmetric()))) and bulk.complete(unsymmetric())
    np.testing.assert_array_equal(bulk.solve(RHS), first)


def test_followers_of_a_platen_move_with_its_leading_unknown():
    """Their rows say u_i − u_leader = b_i, and no other row has them."""
    followers = np.array([12, 30], dtype=np.int32)
    leaders = np.array([LEFT[1], 5], dtype=np.int32)
    A = stiffness()
    A[followers] = A[:, followers] = 0.0
    A[followers, followers] = 1.0
    A[followers, leaders] = -1.0
    bulk = KeptBulk(LEFT, Followers(followers, leaders), "bulk_")
    assert bulk.factorise(petsc(A)) and bulk.complete(unsymmetric()) and bulk.symmetric
    wanted = np.linalg.solve(with_contact(A, unsymmetric()), RHS)
    np.testing.assert_allclose(bulk.solve(RHS), wanted, rtol=1e-9, atol=1e-11)


def test_what_is_not_symmetric_is_refused_and_said():
    A = stiffness()
    inner = np.delete(np.arange(SIZE), LEFT)
    row, column = np.argwhere(np.triu(A[np.ix_(inner, inner)], 1))[0]
    skew = A.copy()
    skew[inner[row], inner[column]] += 1e-6
    bulk = KeptBulk(LEFT, NONE, "bulk_")
    assert not bulk.factorise(petsc(skew)) and not bulk.symmetric and bulk.worn
    assert bulk.factorise(petsc(A)) and bulk.symmetric and not bulk.worn


def test_a_bulk_that_cannot_be_factorised_stays_worn():
    A = scipy.sparse.csr_matrix(stiffness())
    block = PETSc.Mat().createAIJ(A.shape, csr=(A.indptr, A.indices, A.data))
    bulk = KeptBulk(LEFT, NONE, "bulk_")
    with values_in_place(block) as values:
        values[:] = 0.0
    assert not bulk.factorise(block) and bulk.worn and bulk.symmetric


def test_contact_that_is_singular_or_has_no_numbers_is_told():
    bulk = KeptBulk(LEFT, NONE, "bulk_")
    assert bulk.factorise(petsc(stiffness()))
    own = bulk._factor.complement
    assert not bulk.complete(-own)
    contact = unsymmetric()
    contact[0, 1] = np.nan
    assert not bulk.complete(contact)
    assert bulk.complete(unsymmetric())
