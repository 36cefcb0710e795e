"""The semi-implicit treatment of the films' viscous stress, over all contacts.

Each point's formula is in :mod:`tribox.forms.contact.explicit`: the film's traction of the step
before is held while accelerations are found, then corrected by what an implicit dashpot would add.
"""

from __future__ import annotations

from collections.abc import Sequence

import dolfinx

from tribox.app.explicit.lumped_dynamics import LumpedDynamics
from tribox.app.explicit.state import ExplicitState
from tribox.forms.contact.explicit import ExplicitContact
from tribox.geometry.surfaces.exchange import NodalVector
from tribox.geometry.surfaces.facets import Floats

REFRESH = 25  # steps between two evaluations of the masses that the film moves


class FilmCorrection:
    """Corrects the viscous tractions of the contacts that have a film."""

    def __init__(
        self,
        contacts: Sequence[ExplicitContact],
        dynamics: LumpedDynamics,
        space: dolfinx.fem.FunctionSpace,
        damping: float,
    ) -> None:
        """Find the unknowns that the films' forces can reach; collective.

        Args:
            contacts: those with a film.
            dynamics: lumped masses.
            space: of the displacement.
            damping: 1/s, c of the damping force c m v.
        """
        self.contacts = list(contacts)
        self._dynamics, self._damping = dynamics, damping
        self._scratch = NodalVector(space)
        self._touched = dynamics.touched([c.exchange for c in self.contacts], self._scratch)

    def hold(self) -> None:
        """Put the films' tractions of the step before in place of those just evaluated."""
        for contact in self.contacts:
            contact.hold_film()

    def correct(self, state: ExplicitState, residual: NodalVector, dt: float) -> None:
        """Correct the films' tractions for the velocities of the next half step; collective.

        Args:
            state: velocities, and accelerations with the tractions that were held.
            residual: forces; the change of the films' is added.
            dt: s, length of the step.
        """
        if state.steps % REFRESH == 0:
            for contact in self.contacts:
                contact.refresh_compliance(self._dynamics.inverse, self._scratch)
        b = 0.5 * self._damping * dt
        keep, gain = (1.0 - b) / (1.0 + b), dt / (1.0 + b)
        for contact in self.contacts:
            contact.correct_film(state.v, keep, state.a, gain, residual)

    def accelerate(self, residual: Floats, pull: Floats, platens: Floats, out: Floats) -> Floats:
        """Renew the accelerations ``out`` (n,) where the films' forces may have changed them.

        Collective where a film touches a platen.

        Args:
            residual: (n,), N, with the corrected tractions.
            pull: (p,), N, on the platens.
            platens: (p,), m/s², the platens' accelerations before.
            out: (n,), m/s².

        Returns:
            The platens' accelerations (p,), m/s².
        """
        if self._touched is None:
            return self._dynamics.accelerate(residual, pull, out)[0]
        self._dynamics.accelerate_at(self._touched, residual, out)
        return platens
