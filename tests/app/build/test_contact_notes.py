"""What is said of a contact once case and mesh are put together."""

from __future__ import annotations

import numpy as np
import pytest

from app.build.contact_notes import note_on_stick, notes_on_penalty
from app.case.friction import Coulomb


def test_a_stiff_penalty_is_noted_in_explicit_runs_only():
    [note] = notes_on_penalty(1, 130.1342, 0.5, True)
    assert note.startswith("contact.1: a penalty of penalty_factor = 130.1, 65.1 times")
    assert "shortens explicit steps" in note and note.endswith("; 2 to 6 is stiff enough for most")
    assert not list(notes_on_penalty(1, 130.1342, 0.5, False))


def test_waves_feel_the_oedometric_modulus_and_not_the_factor():
    """The default is three times it where a body is nearly incompressible: nothing to say."""
    assert not list(notes_on_penalty(0, 30.0, 0.1, True))
    assert len(list(notes_on_penalty(0, 30.0, 0.9, True))) == 1


@pytest.mark.parametrize("stiffness", [10.0, np.nextafter(10.0, 11.0), 3.0])
@pytest.mark.parametrize("ratio", [1.0, 0.1, 2.86])
def test_round_off_in_the_factor_makes_no_note(stiffness, ratio):
    assert not list(notes_on_penalty(0, stiffness / ratio, ratio, True))


def test_a_stick_far_softer_than_the_elements_is_noted():
    """As where a resolved case is run with a body a thousand times stiffer."""
    friction = Coulomb.model_validate({"law": "coulomb", "mu": 0.2, "K_T": 1e10})
    assert not list(note_on_stick(0, friction, 1e9))
    [note] = note_on_stick(0, friction, 1e12)
    assert note.startswith("contact.0: K_T is 0.01 times the stiffness G/h")
