"""Bodies that share nodes: they are bonded, and move and balance as one."""

from __future__ import annotations

from itertools import combinations

import dolfinx
import numpy as np
from mpi4py import MPI

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.forms.bodies.solid import Solid


def bonded_groups(problem: Equilibrium) -> list[list[Solid]]:
    """All bodies, those together that are connected by shared nodes; collective.

    Returns:
        In the order of the problem's bodies, by the first of each group; the same on all ranks.
    """
    solids = problem.solids
    number = list(range(len(solids)))
    if len(solids) > 1:
        index = problem.space.dofmap.index_map
        uses = np.zeros((len(solids), index.size_local), dtype=np.bool_)
        for row, solid in zip(uses, solids, strict=True):
            marks = dolfinx.la.vector(index, 1, dtype=np.float64)
            marks.array[np.unique(problem.space.dofmap.list[solid.cells])] = 1.0
            # A body may use a node only on a rank that does not own it.
            marks.scatter_reverse(dolfinx.la.InsertMode.add)
            row[:] = marks.array[: index.size_local] > 0.0
        pairs = list(combinations(range(len(solids)), 2))
        local = np.array([np.count_nonzero(uses[a] & uses[b]) for a, b in pairs])
        shared = problem.comm.allreduce(local, op=MPI.SUM)
        for (a, b), count in zip(pairs, shared, strict=True):
            if count:
                number = [number[a] if n == number[b] else n for n in number]
    groups: dict[int, list[Solid]] = {}
    for n, solid in zip(number, solids, strict=True):
        groups.setdefault(n, []).append(solid)
    return list(groups.values())
