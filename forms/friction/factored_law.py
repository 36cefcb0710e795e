r"""A friction law times a factor that may change from step to step, such as a lubricant that comes.

Traction, stick stiffness, stored energy and dissipation of the law are all multiplied by the factor
:math:`\varphi`. When it changes from :math:`\varphi_n`, the elastic slip of the last step becomes

.. math:: r g_e, \qquad r = \min(1, \varphi_n/\varphi),

so that a factor that rises keeps the traction, and one that falls keeps the elastic slip; the
energy that is set free, :math:`\varphi_n \psi(g_e) - \varphi \psi(r g_e) \ge 0` for stored energies
that are quadratic in :math:`g_e`, is entered as switching. Neither creates energy.

Axis letters as in :mod:`tribox.forms.friction.law`.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import fields, make_dataclass, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tribox.forms.friction.law import Dissipation, FrictionLaw, FrictionResponse, FrictionState
from tribox.forms.parameters import require

Floats = NDArray[np.float64]


class FactoredLaw:
    """A friction law (a ``FrictionLaw``) times a factor >= 0, at the end of the step computed.

    Where friction tends is passed on; ``largest``: factor, for bounds on the stiffness.
    """

    def __init__(self, law: FrictionLaw, factor: float = 1.0, largest: float | None = None) -> None:
        """Take a law; ``largest`` of None is the factor; ValueError for a negative factor."""
        require("factor", factor, ge=0.0)
        self.law, self.factor = law, factor
        self.largest = factor if largest is None else max(largest, factor)
        self.takes_film_cover = bool(getattr(law, "takes_film_cover", False))
        self.looks_inside = bool(getattr(law, "looks_inside", False))
        if hasattr(law, "settling_slip"):
            self.settling_slip = float(law.settling_slip)
        if hasattr(law, "unsettled"):
            self.unsettled = partial(self._multiplied, "unsettled")
        if hasattr(law, "presliding_length"):
            self.presliding_length = law.presliding_length

    def initial_state(self, n: int, dim: int) -> FrictionState:
        """As the law's, with the present factor."""
        return _with_factor(self.law.initial_state(n, dim), np.full(n, self.factor))

    def stored_energy(self, state: FrictionState) -> Floats:
        """The law's, times the factor of the step that the state is of, (q,), J/m^2."""
        return _factor(state) * self.law.stored_energy(state)

    def coefficient(self, state: FrictionState) -> Floats:
        """The law's, times the factor of the step that the state is of, (q,)."""
        return _factor(state) * self.law.coefficient(state)

    def update(
        self,
        slip_increment: Floats,
        dt: float,
        pressure: Floats,
        film: Floats,
        state: FrictionState,
        **options: Any,
    ) -> FrictionResponse:
        """Traction, derivatives and trial state of one step; see ``FrictionLaw.update``."""
        factor, before = self.factor, _factor(state)
        # r = min(1, φ_n/φ) without a division by a factor of 0.
        kept = np.divide(before, factor, out=np.ones_like(before), where=before < factor)
        start = replace(state, elastic_slip=kept[:, None] * state.elastic_slip)
        out = self.law.update(slip_increment, dt, pressure, film, start, **options)
        # φ_n ψ(g_e) − φ ψ(r g_e): of energies quadratic in g_e never negative.
        freed = before * self.law.stored_energy(state) - factor * self.law.stored_energy(start)
        parts = {f.name: factor * getattr(out.dissipation, f.name) for f in fields(Dissipation)}
        parts["switching"] = parts["switching"] + freed
        return FrictionResponse(
            traction=factor * out.traction,
            d_traction_d_slip=factor * out.d_traction_d_slip,
            d_traction_d_elastic=(factor * kept)[:, None, None] * out.d_traction_d_elastic,
            d_traction_d_pressure=factor * out.d_traction_d_pressure,
            d_traction_d_film=factor * out.d_traction_d_film,
            state=_with_factor(out.state, np.full(len(kept), factor)),
            regime=out.regime,
            dissipation=Dissipation(**parts),
            held_back=None if out.held_back is None else factor * out.held_back,
        )

    def _multiplied(self, member: str, state: FrictionState, pressure: Floats) -> Floats:
        """What the law says of a state, times its factor, (q,)."""
        return _factor(state) * getattr(self.law, member)(state, pressure)


def strongest(law: FrictionLaw) -> FrictionLaw:
    """The law with the largest factor that it will have."""
    return FactoredLaw(law.law, law.largest) if isinstance(law, FactoredLaw) else law


@lru_cache
def _factored(kind: Hashable) -> Any:
    """The states of a kind of state that know their factor."""
    assert isinstance(kind, type)
    name, more = f"Factored{kind.__name__}", [("factor", Floats)]
    return make_dataclass(name, more, bases=(kind,), slots=True)


def _with_factor(state: FrictionState, factor: Floats) -> FrictionState:
    """The state with the factor (q,) of its step."""
    known = {f.name: getattr(state, f.name) for f in fields(state) if f.name != "factor"}
    kind: Any = type(state)
    out: FrictionState = (kind if hasattr(state, "factor") else _factored(kind))(
        **known, factor=factor
    )
    return out


def _factor(state: Any) -> Floats:
    """Factor (q,) of the step that a state is of."""
    return state.factor
