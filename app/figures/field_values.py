"""One number per cell, or per node, of an array of the field files: what bodies are coloured by."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from tribox.app.errors import InputError
from tribox.app.figures.style import Floats
from tribox.app.figures.units import FIELDS, Unit, fitting

if TYPE_CHECKING:
    from tribox.app.results.vtu import Grid
DEFAULT_FIELD = "von_mises_stress"
VECTOR, TENSOR = ("x", "y", "z"), tuple(i + j for i in "xyz" for j in "xyz")
# Corners are singular: the largest stress is that of one cell, and says how fine the mesh is.
SHOWN = 0.995  # share of the cells whose values the colours tell apart
UNLIKE = 0.02  # of the largest, from which on values of the other sign count as such


@dataclass(frozen=True, slots=True)
class CellField:
    """Values to colour cells by.

    Attributes:
        values: (c,), SI, one for each cell; label: of the colour bar, without the unit.
        unit: SI; "" where the figures do not know it.
        name: as it was asked for.
    """

    values: Floats
    label: str
    unit: str
    name: str


def named_after(stem: str, field: str) -> str:
    """Name of a picture in the colours of a field; of the default field it stays as it is.

    Args:
        stem: name without ending, such as "deformed-1-press".
        field: array of the field files.
    """
    if field == DEFAULT_FIELD:
        return stem
    first, dash, rest = stem.partition("-")
    plain = re.sub(r"[^\w.+=%-]+", "_", field)[:100]  # no other directory, whatever the file says
    return f"{first}-{plain}{dash}{rest}"


def cell_field(mesh: Grid, cells: Sequence[NDArray[np.int64]], name: str) -> CellField:
    """An array of a mesh, one number for each cell: of nodes the mean over the corners.

    Args:
        mesh: of a field file.
        cells: corners (c, a) of the cells, block by block.
        name: of a cell or point array. Of vectors the length is shown, of tensors the component
            that ends the name, such as ``cauchy_stress_xy`` (likewise ``displacement_x``).

    Raises:
        InputError: there is no such array.
    """
    array, component = _split(mesh, name)
    if array in mesh.cell_data:
        values = np.concatenate([np.asarray(block, np.float64) for block in mesh.cell_data[array]])
    else:
        nodal = np.asarray(mesh.point_data[array], dtype=np.float64)
        values = np.concatenate([nodal[corners].mean(axis=1) for corners in cells])
    scalar = _scalar(values.reshape(len(values), -1), component, name)
    known = FIELDS.get(array)
    label = array if known is None else f"{known.name} {known.symbol}".rstrip()
    suffix = f"_{component}" if component else ""
    if known is not None and not component and values.ndim > 1:
        label = f"{known.name} |{known.symbol}|"
        suffix = ""
    return CellField(scalar, label + suffix, "" if known is None else known.unit, name)


def _split(mesh: Grid, name: str) -> tuple[str, str]:
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
    out: Floats = np.linalg.norm(values, axis=1)
    return out


@dataclass(frozen=True, slots=True)
class ColourScale:
    """How values become colours.

    Attributes:
        norm: of values in ``unit``; colours: name of the colours.
        unit: of the colour bar; extend: which ends of the bar are pointed, as matplotlib says.
    """

    norm: Normalize
    colours: str
    unit: Unit
    extend: str


def common_scale(fields: Sequence[CellField]) -> ColourScale:
    """One scale for several states of a run, so that a colour means the same in all of them."""
    return colour_scale(np.concatenate([one.values for one in fields]), fields[0].unit)


def colour_scale(values: Floats, unit: str) -> ColourScale:
    """Colours for values of one or several states: from 0 where all have one sign.

    Args:
        values: (n,), SI; NaN is passed over.
        unit: SI.
    """
    found = values[np.isfinite(values)]
    if not len(found):
        found = np.zeros(1)
    tail = 0.5 * (1.0 - SHOWN)
    low, high = (float(v) for v in np.quantile(found, [tail, 1.0 - tail]))
    least, most = float(found.min()), float(found.max())
    if high - low <= 1e-9 * max(abs(low), abs(high)):  # uniform but for a few cells, or all of it
        low, high = least, most
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
