"""A mesh with named bodies and surfaces as plain arrays, and how it goes from process to process.

Axis letters: n nodes, c cells, f facets, a corners.
"""

from __future__ import annotations

import io
import json
import zipfile
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from tribox.geometry.meshes.gmsh_model import (
    CORNERS,
    DIMENSION,
    FACETS,
    FARTHEST,
    MeshError,
    doubled,
    nodes_of,
)


@dataclass(frozen=True, slots=True)
class Part:
    """A body or a surface."""

    tag: int  # its number
    # (c, a) or (f, a) nodes of its cells or facets, in gmsh's order: corners come first
    nodes: npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class MeshArrays:
    """A mesh on one process."""

    cell: str  # shape of its cells, for instance "triangle"
    position: npt.NDArray[np.float64]  # (n, 3), m, of the nodes
    bodies: dict[str, Part]  # cells by name
    surfaces: dict[str, Part]  # facets by name
    # nodes (e, 1) of points, or in space (e, 2) of edges, by name
    groups: dict[str, npt.NDArray[np.int64]] = field(default_factory=dict)
    order: int = 1  # 1: cells are straight; 2: they are curved
    notes: tuple[str, ...] = ()  # what the reader did to it, one line each

    @property
    def dim(self) -> int:
        """Dimension of the cells."""
        return DIMENSION[self.cell]

    @property
    def cells(self) -> npt.NDArray[np.int64]:
        """Corners (c, a) of the cells of all bodies, one body after the other."""
        corners = CORNERS[self.cell]
        return np.concatenate([body.nodes[:, :corners] for body in self.bodies.values()])

    def facets(self, surface: str) -> npt.NDArray[np.int64]:
        """Corners (f, a) of the facets of a surface."""
        return self.surfaces[surface].nodes[:, : CORNERS[FACETS[self.cell]]]

    def emptied(self) -> MeshArrays:
        """Names, tags and groups alone, without nodes and elements."""
        bodies, surfaces = (
            {name: Part(part.tag, part.nodes[:0]) for name, part in parts.items()}
            for parts in (self.bodies, self.surfaces)
        )
        return replace(self, position=self.position[:0], bodies=bodies, surfaces=surfaces)

    def straightened(self) -> MeshArrays:
        """With straight cells of first order, between the corners; without the other nodes."""
        if self.order == 1:
            return self
        # Nodes of no straight cell go, so the others move up; a number that is left behind is -1.
        used = np.unique(self.cells)
        number = np.full(len(self.position), -1, dtype=np.int64)
        number[used] = np.arange(len(used))
        bodies, surfaces = (
            {name: Part(part.tag, number[part.nodes[:, :corners]]) for name, part in parts.items()}
            for parts, corners in (
                (self.bodies, CORNERS[self.cell]),
                (self.surfaces, CORNERS[FACETS[self.cell]]),
            )
        )
        note = "second-order cells: of first order here, without the nodes between the corners"
        return replace(
            self,
            position=self.position[used],
            bodies=bodies,
            surfaces=surfaces,
            groups={name: number[rows] for name, rows in self.groups.items()},
            order=1,
            notes=(*self.notes, note),
        )

    def scaled(self, factor: float) -> MeshArrays:
        """With coordinates times a factor; MeshError if they leave the range of numbers."""
        if factor == 1.0:
            return self
        position = factor * self.position
        least = float(np.ptp(position, axis=0).max())
        if not np.abs(position).max() <= FARTHEST or not least > 1.0 / FARTHEST:
            raise MeshError(f"geometry.scale = {factor:g} m makes the mesh {least:g} m long")
        return replace(self, position=position)

    def cuts_noted(self) -> MeshArrays:
        """With a note on each body whose nodes lie on each other, not joined: it is cut there."""
        notes = list(self.notes)
        for name, body in self.bodies.items():
            place = self.position[np.unique(body.nodes)]
            twice = doubled(place)
            if len(twice):
                where = ", ".join(f"{x:.4g}" for x in place[twice.min()][: self.dim])
                notes.append(
                    f"body {name}: {len(twice)} of its nodes lie where others of it do, as at "
                    f"({where}) m, and are not joined: it is cut there, and its parts pass through "
                    "each other; join them (Coherence in a gmsh drawing, or Coherence Mesh)"
                )
        return replace(self, notes=tuple(notes))

    def packed(self) -> bytes:
        """All of it in numpy's format of several arrays, which holds numbers only."""
        parts = [*self.bodies.values(), *self.surfaces.values()]
        header = {
            "cell": self.cell,
            "order": self.order,
            "notes": self.notes,
            "bodies": [[name, part.tag] for name, part in self.bodies.items()],
            "surfaces": [[name, part.tag] for name, part in self.surfaces.items()],
            "groups": list(self.groups),
        }
        text = np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)
        stream = io.BytesIO()
        arrays = {f"part{number}": part.nodes for number, part in enumerate(parts)}
        arrays |= {f"group{number}": nodes for number, nodes in enumerate(self.groups.values())}
        np.savez(stream, header=text, position=self.position, **arrays)  # type: ignore[arg-type]
        return stream.getvalue()


def unpacked(data: bytes) -> MeshArrays:
    """The mesh behind `MeshArrays.packed`, checked: MeshError if its sender was broken."""
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            header = json.loads(arrays["header"].tobytes())
            named = [*header["bodies"], *header["surfaces"]]
            parts = [
                (str(name), Part(int(tag), np.asarray(arrays[f"part{number}"])))
                for number, (name, tag) in enumerate(named)
            ]
            # Bodies and surfaces were numbered through; the first ``count`` are bodies.
            count = len(header["bodies"])
            groups = {
                str(name): np.asarray(arrays[f"group{number}"])
                for number, name in enumerate(header["groups"])
            }
            mesh = MeshArrays(
                str(header["cell"]),
                np.asarray(arrays["position"]),
                dict(parts[:count]),
                dict(parts[count:]),
                groups,
                order=int(header["order"]),
                notes=tuple(map(str, header["notes"])),
            )
    except (ValueError, KeyError, TypeError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise MeshError(f"the arrays of the mesh are damaged ({error})") from error
    _check(mesh)
    return mesh


def _check(mesh: MeshArrays) -> None:
    """See that shapes and numbers are possible."""
    sound = mesh.cell in FACETS and mesh.order in (1, 2) and bool(mesh.bodies)
    sound = sound and mesh.position.dtype == np.float64 and mesh.position.shape[1:] == (3,)
    sound = sound and bool(np.isfinite(mesh.position).all())
    if sound:
        facet = FACETS[mesh.cell]
        nodes = len(mesh.position)
        sound = all(
            _is_sound(part, nodes_of(shape, mesh.order), nodes)
            for shape, parts in ((mesh.cell, mesh.bodies), (facet, mesh.surfaces))
            for part in parts.values()
        )
        sound = sound and all(_is_group(rows, nodes) for rows in mesh.groups.values())
    if not sound:
        raise MeshError("the arrays of the mesh are damaged")


def _is_group(rows: npt.NDArray[np.int64], nodes: int) -> bool:
    """Whether points or edges exist and are made of the nodes."""
    if rows.dtype != np.int64 or rows.ndim != 2 or rows.shape[1] not in (1, 2) or not len(rows):
        return False
    return bool(rows.min() >= 0 and rows.max() < nodes)


def _is_sound(part: Part, width: int, nodes: int) -> bool:
    """Whether elements exist and are made of so many of the nodes, each once."""
    rows: Any = part.nodes
    if rows.dtype != np.int64 or rows.ndim != 2 or rows.shape[1] != width or not len(rows):
        return False
    if abs(part.tag) > np.iinfo(np.int32).max or rows.min() < 0 or rows.max() >= nodes:
        return False
    ordered = np.sort(rows, axis=1)
    return bool((ordered[:, 1:] > ordered[:, :-1]).all())
