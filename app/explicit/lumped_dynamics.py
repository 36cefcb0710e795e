"""Accelerations from forces: lumped masses, constrained unknowns, rigid platens."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from mpi4py import MPI

from tribox.app.equilibrium.constraints import Platen
from tribox.geometry.surfaces.exchange import NodalVector, SurfaceExchange
from tribox.geometry.surfaces.facets import Floats, Ints


class LumpedDynamics:
    """From forces to accelerations.

    A platen is a rigid edge: its unknowns share the sum of the forces and of the masses, to which
    it adds a mass of its own.

    Attributes:
        mass: (n,), kg per unit thickness, owned unknowns; a platen's own mass is on its leader.
        inverse: (n,), 1/mass, 0 at constrained unknowns.
        platens: the platens; platen_mass: (p,), kg, their summed masses.
        springs: (n,), N/m per unit thickness, of foundations at the owned unknowns, from above.
        no_pull: (p,) zeros, for platens without a force.
    """

    def __init__(
        self,
        mass: Floats,
        constrained: Ints,
        platens: Sequence[Platen],
        first: int,
        dim: int,
        comm: MPI.Comm,
    ) -> None:
        """Sum the platens' masses; collective.

        Args:
            mass: (n,) lumped mass of the owned unknowns.
            constrained: owned unknowns that follow a program.
            platens: rigid edges.
            first: global number of the first owned unknown.
            dim: unknowns per node.
            comm: of the mesh.
        """
        self.mass, self.first, self.dim = mass.copy(), first, dim
        self.platens, self.comm = list(platens), comm
        for platen in self.platens:
            leader = int(platen.all_dofs[0]) - first if len(platen.all_dofs) else -1
            if 0 <= leader < len(mass):
                self.mass[leader] += platen.mass
        self.platen_mass = self.sums(self.mass)
        self.springs: Floats = np.zeros(len(mass))
        self.constrain(constrained)
        self.no_pull: Floats = np.zeros(len(self.platens))

    def constrain(self, constrained: Ints) -> None:
        """From now on these owned unknowns follow a program."""
        self.inverse: Floats = np.zeros_like(self.mass)  # what carries no body has no mass
        np.divide(1.0, self.mass, out=self.inverse, where=self.mass > 0.0)
        self.inverse[constrained] = 0.0
        self._negative = -self.inverse

    def sums(self, values: Floats) -> Floats:
        """Sum of ``values`` (n,) over each platen's unknowns (p,); collective."""
        local = np.array([values[p.dofs].sum() for p in self.platens])
        return self._summed(local)

    def _summed(self, local: Floats) -> Floats:
        if self.comm.size == 1:
            return local
        total = np.empty_like(local)
        self.comm.Allreduce(local, total, op=MPI.SUM)
        return total

    def accelerate(
        self, residual: Floats, pull: Floats, out: Floats, valid: bool = True
    ) -> tuple[Floats, bool]:
        """Accelerations −r/m (n,) into ``out``, m/s²; collective.

        Args:
            residual: (n,), N, internal and contact forces less the loads'.
            pull: (p,), N, force on each platen.
            out: accelerations.
            valid: whether the forces of this rank are valid.

        Returns:
            The platens' accelerations (p,), m/s², the same on all ranks; whether the forces of all
            ranks are valid.
        """
        np.multiply(residual, self._negative, out=out)
        if not self.platens and self.comm.size == 1:
            return self.no_pull, valid
        local = np.array([residual[p.dofs].sum() for p in self.platens] + [float(not valid)])
        total = self._summed(local)
        platens: Floats = (pull - total[:-1]) / self.platen_mass
        for platen, value in zip(self.platens, platens, strict=True):
            out[platen.dofs] = value
        return platens, bool(total[-1] == 0.0)

    def accelerate_at(self, dofs: Ints, residual: Floats, out: Floats) -> None:
        """Renew the accelerations of owned unknowns ``dofs`` that belong to no platen."""
        out[dofs] = residual[dofs] * self._negative[dofs]

    def touched(self, pairs: Iterable[SurfaceExchange], scratch: NodalVector) -> Ints | None:
        """Owned unknowns that the pairs' loads can reach; None if one is a platen's; collective.

        Args:
            pairs: nodes of the contact pairs.
            scratch: overwritten.
        """
        scratch.owned[:] = 0.0
        for pair in pairs:
            pair.add(np.ones((len(pair.nodes), self.dim)), scratch)
        found = np.nonzero(scratch.owned)[0].astype(np.int32)
        meets = any(np.intersect1d(found, platen.dofs).size for platen in self.platens)
        return None if self.comm.allreduce(meets, op=MPI.LOR) else found

    def dot(self, a: Floats, b: Floats) -> float:
        """Inner product aᵀM b over all ranks; collective."""
        return float(self.comm.allreduce(float(np.dot(a * self.mass, b)), op=MPI.SUM))

    def project(self, w: Floats) -> Floats:
        """The part of ``w`` (n,) that supports and platens allow, M-orthogonal; collective."""
        out: Floats = np.where(self.inverse > 0.0, w, 0.0)
        means = self.sums(self.mass * out) / self.platen_mass
        for platen, mean in zip(self.platens, means, strict=True):
            out[platen.dofs] = mean
        return out

    def add_springs(self, w: Floats, out: Floats) -> None:
        """Add the forces of springs stretched by ``w`` (n,) to ``out``: platens', foundations'."""
        out += self.springs * w
        for platen in self.platens:
            leader = int(platen.all_dofs[0]) - self.first if len(platen.all_dofs) else -1
            if 0 <= leader < len(w):
                out[leader] += platen.stiffness * w[leader]
