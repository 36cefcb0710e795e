"""A tied pair in an explicit step: the same forces as in an implicit one, and no history."""

from __future__ import annotations

from tribox.forms.contact.explicit import ExplicitContact
from tribox.forms.contact.state import ContactTrial
from tribox.forms.contact.tie import TieTerm
from tribox.geometry.surfaces.exchange import NodalVector
from tribox.geometry.surfaces.facets import Floats


class ExplicitTie(ExplicitContact):
    """See :class:`tribox.forms.contact.explicit.ExplicitContact`.

    Attributes:
        tie: the pair.
    """

    def __init__(self, tie: TieTerm) -> None:
        """Allocate the values at the nodes; collective."""
        super().__init__(tie)
        self.tie = tie

    def evaluate(self, u: NodalVector, dt: float, rate_dependent: bool = True) -> ContactTrial:
        """See ``ExplicitContact.evaluate``."""
        self.exchange.gather(u, self._values)
        self.trial = self.tie.evaluate_at(self._values.copy(), dt)
        return self.trial

    def add_forces(self, out: NodalVector) -> None:
        """See ``ExplicitContact.add_forces``."""
        assert self.trial is not None
        self.exchange.add(self.tie.forces(self.trial), out)

    def set_dashpots(self, modulus: float, inverse_mass: Floats, work: NodalVector) -> None:
        """See ``ExplicitContact.set_dashpots``; what is tied does not bounce, and has none."""

    def add_stiffness(self, values: Floats, out: NodalVector) -> None:
        """Add the stiffness times ``values`` (n, i) at the pair's nodes to ``out``; collective."""
        self.exchange.add(self.tie.stiffness_times(values), out)
