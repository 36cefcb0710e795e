"""Which free bodies float: those that no contact presses on."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from tribox.app.implicit.loose_bodies import SHARE, WeakHold


def hold(pairs: list[list[int]], forces: list[float]) -> WeakHold:
    """Free bodies a, b, ... on ``pairs``, and the forces, N, of the contacts."""
    slave = SimpleNamespace(slave=SimpleNamespace(weight=np.ones(1)))
    made = object.__new__(WeakHold)
    made.problem = SimpleNamespace(
        comm=MPI.COMM_SELF,
        contacts=[SimpleNamespace(surface=slave) for _ in forces],
        trials=[SimpleNamespace(pressure=np.array([force])) for force in forces],
    )
    made.bodies = [SimpleNamespace(name=name) for name in "abc"[: len(pairs)]]
    made.pairs = pairs
    return made


@pytest.mark.parametrize(
    ("pairs", "forces", "floating"),
    [
        ([[0]], [1.0], []),
        ([[0]], [2.0 * SHARE], []),
        ([[0]], [0.5 * SHARE], ["a"]),  # points that touch by round-off hold nothing
        ([[]], [1.0], ["a"]),
        ([[0], [1]], [1.0, 0.0], ["b"]),
        ([[0, 1]], [0.0, 1.0], []),
    ],
)
def test_a_body_floats_unless_a_contact_presses_on_it(pairs, forces, floating):
    assert hold(pairs, forces).floating(1.0) == floating
