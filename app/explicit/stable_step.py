"""The stable time step of central differences, from the largest eigenvalue of M⁻¹K.

K is the stiffness of the bodies, of the penalty and of the elastic slip. Its action on a vector is
a difference of internal forces, so no matrix is made. Lanczos' iteration in the inner product of M
finds the largest eigenvalue λ from below; the residual of its Ritz vector is added, so that the
step 2/√λ errs on the safe side. The viscous stress of films is solved for at each point: the step
has no bound by it.

A node that meets the penalty for a single step leaves with up to ω² Δt² − 1 times its speed, ω its
frequency on the penalty alone. Linear stability allows ω Δt = 2, at which contacts that open and
close gain energy with every rebound; the bound taken here is ω Δt ≤ √2, where that factor is one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import basix
import dolfinx
import numpy as np
from mpi4py import MPI

from tribox.app.equilibrium.bodies import Bodies
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.rigid_tool import RigidTool
from tribox.app.equilibrium.snapshot import Kept, Nodal, Remembers, Snapshot
from tribox.app.equilibrium.unknowns import place_of_largest
from tribox.app.explicit.leap_frog import LumpedDynamics
from tribox.forms.bodies.loads import Foundation
from tribox.forms.bodies.weights import element_frequencies, lumped_mass
from tribox.forms.contact.stiffness import PairStiffness
from tribox.geometry.surfaces.facets import Floats
from tribox.geometry.surfaces.surface import NodalVector


@dataclass(frozen=True, slots=True)
class MassScaling:
    """Mass added so that the step may be longer; ValueError if its values do not fit the kind."""

    # "uniform": every density times a factor; "limiting": mass only for the elements that would
    # need a shorter step than ``step``
    kind: Literal["uniform", "limiting"] = "limiting"
    factor: float | None = None  # of all densities, >= 1; with "uniform" unless ``step`` is given
    step: float | None = None  # s, stable step, before the safety factor, that the mass must allow

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
    """Settings of the explicit stepper."""

    dt_safety: float = 0.9  # the recommended step over the stable one, in (0, 1]
    damping: float = 0.0  # 1/s, c of the damping force c m v; >= 0
    mass_scaling: MassScaling | None = None  # mass added for a longer step, or none
    reestimate_every: int = 1000  # steps between two estimates of the stable step
    check_every: int = 100  # steps between two checks of the energy
    # ratio of stored to supplied energy above which the run counts as unstable
    energy_limit: float = 1.5
    compiled: bool = True  # whether to use the compiled kernels where there are any


# -- Lumped masses of a problem, raised where a longer step is wanted ------------------------------

ROUNDS = 20  # at most; an element's own factor changes the masses of its neighbours too


@dataclass(frozen=True, slots=True)
class ScaledMass:
    """Masses with what the scaling added."""

    mass: Floats  # (n,), kg per unit thickness, of the owned unknowns
    added: float  # kg per unit thickness, by scaling, of all ranks
    original: float  # likewise, without scaling
    scaled: float  # share of the elements whose mass was raised


def scaled_mass(
    problem: Equilibrium, scaling: MassScaling | None, pairs: Sequence[PairStiffness]
) -> ScaledMass:
    """Lumped masses with what the scaling adds; collective; ValueError without a density."""
    plain = lumped_mass(problem.space, problem.solids)
    if scaling is None:
        return _result(problem, plain, plain, np.ones(1))
    if scaling.factor is not None:
        return _result(problem, plain, scaling.factor * plain, np.full(1, scaling.factor))
    assert scaling.step is not None
    highest = 4.0 / scaling.step**2  # 1/s², of an oscillation that the step can just follow
    limits = _Limits(problem, pairs)
    if scaling.kind == "uniform":
        worst = problem.comm.allreduce(limits.of(plain).max(initial=0.0), op=MPI.MAX)
        most = max(float(worst) / highest, 1.0)
        return _result(problem, plain, most * plain, np.full(1, most))
    factor, mass = np.ones(limits.count), plain
    for _ in range(ROUNDS):
        excess = limits.of(mass, factor) / highest
        if not problem.comm.allreduce(bool(np.any(excess > 1.0 + 1e-9)), op=MPI.LOR):
            break
        factor *= np.maximum(excess, 1.0)
        mass = lumped_mass(problem.space, problem.solids, factor)
    return _result(problem, plain, mass, factor)


def with_tools(mass: Floats, tools: Sequence[RigidTool]) -> Floats:
    """Masses (n,), kg per unit thickness, of the owned unknowns with those of tools, unscaled.

    Where a tool's motion is prescribed its mass is of no account.
    """
    out = mass.copy()
    for tool in tools:
        moves = tool.here & tool.free
        out[tool.dofs[moves]] = tool.mass[moves]
    return out


def _result(problem: Equilibrium, plain: Floats, mass: Floats, factors: Floats) -> ScaledMass:
    n, dim = problem.owned, problem.dim
    counts = [mass[:n].sum() - plain[:n].sum(), plain[:n].sum()]
    # A lumped mass stands once for each component of its node.
    total = problem.comm.allreduce(np.array(counts)) / dim
    raised = problem.comm.allreduce(
        np.array([np.count_nonzero(factors > 1.0), len(factors)], dtype=float)
    )
    return ScaledMass(mass[:n].copy(), float(total[0]), float(total[1]), raised[0] / raised[1])


class _Limits:
    """Bounds ω² of the oscillations of each owned cell and of the contacts at its nodes."""

    def __init__(self, problem: Equilibrium, pairs: Sequence[PairStiffness]) -> None:
        space = problem.space
        mesh = space.mesh
        cells = mesh.topology.index_map(mesh.topology.dim).size_local
        self._nodes = np.asarray(space.dofmap.list)[:cells]
        self._alone = np.zeros(cells)
        for solid in problem.solids:
            self._alone[solid.cells] = element_frequencies(space, solid)
        stiffness = NodalVector(space)
        for pair in pairs:
            pair.add_bound(stiffness)
        stiffness.update_ghosts()
        self._stiffness = stiffness.array.copy()
        self._dim = problem.dim

    @property
    def count(self) -> int:
        """Number of owned cells."""
        return len(self._alone)

    def of(self, mass: Floats, factor: Floats | float = 1.0) -> Floats:
        """ω² (c,) of the cells for nodal masses (local unknowns) and a factor per cell."""
        bound = np.zeros_like(mass)  # nodes beside those of bodies are without mass
        np.divide(self._stiffness, mass, out=bound, where=mass > 0.0)
        per_node = bound.reshape(-1, self._dim).max(axis=1)
        # ω² of a sum of stiffnesses is at most the sum of both: the cell alone, and the contact's
        # springs on the worst of its nodes.
        return self._alone / factor + per_node[self._nodes].max(axis=1, initial=0.0)


# -- The stable time step of central differences, from the largest eigenvalue of M⁻¹K --------------

FIRST, AGAIN = 40, 12  # most Lanczos iterations of the first estimate, and of later ones
NUDGE = 1e-5  # of the smallest cell: how far nodes are moved for differences of forces
LOOK, STRAINED = 25, 0.03  # steps between two looks at the cells; what one may strain by


@dataclass(frozen=True, slots=True)
class StableStep:
    """Stable steps, s."""

    limit: float  # of everything together: above it the motion grows without bound
    elements: float  # of the bodies alone
    penalty: float  # with contact and springs
    closing: float  # √2 over the highest frequency of the nodes on the penalty alone
    reason: str  # what limits the step
    place: tuple[float, ...]  # where the fastest oscillation is, m, undeformed


@dataclass(slots=True)
class Mode:
    """The fastest oscillation found."""

    value: float  # 1/s², upper estimate of the eigenvalue
    vector: Floats  # (n,), of unit mass norm


class Stiffness:
    """Actions of K on vectors of the unknowns, by differences of forces."""

    def __init__(
        self,
        dynamics: LumpedDynamics,
        bodies: Bodies,
        u: NodalVector,
        space: dolfinx.fem.FunctionSpace,
        pairs: Sequence[PairStiffness],
    ) -> None:
        """Allocate vectors and find the smallest cell; collective."""
        self.dynamics, self._bodies, self._u, self.pairs = dynamics, bodies, u, pairs
        self._moved, self._force = NodalVector(space), NodalVector(space)
        mesh = space.mesh
        cells = np.arange(mesh.topology.index_map(mesh.topology.dim).size_local, dtype=np.int32)
        smallest = float(mesh.h(mesh.topology.dim, cells).min(initial=np.inf))
        self.smallest = float(dynamics.comm.allreduce(smallest, op=MPI.MIN))
        ends = np.array(basix.topology(mesh.basix_cell())[1])
        corners = np.asarray(space.dofmap.list)[cells]  # they come first
        self._edges = [corners[:, end] for end in ends.T]
        self._reference = space.tabulate_dof_coordinates()[:, : dynamics.dim]
        self._reach = NUDGE * self.smallest

    def place(self) -> Floats:
        """The present displacements (n,), m, of the owned unknowns."""
        return self._u.owned.copy()

    def edges_at(self, place: Floats) -> Floats:
        """Lengths (c, e), m, of the cells' edges at the displacements ``place``; collective."""
        self._moved.owned[:] = place
        self._moved.update_ghosts()
        return self._lengths(self._moved.array)

    def strain_since(self, edges: Floats) -> float:
        """Largest strain of an edge of a cell that had the lengths (c, e); collective.

        Thinner cells oscillate faster, and stretched rubber gets stiffer.
        """
        most = float(np.max(np.abs(self._lengths(self._u.array) / edges - 1.0), initial=0.0))
        return float(self.dynamics.comm.allreduce(most, op=MPI.MAX))

    def _lengths(self, u: Floats) -> Floats:
        """Of the cells' edges (c, e), m, for displacements u of the local unknowns."""
        x = self._reference + u.reshape(self._reference.shape)
        along = x[self._edges[0]] - x[self._edges[1]]
        return np.asarray(np.sqrt(np.einsum("cei,cei->ce", along, along)))

    def bodies(self, w: Floats) -> Floats:
        """K w of the bodies (n,), w a direction (n,); collective."""
        most = self.dynamics.comm.allreduce(float(np.abs(w).max(initial=0.0)), op=MPI.MAX)
        out: Floats = np.zeros_like(w)
        if not most > 0.0:
            return out
        h = self._reach / most
        # Central differences of the internal forces: K w without a matrix, to the second order of
        # the nudge.
        for sign in (1.0, -1.0):
            self._moved.owned[:] = self._u.owned + sign * h * w
            self._moved.update_ghosts()
            self._bodies.evaluate(self._moved.array, self._force.array, None)
            self._force.collect_ghosts()
            out += sign * self._force.owned
        return out / (2.0 * h)

    def contacts(self, w: Floats) -> Floats:
        """K w of contact and springs, (n,); collective."""
        self._moved.owned[:] = w
        self._force.owned[:] = 0.0
        for pair in self.pairs:
            pair.add(self._moved, self._force)
        self.dynamics.add_springs(w, self._force.owned)
        return self._force.owned.copy()


def largest(
    dynamics: LumpedDynamics, apply: Callable[[Floats], Floats], start: Floats, iterations: int
) -> Mode:
    """Largest eigenvalue of M⁻¹A by Lanczos' iteration from ``start`` (n,); collective."""
    q = dynamics.project(start)
    norm = np.sqrt(dynamics.dot(q, q))
    if not norm > 0.0:
        return Mode(0.0, q)
    basis = [q / norm]
    alpha: list[float] = []
    beta: list[float] = []
    z = np.empty_like(q)
    for _ in range(iterations):
        dynamics.accelerate(apply(basis[-1]), dynamics.no_pull, z)
        np.negative(z, out=z)
        alpha.append(dynamics.dot(basis[-1], z))
        for previous in basis:  # full orthogonalisation: no spurious copies of eigenvalues
            z -= dynamics.dot(previous, z) * previous
        norm = float(np.sqrt(dynamics.dot(z, z)))
        tridiagonal = np.diag(alpha) + np.diag(beta, 1) + np.diag(beta, -1)
        values, vectors = np.linalg.eigh(tridiagonal)
        beta.append(norm)
        # Residual |M⁻¹A y − θ y| = β |s_last| of the Ritz pair (Parlett, The Symmetric Eigenvalue
        # Problem, 1980, ch. 13): an eigenvalue lies within it, and θ + β |s_last| is an upper
        # estimate.
        missed = norm * abs(vectors[-1, -1])
        if missed <= 1e-3 * values[-1] or norm <= 1e-12 * abs(values[-1]):
            break
        basis.append(z / norm)
    ritz = sum(c * b for c, b in zip(vectors[:, -1], basis, strict=False))
    return Mode(float(values[-1] + missed), np.asarray(ritz))


class StableSteps:
    """Estimates the stable step; each estimate starts from the eigenvectors of the last."""

    def __init__(self, stiffness: Stiffness, space: dolfinx.fem.FunctionSpace) -> None:
        self._stiffness, self._space = stiffness, space
        self._bodies: Mode | None = None
        self._whole: Mode | None = None
        self._contact: Mode | None = None
        self._place = stiffness.place()
        self._edges = stiffness.edges_at(self._place)
        self._noise = self._seed()

    def estimate(self) -> StableStep:
        """The stable step of the present configuration; collective."""
        s = self._stiffness
        self._place = s.place()
        self._edges = s.edges_at(self._place)
        self._bodies = self._largest(s.bodies, self._bodies)
        elements, mode = _step_of(self._bodies.value), self._bodies
        penalty = elements
        sprung = any(p.stiffness for p in s.dynamics.platens) or s.dynamics.springs.any()
        if s.pairs or sprung:
            mode = self._whole = self._largest(lambda w: s.bodies(w) + s.contacts(w), self._whole)
            penalty = _step_of(mode.value)
        closing = np.inf
        if s.pairs:
            self._contact = self._largest(s.contacts, self._contact)
            closing = float(np.sqrt(0.5)) * _step_of(self._contact.value)
        reason = "the elements" if penalty > 0.99 * elements else "the contact's stiffness"
        if closing < 0.99 * penalty:
            assert self._contact is not None
            reason, mode = "the contact's opening and closing", self._contact
        limit = min(penalty, closing)
        place = place_of_largest(s.dynamics.mass * mode.vector**2, self._space)
        return StableStep(limit, elements, penalty, closing, reason, place)

    def outdated(self) -> bool:
        """Whether a cell has strained by more than a little since the last estimate; collective."""
        return not self._stiffness.strain_since(self._edges) <= STRAINED

    def snapshot(self) -> Snapshot:
        """The oscillations that the next estimate starts from, and the place of the last."""
        modes = {"bodies": self._bodies, "whole": self._whole, "contact": self._contact}
        return {"place": Nodal(self._place)} | {
            name: None if mode is None else {"value": mode.value, "vector": Nodal(mode.vector)}
            for name, mode in modes.items()
        }

    def restore(self, kept: Snapshot) -> None:
        """Go on from what :meth:`snapshot` has seen."""
        kept = dict(kept)
        self._place = kept.pop("place")
        self._edges = self._stiffness.edges_at(self._place)
        modes = {name: None if mode is None else Mode(**mode) for name, mode in kept.items()}
        self._bodies, self._whole, self._contact = (
            modes[name] for name in ("bodies", "whole", "contact")
        )

    def _seed(self) -> Floats:
        """An irregular vector (n,) that depends on the nodes' positions, not on the ranks."""
        dynamics = self._stiffness.dynamics
        dim = dynamics.dim
        where = self._space.tabulate_dof_coordinates()[: len(dynamics.mass) // dim, :dim]
        phase = where @ np.array([12.9898, 78.233, 37.719][:dim]) / self._stiffness.smallest
        return np.sin(phase[:, None] + 1.7 * np.arange(dim)).reshape(-1)

    def _largest(self, apply: Callable[[Floats], Floats], last: Mode | None) -> Mode:
        """Begin with the last vector and some noise, which excites all other modes."""
        dynamics = self._stiffness.dynamics
        noise = dynamics.project(self._noise)
        if last is None:
            return largest(dynamics, apply, noise, FIRST)
        noise *= 0.1 / np.sqrt(dynamics.dot(noise, noise))
        return largest(dynamics, apply, last.vector + noise, AGAIN)


class StepEstimate(Remembers):
    """The stable step, estimated again after a number of steps, and where cells strain."""

    _made_at: Kept[int]
    _looked_at: Kept[int]
    _last: Kept[StableStep | None]
    _stable_steps: Kept[StableSteps]

    def __init__(self, stable_steps: StableSteps, every: int) -> None:
        self._stable_steps, self._every = stable_steps, every
        self._made_at = self._looked_at = 0
        self._last = None

    def at(self, steps: int) -> StableStep:
        """What the stable step is made of after so many steps; collective when it is due."""
        due = self._last is None or steps - self._made_at >= self._every
        if not due and steps - self._looked_at >= LOOK:
            due, self._looked_at = self._stable_steps.outdated(), steps
        if due or self._last is None:
            self._last, self._made_at = self._stable_steps.estimate(), steps
        return self._last

    def last(self, steps: int) -> StableStep:
        """The last estimate, due or not; collective if there is none."""
        return self._last or self.at(steps)


def _step_of(value: float) -> float:
    """2/√λ, s; 0 where λ is not a number."""
    if np.isnan(value):
        return 0.0
    return 2.0 / float(np.sqrt(value)) if value > 0.0 else np.inf


def foundation_springs(problem: Equilibrium) -> Floats:
    """Stiffness (n,) of elastic foundations at the owned unknowns, N/m, from above.

    The integrals of products of shape functions are taken for those of single ones at the diagonal,
    which is more for first-order surfaces, and the larger of both stiffnesses in every
    direction, also where it does not act yet.
    """
    out = np.zeros(problem.owned)
    for load in problem.loads:
        if isinstance(load, Foundation):
            out += load.strongest * np.abs(load.shares)
    return out
