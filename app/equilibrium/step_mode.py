"""How a step is evaluated: its duration, the mode of each contact pair, and holding springs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from tribox.forms.contact.interior_point import InteriorPoint, SoftenedPoint
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.state import AS_IS, ContactMode, ContactTrial
from tribox.geometry.surfaces.facets import Bools, Floats


@dataclass(frozen=True, slots=True)
class HoldingSprings:
    """A spring to a fixed place at every node of a body, in the directions in which it is loose."""

    stiffness: Floats  # (n,), N/m, of the owned unknowns
    place: Floats  # (n,), m, where they carry no force
    # whether they are part of the solution, of bodies that carry nothing: forces are to be compared
    # with the largest of the run then
    weak: bool = False

    def force(self, at: Floats) -> Floats:
        """Residual (n,), N, of the owned unknowns (n,), m."""
        return self.stiffness * (at - self.place)


@dataclass(frozen=True, slots=True)
class StepMode:
    """What residual and tangent depend on beside the displacements and the loads."""

    dt: float = 1.0  # duration of the step, s
    modes: tuple[ContactMode, ...] = ()  # mode of each contact pair; empty: all pairs as they are
    # springs that hold bodies while a solution is sought; None in what is committed
    holding: HoldingSprings | None = None
    # whether the bodies' materials feel time; the contacts' modes say it of them
    rate_dependent: bool = True

    @classmethod
    def of_stage(
        cls, dt: float, contacts: Iterable[ContactTerm], rate_dependent: bool = True
    ) -> StepMode:
        """All pairs as they are, in a stage that feels time or does not."""
        modes = tuple(ContactMode(rate_dependent=rate_dependent) for _ in contacts)
        return cls(dt, modes, rate_dependent=rate_dependent)

    @property
    def material_dt(self) -> float:
        """Duration of the step as the bodies' materials feel it, s: infinite without rates."""
        return self.dt if self.rate_dependent else math.inf

    def pairs(self, contacts: Sequence[ContactTerm]) -> Iterator[tuple[ContactTerm, ContactMode]]:
        """Each contact with its mode."""
        return zip(contacts, self.modes or (AS_IS,) * len(contacts), strict=True)

    def with_penalty_scale(
        self, contacts: Sequence[ContactTerm], penalty_scale: float, adhesive_facets: float = 0.0
    ) -> StepMode:
        """The same with a penalty ``penalty_scale`` times as high, and another adhesive gap."""
        changed = [
            replace(
                mode,
                penalty_scale=penalty_scale * mode.penalty_scale,
                adhesive_gap=adhesive_facets * term.surface.facet_length,
            )
            for term, mode in self.pairs(contacts)
        ]
        return replace(self, modes=tuple(changed))

    def without(self, contacts: Sequence[ContactTerm], gone: Bools) -> StepMode:
        """The same without pressure and friction in some pairs (p,)."""
        pairs = zip(self.pairs(contacts), gone, strict=True)
        changed = [replace(mode, penalty_scale=0.0) if off else mode for (_, mode), off in pairs]
        return replace(self, modes=tuple(changed))

    def with_thinned_oil(self, contacts: Sequence[ContactTerm], factor: float) -> StepMode:
        """The same with ``factor`` times the viscosity in films that are found."""
        changed = [replace(mode, thinned=factor) for _, mode in self.pairs(contacts)]
        return replace(self, modes=tuple(changed))

    def inside(self, points: Sequence[InteriorPoint | SoftenedPoint | None]) -> StepMode:
        """The same with contacts on their way to their laws, one point for each pair."""
        pairs = zip(self.modes, points, strict=True)
        return replace(self, modes=tuple(replace(mode, interior=at) for mode, at in pairs))

    def held(self, springs: HoldingSprings | None) -> StepMode:
        """The same with bodies held by springs."""
        return replace(self, holding=springs)

    def frozen(self, contacts: Sequence[ContactTerm], trials: Sequence[ContactTrial]) -> StepMode:
        """The same with all points frozen on their facets of these evaluations."""
        changed = [
            replace(mode, frozen_facets=trial.projection.facet)
            for (_, mode), trial in zip(self.pairs(contacts), trials, strict=True)
        ]
        return replace(self, modes=tuple(changed))

    def with_friction_as_load(self, contacts: Sequence[ContactTerm]) -> StepMode:
        """The same with friction that has no stiffness: bodies slide on each other freely."""
        changed = [replace(mode, friction_as_load=True) for _, mode in self.pairs(contacts)]
        return replace(self, modes=tuple(changed))

    def only_pressed(self, contacts: Sequence[ContactTerm]) -> StepMode:
        """The same with a tangent in which contacts that only touch have no stiffness."""
        changed = [replace(mode, only_pressed=True) for _, mode in self.pairs(contacts)]
        return replace(self, modes=tuple(changed))


DEFAULT_STEP = StepMode()
