"""Which bodies a factorisation may be kept of for a whole run, and the matrix that it is made of.

A body that is much stiffer than what presses on it hardly deforms: its tangent is that of the
undeformed state, and the stiffness of its contacts is little beside its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import dolfinx
import numpy as np
from petsc4py import PETSc

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.pattern import cell_matrix
from tribox.app.equilibrium.slanted import SlantedPlaten
from tribox.app.equilibrium.supports import (
    JoinedBodies,
    bodies_of,
    joined_bodies,
    motions_left,
    motions_of,
)
from tribox.forms.bodies.materials import Material
from tribox.forms.bodies.solid import Solid
from tribox.forms.contact.penalty import ContactTerm
from tribox.geometry.surfaces.facets import Bools, Ints

STIFFER = 0.5  # largest stiffness of a contact over that of a facet's extent of a body that is kept


@dataclass(frozen=True, slots=True)
class KeptBodies:
    """The bodies of which a factorisation is kept while the supports stay."""

    solids: tuple[Solid, ...]  # the bodies
    kept: Bools  # (n,) whether an owned unknown is theirs

    @property
    def dofs(self) -> Ints:
        """Their owned local unknowns."""
        return np.nonzero(self.kept)[0].astype(np.int32)

    @property
    def others(self) -> Ints:
        """All other owned local unknowns."""
        return np.nonzero(~self.kept)[0].astype(np.int32)

    def tangent(self, problem: Equilibrium) -> PETSc.Mat:
        """Their tangent undeformed, on their supports, without contacts; collective."""
        unknowns = problem.unknowns
        cells = np.concatenate([solid.cells for solid in self.solids])
        whole = cell_matrix(unknowns.space, cells)
        u = problem.u.x.array
        present = u.copy()
        u[:] = 0.0
        for solid in self.solids:
            problem.bodies.add_elastic_tangent(whole, problem.solids.index(solid))
        u[:] = present
        whole.assemble()
        rows = PETSc.IS().createGeneral(self.dofs + unknowns.first, comm=unknowns.comm)
        rows.setBlockSize(problem.dim)
        out = whole.createSubMatrix(rows, rows)
        held = np.isin(self.dofs, problem.constrained_dofs()).nonzero()[0]
        out.zeroRowsColumns(held.astype(PETSc.IntType) + out.getOwnershipRange()[0], 1.0)
        whole.destroy()
        rows.destroy()
        return out


def stiff_solids(problem: Equilibrium) -> list[Solid]:
    """The bodies that are elastic and much stiffer than all that presses on them; collective."""
    return [solid for solid in problem.solids if not solid.remembers and _is_stiff(problem, solid)]


def _is_stiff(problem: Equilibrium, solid: Solid) -> bool:
    ends = [bodies_of(problem, term) for term in problem.contacts]
    on = [
        term
        for term, pair in zip(problem.contacts, ends, strict=True)
        if not term.tied and solid in (pair.slave, pair.master)
    ]
    stiffness = [_contact_modulus(problem, term) for term in on]
    return bool(on) and max(stiffness) <= STIFFER * young_modulus(solid.material)


def _contact_modulus(problem: Equilibrium, term: ContactTerm) -> float:
    """Penalty times the length of a slave facet, Pa; collective."""
    penalty = np.asarray(term.penalty, dtype=np.float64)
    total, count = problem.comm.allreduce(np.array([penalty.sum(), penalty.size]))
    return float(total / max(count, 1.0) * term.surface.facet_length)


def young_modulus(material: Material) -> float:
    """E = 9 K G / (3 K + G), Pa."""
    bulk, shear = material.bulk_modulus, material.shear_modulus
    return 9.0 * bulk * shear / (3.0 * bulk + shear)


def kept_bodies(problem: Equilibrium, stiff: Sequence[Solid]) -> KeptBodies | None:
    """Those of the stiff bodies that the supports at hand hold by themselves; collective.

    Returns None where there are none, or all bodies are.
    """
    found = [one for one in joined_bodies(problem) if _is_kept(problem, one, stiff)]
    solids = tuple(solid for one in found for solid in one.solids)
    if not solids or len(solids) == len(problem.solids):
        return None
    return KeptBodies(solids, _unknowns_of(problem, solids))


def _is_kept(problem: Equilibrium, joined: JoinedBodies, stiff: Sequence[Solid]) -> bool:
    """Whether all of a body, or of bonded ones, is stiff, tied to nothing, and held."""
    if joined.grips or len(joined.groups) > 1 or any(solid not in stiff for solid in joined.solids):
        return False
    mine = _unknowns_of(problem, joined.solids)
    moved = [
        platen.dofs
        for platen in problem.platens
        if platen.acts and (isinstance(platen, SlantedPlaten) or platen.displacement is None)
    ]
    touched = any(bool(mine[dofs].any()) for dofs in moved)
    if problem.comm.allreduce(int(touched)):
        return False
    return _is_held(problem, mine, joined.of_revolution)


def _is_held(problem: Equilibrium, mine: Bools, axisymmetric: bool) -> bool:
    """Whether no rigid motion of owned unknowns (n,) is left by those that are prescribed."""
    dim = problem.dim
    nodes = np.nonzero(mine.reshape(-1, dim).any(axis=1))[0].astype(np.int32)
    modes, _ = motions_of(problem, nodes, axisymmetric)
    held = np.zeros(problem.owned, dtype=bool)
    held[problem.constrained_dofs()] = True
    resisted = held.reshape(-1, dim)[nodes]
    gram = problem.comm.allreduce(np.einsum("nai,nbi,ni->ab", modes, modes, resisted))
    return not motions_left(problem, gram, nodes).any()


def _unknowns_of(problem: Equilibrium, solids: Sequence[Solid]) -> Bools:
    """Whether owned unknowns (n,) are those of bodies; collective."""
    index = problem.space.dofmap.index_map
    marks = dolfinx.la.vector(index, 1, dtype=np.float64)
    for solid in solids:
        marks.array[np.unique(problem.space.dofmap.list[solid.cells])] = 1.0
    marks.scatter_reverse(dolfinx.la.InsertMode.add)  # a node may be used on another rank alone
    return np.repeat(marks.array[: index.size_local] > 0.0, problem.dim)
