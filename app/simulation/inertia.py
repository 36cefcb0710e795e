"""Kinetic against strain energy of explicit load steps, and what is said of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from tribox.app.build.load_steps import LoadStep
from tribox.app.case.case import Case

REST = 1e-3  # kinetic over strain energy up to which a relaxed body counts as at rest


@dataclass(slots=True)
class Inertia:
    """Kinetic against strain energy over one explicit load step, from its rows.

    Attributes:
        label: of the load step.
        kinetic, strain: J/m, sums over its rows.
        last: kinetic over strain energy at its last row.
    """

    label: str
    kinetic: float = 0.0
    strain: float = 0.0
    last: float = 0.0

    @property
    def ratio(self) -> float:
        """Mean kinetic over mean strain energy; 0 without strain energy."""
        return self.kinetic / self.strain if self.strain > 0.0 else 0.0

    def add(self, kinetic: float, strain: float) -> None:
        """Enter a row's energies, J/m."""
        self.kinetic += kinetic
        self.strain += max(strain, 0.0)
        self.last = kinetic / strain if strain > 0.0 else 0.0


def notes_on_inertia(case: Case, load_step: LoadStep, inertia: Inertia) -> Iterator[str]:
    """Warnings after an explicit load step: scaled mass that is felt, and bodies not at rest.

    Args:
        case: what was run; load_step: the part that has ended.
        load_step: see case.
        inertia: kinetic against strain energy over it.
    """
    limit = case.solver.kinetic_limit
    if case.solver.mass_scaling is not None and inertia.ratio > limit:
        yield (
            f"stage {load_step.label}: kinetic energy is {inertia.ratio:.2g} of the strain "
            f"energy, above kinetic_limit = {limit:g}: the scaled mass is felt (less mass_scaling, "
            "a longer ramp or a lower velocity)"
        )
    if load_step.stage.relax and inertia.last > REST:
        yield (
            f"stage {load_step.label}: not at rest at its end, kinetic energy is "
            f"{inertia.last:.2g} of the strain energy (longer duration)"
        )
