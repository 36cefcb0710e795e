"""What is said of the tables of a contact: its stick, its film."""

import tomllib

import pytest
from mpi4py import MPI
from pydantic import ValidationError

from tribox.app.build.contacts import note_on_stick
from tribox.app.build.model import build_model
from tribox.app.case.case import Case
from tribox.app.case.friction import TABLES


def test_a_stick_far_softer_or_stiffer_than_the_elements_is_noted():
    """As where a resolved case is run with a body a thousand times stiffer."""
    friction = TABLES["coulomb"].model_validate({"law": "coulomb", "mu": 0.2, "K_T": 1e10})
    assert not list(note_on_stick(0, friction, 1e9))
    [note] = note_on_stick(0, friction, 1e12)
    assert note.startswith("contact.0: K_T is 0.01 times the stiffness G/h")
    assert not list(note_on_stick(0, friction, 1e7))
    [note] = note_on_stick(0, friction, 1e6)
    assert note.startswith("contact.0: K_T is 1e+04 times") and "many iterations" in note


def test_a_film_that_the_law_does_not_know_is_noted(block):
    data = tomllib.loads(block)
    assert not [
        n for n in build_model(Case.model_validate(data), MPI.COMM_SELF).notes if "film" in n
    ]
    data["contact"][0]["film"] = {"thickness": "30 nm"}
    stribeck = {"law": "stribeck", "mu_s": 0.2, "mu_d": 0.1, "V_s": 0.1}
    for friction in (data["contact"][0]["friction"], stribeck):
        data["contact"][0]["friction"] = friction
        notes = build_model(Case.model_validate(data), MPI.COMM_SELF).notes
        [note] = [n for n in notes if "film" in n]
        assert note == f'contact.0: film has no effect with law = "{friction["law"]}"'
    # Nor has a sweep over it, and there is no viscosity of what does not act.
    model = build_model(Case.model_validate(data), MPI.COMM_SELF)
    assert model.problem.contacts[0].film.thickness == 0.0
    swept = {"sweep": {"key": "contact.0.film.thickness", "values": ["1 nm", "2 nm"]}}
    with pytest.raises(ValidationError, match="all runs would be the same"):
        Case.model_validate(data | swept)
