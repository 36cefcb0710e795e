"""The discrete equilibrium of all bodies, contacts and loads: residual and tangent.

What is prescribed is in :mod:`tribox.app.equilibrium.constraints`, the matrix in
:mod:`tribox.app.equilibrium.tangent`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import dolfinx
import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.equilibrium.bodies import Bodies
from tribox.app.equilibrium.constraints import Constraints, Platen, Prescribed, Unknowns
from tribox.app.equilibrium.rigid_tool import (
    NOTHING,
    RigidTool,
    held_fast,
    hold_what_slips,
    holding_of_idle_tools,
    rests_of_tools,
)
from tribox.app.equilibrium.step_mode import DEFAULT_STEP, HoldingSprings, StepMode
from tribox.app.equilibrium.tangent import Tangent
from tribox.app.equilibrium.timers import Stopwatch
from tribox.app.equilibrium.unknowns import NodalLoad, box_of
from tribox.forms.bodies.loads import Load
from tribox.forms.bodies.solid import Solid
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.state import ContactTrial
from tribox.geometry.meshes.blocks import Block
from tribox.geometry.surfaces.facets import Floats, Ints

# -- Forces that a solution is judged by: round-off, reference of the residual, worst place --------

FAR = 1e6  # displacement over the extent of the mesh from which on nothing is evaluated
MOVED = 1e-6  # residual over the force that the motion of bodies may leave at most


class RoundOff:
    """Norm of the residual that rounding alone leaves, at any displacement.

    The deformation gradient is rounded by ε, however small the strain, and the displacement u by
    ε|u|. The first leaves forces of norm b, the second forces of norm c
    (:meth:`tribox.forms.bodies.solid.Solid.roundoff_squares`):

        r² = Σ_solids b² + c².

    Newton's method carried on without end stays between 0.15 and 0.5 of r: blocks, boxes, a sphere,
    of 1 kPa to 70 GPa, moved by up to 600 cells; in bodies stretched, sheared and thinned 5 to 8
    times between 0.03 and 0.9. Rounded gaps are the contacts'
    (:meth:`tribox.forms.contact.penalty.ContactTerm.roundoff_squared`).

    Attributes:
        names: of the solids; let_go: of those that no support keeps in their place.
    """

    def __init__(self, space: dolfinx.fem.FunctionSpace, solids: Iterable[Solid]) -> None:
        """Take the solids; collective."""
        self._comm = space.mesh.comm
        self._farthest = FAR * float(
            np.ptp(box_of(self._comm, space.mesh.geometry.x), axis=0).max()
        )
        self._solids = list(solids)
        self._known: tuple[list[Floats], Floats] | None = None  # at which displacement
        self.names = [solid.name for solid in self._solids]
        self.let_go: set[str] = set()

    def is_within_reach(self, x: PETSc.Vec) -> bool:
        """Whether displacements x, m, are numbers, and such that more than rounding is left.

        Iterations that diverge would else come to rest where all forces are; collective.
        """
        return bool(x.norm(PETSc.NormType.NORM_INFINITY) < self._farthest)

    def squares(self) -> tuple[Floats, Floats]:
        """b² and c² of each solid at the displacement evaluated last; collective."""
        places = [solid.displacement.x.array for solid in self._solids[:1]]
        known = self._known
        if known is None or not all(map(np.array_equal, known[0], places)):
            local = np.array([solid.roundoff_squares() for solid in self._solids]).reshape(-1, 2)
            self._known = known = [place.copy() for place in places], local
        at_rest, moved = self._comm.allreduce(known[1]).T
        return at_rest, moved

    def norm(self, force: float) -> float:
        """Norm r of all solids at the displacement evaluated last, N (N/m); collective.

        The motion of bodies that are let go counts for ``MOVED`` of ``force`` at most: one that
        nothing holds may be put so far away that nothing but rounding is left of its forces.
        """
        at_rest, moved = self.squares()
        free = np.array([name in self.let_go for name in self.names], dtype=bool)
        of_free = min(float(moved[free].sum()), (MOVED * force) ** 2)
        return float(np.sqrt(at_rest.sum() + moved[~free].sum() + of_free))


# -- The discrete equilibrium of all bodies, contacts and loads: residual and tangent --------------


@dataclass(slots=True)
class Known:
    """What has been computed at the displacement spread last."""

    strain_energy: float | None = None  # J (J/m); None: not yet
    balanced: StepMode | None = None  # how the residual was evaluated there, if that came last


class Equilibrium:
    """Residual and tangent of the whole problem, as SNES asks for them.

    The parts are given once. What changes is the state: ``u``, ``trials``, ``committed`` and
    ``unbalanced``. :meth:`residual`, :meth:`assemble_tangent` and :meth:`commit` set it; a stepper
    with kernels of its own (the explicit one) sets these four attributes itself.

    Attributes:
        u: displacement function; holds the last vector that was evaluated.
        trials: contacts at the last evaluation; committed: at the last converged step.
        evaluated: how the contacts were evaluated last.
        unbalanced: (n,), N per unit thickness, forces of the owned unknowns at the last evaluation,
            reactions included.
        reference_force: N per unit thickness, what residual norms are compared with: the largest of
            contact forces, reactions and loads at the last evaluation.
        solids, contacts, loads, nodal_loads, tools: the parts; bodies: the solids' equations.
        turning: holds the angles of tools that no moment drives; None: there are none.
        unknowns: their numbering; constraints: what is prescribed; tangent: the matrix.
        timer: seconds by part.
        rounding: what rounding alone leaves of the residual.
    """

    def __init__(
        self,
        u: dolfinx.fem.Function,
        solids: Sequence[Solid],
        contacts: Sequence[ContactTerm],
        prescribed: Sequence[Prescribed] = (),
        platens: Sequence[Platen] = (),
        loads: Sequence[Load] = (),
        nodal_loads: Sequence[NodalLoad] = (),
        tools: Sequence[RigidTool] = (),
        blocks: Sequence[Block] = (),
    ) -> None:
        """Put the parts together; collective."""
        self.u = u
        self.solids, self.contacts = list(solids), list(contacts)
        self.loads, self.nodal_loads = list(loads), list(nodal_loads)
        self.tools = list(tools)
        blocks = [*(tool.block for tool in self.tools), *blocks]
        self.unknowns = Unknowns(u.function_space, blocks)
        self.constraints = Constraints(self.unknowns, prescribed, platens)
        self.bodies = Bodies(u, self.solids)
        self.tangent = Tangent(self.constraints, self.bodies, self.contacts, self.loads)
        self.timer = Stopwatch()
        self.trials: list[ContactTrial] = []
        self.committed: list[ContactTrial] = []
        self.unbalanced: Floats = np.zeros(self.owned)
        self.reference_force = 0.0
        self.rounding = RoundOff(self.space, self.solids)
        self.evaluated = DEFAULT_STEP
        self.turning = holding_of_idle_tools(self.tools, self.solids, self.owned)
        self._known = Known()
        self._work = dolfinx.la.vector(self.space.dofmap.index_map, self.dim)

    # -- parts --------------------------------------------------------------------------------

    @property
    def space(self) -> dolfinx.fem.FunctionSpace:
        """Displacement space."""
        return self.unknowns.space

    @property
    def comm(self) -> MPI.Comm:
        """Communicator of the mesh."""
        return self.unknowns.comm

    @property
    def dim(self) -> int:
        """Unknowns per node."""
        return self.unknowns.dim

    @property
    def owned(self) -> int:
        """Number of unknowns on this rank."""
        return self.unknowns.owned

    @property
    def first(self) -> int:
        """Global number of this rank's first unknown."""
        return self.unknowns.first

    @property
    def size(self) -> int:
        """Number of unknowns on all ranks."""
        return self.unknowns.size

    @property
    def fields(self) -> list[Block]:
        """The blocks beside the displacement whose residuals have sizes of their own."""
        return self.unknowns.fields

    @property
    def prescribed(self) -> list[Prescribed]:
        """Displacement components held at given values."""
        return self.constraints.prescribed

    @property
    def platens(self) -> list[Platen]:
        """Surfaces that move as one."""
        return self.constraints.platens

    @property
    def pattern_changes(self) -> int:
        """How often the matrix's pattern was made or widened."""
        return self.tangent.pattern_changes

    @property
    def roundoff(self) -> float:
        """:meth:`roundoff_beside` the present forces alone."""
        return self.roundoff_beside(0.0)

    def roundoff_beside(self, force: float) -> float:
        """Residual norm below which only round-off is left, at ``u``; N/m; collective.

        Args:
            force: N/m, that was there before, as of a body that is let go.
        """
        bodies = self.rounding.norm(max(self.reference_force, force))
        return float(np.hypot(bodies, self.roundoff_of_contacts()))

    def roundoff_of_contacts(self) -> float:
        """What rounded gaps and jumps alone leave of the residual, N/m; collective."""
        x = self.u.x.petsc_vec
        evaluated = zip(self.contacts, self.trials, strict=False)  # nothing is, at the start
        local = sum(term.roundoff_squared(x, trial) for term, trial in evaluated)
        return float(np.sqrt(self.comm.allreduce(local, op=MPI.SUM))) if self.contacts else 0.0

    def constrained_dofs(self) -> Ints:
        """Owned local unknowns with a prescribed displacement."""
        return self.constraints.dofs

    def constrained_values(self, x: PETSc.Vec) -> Floats:
        """Owned unknowns (…,) with the prescribed values put into a copy of ``x``."""
        return self.constraints.values(x)

    def given_way(self, x: PETSc.Vec) -> float:
        """Largest way from ``x``, m, that supports go, and ends of springs are off; collective."""
        way = float(np.abs(self.constrained_values(x) - x.array_r).max(initial=0.0))
        for platen in self.constraints.acting:
            if platen.loaded and platen.stiffness > 0.0:
                off = np.abs(platen.end - x.array_r[platen.dofs])
                way = max(way, float(off.max(initial=0.0)))
        return self.comm.allreduce(way, op=MPI.MAX)

    def new_vector(self) -> PETSc.Vec:
        """A global vector of unknowns, m, holding zeros."""
        return self.unknowns.new_vector()

    def sliding(
        self, trials: Sequence[ContactTrial]
    ) -> Iterator[tuple[int, ContactTerm, ContactTrial]]:
        """The pairs that act and are not tied, with their numbers and what was found of them."""
        for index, (term, trial) in enumerate(zip(self.contacts, trials, strict=False)):
            if term.active and not term.tied:
                yield index, term, trial

    # -- state --------------------------------------------------------------------------------

    @property
    def flows(self) -> bool:
        """Whether any body yields; one may remember and not yield."""
        return any(solid.flows for solid in self.solids)

    def spread(self, x: PETSc.Vec) -> None:
        """Copy the unknowns into the displacement function, ghosts included; collective."""
        self._known = Known()
        self.u.x.array[: self.owned] = x.array_r
        self.u.x.scatter_forward()

    def strain_energy(self) -> float:
        """Strain energy of all bodies at the displacement spread last, J/m; collective."""
        if self._known.strain_energy is None:
            local = self.bodies.strain_energy()
            self._known.strain_energy = float(self.comm.allreduce(local, op=MPI.SUM))
        return self._known.strain_energy

    def plastic_dissipation(self) -> tuple[float, float]:
        """What bodies that yield dissipated so far, and its numerical part, see `dissipated`."""
        return self.dissipated(flows=True)

    def dissipated(self, flows: bool) -> tuple[float, float]:
        """What bodies dissipated in all committed steps, and its numerical part; collective.

        Returns J (J/m in plane strain), since the start.
        """
        kind = [solid.dissipated for solid in self.solids if solid.flows == flows]
        total = self.comm.allreduce(np.sum(kind, axis=0) + np.zeros(2), op=MPI.SUM)
        return float(total[0]), float(total[1])

    def is_evaluated(self, x: PETSc.Vec) -> bool:
        """Whether ``x`` is what was evaluated last, on all ranks; collective."""
        same = np.array_equal(self.u.x.array[: self.owned], x.array_r)
        return bool(self.comm.allreduce(same, op=MPI.LAND))

    def knows(self, x: PETSc.Vec, step: StepMode) -> bool:
        """Whether the residual at ``x`` in this very attempt of a step came last; collective.

        Loads and states do not change within one; the default stands for any number of them.
        """
        return self._known.balanced is step is not DEFAULT_STEP and self.is_evaluated(x)

    def commit(self) -> None:
        """Make what was evaluated last the state that the next step starts from."""
        # From another state the same displacement has another residual.
        self._known.balanced = None
        for solid in self.solids:
            solid.commit()
        self.committed = list(self.trials)
        if self.turning is not None:
            self.turning = replace(self.turning, place=self.u.x.array[: self.owned].copy())
        for term, trial in zip(self.contacts, self.trials, strict=True):
            term.commit(trial)

    # -- residual -----------------------------------------------------------------------------

    def residual(
        self, snes: PETSc.SNES | None, x: PETSc.Vec, f: PETSc.Vec, step: StepMode = DEFAULT_STEP
    ) -> None:
        """Out-of-balance forces at ``x`` (N per unit thickness); the SNES function; collective."""
        if not self.knows(x, step):
            self._evaluate(x, f, step)
        # Constraining overwrites the reactions, which `unbalanced` keeps.
        f.array[:] = self.unbalanced
        self.constraints.constrain_residual(f.array, x.array_r)

    def _evaluate(self, x: PETSc.Vec, f: PETSc.Vec, step: StepMode) -> None:
        """Evaluate everything at ``x``; ``f`` is worked with."""
        self.spread(x)
        with self.timer("assembly"):
            self._evaluate_solids(step)
            f.array[:] = self._gathered(self.bodies.add_forces)
            outside = self.load_forces()
            f.array[:] -= outside
        with self.timer("contact"):
            self._evaluate_contacts(x, step)
            contact_squared = self._contact_forces(f)
        for springs in self._springs(step):
            pulls = springs.force(x.array_r)
            f.array[:] += pulls
            if springs.weak:  # nothing else may act on what they hold
                outside = outside - pulls
        self.unbalanced = f.array_r.copy()
        unbalanced, given = self._forces(self.unbalanced), self._forces(outside)
        self.reference_force = self.constraints.reference_force(unbalanced, given, contact_squared)
        self._known.balanced = step

    def _on_bodies(self, values: Floats) -> Floats:
        """Residuals (n,) without those of fields, which are no forces."""
        if not self.fields:
            return values
        out = values.copy()
        for field in self.fields:
            out[field.dofs] = 0.0
        return out

    def _forces(self, values: Floats) -> Floats:
        """Residuals or loads (n,), but for those of fields and moments on tools.

        A moment grows with how far off the tool's centre lies: beside it no residual would count.
        """
        out = self._on_bodies(values).copy()
        for tool in self.tools:
            out[tool.dofs[-1:][tool.here[-1:]]] = 0.0
        return out

    def judged(self, f: PETSc.Vec, force: float) -> tuple[float, float]:
        """Norm of a residual, and what it is compared with; collective.

        With fields it is the largest of that of the forces and, for each field, that of its rows in
        the measure of its own reference:

            max(|f_u|, F |f_b| / r_b),    F > 0.

        Args:
            f: (n,), N, the residual.
            force: N, what forces are compared with; 0: none are known.
        """
        if not self.fields:
            return float(f.norm()), force
        parts = [self._on_bodies(f.array_r), *(f.array_r[field.dofs] for field in self.fields)]
        squares = np.array([float(part @ part) for part in parts])
        self.comm.Allreduce(MPI.IN_PLACE, squares, op=MPI.SUM)
        scale, norms = force or 1.0, np.sqrt(squares)
        shares = [
            scale * norm / (field.reference or 1.0)
            for field, norm in zip(self.fields, norms[1:], strict=True)
        ]
        return float(max(norms[0], *shares)), scale

    def _gathered(self, add: Callable[[Floats], object]) -> Floats:
        """What all ranks ``add`` at the owned unknowns; collective."""
        self._work.array[:] = 0.0
        add(self._work.array)
        self._work.scatter_reverse(dolfinx.la.InsertMode.add)
        return self._work.array[: self.owned].copy()

    def _evaluate_solids(self, step: StepMode, tangent: bool = False) -> None:
        """Where a body's material cannot be evaluated its forms give NaN, and so the residual."""
        for solid in self.solids:
            solid.evaluate(step.material_dt, tangent)

    def _evaluate_contacts(self, x: PETSc.Vec, step: StepMode) -> None:
        self.evaluated, self._known.balanced = step, None
        pairs = step.pairs(self.contacts)
        self.trials = [term.evaluate(x, step.dt, mode) for term, mode in pairs]

    def _contact_forces(self, f: PETSc.Vec) -> float:
        """Add the contact residuals to ``f``; returns the norm of this rank's, squared."""
        pairs = zip(self.contacts, self.trials, strict=True)
        squared = sum(self._add_forces_of(term, trial, f) for term, trial in pairs)
        f.assemble()
        return squared

    def _add_forces_of(self, term: ContactTerm, trial: ContactTrial, f: PETSc.Vec) -> float:
        """Add a contact's residual to ``f``, without assembling; its norm on this rank, squared."""
        nodes, values, squared = term.forces_at_nodes(trial)
        f.setValues(
            self.unknowns.of_nodes(nodes).reshape(-1),
            values.reshape(-1),
            addv=PETSc.InsertMode.ADD_VALUES,
        )
        return squared

    def pair_forces(self, pair: int) -> Floats:
        """Forces (n,), N/m, of a contact on the owned unknowns when converged; collective."""
        f = self.new_vector()
        if self.committed:
            self._add_forces_of(self.contacts[pair], self.committed[pair], f)
        f.assemble()
        forces: Floats = -f.array_r
        f.destroy()
        return forces

    def load_forces(self) -> Floats:
        """Owned part of the loads' forces on the bodies at the last state, N/m; collective."""
        acting = [load.residual for load in self.loads if load.acts]

        def add(out: Floats) -> None:
            for form in acting:
                dolfinx.fem.assemble_vector(out, form)

        forces = -self._gathered(add) if acting else np.zeros(self.owned)
        for load in self.nodal_loads:
            load.add_to(forces)
        for rest in self.rests():
            forces -= rest.force(self.u.x.array[: self.owned])
        return forces

    def rests(self) -> list[HoldingSprings]:
        """Stops that tools rest on at the displacement spread last."""
        return rests_of_tools(self.tools, self.u.x.array[: self.owned], self.constraints.dofs)

    def reaction(self, part: Prescribed | Platen) -> float:
        """Force of a support or platen on the bodies at the last evaluation; collective.

        Returns N (in plane strain per unit thickness), along the direction of the part.
        """
        return float(self.comm.allreduce(part.total(self.unbalanced), op=MPI.SUM))

    def held_weakly(self) -> float:
        """Sum of the magnitudes of all forces of weak springs on bodies that float, N; collective.

        As evaluated last; 0 without any.
        """
        springs = self.evaluated.holding
        if springs is None or not springs.weak:
            return 0.0
        forces = springs.force(self.u.x.array[: self.owned])
        forces[self.constrained_dofs()] = 0.0
        return float(self.comm.allreduce(float(np.abs(forces).sum()), op=MPI.SUM))

    def worst_place(self) -> tuple[float, ...]:
        """Where the largest out-of-balance force of the last evaluation is, m; collective."""
        return self.constraints.worst_place(self.unbalanced)

    # -- tangent ------------------------------------------------------------------------------

    def new_matrix(self, x: PETSc.Vec) -> PETSc.Mat:
        """The tangent's matrix with room for solids, platens and the contact at ``x``."""
        self._evaluate_contacts(x, DEFAULT_STEP)
        return self.tangent.new_matrix(self.trials)

    def assemble_tangent(
        self,
        x: PETSc.Vec,
        A: PETSc.Mat,
        step: StepMode = DEFAULT_STEP,
        before: PETSc.Vec | None = None,
    ) -> None:
        """Tangent at ``x`` with all rows free but those that follow a platen; collective.

        Args:
            x: displacement, m.
            before: displacement, m, that the pressure in nearly incompressible cells is carried
                from (:mod:`tribox.forms.bodies.solid`); None: the exact tangent.
        """
        known = self.knows(x, step)
        if not known:
            self.spread(x)
        with self.timer("assembly"):
            self._evaluate_solids(step, tangent=True)
        if not known:
            with self.timer("contact"):
                self._evaluate_contacts(x, step)
        if before is not None:
            self._carry_pressures(before)
        springs = [*self._springs(step), *self.rests()]
        self.tangent.assemble(A, self.trials, self.timer, springs, before is not None)
        hold_what_slips(A, self.tools, self.solids, self.nodal_loads, self.first)

    def _springs(self, step: StepMode) -> list[HoldingSprings]:
        """Springs that hold bodies and tools in a step."""
        turning = self.turning
        if turning is not None and any(mode.friction_as_load for mode in step.modes):
            turning = held_fast(turning)
        return [springs for springs in (turning, step.holding) if springs is not None]

    def is_held_slightly(self) -> bool:
        """Whether idle tools are held by next to nothing at the last evaluation; collective.

        With a force that counts the slight spring would stand for a contact: a roller spun round
        and round until it balances all of the friction is no solution.
        """
        if self.turning is None:
            return True
        force = np.abs(self.turning.force(self.u.x.array[: self.owned])).max(initial=0.0)
        return bool(self.comm.allreduce(force, op=MPI.MAX) <= NOTHING * self.reference_force)

    def _carry_pressures(self, before: PETSc.Vec) -> None:
        with self.timer("assembly"):
            self._work.array[: self.owned] = before.array_r
            self._work.scatter_forward()
            for solid in self.solids:
                if solid.carried is not None:
                    solid.carried.carry(self._work.array)

    def jacobian(
        self,
        snes: PETSc.SNES | None,
        x: PETSc.Vec,
        A: PETSc.Mat,
        P: PETSc.Mat,
        step: StepMode = DEFAULT_STEP,
        before: PETSc.Vec | None = None,
    ) -> None:
        """Tangent at ``x`` into ``A``; the SNES Jacobian. ``P`` is the same matrix.

        Exact, unless pressures are carried from ``before``, see :meth:`assemble_tangent`.
        """
        self.assemble_tangent(x, A, step, before)
        with self.timer("assembly"):
            self.constraints.constrain_matrix(A)


# -- What each load gives by itself: for tables of forces, and for explicit steps ------------------


def load_residuals(problem: Equilibrium, out: Sequence[Floats] = ()) -> list[Floats]:
    """Residuals of the loads with forms, then of those at nodes, at the present displacement.

    Returns (n,), N per unit thickness, of each load: this rank's part at its local unknowns.

    Args:
        out: of an earlier call, overwritten; empty: new arrays.
    """
    number = len(problem.loads) + len(problem.nodal_loads)
    arrays = list(out) or [np.zeros(len(problem.u.x.array)) for _ in range(number)]
    split = len(problem.loads)
    for values, load in zip(arrays[:split], problem.loads, strict=True):
        values[:] = 0.0
        if load.acts:
            dolfinx.fem.assemble_vector(values, load.residual)
    for values, nodal in zip(arrays[split:], problem.nodal_loads, strict=True):
        values[:] = 0.0
        nodal.add_to(values)
        values *= -1.0
    return arrays
