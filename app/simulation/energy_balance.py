"""The energy balance: external work against stored energy and dissipation, step by step."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.case.case import Case
from tribox.app.case.stage import LoadStep
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.snapshot import AtPoints, Kept, Nodal, Remembers, Snapshot
from tribox.app.equilibrium.step_mode import StepMode
from tribox.app.simulation.contact_resultants import ContactResultants
from tribox.app.simulation.history import Row
from tribox.forms.contact.lubricated import LubricatedTerm
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.pressure import AveragedPressure
from tribox.forms.contact.state import ContactMode, ContactTrial
from tribox.geometry.surfaces.facets import Floats, Ints

# Columns of the history that are sums of the balance, by the name of the sum.
_COLUMNS = {
    **{name: f"{name}_energy" for name in ("strain", "kinetic", "interface")},
    "dissipation": "dissipation",
    **{name: f"{name}_dissipation" for name in ("plastic", "viscous", "numerical", "damping")},
    "work": "external_work",
}
_SUMS = (*_COLUMNS, "sampled", "_initial_kinetic")


@dataclass(slots=True)
class Work:
    """External forces on the bodies at a converged state, for the work they do."""

    force: Floats  # owned part of the forces of supports, platens and loads, N/m
    position: Floats  # owned unknowns, m
    # of each pair gaps, m, and pressures, Pa, of its vertices (v,) or points (q,)
    contacts: list[tuple[Floats, Floats]]
    # of each pair pressures, Pa, and offsets of the gaps, m, of the points (q,); None without a fit
    fits: list[tuple[Floats, Floats] | None]

    @classmethod
    def at(cls, problem: Equilibrium, position: Floats) -> Work:
        """Forces of the state that was evaluated last; collective."""
        force, given = problem.load_forces(), _given(problem)
        force[given] += problem.unbalanced[given]
        pairs = zip(problem.contacts, problem.trials, strict=True)
        contacts = [gaps_and_pressures(term, trial) for term, trial in pairs]
        offsets = [trial.projection.offset for trial in problem.trials]
        fits = [
            None if offset is None else (trial.pressure.copy(), offset)
            for trial, offset in zip(problem.trials, offsets, strict=True)
        ]
        return cls(force, position.copy(), contacts, fits)

    def until(self, other: Work, problem: Equilibrium) -> Floats:
        """Work from this state to ``other`` (2,), J/m, and what the step's ends make of it.

        By the trapezoidal rule, less what that adds where contact begins or ends in between;
        collective.
        """
        mean, less = 0.5 * (self.force + other.force), 0.0
        work = float(mean @ (other.position - self.position))
        fits = zip(self.fits, other.fits, strict=True)
        pairs = zip(problem.contacts, self.contacts, other.contacts, fits, strict=True)
        for term, before, after, (fit, fitted) in pairs:
            if fit is not None and fitted is not None:
                work += fit_work(term, fit, fitted)
            less += kinks(term, before, after)
        done: Floats = problem.comm.allreduce(np.array([work - less, work]))
        return done


def _given(problem: Equilibrium) -> Ints:
    """Owned unknowns whose forces are reactions: a platen's displacement may be prescribed."""
    moved = [problem.constrained_dofs(), *(p.dofs for p in problem.platens if p.acts)]
    return np.unique(np.concatenate(moved))


def gaps_and_pressures(term: ContactTerm, trial: ContactTrial) -> tuple[Floats, Floats]:
    """Gaps, m, and pressures, Pa of all masters, of vertices (v,) or points (q,) of a pair."""
    normal, at = trial.normal_contact, trial.projection
    if not _by_vertices(term):
        return np.where(at.on_surface, trial.kinematics.gap, 0.0), trial.pressure.copy()
    if normal.gap is None or normal.nodal_pressure is None:
        none = np.zeros(term.surface.vertices.count)
        return none, none
    share = 1.0 if normal.area is None else normal.area / term.surface.vertices.area
    return normal.gap, normal.nodal_pressure * share


def _by_vertices(term: ContactTerm) -> bool:
    return term.tied or isinstance(term.rule, AveragedPressure)


def kinks(term: ContactTerm, before: tuple[Floats, Floats], after: tuple[Floats, Floats]) -> float:
    """What the trapezoidal rule adds to the work where a pair closes or opens, J/m, of this rank.

    A spring that closes between a gap g and a pressure p takes p²/2K per area, and the rule p g/2
    more: in truth nothing presses while there is a gap. It takes as much less where one opens.
    Forces from outside have the same kink.

    Args:
        before: gaps, m, and pressures, Pa, at the start of a step; after: at its end.
    """
    if term.tied or not term.active or isinstance(term, LubricatedTerm):
        return 0.0  # a film presses across its gap
    (first, low), (last, high) = before, after
    closes, opens = (low <= 0.0) & (high > 0.0), (low > 0.0) & (high <= 0.0)
    density = 0.5 * np.where(closes, high, 0.0) * np.maximum(first, 0.0)
    density -= 0.5 * np.where(opens, low, 0.0) * np.maximum(last, 0.0)
    if _by_vertices(term):
        density = term.surface.vertices.at_points(density)
    return float(term.surface.slave.weight @ density)


def fit_work(
    term: ContactTerm, before: tuple[Floats, Floats], after: tuple[Floats, Floats]
) -> float:
    """Work of what makes the surfaces of a fit larger, −∫ p do, J/m, of this rank.

    The energy of the contact is a function of the gaps g + o of its points, and the pressure of a
    point is its derivative: whoever changes the offset o does the work −p do per area, as a body
    that warms up in a bore does. The mean offset of a vertex is not enough: beyond the end of the
    master nothing is felt.

    Args:
        before: pressures, Pa, and offsets, m, of the points at the start of a step; after: at its
            end.
    """
    (low, first), (high, last) = before, after
    return float(term.surface.slave.weight @ (-0.5 * (low + high) * (last - first)))


class EnergyBalance:
    """Adds up work and dissipation over a run and holds them against the stored energy.

    Attributes:
        work, dissipation, numerical: J/m since the start; the numerical part is contained in the
            dissipation: the traction at the end of a step times the slip, less the trapezoidal
            rule. It falls in proportion to the step.
        strain, interface: J/m, stored now, less what was stored at the start.
        plastic: J/m since the start, of the bodies' materials; its numerical part, the yield stress
            at the end of a step less the mean over it, is contained in ``numerical`` too; viscous:
            likewise, of bodies that creep and do not yield.
        sampled: J/m since the start, as ``work`` with forces as they stand at the ends of steps.
        kinetic: J/m, present; damping: J/m taken by mass-proportional damping, the contacts'
            dashpots and relaxation.
    """

    def __init__(self, problem: Equilibrium, x: PETSc.Vec) -> None:
        """Begin at the state ``x``; collective.

        Nothing bears a load that stands in full already. In a motion through equilibria it grows
        over the first step, as one does that begins with a later stage, from nothing: were it there
        all along, it would do the work F u on a body that stores F u/2, and the rest would be what
        the body would be thrown with.
        """
        self.problem = problem
        residual = x.duplicate()
        # Nothing moves yet: no film, which may be out of balance at the start, is asked to.
        still = tuple(ContactMode(rate_dependent=False) for _ in problem.contacts)
        problem.residual(None, x, residual, StepMode(modes=still))
        residual.destroy()
        self._last = Work.at(problem, x.array_r)
        loads = np.ones(len(self._last.force), dtype=bool)
        loads[_given(problem)] = False
        self._last.force[loads] = 0.0
        pairs = zip(problem.contacts, problem.trials, strict=True)
        stored = sum(term.interface_energy(trial) for term, trial in pairs)
        interface = float(problem.comm.allreduce(stored, op=MPI.SUM))
        self._start = (problem.strain_energy(), interface)
        self.work = self.sampled = self.dissipation = self.numerical = 0.0
        self.strain = self.interface = self.kinetic = self.damping = 0.0
        self.plastic = self.viscous = 0.0
        self._flow = self._lost()
        self._initial_kinetic = 0.0

    def set_initial_kinetic_energy(self, kinetic: float) -> None:
        """Enter the kinetic energy (J/m) that the bodies are given at the start of their motion."""
        self.kinetic = self._initial_kinetic = kinetic

    def add_interval(
        self, resultants: Sequence[ContactResultants], work: float, damping: float, kinetic: float
    ) -> None:
        """Enter explicit steps, J/m of all ranks, up to what was spread last; collective.

        ``work``: of supports, platens and loads; ``damping``: of dashpots and relaxation too.
        """
        self.work += work
        self.sampled += work  # of means of forces
        self.damping += damping
        self.kinetic = kinetic
        self._enter_contacts(resultants)

    def _enter_contacts(self, resultants: Sequence[ContactResultants]) -> None:
        self.strain = self.problem.strain_energy() - self._start[0]
        self.interface = sum(m.energy for m in resultants) - self._start[1]
        self.dissipation += sum(m.dissipated for m in resultants)
        self.numerical += sum(m.numerical for m in resultants)
        before, self._flow = self._flow, self._lost()
        more = self._flow - before
        self.plastic += float(more[0])
        self.viscous += float(more[1])
        self.numerical += float(more[2])

    def _lost(self) -> Floats:
        """What bodies have lost by plastic flow, by creep, and the numerical part; collective."""
        plastic, viscous = (self.problem.dissipated(flows) for flows in (True, False))
        return np.array([plastic[0], viscous[0], plastic[1] + viscous[1]])

    def add(self, x: PETSc.Vec, resultants: Sequence[ContactResultants]) -> None:
        """Enter the converged step that was evaluated last, at ``x``; collective."""
        now = Work.at(self.problem, x.array_r)
        work, sampled = self._last.until(now, self.problem)
        self.work += float(work)
        self.sampled += float(sampled)
        self._last = now
        self._enter_contacts(resultants)

    def take_over(self, force: Floats) -> None:
        """Count forces (n,), N/m, that were those of contacts so far, as of loads from now on."""
        self._last = replace(self._last, force=self._last.force + force)

    def snapshot(self) -> Snapshot:
        """All sums so far."""
        pairs = zip(self.problem.contacts, self._last.contacts, strict=True)
        return {
            "sums": {name: getattr(self, name) for name in _SUMS},
            "start": list(self._start),
            "flow": self._flow.tolist(),
            "force": Nodal(self._last.force),
            "position": Nodal(self._last.position),
            "contacts": [
                arrays if _by_vertices(term) else tuple(AtPoints(pair, a) for a in arrays)
                for pair, (term, arrays) in enumerate(pairs)
            ],
            "fits": [
                None if arrays is None else tuple(AtPoints(pair, a) for a in arrays)
                for pair, arrays in enumerate(self._last.fits)
            ],
        }

    def restore(self, kept: Snapshot) -> None:
        """Go on from what :meth:`snapshot` has seen."""
        for name, value in kept["sums"].items():
            setattr(self, name, value)
        self._flow = np.array(kept["flow"])
        self._start = (kept["start"][0], kept["start"][1])
        contacts = [(gap, pressure) for gap, pressure in kept["contacts"]]
        fits = [None if arrays is None else (arrays[0], arrays[1]) for arrays in kept["fits"]]
        self._last = Work(kept["force"], kept["position"], contacts, fits)

    @property
    def error(self) -> float:
        """External work that is neither stored nor dissipated, J/m."""
        stored = self.strain + self.interface + self.kinetic - self._initial_kinetic
        dissipated = self.dissipation + self.plastic + self.viscous - self.numerical
        return self.work - stored - dissipated - self.damping

    def columns(self, thickness: float) -> dict[str, Any]:
        """Columns of the history that are energies, J, of a slab of ``thickness`` (m)."""
        columns = {column: getattr(self, name) for name, column in _COLUMNS.items()}
        columns["energy_error"] = self.error
        return {name: energy * thickness for name, energy in columns.items()}


# -- Forces at the ends of steps, which are samples, against the work that was done ---------------

FEWEST = 8  # steps, over which a mean of forces says something
LASTS = 0.5  # of the largest normal force, that presses all the while
OFF, COUNTS = 0.03, 0.1  # of the work that was spent, and of the largest of the run


class SampledForces(Remembers):
    """Looks at the second half of each load step: means of forces there would be steady ones.

    Where a facet comes and another goes in each step, forces at the ends of steps are always those
    of one phase, and their mean is not the force that does the work.
    """

    _steps: Kept[list[tuple[float, float, float]]]  # of the load step: J, J by forces, N
    _found: Kept[list[str]]
    _largest: Kept[float]  # J, work of the run so far

    def __init__(self) -> None:
        self._steps, self._found, self._largest = [], [], 0.0

    def step(self, row: Row, sampled: float) -> None:
        """Look at a converged step, and at the work of the forces at the ends of all so far, J."""
        self._largest = max(self._largest, abs(row.external_work))
        self._steps.append((row.external_work - row.energy_error, sampled, row.normal_force))

    def end(self, label: str) -> None:
        """A load step has ended."""
        half = np.array(self._steps[len(self._steps) // 2 :]).reshape(-1, 3)
        self._steps = []
        if len(half) < FEWEST or half[:, 2].min() <= LASTS * half[:, 2].max():
            return
        spent, sampled = half[-1, :2] - half[0, :2]
        off, of = abs(sampled - spent), max(abs(spent), abs(sampled), COUNTS * self._largest)
        # Where the half begins and ends within a facet makes up to the work of a step.
        if off > max(OFF * of, np.abs(np.diff(half[:, 1])).max()):
            self._found.append(
                f"stage {label}: over its second half forces at the ends of steps make a work of "
                f"{sampled:.4g} J, but {spent:.4g} J were spent: as contact comes and goes within "
                f"steps of about a facet, means of forces in the tables are off by "
                f"{100.0 * off / of:.2g} % (steps of a third of a facet, or external_work over the "
                "way)"
            )

    def warnings(self) -> Iterator[str]:
        """A line for each load step."""
        yield from self._found


# -- Kinetic against strain energy of explicit load steps, and what is said of it ------------------

REST = 1e-3  # kinetic over strain energy up to which a relaxed body counts as at rest
UNFELT = 1e-3  # added over original mass up to which motion is that of the bodies' own mass


@dataclass(slots=True)
class Inertia:
    """Kinetic against strain energy over one explicit load step, from its rows."""

    label: str  # of the load step
    kinetic: float = 0.0  # J/m, sums over its rows
    strain: float = 0.0  # likewise
    last: float = 0.0  # kinetic over strain energy at its last row

    @property
    def ratio(self) -> float:
        """Mean kinetic over mean strain energy; 0 without strain energy."""
        return self.kinetic / self.strain if self.strain > 0.0 else 0.0

    def add(self, kinetic: float, strain: float) -> None:
        """Enter a row's energies, J/m."""
        self.kinetic += kinetic
        self.strain += max(strain, 0.0)
        self.last = kinetic / strain if strain > 0.0 else 0.0


def notes_on_inertia(
    case: Case, load_step: LoadStep, inertia: Inertia, added: float
) -> Iterator[str]:
    """Warnings after an explicit load step: scaled mass that is felt, and bodies not at rest.

    Args:
        added: mass that scaling added, over that of the bodies.
    """
    limit = case.solver.kinetic_limit
    if added > UNFELT and inertia.ratio > limit:
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
