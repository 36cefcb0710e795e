"""Notices steps that ended at round-off: they did not reach the tolerance that was asked for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.snapshot import Snapshot
from tribox.app.implicit.stepper import StepResult
from tribox.app.simulation.history import Row
from tribox.app.simulation.observer import Interval
from tribox.forms.bodies.materials import oedometric_modulus

TOUCHING = 1e-9  # penetration over a facet's length up to which bodies only touch
RIGID = 1e4  # stiffness over that of another body beyond which a body need not go to be rigid


@dataclass(frozen=True, slots=True)
class AtRoundOff:
    """A load step whose residual fell no further than round-off.

    Attributes:
        share: largest residual of its steps over its largest contact or reaction force.
        stage: its label.
        body: whose rounding leaves most; carried: whether because it has moved far.
    """

    share: float
    stage: str
    body: str
    carried: bool


class RoundOffWatch:
    """Compares what Newton's method ended with, step by step, with what was asked for.

    A residual counts against the largest force of its load step: of bodies that carry nothing yet
    rounding is all there is.

    Attributes:
        worst: the load step with the largest share so far; None while all reached the tolerance.
    """

    def __init__(self, problem: Equilibrium, tolerance: float) -> None:
        """Begin with no step.

        Args:
            problem: what is solved.
            tolerance: residual allowed, relative to the contact or reaction force.
        """
        self.worst: AtRoundOff | None = None
        self._problem, self._tolerance = problem, tolerance
        lengths = [term.surface.facet_length for term in problem.contacts]
        self._touching = TOUCHING * min(lengths, default=0.0)
        self._begin()

    def _begin(self) -> None:
        self._residual = self._force = 0.0
        self._loaded = False

    def step(self, row: Row, result: StepResult | Interval) -> None:
        """Look at a converged step; collective."""
        if isinstance(result, Interval):
            return
        force = self._problem.reference_force
        self._force = max(self._force, force)
        pressed = bool(self._problem.contacts) and row.max_penetration > self._touching
        self._loaded |= pressed or force > self._problem.roundoff
        last = result.residuals[-1] if result.residuals else 0.0
        if last > self._tolerance:
            self._residual = max(self._residual, last * force)

    def end(self, label: str) -> None:
        """A load step has ended, with or without a solution; collective."""
        share = self._residual / self._force if self._force > 0.0 else 0.0
        worse = self.worst is None or share > self.worst.share
        if self._loaded and share > self._tolerance and worse:
            self.worst = AtRoundOff(share, label, *self._noisiest())
        self._begin()

    def snapshot(self) -> Snapshot:
        """What has been seen so far."""
        return {
            "worst": None if self.worst is None else asdict(self.worst),
            "load_step": [self._residual, self._force, self._loaded],
        }

    def restore(self, kept: Snapshot) -> None:
        """Go on from what :meth:`snapshot` has seen."""
        self.worst = None if kept["worst"] is None else AtRoundOff(**kept["worst"])
        self._residual, self._force, self._loaded = kept["load_step"]

    def _noisiest(self) -> tuple[str, bool]:
        """The body whose rounding leaves most, and whether by its motion; collective."""
        rounding = self._problem.rounding
        at_rest, carried = rounding.squares()
        at = int((at_rest + carried).argmax())
        return rounding.names[at], bool(carried[at] > at_rest[at])

    def warnings(self) -> Iterator[str]:
        """One line if some load step ended at round-off."""
        if self.worst is None:
            return
        yield (
            f"stage {self.worst.stage}: a residual of {self.worst.share:.1e} of the contact or "
            f"reaction force was accepted, not solver.tolerance = {self._tolerance:.3g}: rounding "
            f"in body {self.worst.body} leaves no less; the results are no better than that; try "
            f"{self._cure(self.worst)}"
        )

    def _cure(self, worst: AtRoundOff) -> str:
        moduli = {s.name: oedometric_modulus(s.material) for s in self._problem.solids}
        ratio = moduli[worst.body] / min(moduli.values())
        if worst.carried and len(moduli) > 1:
            return f"letting the other body move, as {worst.body} has moved far"
        if ratio > RIGID:
            return (
                f"a lower modulus of {worst.body}, which is {ratio:.1g} times as stiff as the "
                f"softest body (1000 times is as good as rigid)"
            )
        return "a larger load, or a larger solver.tolerance if this is enough"
