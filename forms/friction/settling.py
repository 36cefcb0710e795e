r"""What a friction law may say, beside its four methods, of where its friction tends.

A velocity is kept until the friction is steady. Steady is not "changes little in a step": friction
that weakens only after a slip of :math:`A_d` is constant before, and far from where it ends. The
law alone knows. It may have any of these three, beyond the methods of ``FrictionLaw``:

- ``unsettled(state, pressure)``: (q,), Pa, by how much the friction traction is above the one that
  it tends to if the point slides on for ever under the same conditions;
- ``presliding_length(state, pressure)``: (q,), m, slip in which the traction follows a change of
  direction or speed, such as :math:`\mu p/K_T`;
- ``settling_slip``: m, slip from which on the coefficient of friction is within ``SETTLED`` of
  where it tends; 0 where it does not depend on the slip, inf where it never comes so near.

What it does not say is taken as: nothing left, the elastic slip of the state, 0.
"""

from __future__ import annotations

from typing import Protocol, cast

import numpy as np
from numpy.typing import NDArray

from tribox.forms.friction.law import FrictionLaw, FrictionState

Floats = NDArray[np.float64]

SETTLED = 1e-3
"""Distance of friction from where it tends, relative, at which it counts as being there."""


class _Settling(Protocol):
    """All that a law may say."""

    settling_slip: float

    def unsettled(self, state: FrictionState, pressure: Floats) -> Floats: ...

    def presliding_length(self, state: FrictionState, pressure: Floats) -> Floats: ...


def knows_its_end(law: FrictionLaw) -> bool:
    """Whether it is known, at every point, how far friction is from where it tends."""
    return hasattr(law, "unsettled") or settling_slip(law) == 0.0


def settling_slip(law: FrictionLaw) -> float:
    """Slip after which a law's coefficient of friction has settled, m; 0 if it does not say."""
    return float(getattr(law, "settling_slip", 0.0))


def unsettled(law: FrictionLaw, state: FrictionState, pressure: Floats) -> Floats:
    """By how much friction is above the traction it tends to, (q,), Pa; 0 at open points.

    Args:
        law: the law.
        state: after the step, of q points.
        pressure: (q,), Pa, t_N.
    """
    if not hasattr(law, "unsettled"):
        return np.zeros_like(pressure)
    left = cast(_Settling, law).unsettled(state, pressure)
    return np.where(pressure > 0.0, left, 0.0)


def presliding_length(law: FrictionLaw, state: FrictionState, pressure: Floats) -> Floats:
    """Slip in which friction follows a change, (q,), m; 0 at open points.

    Args:
        law: the law.
        state: after the step, of q points.
        pressure: (q,), Pa, t_N.
    """
    if hasattr(law, "presliding_length"):
        length = cast(_Settling, law).presliding_length(state, pressure)
    else:
        length = np.linalg.norm(state.elastic_slip, axis=1)
    return np.where(pressure > 0.0, length, 0.0)
