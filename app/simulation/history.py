"""The history of a run: one row for each converged step, and what its columns are called."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import MISSING, dataclass, field, fields
from typing import Any


@dataclass(frozen=True, slots=True)
class Column:
    """A column of the history."""

    title: str  # what it is called in tables for people
    unit: str  # SI; "text" of a text, "" of a plain number
    pair: bool = False  # whether a pair of surfaces has one for itself
    count: bool = False  # whether it tells of the way to the result, not of the physics
    # whether it can be a small difference of large numbers, and is to be compared with those
    difference: bool = False


def column(title: str, unit: str, *, default: Any = MISSING, **more: bool) -> Any:
    """Declare a column; see :class:`Column`."""
    return field(default=default, metadata={"column": Column(title, unit, **more)})


@dataclass(slots=True)
class Row:
    """One line of the history: a converged step. SI units; forces for the given thickness.

    ``normal_force`` is the integral of the contact pressure, ``friction_force`` that of the
    friction's magnitude, ``friction_coefficient`` their ratio. ``tangential_force`` is the friction
    along the surface with its sign, ``normal_resultant`` and ``drag`` are the whole resultant
    across and along the contact. ``velocity`` is that of the driven boundaries (0 without),
    ``effective_viscosity`` T D/(A V) with A the closed reference area, ``area_ratio``
    the mean da/dA of that area. ``energy_error`` is external work less strain, kinetic and
    interface energy and dissipation (that of the contacts, and ``plastic_dissipation`` and
    ``viscous_dissipation`` in the bodies), these by the trapezoidal rule: ``numerical_dissipation``
    is what the dissipations of the backward Euler steps hold beyond it. ``force`` is the resultant
    of all tractions on the slave, ``friction`` that of the friction on the master, ``twist_moment``
    its moment about the mean normal through the centre of pressure.

    In an explicit run a row stands for many time steps: forces are means over them, the rest is as
    it is at their end, ``dt`` is the length of one and ``attempts`` their number.

    There are more than twenty attributes because each is a column of ``history.csv``: name, title
    and unit stand here alone, what it is in docs/results.md.
    """

    step: int = column("step", "", count=True)
    time: float = column("time t", "s")
    stage: str = column("stage", "text", count=True)
    dt: float = column("length of the step", "s")
    velocity: float = column("sliding velocity V", "m/s")
    slip_speed: float = column("slip speed", "m/s", pair=True)
    driven_displacement: float = column("driven path", "m")
    normal_force: float = column("normal force N", "N", pair=True)
    friction_force: float = column("friction force F_T", "N", pair=True)
    tangential_force: float = column("signed friction force", "N", pair=True)
    normal_resultant: float = column("normal resultant", "N", pair=True)
    drag: float = column("drag", "N", pair=True)
    friction_coefficient: float = column("friction coefficient F_T/N", "", pair=True)
    mu: float = column("μ of the law", "", pair=True)
    film_thickness: float = column("film thickness D", "m", pair=True)
    effective_viscosity: float = column("effective viscosity η_eff", "Pa s", pair=True)
    contact_area: float = column("contact area A", "m²", pair=True)
    area_ratio: float = column("area_ratio", "", pair=True)
    stick_fraction: float = column("share that sticks", "", pair=True)
    viscous_fraction: float = column("share only the film carries", "", pair=True)
    max_penetration: float = column("largest penetration", "m", pair=True)
    newton_iterations: int = column("Newton iterations", "", count=True)
    linear_iterations: int = column("linear iterations", "", count=True)
    attempts: int = column("attempts", "", count=True)
    strain_energy: float = column("strain energy", "J")
    kinetic_energy: float = column("kinetic energy", "J")
    interface_energy: float = column("interface energy", "J")
    dissipation: float = column("dissipation", "J")
    plastic_dissipation: float = column("plastic dissipation", "J")
    viscous_dissipation: float = column("viscous dissipation", "J")
    numerical_dissipation: float = column("numerical dissipation", "J")
    damping_dissipation: float = column("damping dissipation", "J")
    external_work: float = column("external work", "J")
    energy_error: float = column("energy error", "J", difference=True)
    force_x: float = column("force R_x", "N", difference=True, default=0.0)
    force_y: float = column("force R_y", "N", difference=True, default=0.0)
    force_z: float = column("force R_z", "N", difference=True, default=0.0)
    friction_x: float = column("friction_x", "N", difference=True, default=0.0)
    friction_y: float = column("friction_y", "N", difference=True, default=0.0)
    friction_z: float = column("friction_z", "N", difference=True, default=0.0)
    twist_moment: float = column("twisting moment", "N m", difference=True, default=0.0)

    @property
    def when(self) -> str:
        """Time and stage in words."""
        return f"time {time_text(self.time, self.dt)}, stage {self.stage}"


COLUMNS = tuple(f.name for f in fields(Row))
DECLARED: dict[str, Column] = {f.name: f.metadata["column"] for f in fields(Row)}
"""What each column is called."""
RESULTANTS = tuple(n for n, c in DECLARED.items() if c.difference and n != "energy_error")
PHYSICAL = tuple(n for n, c in DECLARED.items() if not (c.count or c.difference))
"""Columns that describe the physics alone."""
PAIR_COLUMNS = tuple(n for n, c in DECLARED.items() if c.pair)
"""Columns that a pair of surfaces has for itself, in ``contacts.csv``; beside the resultants."""


UNBALANCED = 0.01  # energy gap from which on a run is warned of


def energy_gap(rows: Sequence[Row]) -> float:
    """Last energy error over the largest external work or kinetic energy of the run; 0 without."""
    largest = max((max(abs(row.external_work), row.kinetic_energy) for row in rows), default=0.0)
    return rows[-1].energy_error / largest if largest > 0.0 else 0.0


# -- Times in messages: digits enough to tell one step from the next -------------------------------

FEWEST, MOST = 6, 17  # digits; a float has no more than 17


def time_text(time: float, dt: float) -> str:
    """A time, s, with the digits that a step of ``dt``, s, changes, and one more."""
    digits = FEWEST
    if time and dt and math.isfinite(time) and math.isfinite(dt):
        apart = math.floor(math.log10(abs(time))) - math.floor(math.log10(abs(dt)))
        digits = min(max(apart + 2, FEWEST), MOST)
    return f"{time:.{digits}g} s"
