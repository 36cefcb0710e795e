"""What is said of a contact once case and mesh are put together."""

from __future__ import annotations

import numpy as np
import pytest

from app.build.contact_notes import notes_on_penalty


def test_a_stiff_penalty_is_noted_in_explicit_runs_only():
    [note] = notes_on_penalty(1, 130.1342, True)
    assert note.startswith("contact.1: a penalty of penalty_factor = 130.1 shortens explicit steps")
    assert not list(notes_on_penalty(1, 130.1342, False))


@pytest.mark.parametrize("factor", [10.0, np.nextafter(10.0, 11.0), 3.0])
def test_round_off_in_the_factor_makes_no_note(factor):
    assert not list(notes_on_penalty(0, factor, True))
