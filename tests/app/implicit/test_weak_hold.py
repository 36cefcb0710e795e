"""Which free bodies float: those that neither contact nor a tie holds."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from app.equilibrium.free_bodies import FreeBody
from app.implicit.weak_hold import SHARE, WeakHold


def hold(pairs: list[list[int]], contacts: list[tuple[bool, float]], active: bool = True):
    """Free bodies a, b, ... on ``pairs``; of each contact whether it is tied, and its force, N."""
    slave = SimpleNamespace(slave=SimpleNamespace(weight=np.ones(1)))
    terms = [SimpleNamespace(tied=tied, active=active, surface=slave) for tied, _ in contacts]
    trials = [SimpleNamespace(pressure=np.array([force])) for _, force in contacts]
    made = object.__new__(WeakHold)
    made.problem = SimpleNamespace(comm=MPI.COMM_SELF, contacts=terms, trials=trials)
    made.bodies = [FreeBody(name, np.empty(0, dtype=int), 1.0) for name in "abc"[: len(pairs)]]
    made.pairs = pairs
    return made


@pytest.mark.parametrize(
    ("pairs", "contacts", "floating"),
    [
        ([[0]], [(False, 1.0)], []),  # pressed on something
        ([[0]], [(False, 0.5 * SHARE)], ["a"]),
        ([[0]], [(True, 0.0)], []),  # tied to what is held, without force
        ([[0]], [(True, -1.0)], []),  # ... and pulled
        ([[0], [0]], [(True, -1.0)], ["a", "b"]),  # tied to each other alone
        ([[0, 1], [1]], [(False, 1.0), (True, 0.0)], []),  # a is pressed, b tied to it
        ([[0], [0, 1], [1, 2]], [(True, 0.0), (True, 0.0), (True, 0.0)], []),  # a chain to a wall
        ([[0], [0, 1], [1]], [(True, 0.0), (True, 0.0)], ["a", "b", "c"]),
    ],
)
def test_a_body_floats_unless_contact_or_ties_hold_it(pairs, contacts, floating):
    assert hold(pairs, contacts).floating(1.0) == floating


def test_a_tie_that_has_let_go_holds_nothing():
    assert hold([[0]], [(True, 0.0)], active=False).floating(1.0) == ["a"]
