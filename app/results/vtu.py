"""Writes unstructured grids as VTU files (VTK's XML format), binary.

Every array stands in its XML element as blocks in zlib's format, in base64. VTK, ParaView, pyvista
and meshio read such files. Of arrays appended as raw bytes, a quarter smaller, meshio makes
something only by chance: it joins them in base64 without regard to its padding.

The digits of results hardly shrink, and to compress them took most of the time of an output. They
are stored in zlib's format as they are; compressed are arrays of zeros but for a few, and once what
does not change from one file to the next, see :class:`Packed`.
"""

from __future__ import annotations

import base64
import sys
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from tribox.app.results.directory import written_whole

Array = NDArray[Any]

BLOCK = 1 << 20  # bytes in a block: zlib makes itself ready for each anew
FEW = 0.25  # share of numbers other than zero below which an array is compressed
_STORED, _QUICK, _SMALL = 0, 1, 6  # levels of zlib
_TYPES = {"f4": "Float32", "f8": "Float64", "i4": "Int32", "i8": "Int64", "u1": "UInt8"}


@dataclass(frozen=True, slots=True)
class Packed:
    """An array as it stands in a file."""

    data: tuple[bytes, bytes]  # header, and blocks, in base64
    kind: str  # VTK's name of the type
    width: int  # number of components, 0 of plain numbers


def pack(values: Array | Packed, *, lasting: bool = False) -> Packed:
    """Put an array (n,) or (n, i) into blocks; one that is packed already stays as it is.

    ``lasting``: it is written to many files, so that it is worth its compression.
    """
    if isinstance(values, Packed):
        return values
    whole = np.ascontiguousarray(values).reshape(-1)
    as_bits = whole.view(f"u{whole.itemsize}")  # faster to compare with zero than floats
    few = np.count_nonzero(as_bits) < FEW * values.size
    level = _SMALL if lasting else _QUICK if few else _STORED
    raw = memoryview(whole.view(np.uint8))
    blocks = [zlib.compress(raw[at : at + BLOCK], level) for at in range(0, len(raw), BLOCK)]
    last = len(raw) - BLOCK * (len(blocks) - 1) if blocks else 0
    header = np.array([len(blocks), BLOCK, last, *map(len, blocks)], dtype=np.uint32)
    data = base64.b64encode(header.tobytes()), base64.b64encode(b"".join(blocks))
    width = values.shape[1] if values.ndim > 1 else 0
    return Packed(data, _TYPES[values.dtype.str[1:]], width)


@dataclass(frozen=True, slots=True)
class Cells:
    """The cells of a grid, packed once."""

    connectivity: Packed  # VTK's arrays
    offsets: Packed  # likewise
    types: Packed  # likewise
    count: int  # number of cells

    @classmethod
    def of_one_kind(cls, nodes: Array, kind: int) -> Cells:
        """Cells that are all alike.

        ``nodes``: (c, a) points of each cell, in VTK's order; ``kind``: VTK's number of the cell.
        """
        count, width = nodes.shape
        return cls(
            pack(nodes.reshape(-1).astype(np.int32), lasting=True),
            pack(width * np.arange(1, count + 1, dtype=np.int32), lasting=True),
            pack(np.full(count, kind, dtype=np.uint8), lasting=True),
            count,
        )


def write_vtu(
    path: Path,
    points: Array,
    cells: Cells,
    point_data: Mapping[str, Array | Packed],
    cell_data: Mapping[str, Array | Packed],
    time: float,
    step: int,
) -> None:
    """Write points (n, 3), m, and cells, under a temporary name first, with ``time``, s, and step.

    Data (n,) or (n, i) of points, (c,) or (c, i) of cells, by name.
    """
    order = "LittleEndian" if sys.byteorder == "little" else "BigEndian"
    with written_whole(path) as part, part.open("wb") as stream:
        stream.write(_HEAD.format(order=order, time=time, step=step).encode())
        stream.write(
            f'    <Piece NumberOfPoints="{len(points)}" NumberOfCells="{cells.count}">\n'.encode()
        )
        _write_group(stream, "PointData", point_data)
        _write_group(stream, "CellData", cell_data)
        _write_group(stream, "Points", {"Points": points})
        names = ("connectivity", "offsets", "types")
        _write_group(stream, "Cells", {name: getattr(cells, name) for name in names})
        stream.write(b"    </Piece>\n  </UnstructuredGrid>\n</VTKFile>\n")


_HEAD = """<?xml version="1.0"?>
<VTKFile type="UnstructuredGrid" version="1.0" byte_order="{order}" header_type="UInt32" \
compressor="vtkZLibDataCompressor">
  <UnstructuredGrid>
    <FieldData>
      <DataArray type="Float64" Name="TimeValue" NumberOfTuples="1" format="ascii">{time!r}\
</DataArray>
      <DataArray type="Int64" Name="step" NumberOfTuples="1" format="ascii">{step}</DataArray>
    </FieldData>
"""


def _write_group(stream: BinaryIO, tag: str, arrays: Mapping[str, Array | Packed]) -> None:
    """The arrays of points or cells."""
    stream.write(f"      <{tag}>\n".encode())
    for name, values in arrays.items():
        packed = pack(values)
        width = f' NumberOfComponents="{packed.width}"' if packed.width else ""
        of = f'type="{packed.kind}" Name="{name}"{width} format="binary"'
        stream.write(f"        <DataArray {of}>".encode())
        stream.writelines(packed.data)
        stream.write(b"</DataArray>\n")
    stream.write(f"      </{tag}>\n".encode())


def with_three_components(vectors: Array) -> Array:
    """Vectors (n, i) as (n, 3): files know no plane; zeros across it."""
    if vectors.shape[1] == 3:
        return vectors
    out = np.zeros((len(vectors), 3), dtype=vectors.dtype)
    out[:, : vectors.shape[1]] = vectors
    return out
