"""A law of the user's that goes wrong: noted with its line, and never an exception."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tribox.forms.friction.coulomb import CoulombLaw, CoulombParameters
from tribox.forms.friction.guarded_law import GuardedLaw
from tribox.forms.friction.law import FrictionState

COULOMB = CoulombLaw(CoulombParameters(mu=0.3, K_T=1e12))
SLIP, P, FILM = np.full((3, 2), 1e-7), np.full(3, 1e6), np.zeros(3)


class Spoilt:
    """Coulomb friction of which one method is replaced."""

    def __init__(self, **methods) -> None:
        for name in ("initial_state", "update", "stored_energy", "coefficient"):
            setattr(self, name, getattr(COULOMB, name))
        self.__dict__ |= methods


def update_with(**parts):
    return lambda *args, **options: replace(COULOMB.update(*args, **options), **parts)


def fails(*args, **options):
    raise LookupError("nothing\nthere")


def ask(law: GuardedLaw):
    return law.update(SLIP, 0.1, P, FILM, law.initial_state(3, 2), area_ratio=np.ones(3))


def test_a_good_law_answers_as_without_the_guard():
    law = GuardedLaw(COULOMB, "coulomb")
    plain = COULOMB.update(SLIP, 0.1, P, FILM, COULOMB.initial_state(3, 2))
    np.testing.assert_array_equal(ask(law).traction, plain.traction)
    assert law.fault is law.not_finite is None
    assert not hasattr(law, "unsettled") and not law.takes_film_cover


def test_an_exception_is_noted_with_its_line_and_the_law_asked_no_more():
    calls = []
    law = GuardedLaw(Spoilt(update=lambda *a, **k: calls.append(1) or fails()), "my", __file__)
    assert np.isnan(ask(law).traction).all()
    line = fails.__code__.co_firstlineno + 1
    assert law.fault == f"the friction law my fails: {__file__}:{line}: LookupError: nothing there"
    assert np.isnan(ask(law).traction).all() and len(calls) == 1
    np.testing.assert_array_equal(law.coefficient(FrictionState.zeros(3, 2)), np.zeros(3))


NO_STATE = FrictionState.zeros(2, 2)
WRONG = {
    "traction": (update_with(traction=np.zeros((3, 3))), "traction has shape (3, 3) for 3 points"),
    "ragged": (update_with(traction=[[1.0], [1.0, 2.0]]), "ValueError: setting an array"),
    "regime": (update_with(regime=0), "regime has shape () for 3 points in 2D, expected (3,)"),
    "state": (update_with(state=NO_STATE), "elastic_slip of the state has shape (2, 2)"),
    "no state": (update_with(state=None), "the state is NoneType, which has no elastic_slip"),
    "dissipation": (update_with(dissipation=None), "dissipation.coulomb has shape ()"),
    "nothing": (lambda *a, **k: None, "answers with None"),
    "another": (lambda *a, **k: 3.0, "update answers with float, which has no traction"),
}


@pytest.mark.parametrize("name", WRONG)
def test_an_answer_of_another_shape_is_named(name):
    update, said = WRONG[name]
    law = GuardedLaw(Spoilt(update=update), "my")
    assert np.isnan(ask(law).traction).all()
    assert law.fault is not None and said in law.fault


@pytest.mark.parametrize("member", ["stored_energy", "coefficient", "unsettled"])
@pytest.mark.parametrize(
    ("answer", "said"),
    [(np.ones(2), "has shape (2,) for 3 points"), (np.full(3, np.inf), "is not finite at 3 of 3")],
)
def test_values_of_a_state_are_looked_at(member, answer, said):
    law = GuardedLaw(Spoilt(**{member: lambda *args: answer}), "my")
    law.try_state(FrictionState.zeros(3, 2), P)
    assert law.fault == f"the friction law my fails: {member} {said}" + (
        ", expected (3,)" if "shape" in said else " points"
    )


def test_numbers_that_are_not_finite_are_told_of_the_last_answer():
    part = COULOMB.update(SLIP, 0.1, P, FILM, COULOMB.initial_state(3, 2)).d_traction_d_pressure
    part = np.where(np.arange(3)[:, None] == 1, np.nan, part)
    spoilt = Spoilt(update=update_with(d_traction_d_pressure=part))
    law = GuardedLaw(spoilt, "my")
    ask(law)
    assert law.fault is None and law.not_finite is not None
    assert "d_traction_d_pressure at 1 of 3 points, the first at slip_increment" in law.not_finite
    law.update(np.full((3, 2), np.nan), 0.1, P, FILM, FrictionState.zeros(3, 2))
    assert law.not_finite is None  # what was asked was no number either
    spoilt.update = COULOMB.update
    ask(law)
    assert law.not_finite is None


def test_the_working_directory_is_put_back(tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def moves(*args, **options):
        os.chdir("/")
        return COULOMB.update(*args, **options)

    law = GuardedLaw(Spoilt(update=moves), "my")
    ask(law)
    assert law.fault is None and Path.cwd() == tmp_path
