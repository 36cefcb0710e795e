"""Reads the VTU files that tribox writes; numpy and the standard library are enough for that.

meshio, which reads any of them, takes longer to be loaded than a figure to be drawn.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

# Kinds of cells by VTK's numbers, named as meshio names them, with the same order of nodes.
KINDS = {
    1: "vertex",
    3: "line",
    5: "triangle",
    9: "quad",
    10: "tetra",
    12: "hexahedron",
    22: "triangle6",
    24: "tetra10",
    28: "quad9",
    29: "hexahedron27",
}
_TYPES = {"Float32": "f4", "Float64": "f8", "Int32": "i4", "Int64": "i8", "UInt8": "u1"}
_ORDERS = {"LittleEndian": "<", "BigEndian": ">"}
_ZLIB = "vtkZLibDataCompressor"


class UnknownVtuError(ValueError):
    """A VTU file that is none of those that tribox writes."""


@dataclass(frozen=True, slots=True)
class CellBlock:
    """Cells of one kind.

    Attributes:
        type: see :data:`KINDS`; data: (c, a) nodes of each cell.
    """

    type: str
    data: Array


@dataclass(frozen=True, slots=True)
class Grid:
    """What a VTU file holds; the names are those of a ``meshio.Mesh``, which it stands in for.

    Attributes:
        points: (n, 3), m; cells: block by block.
        point_data: (n,) or (n, i) by name; cell_data: by name (c,) or (c, i), block by block.
    """

    points: Array
    cells: list[CellBlock]
    point_data: dict[str, Array]
    cell_data: dict[str, list[Array]]


def read_vtu(path: Path) -> Grid:
    """Read a file.

    Raises:
        UnknownVtuError: it is packed, or has cells, in a way that tribox does not write.
        Exception: whatever its XML parser, base64, zlib and numpy raise for a damaged file.
    """
    root = ElementTree.parse(path).getroot()
    piece = root.find("UnstructuredGrid/Piece")
    order = _ORDERS.get(root.get("byte_order", ""))
    if piece is None or order is None or root.get("compressor") != _ZLIB:
        raise UnknownVtuError(f"{path}: no piece of a grid packed by zlib")
    if root.get("header_type", "UInt32") != "UInt32":
        raise UnknownVtuError(f"{path}: a header of another type")
    points, cells, point_data, cell_data = (
        {e.attrib["Name"]: _array(e, order) for e in piece.iterfind(f"{group}/DataArray")}
        for group in ("Points", "Cells", "PointData", "CellData")
    )
    (places,) = points.values()
    blocks = list(_blocks(cells["connectivity"], cells["offsets"], cells["types"]))
    ends = np.cumsum([len(block.data) for block in blocks], dtype=np.int64)[:-1]
    split = {name: np.split(values, ends) for name, values in cell_data.items()}
    return Grid(places, blocks, point_data, split)


def _array(element: ElementTree.Element, order: str) -> Array:
    """An array (n,) or (n, i), of blocks packed by zlib in base64."""
    if element.get("format") != "binary" or element.get("type") not in _TYPES:
        raise UnknownVtuError("an array that is not binary, or of another type")
    text = (element.text or "").strip().encode()
    count = int(np.frombuffer(base64.b64decode(text[:8])[:4], dtype=f"{order}u4")[0])
    head = -(-4 * (3 + count) // 3) * 4  # characters of the header, which is padded by itself
    sizes = np.frombuffer(base64.b64decode(text[:head]), dtype=f"{order}u4")[3 : 3 + count]
    packed, at = base64.b64decode(text[head:]), np.cumsum([0, *sizes.tolist()])
    raw = b"".join(zlib.decompress(packed[at[k] : at[k + 1]]) for k in range(count))
    values = np.frombuffer(raw, dtype=order + _TYPES[element.attrib["type"]])
    width = int(element.get("NumberOfComponents", "0"))
    return (values.reshape(-1, width) if width else values).copy()


def _blocks(nodes: Array, offsets: Array, types: Array) -> Iterator[CellBlock]:
    """Runs of cells of one kind."""
    begins = np.flatnonzero(np.diff(types, prepend=types[:1] + 1))
    starts = np.concatenate([[0], offsets])
    for begin, end in zip(begins, [*begins[1:], len(types)], strict=False):
        if int(types[begin]) not in KINDS:
            raise UnknownVtuError(f"cells of VTK's kind {types[begin]}")
        rows = nodes[starts[begin] : starts[end]].reshape(end - begin, -1)
        yield CellBlock(KINDS[int(types[begin])], rows)
