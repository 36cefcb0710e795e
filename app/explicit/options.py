"""Settings of explicit dynamics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class MassScaling:
    """Mass added so that the step may be longer.

    Attributes:
        kind: "uniform": every density times a factor; "limiting": mass only for the elements that
            would need a shorter step than ``step``.
        factor: of all densities, >= 1; with "uniform" unless ``step`` is given.
        step: s, stable step, before the safety factor, that the mass has to allow.

    Raises:
        ValueError: factor and step do not fit the kind.
    """

    kind: Literal["uniform", "limiting"] = "limiting"
    factor: float | None = None
    step: float | None = None

    def __post_init__(self) -> None:
        if self.kind == "limiting" and (self.step is None or self.factor is not None):
            raise ValueError('mass_scaling: kind = "limiting" takes step and no factor')
        if self.kind == "uniform" and (self.step is None) == (self.factor is None):
            raise ValueError('mass_scaling: kind = "uniform" takes either factor or step')
        if self.factor is not None and not self.factor >= 1.0:
            raise ValueError(f"mass_scaling.factor = {self.factor!r}: must be at least 1")
        if self.step is not None and not self.step > 0.0:
            raise ValueError(f"mass_scaling.step = {self.step!r} s: must be above 0")


@dataclass(frozen=True, slots=True)
class ExplicitOptions:
    """Settings of the explicit stepper.

    Attributes:
        dt_safety: the recommended step over the stable one, in (0, 1].
        damping: 1/s, c of the damping force c m v; >= 0.
        mass_scaling: mass added for a longer step, or none.
        viscous: "semi-implicit": the film's viscous stress is solved for at each point and does
            not limit the step; "bounded": it is explicit, and in the bound of the step.
        reestimate_every: steps between two estimates of the stable step.
        check_every: steps between two checks of the energy.
        energy_limit: ratio of stored to supplied energy above which the run counts as unstable.
        compiled: whether to use the compiled kernels where there are any.
    """

    dt_safety: float = 0.9
    damping: float = 0.0
    mass_scaling: MassScaling | None = None
    viscous: Literal["semi-implicit", "bounded"] = "semi-implicit"
    reestimate_every: int = 1000
    check_every: int = 100
    energy_limit: float = 1.5
    compiled: bool = True
