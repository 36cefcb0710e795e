"""The outlines of rigid tools where they are, as a series of VTU files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tribox.app.build.model import Model
from tribox.app.build.tools import extent
from tribox.app.results.series import Series
from tribox.app.results.vtu import Cells, pack, with_three_components, write_vtu

NAME = "tools"
_KINDS = {2: 3, 3: 5}  # VTK's numbers of lines and triangles, by the nodes of a cell


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
        self.series = Series(directory, NAME, times)
        first = np.cumsum([0, *(len(one.points) for one in self._outlines)])
        cells = [one.cells + at for one, at in zip(self._outlines, first, strict=False)]
        every = np.concatenate(cells).astype(np.int64)
        number = np.repeat(np.arange(len(cells), dtype=np.int32), [len(part) for part in cells])
        self._cells = Cells.of_one_kind(every, _KINDS[every.shape[1]])
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
