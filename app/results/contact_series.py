"""The contact as two series of VTU files: slave surfaces with nodal values, and contact points."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tribox.app.build.model import Model
from tribox.app.results.contact_nodes import VTK_KINDS, contact_nodes, slave_facets
from tribox.app.results.contact_points import ContactPoints
from tribox.app.results.series import Series
from tribox.app.results.vtu import Array, Cells, Packed, pack, with_three_components, write_vtu

SURFACES, POINTS = "contact", "contact_points"
VERTEX = 1  # VTK's number of a cell of one point
_FIXED = ("reference", "pair", "area", "weight")


class ContactSeries:
    """Writes ``contact.pvd`` and ``contact_points.pvd`` with their files; collective."""

    def __init__(
        self, model: Model, directory: Path, times: Mapping[int, float] | None = None
    ) -> None:
        """Find what does not change, and keep the files of ``times`` (s, by step); collective."""
        self._model = model
        self._facets = slave_facets(model)
        self._points = ContactPoints(model)
        self.series: list[Series] = []
        self._fixed: list[dict[str, Packed]] = [{}, {}]
        if model.problem.comm.rank == 0:
            self.series = [Series(directory, name, times) for name in (SURFACES, POINTS)]
            count = len(self._points.weight)
            self._cells = [
                Cells.of_one_kind(self._facets.nodes, VTK_KINDS[self._facets.kind]),
                Cells.of_one_kind(np.arange(count)[:, None], VERTEX),
            ]
            self._pair = pack(self._facets.pair, lasting=True)

    def write(self, step: int, time: float) -> None:
        """Write the last converged state.

        Args:
            step: number of the step.
            time: s.
        """
        points = self._points.arrays(self._model)
        nodes = contact_nodes(self._model, self._facets)
        if points is None or nodes is None:
            return
        self._write(0, nodes.values, {"pair": self._pair}, step, time)
        self._write(1, points, {}, step, time)

    def _write(
        self,
        which: int,
        values: dict[str, Array],
        cell_data: dict[str, Packed],
        step: int,
        time: float,
    ) -> None:
        series, fixed = self.series[which], self._fixed[which]
        flat = {name: with_three_components(v) if v.ndim > 1 else v for name, v in values.items()}
        position = flat.pop("position")
        if not fixed:
            fixed.update({name: pack(flat[name], lasting=True) for name in _FIXED if name in flat})
        cells = self._cells[which]
        write_vtu(series.path(step), position, cells, {**flat, **fixed}, cell_data, time, step)
        series.add(step, time)
