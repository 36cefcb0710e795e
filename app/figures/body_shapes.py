"""Bodies of a field file as polygons: the cells in the plane, the outer facets in space.

Axis letters: n nodes, c cells, f facets, a corners, i space.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from tribox.app.errors import InputError
from tribox.app.figures.style import FIELDS, Floats, Unit, fitting

if TYPE_CHECKING:
    import meshio

DEFAULT_FIELD = "von_mises_stress"
VECTOR, TENSOR = ("x", "y", "z"), tuple(i + j for i in "xyz" for j in "xyz")
# Corners are singular: the largest stress is that of one cell, and says how fine the mesh is.
SHOWN = 0.995  # share of the cells whose values the colours tell apart
UNLIKE = 0.02  # of the largest, from which on values of the other sign count as such


@dataclass(frozen=True, slots=True)
class CellField:
    """Values to colour cells by."""

    values: Floats  # (c,), SI, one for each cell
    label: str  # of the colour bar, without the unit
    unit: str  # SI; "" where the figures do not know it
    name: str  # as it was asked for


def named_after(stem: str, field: str) -> str:
    """Name of a picture in the colours of a field; of the default field it stays as it is."""
    if field == DEFAULT_FIELD:
        return stem
    first, dash, rest = stem.partition("-")
    plain = re.sub(r"[^\w.+=%-]+", "_", field)[:100]  # no other directory, whatever the file says
    return f"{first}-{plain}{dash}{rest}"


def cell_field(mesh: meshio.Mesh, cells: Sequence[NDArray[np.int64]], name: str) -> CellField:
    """An array of a field file's mesh, one number for each cell: of nodes the corners' mean.

    ``cells``: corners (c, a), block by block. Of vectors the length is shown, of tensors the
    component that ends the name, such as ``cauchy_stress_xy`` (likewise ``displacement_x``);
    InputError if there is no such array.
    """
    array, component = _split(mesh, name)
    if array in mesh.cell_data:
        values = np.concatenate([np.asarray(block, np.float64) for block in mesh.cell_data[array]])
    else:
        nodal = np.asarray(mesh.point_data[array], dtype=np.float64)
        values = np.concatenate([nodal[corners].mean(axis=1) for corners in cells])
    scalar = _scalar(values.reshape(len(values), -1), component, name)
    known = FIELDS.get(array)
    label = array if known is None else known.words
    suffix = f"_{component}" if component else ""
    if known is not None and not component and values.ndim > 1:
        label = f"{known.name} |{known.symbol}|"
        suffix = ""
    return CellField(scalar, label + suffix, "" if known is None else known.unit, name)


def _split(mesh: meshio.Mesh, name: str) -> tuple[str, str]:
    """The array a name means, and the component; "" for all of it."""
    arrays = {**mesh.point_data, **mesh.cell_data}
    if name in arrays:
        return name, ""
    base, _, component = name.rpartition("_")
    if base in arrays and component in (*VECTOR, *TENSOR):
        return base, component
    known = ", ".join(sorted(arrays))
    raise InputError(f"--field {name}: no such array in the field files; there are {known}")


def _scalar(values: Floats, component: str, name: str) -> Floats:
    """A component (c,) of values (c, k), or their length."""
    count = values.shape[1]
    if component:
        letters = TENSOR if count == 9 else VECTOR
        if component not in letters[:count]:
            raise InputError(f"--field {name}: no such component; there are {', '.join(letters)}")
        return values[:, letters.index(component)]
    if count == 1:
        return values[:, 0]
    if count == 9:
        raise InputError(f"--field {name}: a tensor; name a component, such as {name}_xy")
    return np.linalg.norm(values, axis=1)


@dataclass(frozen=True, slots=True)
class ColourScale:
    """How values become colours."""

    norm: Normalize  # of values in ``unit``
    colours: str  # name of the colours
    unit: Unit  # of the colour bar
    extend: str  # which ends of the bar are pointed, as matplotlib says

    def label(self, field: CellField) -> str:
        """Text of the colour bar."""
        return field.label + (f" ({self.unit.name})" if self.unit.name else "")


def common_scale(fields: Sequence[CellField]) -> ColourScale:
    """One scale for several states of a run, so that a colour means the same in all of them."""
    return colour_scale(np.concatenate([one.values for one in fields]), fields[0].unit)


def colour_scale(values: Floats, unit: str) -> ColourScale:
    """Colours for values of one or several states: from 0 where all have one sign.

    Values (n,) in SI; NaN is passed over.
    """
    found = values[np.isfinite(values)]
    if not len(found):
        found = np.zeros(1)
    tail = 0.5 * (1.0 - SHOWN)
    low, high = (float(v) for v in np.quantile(found, [tail, 1.0 - tail]))
    least, most = float(found.min()), float(found.max())
    if high - low <= 1e-9 * max(abs(low), abs(high)):  # uniform but for a few cells, or all of it
        low, high = least, most
    # Colours about zero only where both signs count: else a trace of the other would take half.
    largest = max(abs(low), abs(high))
    if low < -UNLIKE * largest and high > UNLIKE * largest:
        low, high, cmap = -largest, largest, "RdBu_r"
    elif unit == "":
        cmap = "viridis"
    else:
        low, high, cmap = min(low, 0.0), max(high, 0.0), "viridis"
        low = 0.0 if abs(low) < UNLIKE * largest else low
        high = 0.0 if abs(high) < UNLIKE * largest else high
    if high <= low:
        low, high = low - (abs(low) or 1.0) * 1e-6, high + (abs(high) or 1.0) * 1e-6
    slack = 1e-3 * (high - low)
    ends = ("min" * (least < low - slack), "max" * (most > high + slack))
    extend = {("", ""): "neither", ("min", "max"): "both"}.get(ends, ends[0] + ends[1])
    chosen = fitting([low, high], unit)
    return ColourScale(Normalize(low * chosen.factor, high * chosen.factor), cmap, chosen, extend)


Ints = NDArray[np.int64]

# Corners of a cell, by the beginning of what meshio calls it; those of any degree come first.
_CORNERS = {"triangle": 3, "quad": 4, "tetra": 4, "hexahedron": 8, "wedge": 6}
_LAGRANGE = "VTK_LAGRANGE_"
# Sides of cells as VTK numbers their corners.
_SIDES = {
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quad": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tetra": ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)),
    "hexahedron": (
        *((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4)),
        *((1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    ),
    "triangle6": ((0, 1, 2), (2, 3, 4), (4, 5, 0)),  # of nodes round the cell
    "quad9": ((0, 1, 2), (2, 3, 4), (4, 5, 6), (6, 7, 0)),
}
# Nodes round cells of second degree in the plane, as VTK numbers them.
_ROUND = {"triangle6": [0, 3, 1, 4, 2, 5], "quad9": [0, 4, 1, 5, 2, 6, 3, 7]}


@dataclass(frozen=True, slots=True)
class Bodies:
    """All bodies of a state."""

    names: tuple[str, ...]  # of the bodies
    dim: int  # 2 or 3
    position: Floats  # (n, 3), m, current
    reference: Floats  # (n, 3), m, undeformed
    polygons: Ints  # (f, a) nodes round the cells in the plane, round the outer facets in space
    edges: Ints  # (e, 2 or 3) nodes along the sides round each body, in the plane; none in space
    body: Ints  # (f,) of each polygon
    edge_body: Ints  # (e,)
    field: CellField  # values (f,) of the polygons

    def corners(self, factor: float, of: Ints | slice = slice(None)) -> Floats:
        """Corners (f, a, i) of polygons, current, in the unit of ``factor``."""
        return self.position[self.polygons[of], : self.dim] * factor


def read_bodies(mesh: meshio.Mesh, names: Sequence[str], field: str) -> Bodies:
    """Polygons of a field file's mesh, by its ``displacement`` and ``body``.

    InputError if there is no array ``field``.
    """
    blocks = [_corners(block) for block in mesh.cells]
    kinds = [kind for kind, _ in blocks]
    cells = [corners for _, corners in blocks]
    body = np.concatenate([np.asarray(b, dtype=np.int64).reshape(-1) for b in _body(mesh, cells)])
    values = cell_field(mesh, cells, field)
    position = np.zeros((len(mesh.points), 3))
    position[:, : mesh.points.shape[1]] = mesh.points
    displacement = np.zeros_like(position)
    moved = np.asarray(mesh.point_data["displacement"], dtype=np.float64)
    displacement[:, : moved.shape[1]] = moved
    dim = 3 if kinds[0] in ("tetra", "hexahedron") else 2
    if dim == 2:
        rounds = [_round(block) for block in mesh.cells]
        kinds, cells = [kind for kind, _ in rounds], [nodes for _, nodes in rounds]
    sides, owner = _outer_sides(kinds, cells)
    if dim == 3:
        polygons, of, edges, edge_body = sides, owner, sides[:0, :2], body[:0]
    else:
        polygons, of = _padded(cells), np.arange(len(body)).astype(np.int64)
        edges, edge_body = sides, body[owner]
    shown = CellField(values.values[of], values.label, values.unit, values.name)
    count = int(body.max(initial=-1)) + 1
    all_names = (*names, *(f"body {k}" for k in range(len(names), count)))
    return Bodies(
        all_names, dim, position, position - displacement, polygons, edges, body[of], edge_body,
        shown,
    )  # fmt: skip


def _body(mesh: meshio.Mesh, cells: Sequence[Ints]) -> Sequence[Ints]:
    """Numbers of the bodies, block by block; one body where the file does not say."""
    if "body" in mesh.cell_data:
        return list(mesh.cell_data["body"])
    return [np.zeros(len(block), dtype=np.int64) for block in cells]


def _corners(block: meshio.CellBlock) -> tuple[str, Ints]:
    """Kind and corners (c, a) of a block of cells of any degree."""
    kind = block.type.removeprefix(_LAGRANGE).lower().replace("quadrilateral", "quad")
    kind = kind.replace("tetrahedron", "tetra")
    for start, count in _CORNERS.items():
        if kind.startswith(start):
            return start, np.asarray(block.data, dtype=np.int64)[:, :count]
    raise ValueError(f"cells of kind {block.type} cannot be drawn")


def _round(block: meshio.CellBlock) -> tuple[str, Ints]:
    """Kind and nodes (c, a) round the cells of a block in the plane."""
    if block.type in _ROUND:
        return block.type, np.asarray(block.data, dtype=np.int64)[:, _ROUND[block.type]]
    return _corners(block)


def _padded(cells: Sequence[Ints]) -> Ints:
    """Corners of all blocks in one array; triangles among quadrilaterals repeat their last."""
    most = max(block.shape[1] for block in cells)
    return np.concatenate([np.pad(c, ((0, 0), (0, most - c.shape[1])), mode="edge") for c in cells])


def _outer_sides(kinds: Sequence[str], cells: Sequence[Ints]) -> tuple[Ints, Ints]:
    """Sides (f, a) of one cell only, and the cell (f,) that each is of."""
    sides, owner, first = [], [], 0
    for kind, corners in zip(kinds, cells, strict=True):
        table = np.array(_SIDES[kind])
        sides.append(corners[:, table].reshape(-1, table.shape[1]))
        owner.append(first + np.repeat(np.arange(len(corners)), len(table)))
        first += len(corners)
    found, of = np.concatenate(sides), np.concatenate(owner)
    rows = np.array_split(np.sort(found, axis=1), 2, axis=1)
    # Two numbers of each side to sort by: its nodes, two by two, as digits to the base of all.
    base = int(found.max(initial=0)) + 1
    digits = [base ** np.arange(nodes.shape[1]) for nodes in rows]
    keys = np.stack([nodes @ digit for nodes, digit in zip(rows, digits, strict=True)])
    order = np.lexsort(keys)
    other = (np.diff(keys[:, order]) != 0).any(axis=0)  # than the one before
    new = np.concatenate([[True], other, [True]])
    once = np.sort(order[new[:-1] & new[1:]])
    return found[once], of[once]
