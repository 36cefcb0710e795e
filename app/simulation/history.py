"""The history of a run: one row for each converged step, and what its columns are called."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields


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

    There are more than twenty attributes because each is a column of ``history.csv``.
    """

    step: int
    time: float
    stage: str
    dt: float
    velocity: float
    slip_speed: float
    driven_displacement: float
    normal_force: float
    friction_force: float
    tangential_force: float
    normal_resultant: float
    drag: float
    friction_coefficient: float
    mu: float
    film_thickness: float
    effective_viscosity: float
    contact_area: float
    area_ratio: float
    stick_fraction: float
    viscous_fraction: float
    max_penetration: float
    newton_iterations: int
    linear_iterations: int
    attempts: int
    strain_energy: float
    kinetic_energy: float
    interface_energy: float
    dissipation: float
    plastic_dissipation: float
    viscous_dissipation: float
    numerical_dissipation: float
    damping_dissipation: float
    external_work: float
    energy_error: float
    force_x: float = 0.0
    force_y: float = 0.0
    force_z: float = 0.0
    friction_x: float = 0.0
    friction_y: float = 0.0
    friction_z: float = 0.0
    twist_moment: float = 0.0


RESULTANTS = (*(f"{kind}_{i}" for kind in ("force", "friction") for i in "xyz"), "twist_moment")
COLUMNS = tuple(f.name for f in fields(Row))
# Columns that describe the physics alone. The energy error and the resultants are left out: they
# can be small differences of large numbers, and are to be compared with those.
PHYSICAL = tuple(
    name
    for name in COLUMNS
    if name
    not in (
        *("step", "stage", "newton_iterations", "linear_iterations", "attempts", "energy_error"),
        *RESULTANTS,
    )
)


def energy_gap(rows: Sequence[Row]) -> float:
    """Last energy error over the largest external work or kinetic energy of the run; 0 without."""
    largest = max((max(abs(row.external_work), row.kinetic_energy) for row in rows), default=0.0)
    return rows[-1].energy_error / largest if largest > 0.0 else 0.0


# -- Times in messages: digits enough to tell one step from the next -------------------------------

FEWEST, MOST = 6, 17  # digits; a float has no more than 17


def time_text(time: float, dt: float) -> str:
    """A time in s, with the digits that a step of ``dt`` changes, and one more.

    Args:
        time: s.
        dt: s, length of the step that ends or begins there.
    """
    digits = FEWEST
    if time and dt and math.isfinite(time) and math.isfinite(dt):
        apart = math.floor(math.log10(abs(time))) - math.floor(math.log10(abs(dt)))
        digits = min(max(apart + 2, FEWEST), MOST)
    return f"{time:.{digits}g} s"
