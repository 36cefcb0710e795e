"""What the friction laws of the users have done wrong, told to all ranks."""

from __future__ import annotations

from collections.abc import Sequence

from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.state import ContactTrial
from tribox.forms.friction.factored_law import FactoredLaw
from tribox.forms.friction.guarded_law import GuardedLaw
from tribox.forms.friction.law import FrictionLaw


def has_fault(contacts: Sequence[ContactTerm]) -> bool:
    """Whether a law has failed on this rank, or its last answer was not finite; not collective."""
    return any(law.fault or law.not_finite for law in _guarded(contacts))


def law_fault(contacts: Sequence[ContactTerm], trials: Sequence[ContactTrial] = ()) -> str | None:
    """What a law of the user's has done wrong on any rank; None if nothing; collective.

    Without such a law nothing is exchanged.

    Args:
        trials: of them, at a step that is about to be accepted: all that the laws will be asked
            of these states is asked before.
    """
    for term, trial in zip(contacts, trials, strict=False):
        law = _plain(term)
        if isinstance(law, GuardedLaw):
            law.try_state(trial.response.state, trial.pressure)
    return _first_of_all(contacts, [law.fault for law in _guarded(contacts)])


def law_not_finite(contacts: Sequence[ContactTerm]) -> str | None:
    """What of the last answer of a law was no finite number, on any rank; collective."""
    return _first_of_all(contacts, [law.not_finite for law in _guarded(contacts)])


def _guarded(contacts: Sequence[ContactTerm]) -> list[GuardedLaw]:
    return [law for law in map(_plain, contacts) if isinstance(law, GuardedLaw)]


def _plain(term: ContactTerm) -> FrictionLaw:
    """The law of a contact without the factor that it may be multiplied by."""
    return term.law.law if isinstance(term.law, FactoredLaw) else term.law


def _first_of_all(contacts: Sequence[ContactTerm], mine: list[str | None]) -> str | None:
    if not mine:
        return None
    first = next((one for one in mine if one), None)
    return next((one for one in contacts[0].surface.space.mesh.comm.allgather(first) if one), None)
