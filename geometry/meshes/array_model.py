"""Arrays of a mesh in the clothes of a gmsh model, which DOLFINx makes meshes from."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tribox.geometry.meshes.elements import CORNERS, DIMENSION, FACETS, KINDS, NUMBERS
from tribox.geometry.meshes.mesh_arrays import MeshArrays, Part

_Tags = npt.NDArray[np.int64]
_Elements = tuple[list[int], list[_Tags], list[_Tags]]


class ArrayModel:
    """Answers what DOLFINx's reader asks of ``gmsh.model``; names are those of gmsh.

    gmsh itself has left by then: of a file it ran in a process of its own, and its memory is free.
    Each body and each surface is one entity, whose number is its tag.

    Attributes:
        mesh: gmsh's module ``model.mesh``, for which this object stands too.
    """

    def __init__(self, arrays: MeshArrays) -> None:
        """Answer from these arrays."""
        self.mesh = self
        dim = arrays.dim
        self._position = arrays.position
        self._parts: dict[tuple[int, int], tuple[str, Part]] = {}
        shapes = {dim: arrays.cell, dim - 1: FACETS[arrays.cell]}
        self._kinds = {d: NUMBERS[shape, arrays.order] for d, shape in shapes.items()}
        cells = {**arrays.bodies, **{f"carrier {k}": v for k, v in arrays.carriers.items()}}
        for d, parts in ((dim - 1, arrays.surfaces), (dim, cells)):
            self._parts |= {(d, part.tag): (name, part) for name, part in parts.items()}

    def getPhysicalGroups(self, dim: int = -1) -> list[tuple[int, int]]:
        """Dimension and tag of each surface and body."""
        return [key for key in self._parts if dim in (-1, key[0])]

    def getPhysicalName(self, dim: int, tag: int) -> str:
        """The name of one of them."""
        return self._parts[dim, tag][0]

    def getEntitiesForPhysicalGroup(self, dim: int, tag: int) -> list[int]:
        """The one entity of a body or surface."""
        return [tag]

    def getNodes(self) -> tuple[_Tags, npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Numbers from 1 on, flat positions, and no parameters."""
        numbers = np.arange(1, len(self._position) + 1)
        return numbers, self._position.reshape(-1), np.empty(0)

    def getElements(self, dim: int, tag: int = -1) -> _Elements:
        """Kind, numbers and flat nodes of the elements of one entity, or of a dimension."""
        parts = [part for key, (_, part) in self._parts.items() if key[0] == dim]
        begins = np.cumsum([0, *(len(part.nodes) for part in parts)])
        chosen = [
            (1 + begin + np.arange(len(part.nodes)), part.nodes.reshape(-1) + 1)
            for begin, part in zip(begins, parts, strict=False)
            if tag in (-1, part.tag)
        ]
        if not chosen:
            return [], [], []
        numbers, nodes = (np.concatenate(list(found)) for found in zip(*chosen, strict=True))
        return [self._kinds[dim]], [numbers], [nodes]

    def getElementProperties(self, kind: int) -> tuple[str, int, int, int, list[float], int]:
        """Name, dimension, order, nodes, their local places (none here) and corners of a kind."""
        one = KINDS[kind]
        return one.shape, DIMENSION[one.shape], one.order, one.nodes, [], CORNERS[one.shape]
