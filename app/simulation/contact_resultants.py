"""Numbers of a converged step: forces, film, energies; sums over ranks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.build.model import Model
from tribox.app.build.pair_at_start import OVERLAP, PairAtStart
from tribox.app.errors import SolutionError
from tribox.forms.contact.lubricated import LubricatedTerm
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.state import ContactTrial
from tribox.forms.friction.law import Regime
from tribox.geometry.surfaces.facets import Floats

# Vector integrals whose radial part cancels round the ring of an axisymmetric pair.
_CANCELLING = ("force", "normal", "friction")


@dataclass(slots=True)
class ContactResultants:
    """One pair after a step, per unit thickness in plane strain, in all otherwise (N, not N/m).

    "Along" is the way along the surface that signs are for: in the plane to the right of the
    normal; in space the driven direction, or that of the friction where nothing is driven.
    """

    normal_force: float  # N/m, integral of the contact pressure t_N, ≥ 0 on a surface of any shape
    friction_force: float  # N/m, integral of the friction's magnitude |T|
    # N/m, integral of the friction on the master along its surface, with its sign. It leaves out
    # what the drag also holds: pressure on a surface that is not flat
    tangential_force: float
    # N/m, resultant of all tractions on the slave along the mean normal of the contact, and (drag)
    # against the way along it. On a surface that closes on itself (a plug in a tube) it says little
    normal_resultant: float
    drag: float
    # N/m, vectors: resultant of all tractions on the slave, and of the friction on the master. On
    # an axisymmetric pair the radial parts cancel round the ring
    force: tuple[float, ...]
    friction: tuple[float, ...]
    # N m, of the friction on the master about the mean normal, through the centre of pressure; 0 in
    # the plane
    twist_moment: float
    area: float  # m, closed reference area
    area_ratio: float  # mean da/dA of it
    stick: float  # share of it in the sticking regime
    viscous: float  # share of it in the viscous regime
    film: float  # m, weighted by pressure times area
    friction_coefficient: float  # mean of μ(d), weighted likewise
    penetration: float  # m, largest
    speed: float  # m/s, mean slip speed of the closed area
    energy: float  # J/m, penalty and elastic slip
    dissipated: float  # J/m in this step
    # the part of it that backward Euler counts beyond the trapezoidal rule, ½ (T_{n+1} − T_n)·Δg_T
    numerical: float
    least_dissipation: float  # J/m², smallest at any point, without the time integration's own part
    worst: tuple[float, ...]  # where that is (m, current)
    # N m/m, of all tractions on a tool about its centre, (1,) in the plane and (3,) in space; empty
    # without a tool
    tool_moment: tuple[float, ...] = ()
    # N/m, part of the normal force that asperities carry: all but where the film is an unknown
    asperity_force: float = 0.0
    oil: float = 0.0  # m² or m³, on the slave; 0 but where the film is an unknown
    oil_supplied: float = 0.0  # what came in since the start from where it is flooded, likewise


def penetration_of(trial: ContactTrial) -> float:
    """The largest of this rank, m: of points one by one, or of the mean gaps of the pressure."""
    k, normal = trial.kinematics, trial.normal_contact
    if normal.gap is None:
        gap = np.where(k.closed, k.gap, 0.0)
    else:
        gap = np.where(normal.needs(), normal.gap, 0.0)
    return float(np.max(-gap, initial=0.0))


def measure_contact(
    term: ContactTerm, trial: ContactTrial, comm: MPI.Comm, driven: Sequence[float] | None = None
) -> ContactResultants:
    """Resultants of one pair; collective."""
    total = {n: float(value) for n, value in _summed(comm, _scalars(term, trial)).items()}
    area, force = total["closed"], total["load"]
    vectors = _summed(comm, vector_integrals(term, trial))
    parts = trial.response.dissipation
    penetration = comm.allreduce(penetration_of(trial), op=MPI.MAX)
    dry, oil, supplied = _film(term, trial, force)
    least, worst = _least(parts.total - parts.numerical, trial.position, comm)
    found = resultants(vectors, driven, term.surface.axisymmetric)
    if trial.normal_contact.lubrication is not None:
        # The pressure's pull at the inlet is opposite to that at the outlet, and no resistance.
        found["friction_force"] = abs(found["tangential_force"])
    return ContactResultants(
        **found,
        area=area,
        area_ratio=over(total["area_ratio"], area),
        stick=over(total["stick"], area),
        viscous=over(total["viscous"], area),
        film=over(total["film"], force),
        friction_coefficient=over(total["mu"], force),
        penetration=penetration,
        speed=over(total["slip"], area) / trial.dt,
        energy=total["energy"],
        dissipated=total["dissipated"],
        numerical=total["numerical"],
        least_dissipation=least,
        worst=worst,
        asperity_force=dry,
        oil=oil,
        oil_supplied=supplied,
    )


def _film(term: ContactTerm, trial: ContactTrial, force: float) -> tuple[float, float, float]:
    """What asperities carry, oil and its supply, of a pair with the normal force ``force``."""
    film = trial.normal_contact.lubrication
    if film is None or not isinstance(term, LubricatedTerm):
        return force, 0.0, 0.0
    after = term.film_after(trial)
    carried = float(term.linearised.area_of(trial) @ (film.ratio * film.asperity))
    return carried, float(after.volume.sum()), after.supplied


def _scalars(term: ContactTerm, trial: ContactTrial) -> dict[str, Any]:
    """This rank's integrals over the reference area."""
    k, response = trial.kinematics, trial.response
    weight = term.surface.slave.weight
    # What is tied counts where it is tied, also in tension.
    pressed = np.where(k.closed if term.tied else trial.pressure > 0.0, weight, 0.0)
    closed = pressed * term.cover(trial)
    regime, parts = response.regime, response.dissipation
    load = pressed * trial.pressure
    return {
        "closed": closed.sum(),
        "stick": closed[regime == Regime.STICK].sum(),
        "viscous": closed[regime == Regime.VISCOUS].sum(),
        "load": load.sum(),
        "film": load @ trial.film,
        "mu": load @ term.law.coefficient(response.state),
        "slip": closed @ np.linalg.norm(k.slip, axis=1),
        "energy": term.interface_energy(trial),
        "dissipated": weight @ parts.total + fading_loss(term, trial),
        "numerical": lost_by_rule(term, trial, term.state.friction_traction),
        "area_ratio": closed @ trial.area_ratio,
    }


def lost_by_rule(term: ContactTerm, trial: ContactTrial, before: Floats) -> float:
    """What the trapezoidal rule takes for friction's work in a step but the law does not, J/m.

    This rank's; ``before``: (q, i), Pa, tractions at its begin, also of points opened since.
    """
    change = trial.response.traction - before
    rows = np.flatnonzero(change.any(axis=1))
    work = _dot(change[rows], trial.kinematics.way[rows])
    return 0.5 * float(term.surface.slave.weight[rows] @ work)


def fading_loss(term: ContactTerm, trial: ContactTrial) -> float:
    """What this rank's points lost at the end of the master in a step, J per unit thickness."""
    if trial.faded is None or not term.active:
        return 0.0
    return float(term.surface.slave.weight @ trial.faded.lost)


def vector_integrals(term: ContactTerm, trial: ContactTrial) -> dict[str, Floats]:
    """This rank's vector integrals (k, i) over the reference area, for :func:`resultants`.

    They are the traction on the slave, N/m, the normals of the closed area, m, the friction on the
    master, and as ``scalars`` the pressure and the friction's magnitude (in space beside a 0); in
    the plane the friction along the surface beside a 0; in space its moment about the origin, and
    the centre of pressure times the load; of a tool the moment on it (in the plane beside a 0).
    """
    weight, normal = term.surface.slave.weight, trial.kinematics.normal
    traction, load = trial.response.traction, weight * trial.pressure
    pressed = trial.kinematics.closed if term.tied else trial.pressure > 0.0
    scalars = np.zeros(term.surface.dim)
    scalars[:2] = load.sum(), weight @ np.sqrt(_dot(traction, traction))
    out = {
        "force": weight @ trial.traction,
        "normal": np.where(pressed, weight, 0.0) @ normal,
        "friction": weight @ traction,
        "scalars": scalars,
    }
    if term.surface.dim == 2:
        out["right"] = np.array([weight @ _dot(traction, turned_right(normal)), 0.0])
    else:
        out["moment"] = weight @ np.cross(trial.position, traction)
        out["centre"] = load @ trial.position
    if trial.carried is not None:
        arm = trial.projection.foot - trial.carried.centre
        out["tool_moment"] = -(weight @ _moments(arm, trial.traction))
    return out


def resultants(
    vectors: dict[str, Floats], driven: Sequence[float] | None, axisymmetric: bool
) -> dict[str, Any]:
    """Forces of a :class:`ContactResultants`, by name."""
    if axisymmetric:
        # Round the ring radial parts cancel; what the integrals of the section give of them is no
        # force.
        axial = np.array([0.0, 1.0])
        vectors = {n: v * axial if n in _CANCELLING else v for n, v in vectors.items()}
    normal, way = _directions(vectors, driven)
    right = vectors.get("right")
    friction = vectors["friction"] @ way if right is None else right[0]
    return {
        "normal_force": float(vectors["scalars"][0]),
        "friction_force": float(vectors["scalars"][1]),
        "tangential_force": float(friction),
        "normal_resultant": float(vectors["force"] @ normal),
        "drag": -float(vectors["force"] @ way),
        "force": tuple(map(float, vectors["force"])),
        "friction": tuple(map(float, vectors["friction"])),
        "twist_moment": _twist(vectors, normal),
        "tool_moment": _on_tool(vectors, axisymmetric),
    }


def _summed(comm: MPI.Comm, mine: Mapping[str, Any]) -> dict[str, Floats]:
    """The same numbers or vectors, summed over all ranks."""
    total = comm.allreduce(np.array(list(mine.values()), dtype=np.float64))
    return dict(zip(mine, total, strict=True))


def _directions(
    vectors: dict[str, Floats], driven: Sequence[float] | None
) -> tuple[Floats, Floats]:
    """Mean normal of a contact and the way along it that signs are for."""
    normal: Floats = np.zeros_like(vectors["normal"])
    if vectors["normal"].any():
        normal = np.asarray(vectors["normal"] / float(np.linalg.norm(vectors["normal"])))
    if len(normal) == 2:
        return normal, turned_right(normal[None])[0]
    # A boundary that is driven straight into the contact says nothing about the way along it.
    for way in ([] if driven is None else [np.asarray(driven)]) + [vectors["friction"]]:
        along = way - (way @ normal) * normal
        if np.linalg.norm(along) > 1e-6 * np.linalg.norm(way):
            return normal, along / np.linalg.norm(along)
    return normal, np.zeros_like(normal)


def _twist(vectors: dict[str, Floats], normal: Floats) -> float:
    """Moment of the friction about the normal through the centre of pressure, N m; 0 in a plane."""
    load = vectors["scalars"][0]
    if "centre" not in vectors or load <= 0.0:
        return 0.0
    lever = np.cross(vectors["centre"] / load, vectors["friction"])
    return float((vectors["moment"] - lever) @ normal)


def _moments(arm: Floats, force: Floats) -> Floats:
    """Moments (q, i) of forces (q, i); in the plane that across it beside a 0."""
    if arm.shape[1] == 3:
        return np.cross(arm, force).astype(np.float64)
    turning = arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0]
    return np.stack([turning, np.zeros_like(turning)], axis=1)


def _on_tool(vectors: dict[str, Floats], axisymmetric: bool) -> tuple[float, ...]:
    """Moment on a tool about its centre, N m; none without one; of rings it cancels."""
    if "tool_moment" not in vectors:
        return ()
    moment = vectors["tool_moment"]
    if len(moment) == 2:
        moment = (0.0 if axisymmetric else 1.0) * moment[:1]
    return tuple(map(float, moment))


def _dot(u: Floats, v: Floats) -> Floats:
    return np.einsum("qi,qi->q", u, v)


def over(value: float, total: float) -> float:
    """A share of a total; 0 of nothing."""
    return float(value / total) if total > 0.0 else 0.0


def turned_right(normal: Floats) -> Floats:
    """Unit vectors (q, i) along the surface, to the right of the normals (q, i)."""
    return np.stack([normal[:, 1], -normal[:, 0]], axis=1)


def _least(density: Floats, position: Floats, comm: MPI.Comm) -> tuple[float, tuple[float, ...]]:
    at = int(np.argmin(density)) if len(density) else -1
    mine = (float(density[at]), tuple(map(float, position[at]))) if at >= 0 else (np.inf, ())
    least, worst = min(comm.allgather(mine))
    return least, worst


# Columns of a pair alone.
FILM_COLUMNS = ("asperity_force", "oil_volume", "oil_supplied")
_FORCES = ("normal_force", "friction_force", "tangential_force", "normal_resultant", "drag")


def along_force(pairs: Sequence[ContactResultants]) -> float:
    """Sum of the tangential forces' magnitudes, N/m: signs of different pairs do not cancel."""
    return sum(abs(m.tangential_force) for m in pairs)


def contact_columns(
    pairs: Sequence[ContactResultants],
    velocity: float,
    rate_dependent: bool,
    thickness: float,
    noise: float = 0.0,
) -> dict[str, Any]:
    """Columns of the history that are of the contacts: forces summed over the pairs, means by area.

    μ and D are means by the normal force, D and the effective viscosity those of the pairs that
    have a film. ``velocity``: m/s, driven, or 0; ``thickness``: m, of the slab; ``noise``: N/m,
    force up to which there is no ratio.
    """
    normal, friction, tangential, resultant, drag = (
        sum(getattr(m, name) for m in pairs) * thickness for name in _FORCES
    )
    area = sum(m.area for m in pairs)

    def mean(value: Callable[[ContactResultants], float]) -> float:
        return sum(value(m) * m.area for m in pairs) / area if area > 0.0 else 0.0

    wet = [m for m in pairs if m.film > 0.0]
    load, wet_load = (sum(m.normal_force for m in some) for some in (pairs, wet))
    film = over(sum(m.film * m.normal_force for m in wet), wet_load)
    wet_area = abs(velocity) * sum(m.area for m in wet)
    viscosity = over(along_force(wet) * film, wet_area)
    return {
        "slip_speed": mean(lambda m: m.speed) if rate_dependent else 0.0,
        "normal_force": normal,
        "friction_force": friction,
        "tangential_force": tangential,
        "normal_resultant": resultant,
        "drag": drag,
        "friction_coefficient": over(friction, normal) if normal > noise * thickness else 0.0,
        "mu": over(sum(m.friction_coefficient * m.normal_force for m in pairs), load),
        "film_thickness": film,
        "effective_viscosity": viscosity,
        "contact_area": area * thickness,
        "area_ratio": mean(lambda m: m.area_ratio),
        "stick_fraction": mean(lambda m: m.stick),
        "viscous_fraction": mean(lambda m: m.viscous),
        "max_penetration": 0.0 + max((m.penetration for m in pairs), default=0.0),
        **_summed_vectors(pairs, thickness),
    }


def film_columns(pair: ContactResultants, thickness: float) -> tuple[float, ...]:
    """Values of :data:`FILM_COLUMNS`, N and m³, of a slab of ``thickness`` (m)."""
    return (pair.asperity_force * thickness, pair.oil * thickness, pair.oil_supplied * thickness)


def _summed_vectors(pairs: Sequence[ContactResultants], thickness: float) -> dict[str, float]:
    """Columns of force vectors and of the twisting moment."""
    out = {}
    for kind in ("force", "friction"):
        vectors = [getattr(m, kind) for m in pairs]
        for axis, values in zip("xyz", zip(*vectors, strict=True), strict=False):
            out[f"{kind}_{axis}"] = sum(values) * thickness
    return {**out, "twist_moment": sum(m.twist_moment for m in pairs) * thickness}


# -- Contacts that a stage switches on or off ------------------------------------------------------


def begin_stage(model: Model, stage: str, x: PETSc.Vec) -> Floats:
    """Let a stage begin at the displacement x, m; collective; SolutionError on an overlap.

    Returns (n,), N per unit thickness, on owned unknowns, of contacts that are released now.
    """
    terms = model.problem.contacts
    before = [term.active for term in terms]
    model.begin_stage(stage)
    released = np.zeros(model.problem.owned)
    for index, (was, term) in enumerate(zip(before, terms, strict=True)):
        if term.active and not was:
            _require_apart(model, index, stage, x)
        if was and not term.active and model.case.is_released(model.case.contact[index], stage):
            released += model.problem.pair_forces(index)
    return released


def _require_apart(model: Model, index: int, stage: str, x: PETSc.Vec) -> None:
    """Refuse a contact whose surfaces would snap apart; collective."""
    table, term = model.case.contact[index], model.problem.contacts[index]
    surface = term.surface
    values = surface.gather(x)
    points = surface.slave_positions(values[surface.slave_rows])
    at = surface.project(points, surface.master_positions(values))
    if term.offset is not None:
        at.shift(term.offset)
    pair = PairAtStart(f"contact.{index}", table, surface, at)
    if pair.overlap > OVERLAP * surface.facet_length:
        raise SolutionError(
            f"stage {stage}: contact.{index} begins to act while {table.slave} is "
            f"{pair.overlap:.3g} m inside {table.master} at {pair.where_deepest()}, as drawn; the "
            f"bodies may touch then, not overlap (more than "
            f"{OVERLAP * surface.facet_length:.3g} m): let it act from an earlier stage on"
        )


def with_released_energy(
    resultants: Iterable[ContactResultants], before: Sequence[ContactResultants], model: Model
) -> list[ContactResultants]:
    """Resultants in which contacts that have been switched off have lost what they had stored.

    ``before``: of the last step; released friction is that of loads, counted there.
    """
    out, stage = list(resultants), "" if model.loads is None else model.loads.stage
    tables, terms = model.case.contact, model.problem.contacts
    for index, (table, term, last) in enumerate(zip(tables, terms, before, strict=False)):
        if not term.active and last.energy > 0.0:
            out[index] = replace(out[index], dissipated=last.energy)
        if not term.active and model.case.is_released(table, stage):
            out[index] = replace(out[index], numerical=0.0)
    return out
