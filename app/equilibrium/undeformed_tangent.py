"""The tangent of stiff bodies that hardly move: assembled once, and kept for the run.

Where |∇u| ≪ 1 in a whole body, rotation included, its tangent is that of the undeformed state but
for terms of the order of |∇u|. With a residual that is exact the solution stays the same, and each
Newton iteration leaves about |∇u| of the body's part of the residual: with :data:`SMALL` three
digits are gained at least, as many as an iteration of an inexact linear solver gains.

In a slender body the geometric stiffness of a membrane strain ε counts by ε/ε_cr beside the
stiffness against bending, ε_cr = π²/12 (t/l)² being Euler's strain of buckling (plane strip, ends
hinged). The bound is lowered accordingly.

Bodies that a compiled loop covers have none kept: their tangent is made in the time that it takes
to see how far they have moved.

What is kept depends on the undeformed state and on the platens that act, never on the history.
:attr:`UndeformedTangent.on` follows from the displacement at hand: nothing of it joins a restart.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import dolfinx
import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.equilibrium.bodies import Bodies
from tribox.forms.bodies.deformation import GradientBound, thickness_ratio
from tribox.forms.bodies.solid import Solid
from tribox.forms.contact.penalty import ContactTerm

SMALL = 1e-3
"""Largest |∇u| with which a compact body keeps its tangent."""
SLENDER = 5e-3
"""Largest |∇u| over (t/l)², thickness and length, with which a slender body does."""
STIFFER = 100.0
"""Shear modulus, over that of the softest body in contact, from which on a body is stiff. A softer
one soon leaves the bound, and what was kept would have served a few steps only."""


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A stiff body: its number, the bound of its gradients and the largest allowed."""

    index: int
    bound: GradientBound
    largest: float


class UndeformedTangent:
    """Which bodies keep their tangent at the displacement at hand, and what they add.

    Attributes:
        on: of each solid, whether its tangent was the kept one at the last :meth:`decide`.
        allowed: whether tangents are kept at all; False: exact ones always.
        made: how often a matrix of kept tangents was assembled.
    """

    def __init__(self, bodies: Bodies, contacts: Sequence[ContactTerm]) -> None:
        """Begin without any."""
        self._bodies, self._contacts = bodies, contacts
        self._candidates: list[_Candidate] | None = None
        self._matrix: PETSc.Mat | None = None
        self._made_for: object = None
        self.on = (False,) * len(bodies.solids)
        self.allowed = True
        self.made = 0

    def decide(self) -> None:
        """Find which bodies are near enough to undeformed at the displacement; collective."""
        on = [False] * len(self._solids)
        for one in self._stiff() if self.allowed else ():
            u = self._solids[one.index].displacement
            moved = one.bound.largest(u.x.array.reshape(-1, u.function_space.dofmap.index_map_bs))
            on[one.index] = bool(moved <= one.largest)  # not where there are no numbers
        if self._candidates:
            here = np.array(on)
            self._comm.Allreduce(MPI.IN_PLACE, here, op=MPI.LAND)
            on = [bool(one) for one in here]
        self.on = tuple(on)

    @property
    def others(self) -> list[Solid]:
        """The solids whose tangent is that of the displacement at hand."""
        return [solid for solid, on in zip(self._solids, self.on, strict=True) if not on]

    def begin(
        self, A: PETSc.Mat, pattern: object, add: Callable[[PETSc.Mat, Sequence[Solid]], None]
    ) -> None:
        """Let ``A`` hold what the kept tangents add, and zeros elsewhere; collective.

        Args:
            A: the matrix, with its local to global map.
            pattern: what changes with its pattern or that map.
            add: adds tangents of solids at the displacement at hand to a matrix.
        """
        if not any(self.on):
            A.zeroEntries()
            return
        if self._matrix is None or self._made_for != (pattern, self.on):
            self.forget()
            self._matrix = A.duplicate(copy=False)
            self._matrix.setLGMap(*A.getLGMap())
            self._matrix.zeroEntries()
            kept = [solid for solid, on in zip(self._solids, self.on, strict=True) if on]
            with undeformed(kept[0].displacement):
                add(self._matrix, kept)
            self._matrix.assemble()
            self._made_for = pattern, self.on
            self.made += 1
        self._matrix.copy(A, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)

    def forget(self) -> None:
        """Keep no matrix."""
        if self._matrix is not None:
            self._matrix.destroy()
        self._matrix = None

    @property
    def _solids(self) -> list[Solid]:
        return self._bodies.solids

    # -- candidates ---------------------------------------------------------------------------

    @property
    def _comm(self) -> MPI.Comm:
        return self._solids[0].displacement.function_space.mesh.comm

    def _stiff(self) -> list[_Candidate]:
        """Bodies that may keep their tangent; collective when called first."""
        if self._candidates is None:
            self._candidates = [self._candidate(index) for index in self._much_stiffer()]
        return self._candidates

    def _much_stiffer(self) -> list[int]:
        """Elastic bodies without a loop, much stiffer than the softest in contact; collective."""
        touching = self._touching()
        looped = [cells is not None for cells in self._bodies.cells]
        moduli = [solid.material.shear_modulus for solid in self._solids]
        softest = min((m for m, yes in zip(moduli, touching, strict=True) if yes), default=np.inf)
        return [
            index
            for index, (solid, modulus) in enumerate(zip(self._solids, moduli, strict=True))
            if not (solid.remembers or looped[index]) and modulus >= STIFFER * softest
        ]

    def _touching(self) -> list[bool]:
        """Which bodies have nodes on a surface in contact; collective."""
        found = np.zeros(len(self._solids), dtype=bool)
        for index, solid in enumerate(self._solids):
            dofmap = solid.displacement.function_space.dofmap
            local = np.unique(dofmap.list[solid.cells]).astype(np.int32)
            nodes = dofmap.index_map.local_to_global(local)
            surfaces = [term.surface for term in self._contacts]
            on = [np.isin(nodes, s.slave.nodes) | np.isin(nodes, s.own_master) for s in surfaces]
            found[index] = any(bool(some.any()) for some in on)
        if len(self._solids):
            self._comm.Allreduce(MPI.IN_PLACE, found, op=MPI.LOR)
        return [bool(one) for one in found]

    def _candidate(self, index: int) -> _Candidate:
        solid = self._solids[index]
        space = solid.displacement.function_space
        bound = GradientBound(space, solid)
        ratio = thickness_ratio(space, solid, bound.content)
        return _Candidate(index, bound, min(SMALL, SLENDER * ratio**2))


@contextmanager
def undeformed(u: dolfinx.fem.Function) -> Iterator[None]:
    """Within a ``with`` block the displacement is zero, afterwards as it was."""
    before = u.x.array.copy()
    u.x.array[:] = 0.0
    try:
        yield
    finally:
        u.x.array[:] = before
