"""Notes on the directions in which contact alone supports a body."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.supports import Loose, loose_directions, sprung_dofs

__all__ = ["Loose", "loose_directions", "notes_on_supports"]


def notes_on_supports(problem: Equilibrium, touching: bool) -> Iterator[str]:
    """A line on each body and direction that contact alone supports; collective.

    A spring or a foundation is a support. A platen is one where the bodies touch from the start, as
    they are meant to then.

    Args:
        problem: the equilibrium.
        touching: whether the bodies touch from the start.
    """
    moved = [p.dofs for p in problem.constraints.aligned if touching]
    for one in loose_directions(problem, np.concatenate([sprung_dofs(problem), *moved])):
        why = f"no boundary prescribes a displacement in {one.direction}"
        if one.kind == "tool":
            why = f"a {'moment' if one.turns else 'force'} drives it in {one.direction}"
        yield f"{one.name}: {why}; only contact holds it there"
