"""Numbers of a converged step: forces, film, energies. All are sums over ranks, per thickness."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from mpi4py import MPI

from forms.contact import ContactTerm, ContactTrial
from forms.friction import Regime
from geometry.projection import Floats


@dataclass(slots=True)
class ContactMeasure:
    """One pair after a step, per unit thickness.

    Attributes:
        normal_force, drag: N/m; resultant of all tractions on the slave along the mean normal of
            the contact, and against the direction right of it.
        tangential_force: N/m; friction on the master along its surface, to the right. It leaves
            out what the drag also holds: pressure on a surface that is not flat.
        area: m, closed reference area; stretch: mean da/dA of it; stick, viscous: shares of it,
            by regime.
        film: m, friction_coefficient: mean of μ(d); both weighted by pressure times area.
        penetration: m, largest. speed: m/s, mean slip speed of the closed area.
        energy: J/m, penalty and elastic slip. dissipated: J/m in this step; numerical: the part of
            it that backward Euler books beyond the trapezoidal rule, ½ (T_{n+1} − T_n)·Δg_T.
        beyond: share of the reference area that has run past the end of the master.
        least_dissipation: J/m², smallest at any point, without the time integration's own part.
        worst: where that is (m, current).
    """

    normal_force: float
    drag: float
    tangential_force: float
    area: float
    stretch: float
    stick: float
    viscous: float
    film: float
    friction_coefficient: float
    penetration: float
    speed: float
    energy: float
    dissipated: float
    numerical: float
    beyond: float
    least_dissipation: float
    worst: tuple[float, ...]


def measure_contact(term: ContactTerm, trial: ContactTrial, comm: MPI.Comm) -> ContactMeasure:
    """Measure one pair; collective."""
    k, response = trial.kinematics, trial.response
    weight = term.surface.slave.weight
    closed = np.where(trial.pressure > 0.0, weight, 0.0)
    regime, parts = response.regime, response.dissipation
    load = closed * trial.pressure
    mu = term.law.coefficient(response.state)
    sums = np.concatenate(
        [
            [
                closed.sum(),
                closed[regime == Regime.STICK].sum(),
                closed[regime == Regime.VISCOUS].sum(),
                load.sum(),
                load @ trial.film,
                load @ mu,
                closed @ np.linalg.norm(k.slip, axis=1),
                term.interface_energy(trial),
                weight @ parts.total,
                0.5 * (weight @ _dot(response.traction - term.state.friction_traction, k.slip)),
                weight @ (~trial.projection.on_surface & (k.gap < 0.0)),
                weight.sum(),
                weight @ _dot(response.traction, turned_right(k.normal)),
                closed @ trial.stretch,
            ],
            weight @ trial.traction,
            closed @ k.normal,
        ]
    )
    total = np.empty_like(sums)
    comm.Allreduce(sums, total, op=MPI.SUM)
    area, stick, viscous, force = total[:4]
    dim = k.normal.shape[1]
    normal_force, drag = _resultants(total[14 : 14 + dim], total[14 + dim :])
    penetration = comm.allreduce(float(np.max(-k.gap, where=k.closed, initial=0.0)), op=MPI.MAX)
    least, worst = _least(parts.total - parts.numerical, trial.position, comm)
    return ContactMeasure(
        normal_force=normal_force,
        drag=drag,
        tangential_force=float(total[12]),
        area=float(area),
        stretch=_over(total[13], area),
        stick=_over(stick, area),
        viscous=_over(viscous, area),
        film=_over(total[4], force),
        friction_coefficient=_over(total[5], force),
        penetration=penetration,
        speed=_over(total[6], area) / trial.dt,
        energy=float(total[7]),
        dissipated=float(total[8]),
        numerical=float(total[9]),
        beyond=_over(total[10], total[11]),
        least_dissipation=least,
        worst=worst,
    )


def _dot(u: Floats, v: Floats) -> Floats:
    out: Floats = np.einsum("qi,qi->q", u, v)
    return out


def _over(value: float, total: float) -> float:
    return float(value / total) if total > 0.0 else 0.0


def _resultants(force: Floats, normal: Floats) -> tuple[float, float]:
    """Normal resultant of the traction on the slave and the drag, N/m."""
    length = float(np.linalg.norm(normal))
    if length == 0.0:
        return 0.0, 0.0
    n: Floats = np.asarray(normal / length, dtype=np.float64)
    return float(force @ n), float(-(force @ turned_right(n[None])[0]))


def turned_right(normal: Floats) -> Floats:
    """Unit vectors (q, i) along the surface, to the right of the normals (q, i)."""
    return np.stack([normal[:, 1], -normal[:, 0]], axis=1)


def _least(density: Floats, position: Floats, comm: MPI.Comm) -> tuple[float, tuple[float, ...]]:
    at = int(np.argmin(density)) if len(density) else -1
    mine = (float(density[at]), tuple(map(float, position[at]))) if at >= 0 else (np.inf, ())
    least, worst = min(comm.allgather(mine))
    return least, worst


@dataclass(slots=True)
class Row:
    """One line of the history: a converged step. SI units; forces for the given thickness.

    ``tangential_force`` is the friction, ``drag`` the whole resultant along the contact (with the
    pressure on a surface that is not flat). ``velocity`` is that of the driven boundaries (0
    without), ``effective_viscosity`` T D/(A V) with A the closed reference area, ``area_stretch``
    the mean da/dA of that area. ``energy_error`` is external work less strain, kinetic and
    interface energy and dissipation, these by the trapezoidal rule: ``numerical_dissipation`` is
    what the dissipation of the backward Euler steps holds beyond it.
    """

    step: int
    time: float
    stage: str
    dt: float
    velocity: float
    slip_speed: float
    driven_displacement: float
    normal_force: float
    tangential_force: float
    drag: float
    friction_coefficient: float
    mu: float
    film_thickness: float
    effective_viscosity: float
    contact_area: float
    area_stretch: float
    stick_fraction: float
    viscous_fraction: float
    max_penetration: float
    newton_iterations: int
    attempts: int
    strain_energy: float
    kinetic_energy: float
    interface_energy: float
    dissipation: float
    numerical_dissipation: float
    external_work: float
    energy_error: float


COLUMNS = tuple(f.name for f in fields(Row))
# Columns that describe the physics alone. The energy error is left out: it is what remains of large
# numbers that cancel, and is to be held against the external work.
PHYSICAL = tuple(
    name
    for name in COLUMNS
    if name not in ("step", "stage", "newton_iterations", "attempts", "energy_error")
)
