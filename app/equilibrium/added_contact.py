"""Contact that is added to somebody else's residual and tangent.

For scripts with forms, supports and a solver of their own: the mesh and the displacement are
DOLFINx's, vectors and matrices PETSc's, and what is not contact is not looked at.
"""

from __future__ import annotations

from collections.abc import Sequence

import dolfinx
import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.equilibrium.bodies import Bodies
from tribox.app.equilibrium.constraints import Constraints
from tribox.app.equilibrium.tangent import Tangent
from tribox.app.equilibrium.timers import Stopwatch
from tribox.app.equilibrium.unknowns import Unknowns
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.state import AS_IS, ContactTrial
from tribox.geometry.surfaces.facets import Floats, Ints

_ROOM = "tribox_room"  # attribute of a matrix that has room for the contacts' entries


class AddedContact:
    r"""Contact pairs in a problem of one's own.

    With the contact traction t on the slave, the pairs add

    .. math:: R_c = -\int t \cdot (\delta u^1 - \delta u^2)\, dA_0, \quad K_c = dR_c/du

    to a residual R = dE/du and its tangent. The unknowns are numbered as in the displacement's
    space: component i of the global node n is unknown n · dim + i.

    Attributes:
        terms: the pairs.
        trials: of each, what :meth:`evaluate` found last.
    """

    def __init__(
        self,
        u: dolfinx.fem.Function,
        terms: Sequence[ContactTerm],
        bcs: Sequence[dolfinx.fem.DirichletBC] = (),
    ) -> None:
        """Take contacts between surfaces that move by ``u`` (m); collective."""
        self.terms = list(terms)
        self.trials: list[ContactTrial] = []
        self._unknowns = Unknowns(u.function_space)
        constraints = Constraints(self._unknowns, (), ())
        self._tangent = Tangent(constraints, Bodies(u, ()), self.terms, ())
        self._forces = self._unknowns.new_vector()
        self._matrix: PETSc.Mat | None = None
        self._timer = Stopwatch()
        none = np.empty(0, dtype=np.int32)
        given: Ints = np.concatenate([none, *(bc.dof_indices()[0] for bc in bcs)])
        fixed = np.unique(given)
        self._fixed: Ints = fixed[fixed < self._unknowns.owned]

    def evaluate(self, x: PETSc.Vec, dt: float) -> list[ContactTrial]:
        """Find the contact at displacements after a step; nothing is committed; collective.

        Returns gap, pressure, traction and more at the points of each pair.

        Args:
            x: (n,), m, such as ``u.x.petsc_vec`` or what SNES hands in.
            dt: s, length of the step, which laws with a velocity need.
        """
        self.trials = [term.evaluate(x, dt, AS_IS) for term in self.terms]
        return self.trials

    def add_residual(self, b: PETSc.Vec) -> None:
        """Add the contacts' residual R_c, N (per metre in plane strain), to ``b``; collective.

        Args:
            b: (n,), of the displacement's space; of a nested vector the part of the displacement.

        Raises:
            ValueError: it is a vector of another space.
        """
        self._see_size(b.getLocalSize(), "vector")
        forces = self._forces
        forces.set(0.0)
        for term, trial in self._pairs():
            nodes, values, _ = term.forces_at_nodes(trial)
            rows = self._unknowns.of_nodes(nodes).reshape(-1)
            forces.setValues(rows, values.reshape(-1), addv=PETSc.InsertMode.ADD_VALUES)
        forces.assemble()
        forces.array[self._fixed] = 0.0
        b.array[: self._unknowns.owned] += forces.array_r

    def add_tangent(self, A: PETSc.Mat) -> None:
        """Add the contacts' tangent K_c, N/m (per metre in plane strain), to ``A``; collective.

        The matrix gets room for entries that it has none for, its values are kept.

        Args:
            A: (n, n) assembled, of the displacement's space; of a nested matrix its block.

        Raises:
            ValueError: it is a matrix of another space.
        """
        self._see_size(A.getLocalSize()[0], "matrix")
        trials = [trial for _, trial in self._pairs()]
        if self._matrix is None:
            self._matrix = self._tangent.new_matrix(trials)
            self._matrix.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        self._tangent.assemble(self._matrix, trials, self._timer)
        fixed = (self._unknowns.first + self._fixed).astype(PETSc.IntType)
        self._matrix.zeroRowsColumns(fixed, diag=0.0)
        self._add(A, self._matrix)

    def _add(self, A: PETSc.Mat, added: PETSc.Mat) -> None:
        """Add a matrix; the first time with its pattern, which takes longer."""
        room = id(self), self._tangent.pattern_changes
        known = A.getAttr(_ROOM) == room
        if known:
            A.axpy(1.0, added, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
            return
        # For another pattern PETSc puts a new matrix in the place of this one, without its
        # numbering.
        maps = A.getLGMap()
        A.axpy(1.0, added, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        A.setLGMap(*maps)
        A.setAttr(_ROOM, room)

    def commit(self) -> None:
        """Make what was evaluated last the state that the next step starts from.

        Call it once per step, after :meth:`evaluate` at the solution. Until then a step leaves no
        trace, and may be tried again with another length.
        """
        for term, trial in self._pairs():
            term.commit(trial)

    def normal_forces(self) -> Floats:
        """Of each pair ∫ t_N dA over the slave, N (per metre in plane strain); collective."""
        local = [term.surface.slave.weight @ trial.pressure for term, trial in self._pairs()]
        return self._unknowns.comm.allreduce(np.array(local), op=MPI.SUM)

    def _pairs(self) -> list[tuple[ContactTerm, ContactTrial]]:
        if not self.trials:
            raise RuntimeError("the contact has not been evaluated yet: call evaluate(x, dt) first")
        return list(zip(self.terms, self.trials, strict=True))

    def _see_size(self, found: int, kind: str) -> None:
        if found != self._unknowns.owned:
            raise ValueError(
                f"a {kind} with {found} unknowns on this rank; the displacement has "
                f"{self._unknowns.owned}: of a nested one hand in the displacement's block"
            )
