"""All field output of a run: bodies, contact and tools, in the formats that the case asks for.

The contact is two series of VTU files: slave surfaces with nodal values, and contact points.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tribox.app.build.model import Model
from tribox.app.build.tools import extent
from tribox.app.results.bp_files import BpWriter
from tribox.app.results.contact_nodes import VTK_KINDS, contact_nodes, nodal_pressure, slave_facets
from tribox.app.results.contact_points import ContactPoints
from tribox.app.results.field_series import FieldSeries
from tribox.app.results.saving import Saving
from tribox.app.results.series import Series
from tribox.app.results.vtu import Array, Cells, Packed, pack, with_three_components, write_vtu

SURFACES, POINTS = "contact", "contact_points"
VERTEX = 1  # VTK's number of a cell of one point
_FIXED = ("reference", "pair", "area", "weight")
TOOLS = "tools"
_OUTLINES = {2: 3, 3: 5}  # VTK's numbers of lines and triangles, by the nodes of a cell


class ToolSeries:
    """Writes ``tools.pvd`` and ``tools/NNNNNN.vtu`` from the first rank; collective.

    Shapes without end are cut off about the mesh.
    """

    def __init__(
        self, model: Model, directory: Path, times: Mapping[int, float] | None = None
    ) -> None:
        """Make the outlines; collective.

        Args:
            model: what is solved; it must have tools.
            directory: where the files go.
            times: s, by step, of the files that are there and kept.
        """
        self._problem = model.problem
        box = extent(model.named)
        self._outlines = [tool.surface.outline(box) for tool in model.problem.tools]
        self.series: Series | None = None
        if model.problem.comm.rank > 0:
            return
        self.series = Series(directory, TOOLS, times)
        first = np.cumsum([0, *(len(one.points) for one in self._outlines)])
        cells = [one.cells + at for one, at in zip(self._outlines, first, strict=False)]
        every = np.concatenate(cells).astype(np.int64)
        number = np.repeat(np.arange(len(cells), dtype=np.int32), [len(part) for part in cells])
        self._cells = Cells.of_one_kind(every, _OUTLINES[every.shape[1]])
        self._number = pack(number, lasting=True)

    def write(self, step: int, time: float) -> None:
        """Write the tools at the displacement spread last.

        Args:
            step: number of the step.
            time: s.
        """
        problem = self._problem
        moved = []
        for tool, outline in zip(problem.tools, self._outlines, strict=True):
            slots = tool.at(problem.u.x.array[: problem.owned], problem.comm)
            moved.append(tool.surface.moved(outline.points, tool.control_points(slots)))
        if self.series is None:
            return
        before = np.concatenate([outline.points for outline in self._outlines])
        places = with_three_components(np.concatenate(moved))
        displacement = places - with_three_components(before)
        points = {"displacement": displacement}
        cells = {"tool": self._number}
        write_vtu(self.series.path(step), places, self._cells, points, cells, time, step)
        self.series.add(step, time)


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


class OutputFiles:
    """Writes a state to all files; all ranks take part.

    Attributes:
        times: s, by the number of the step, of what has been written.
    """

    def __init__(
        self,
        model: Model,
        directory: Path,
        saving: Saving,
        times: Mapping[int, float] | None = None,
    ) -> None:
        """Open the files; collective.

        Args:
            model: what is solved.
            directory: of the results.
            saving: keeps errors of writing.
            times: s, by the number of the step, of what a run that goes on has written and keeps.
        """
        problem, formats = model.problem, model.case.output.formats
        surfaces = [term.surface for term in problem.contacts]
        told = (problem.u, problem.solids, directory, surfaces, times)
        self._model, self._saving = model, saving
        self._fields = FieldSeries(*told) if "vtu" in formats else None
        self._bp = BpWriter(*told) if "adios2" in formats else None
        self._contact = ContactSeries(model, directory, times) if surfaces else None
        self._tools = ToolSeries(model, directory, times) if problem.tools else None
        self.times: dict[int, float] = dict(times or {})

    def write(self, step: int, time: float) -> None:
        """Write the displacement and the last converged state of the contacts; collective.

        Args:
            step: number of the step.
            time: s.
        """
        self.times[step] = time
        pairs = zip(self._model.problem.contacts, self._model.problem.committed, strict=True)
        pressures = [nodal_pressure(*pair) for pair in pairs]
        if self._fields is not None:
            with self._saving:
                self._fields.write(step, time, pressures)
        if self._bp is not None:
            with self._saving:
                self._bp.write(time, pressures)
        if self._contact is not None:
            with self._saving:
                self._contact.write(step, time)
        if self._tools is not None:
            with self._saving:
                self._tools.write(step, time)

    def described(self, step: int) -> str:
        """Where the output of a step is, in words."""
        name = f"{step:06d}.vtu"
        files = [f"fields/{name}"] if self._fields is not None else []
        files += ["fields.bp and stress.bp"] if self._bp is not None else []
        files += [f"contact/{name}"] if self._contact is not None else []
        files += [f"tools/{name}"] if self._tools is not None else []
        return ", ".join(files) or "no files"

    def write_indices(self) -> None:
        """Bring the indices by time up to date; not collective."""
        for series in self._series():
            with self._saving:
                series.write_index()

    def close(self) -> None:
        """Finish the files; collective."""
        self.write_indices()
        if self._bp is not None:
            with self._saving:
                self._bp.close()

    def _series(self) -> list[Series]:
        contact = self._contact.series if self._contact is not None else []
        fields = self._fields.series if self._fields is not None else None
        tools = self._tools.series if self._tools is not None else None
        return [*contact, *(series for series in (fields, tools) if series is not None)]
