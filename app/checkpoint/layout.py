"""Snapshots of all ranks as one tree of plain arrays, in an order that ranks do not change.

Unknowns of nodes are ordered as the cells of the mesh file or generator name these, those of blocks
follow in the order of their places; the points of a contact pair by their undeformed places, the
cells of a body as in the mesh file or generator.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import dolfinx
import numpy as np
from mpi4py import MPI

from tribox.app.build.model import Model
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.snapshot import Array, AtPoints, InCells, Nodal, Partial, Spread
from tribox.app.results.fields import GatheredMesh
from tribox.forms.bodies.solid import Solid
from tribox.geometry.surfaces.body_facets import owned_facets
from tribox.geometry.surfaces.facets import Floats, Longs, order_by_place

KINDS = {"array": np.ndarray, "nodal": Nodal, "points": AtPoints, "cells": InCells, "sum": Partial}
WHOSE = ("pair", "body")  # attributes of such kinds that tell whose rows an array has


@dataclass(frozen=True, slots=True)
class Order:
    """Rows of all ranks, one rank after the other, and their order that ranks do not change."""

    comm: MPI.Comm  # of the ranks
    order: Longs  # (n,) the gathered row of each ordered one; empty but on the first rank
    counts: list[int]  # rows of each rank, likewise

    @classmethod
    def of(cls, comm: MPI.Comm, mine: int, order: Longs) -> Order:
        """The order of rows of which this rank has ``mine``; collective."""
        return cls(comm, order, comm.gather(mine) or [])

    def gather(self, values: Array) -> Array:
        """Ordered rows (n, …) from those of each rank; on the first rank; collective."""
        parts = self.comm.gather(np.ascontiguousarray(values))
        return values[:0] if parts is None else np.concatenate(parts)[self.order]

    def scatter(self, values: Array | None) -> Array:
        """The rows of each rank from the ordered ones (n, …) on the first; collective."""
        parts = None
        if values is not None:
            rows = np.zeros((sum(self.counts), *values.shape[1:]), dtype=values.dtype)
            rows[self.order] = values  # what no order names, as what is left over in a block, is 0
            parts = np.split(rows, np.cumsum(self.counts)[:-1])
        mine: Array = self.comm.scatter(parts)
        return np.ascontiguousarray(mine)


class Layout:
    """The nodes, contact points and cells of a model, whichever rank has them.

    Attributes:
        identity: what a mesh must agree in, on the first rank: arrays by name.
    """

    def __init__(self, model: Model) -> None:
        """Find the orders; collective."""
        problem = model.problem
        self.comm, self._dim = problem.comm, problem.dim
        mesh = GatheredMesh(problem.space)
        self._unknowns = self._order_of_unknowns(problem, mesh)
        self._points, places = [], []
        for term in problem.contacts:
            mine = term.surface.slave.position
            gathered = self.comm.gather(mine)
            where = np.empty((0, self._dim)) if gathered is None else np.concatenate(gathered)
            order = order_by_place(where) if len(where) else np.empty(0, dtype=np.int64)
            self._points.append(Order.of(self.comm, len(mine), order))
            places.append(where[order])
        self._cells = [self._order_of_cells(model, solid) for solid in problem.solids]
        self.identity = self._identity(model, mesh, places)

    def _identity(
        self, model: Model, mesh: GatheredMesh, places: Sequence[Floats]
    ) -> dict[str, Array]:
        numbers = np.zeros(model.named.mesh.topology.index_map(self._dim).size_local)
        for number, solid in enumerate(model.problem.solids):
            numbers[solid.cells] = number
        bodies = mesh.cellwise(numbers[:, None])
        return {
            "cells": mesh.cells,
            "bodies": bodies.reshape(-1).astype(np.int32),
            "nodes": mesh.reference,
            **{f"points_{pair}": place for pair, place in enumerate(places)},
            **{f"surface_{name}": self._facets(model, name) for name in model.named.surfaces},
        }

    def _order_of_unknowns(self, problem: Equilibrium, mesh: GatheredMesh) -> Order:
        """Order of the unknowns: those of the mesh's nodes, then of each block; collective."""
        order: Longs = np.empty(0, dtype=np.int64)
        if self.comm.rank == 0:
            of_nodes = self._dim * mesh.node_order[:, None] + np.arange(self._dim)
            blocks = problem.unknowns.blocks
            beside = [self._dim * block.nodes + block.components for block in blocks]
            order = np.concatenate([of_nodes.reshape(-1), *beside])
        return Order.of(self.comm, problem.owned, order)

    def _order_of_cells(self, model: Model, solid: Solid) -> Order:
        """Order of a body's cells; collective."""
        numbers = model.named.mesh.topology.original_cell_index[solid.cells]
        parts = self.comm.gather(numbers)
        order = np.empty(0, dtype=np.int64) if parts is None else np.argsort(np.concatenate(parts))
        return Order.of(self.comm, len(numbers), order)

    def _facets(self, model: Model, surface: str) -> Floats:
        """Middles (f, i), m, of a surface's facets, ordered; on the first rank; collective."""
        mesh = model.named.mesh
        mine = owned_facets(mesh, model.named.facets(surface))
        middles = dolfinx.mesh.compute_midpoints(mesh, self._dim - 1, mine)[:, : self._dim]
        parts = self.comm.gather(middles)
        whole = middles[:0] if parts is None else np.concatenate(parts)
        return whole[order_by_place(whole)] if len(whole) else whole

    # -- to one tree --------------------------------------------------------------------------

    def gather(self, snapshot: Any) -> tuple[Any, dict[str, Array]]:
        """A snapshot as plain data and arrays, on the first rank; collective.

        Returns dictionaries, lists and values as JSON knows them, with ``{"$": [kind, name]}`` for
        an array; the arrays by name.
        """
        arrays: dict[str, Array] = {}

        def leaf(value: Any) -> Any:
            for kind, what in KINDS.items():
                if isinstance(value, what):
                    name = f"{len(arrays)}"  # in step on all ranks, though the first alone has all
                    whose = [getattr(value, key) for key in WHOSE if hasattr(value, key)]
                    arrays[name] = self._gather(kind, value, whose)
                    return {"$": [kind, name, *whose]}
            return value

        return _mapped(snapshot, leaf), arrays

    def _gather(self, kind: str, value: Any, whose: list[int]) -> Array:
        """The whole array of one leaf, on the first rank; collective."""
        if (order := self._order(kind, whose)) is not None:
            return order.gather(value.values)
        if kind == "array":
            return np.asarray(value)
        total = np.empty_like(value.values)
        self.comm.Allreduce(np.ascontiguousarray(value.values), total, op=MPI.SUM)
        return total

    def _order(self, kind: str, whose: list[int]) -> Order | None:
        """The order of the rows of one leaf; None: they are not spread over the ranks."""
        if kind == "nodal":
            return self._unknowns
        orders = {"points": self._points, "cells": self._cells}.get(kind)
        return None if orders is None else orders[whose[0]]

    # -- and back -----------------------------------------------------------------------------

    def scatter(self, tree: Any, arrays: dict[str, Array]) -> Any:
        """The tree on every rank with this rank's arrays in it; collective."""
        tree = self.comm.bcast(tree)

        def leaf(value: Any) -> Any:
            if not (isinstance(value, dict) and "$" in value):
                return value
            kind, name, *whose = value["$"]
            return self._scatter(kind, arrays.get(name), whose)

        return _mapped(tree, leaf, lambda value: "$" in value)

    def _scatter(self, kind: str, array: Array | None, whose: list[int]) -> Array:
        """This rank's part of an array that the first one has; collective."""
        if (order := self._order(kind, whose)) is not None:
            return order.scatter(array)
        whole: Array = self.comm.bcast(array)
        return np.zeros_like(whole) if kind == "sum" and self.comm.rank > 0 else whole.copy()


def _mapped(
    tree: Any, leaf: Callable[[Any], Any], is_leaf: Callable[[Any], bool] = lambda value: False
) -> Any:
    """A tree with every leaf replaced."""
    if isinstance(tree, dict) and not is_leaf(tree):
        return {key: _mapped(value, leaf, is_leaf) for key, value in tree.items()}
    if isinstance(tree, list | tuple):
        return [_mapped(value, leaf, is_leaf) for value in tree]
    return leaf(tree)


def copied(snapshot: Any) -> Any:
    """A snapshot that shares no memory with the run."""

    def leaf(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            return value.copy()
        if isinstance(value, Spread):
            return replace(value, values=value.values.copy())
        return value

    return _mapped(snapshot, leaf)


def differences(mine: dict[str, Array], kept: dict[str, Array]) -> Iterator[str]:
    """In what two meshes differ, by their identities, in words."""
    for name, what in (("cells", "cells"), ("bodies", "bodies of the cells")):
        if mine[name].shape != kept[name].shape:
            yield f"{len(mine[name])} cells instead of {len(kept[name])}"
            return
        if not np.array_equal(mine[name], kept[name]):
            yield f"other {what}"
            return
    size = float(np.ptp(kept["nodes"], axis=0).max())
    for name in kept.keys() - {"cells", "bodies"}:
        if name not in mine or mine[name].shape != kept[name].shape:
            what = name.partition("_")[2] if name.startswith("surface") else "contact points"
            yield f"other facets or points: {what}"
            return
        apart = np.abs(mine[name] - kept[name]).max(initial=0.0)
        if not apart <= 1e-9 * size:
            yield f"{name.split('_')[0]} moved by up to {apart:.3g} m"
            return
