"""All field output of a run as series of VTU files: bodies, contact and tools.

The contact is two series of VTU files: slave surfaces with nodal values, and contact points.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import dolfinx
import numpy as np
from numpy.typing import NDArray

from tribox.app.build.model import Model
from tribox.app.build.tools import extent
from tribox.app.results import contact_points
from tribox.app.results.directory import Place, write_text
from tribox.app.results.fields import ContactPressureField, GatheredMesh, StressField
from tribox.app.results.saving import Saving
from tribox.app.results.vtu import Array, Cells, Packed, pack, with_three_components, write_vtu
from tribox.forms.bodies.point_stress import triaxiality
from tribox.forms.bodies.solid import Solid
from tribox.geometry.surfaces.facets import Floats
from tribox.geometry.surfaces.surface import ContactSurface

# -- Series of files over time, one a step, and their index as ParaView reads it -------------------

INDEX_SHARE = 0.01  # of the time that may go into rewriting the index


class Series:
    """``NAME.pvd`` and the files ``NAME/NNNNNN.vtu`` that it lists; for one rank.

    The index is rewritten under a temporary name, so that it is whole at any moment; of a long
    series not with every file.
    """

    def __init__(
        self, directory: Path, name: str, times: Mapping[int, float] | None = None
    ) -> None:
        """No index yet; files of ``times`` (s, by step) are kept of a run that goes on."""
        self._directory, self._name = directory, name
        self._place = Place(directory)
        self._lines: list[str] = []
        self._next = 0.0
        if times is not None:
            kept = {step: when for step, when in times.items() if self.path(step).is_file()}
            names = {self.path(step).name for step in kept}
            for path in (self._directory / self._name).glob("*.vtu*"):
                if path.name not in names:
                    path.unlink()
            self._lines = [self._line(step, when) for step, when in kept.items()]
            if kept:
                self.write_index()

    def path(self, step: int) -> Path:
        """The file of a step, in a directory that is made with the first of them."""
        self._place.check()
        (self._directory / self._name).mkdir(exist_ok=True)
        return self._directory / self._name / f"{step:06d}.vtu"

    def write(
        self,
        step: int,
        when: float,
        points: Array,
        cells: Cells,
        point_data: Mapping[str, Array | Packed],
        cell_data: Mapping[str, Array | Packed],
    ) -> None:
        """Write the file of a step, at ``when`` (s), as :func:`write_vtu` does, and list it."""
        write_vtu(self.path(step), points, cells, point_data, cell_data, when, step)
        self.add(step, when)

    def add(self, step: int, when: float) -> None:
        """List the file of a step, which has been written."""
        self._lines.append(self._line(step, when))
        if time.monotonic() >= self._next:
            self.write_index()

    def _line(self, step: int, when: float) -> str:
        file = f"{self._name}/{step:06d}.vtu"
        return f'    <DataSet timestep="{when!r}" part="0" file="{file}"/>\n'

    def write_index(self) -> None:
        """Write the index of all files so far, if there are any."""
        if not self._lines:
            return
        self._place.check()
        began = time.monotonic()
        write_text(
            self._directory / f"{self._name}.pvd",
            '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
            f"{''.join(self._lines)}  </Collection>\n</VTKFile>\n",
        )
        ended = time.monotonic()
        self._next = ended + (ended - began) / INDEX_SHARE


# -- All field output of a run: bodies, contact and tools ------------------------------------------

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
        """Make the outlines of tools, kept files by ``times`` (s, by step); collective."""
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
        """Write the tools at the displacement spread last."""
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
        points, cells = {"displacement": displacement}, {"tool": self._number}
        self.series.write(step, time, places, self._cells, points, cells)


class ContactSeries:
    """Writes ``contact.pvd`` and ``contact_points.pvd`` with their files; collective."""

    def __init__(
        self, model: Model, directory: Path, times: Mapping[int, float] | None = None
    ) -> None:
        """Find what does not change, and keep the files of ``times`` (s, by step); collective."""
        self._model = model
        facets = contact_points.slave_facets(model)
        self._points = contact_points.ContactPoints(model)
        self.series: list[Series] = []
        self._fixed: list[dict[str, Packed]] = [{}, {}]
        if model.problem.comm.rank == 0:
            self.series = [Series(directory, name, times) for name in (SURFACES, POINTS)]
            count = len(self._points.weight)
            self._cells = [
                Cells.of_one_kind(facets.nodes, contact_points.VTK_KINDS[facets.kind]),
                Cells.of_one_kind(np.arange(count)[:, None], VERTEX),
            ]
            self._pair = pack(facets.pair, lasting=True)

    def write(self, step: int, time: float) -> None:
        """Write the last converged state."""
        points = self._points.arrays(self._model)
        nodes = contact_points.contact_nodes(self._model)
        if points is None or nodes is None:
            return
        self._write(0, nodes, {"pair": self._pair}, step, time)
        self._write(1, points, {}, step, time)

    def _write(
        self,
        which: int,
        values: dict[str, Array],
        cell_data: dict[str, Packed],
        step: int,
        time: float,
    ) -> None:
        fixed, cells = self._fixed[which], self._cells[which]
        flat = {name: with_three_components(v) if v.ndim > 1 else v for name, v in values.items()}
        position = flat.pop("position")
        if not fixed:
            fixed.update({name: pack(flat[name], lasting=True) for name in _FIXED if name in flat})
        self.series[which].write(step, time, position, cells, {**flat, **fixed}, cell_data)


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
        """Open the files, or go on with those of ``times`` (s, by step); collective."""
        problem = model.problem
        surfaces = [term.surface for term in problem.contacts]
        self._model, self._saving = model, saving
        # What the files of a step are called, and what writes them.
        fields = FieldSeries(problem.u, problem.solids, directory, surfaces, times)
        self._parts: list[tuple[str, Callable[[int, float, Sequence[Floats]], None]]] = [
            ("fields/{:06d}.vtu", fields.write)
        ]
        found = [fields.series]
        if surfaces:
            contact = ContactSeries(model, directory, times)
            self._parts.append(("contact/{:06d}.vtu", lambda n, when, _: contact.write(n, when)))
            found += contact.series
        if problem.tools:
            tools = ToolSeries(model, directory, times)
            self._parts.append(("tools/{:06d}.vtu", lambda n, when, _: tools.write(n, when)))
            found.append(tools.series)
        self._series = [series for series in found if series is not None]
        self.times: dict[int, float] = dict(times or {})

    def write(self, step: int, time: float) -> None:
        """Write the displacement and the last converged state of the contacts; collective."""
        self.times[step] = time
        pairs = zip(self._model.problem.contacts, self._model.problem.committed, strict=True)
        pressures = [contact_points.nodal_pressure(*pair) for pair in pairs]
        for _, write in self._parts:
            with self._saving:
                write(step, time, pressures)

    def described(self, step: int) -> str:
        """Where the output of a step is, in words."""
        return ", ".join(name.format(step) for name, _ in self._parts)

    def write_indices(self) -> None:
        """Bring the indices by time up to date; not collective."""
        for series in self._series:
            with self._saving:
                series.write_index()


# -- Fields of all bodies as a series of VTU files: deformed places, stress and strain -------------

Singles = NDArray[np.float32]


class FieldSeries:
    """Writes ``fields.pvd`` and ``fields/NNNNNN.vtu`` from the first rank; collective."""

    def __init__(
        self,
        u: dolfinx.fem.Function,
        solids: Sequence[Solid],
        directory: Path,
        surfaces: Sequence[ContactSurface] = (),
        times: Mapping[int, float] | None = None,
    ) -> None:
        """Gather what does not change.

        Cells carry the numbers of their bodies. ``times``: s, by step, of the files that are kept.
        """
        space = u.function_space
        self._u, self._comm, self._dim = u, space.mesh.comm, space.mesh.geometry.dim
        self._owned = space.dofmap.index_map.size_local
        self._stress = StressField(u, solids)
        self._contact = ContactPressureField(u, surfaces) if surfaces else None
        self._mesh = GatheredMesh(space)
        topology = space.mesh.topology
        number = np.zeros(topology.index_map(topology.dim).size_local, dtype=np.int32)
        for k, solid in enumerate(solids):
            number[solid.cells] = k
        body = self._mesh.cellwise(number)
        self.series: Series | None = None
        if self._comm.rank == 0:
            self.series = Series(directory, "fields", times)
            self._cells = Cells.of_one_kind(self._mesh.cells, self._mesh.kind)
            self._body = pack(body, lasting=True)

    def write(self, step: int, time: float, pressures: Sequence[Floats] = ()) -> None:
        """Write the present state, with pressures (v,), Pa, at each slave's vertices."""
        # Displacement, m, and contact pressure, Pa, (n, i + 1) at this rank's own nodes.
        out = np.zeros((self._owned, self._dim + 1))
        out[:, : self._dim] = self._u.x.array.reshape(-1, self._dim)[: self._owned]
        if self._contact is not None:
            out[:, self._dim] = self._contact.at(pressures)[: self._owned]
        nodes = self._mesh.nodal(out)
        cells = {name: self._mesh.cellwise(own) for name, own in self._in_cells().items()}
        if self.series is None:
            return
        displacement = with_three_components(nodes[:, : self._dim])
        self.series.write(
            step,
            time,
            with_three_components(self._mesh.reference) + displacement,
            self._cells,
            {"displacement": displacement, "contact_pressure": nodes[:, self._dim]},
            {"body": self._body, **cells},
        )

    def _in_cells(self) -> dict[str, Floats | Singles]:
        """Stress, Pa, and strain (c,) or (c, 9) in this rank's own cells, by name.

        In single precision, 7 digits, but for what is near 1 and of interest for its difference
        from 1.
        """
        found = self._stress.evaluate()
        strain = found.strain
        out: dict[str, Floats | Singles] = {
            "cauchy_stress": _single(found.stress),
            "von_mises_stress": _single(found.von_mises),
            "pressure": _single(found.pressure),
            "J": strain.J,
            "max_stretch": strain.max_stretch,
            "log_strain": _single(strain.log_strain),
        }
        if self._stress.flows:
            thickness = np.linalg.eigvalsh(strain.log_strain)[:, 0]
            out |= {
                "equivalent_plastic_strain": _single(found.plastic_strain),
                "triaxiality": _single(triaxiality(found.stress)),
                "thickness_strain": _single(thickness),
            }
        return out


def _single(values: NDArray[np.floating[Any]]) -> Singles:
    """Values (c, …) in single precision, tensors as rows of nine."""
    return values.reshape(len(values), *([9] if values.ndim > 1 else [])).astype(np.float32)
