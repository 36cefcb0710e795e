"""Values along the slave surfaces of the contact pairs that a case follows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tribox.app.build.model import Model
from tribox.app.results.contact_nodes import ContactNodes, contact_nodes, slave_facets
from tribox.app.results.point_probes import AXES
from tribox.geometry.surfaces.facets import Floats, Longs
from tribox.geometry.surfaces.ordering import chains

AT_VERTEX = 1e-9  # share of a segment up to which a point lies at its end


@dataclass(frozen=True, slots=True)
class _Along:
    """How the values of one probe follow from those of the vertices.

    Attributes:
        name: of the probe; pair: number of the contact.
        first, second: (p,) vertices on either side of each point; share: (p,) of the second.
        way: (p,) m, undeformed arc length; NaN in space.
        at_vertices: whether the points are the vertices, each with an area of its own.
    """

    name: str
    pair: int
    first: Longs
    second: Longs
    share: Floats
    way: Floats
    at_vertices: bool


class ContactProbes:
    """The table of the contact lines: nodal values, linear between the vertices."""

    def __init__(self, model: Model, probes: Sequence[tuple[str, str, int | None]]) -> None:
        """Find the points on the surfaces; collective.

        Args:
            model: what is solved, before its first step too.
            probes: name, contact pair, and number of points or None for the vertices.
        """
        self._model = model
        labels = [contact.label for contact in model.case.contact]
        self._asked = [(name, labels.index(pair), points) for name, pair, points in probes]
        self._labels = labels
        self._facets = slave_facets(model)
        self._along: list[_Along] = []
        self._names: tuple[str, ...] = ()

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns after those that say when; known from the first rows on."""
        return ("probe", "pair", "point", "arc_length", *self._names)

    def rows(self) -> list[tuple[object, ...]]:
        """Rows after the last step, on the first rank; collective."""
        nodes = contact_nodes(self._model, self._facets)
        if nodes is None:
            return []
        values = {name: v for name, v in nodes.values.items() if name != "pair"}
        if not self._along:
            self._along = [_along(nodes, *asked) for asked in self._asked]
            self._names = tuple(_names(values))
        return [row for along in self._along for row in self._rows_of(along, values)]

    def _rows_of(self, along: _Along, values: dict[str, Floats]) -> Iterator[tuple[object, ...]]:
        table = np.concatenate([v.reshape(len(v), -1) for v in values.values()], axis=1)
        first, second, share = table[along.first], table[along.second], along.share[:, None]
        # At a vertex its own value, also where that of the neighbour is no number.
        found = np.where(share == 0.0, first, (1.0 - share) * first + share * second)
        if not along.at_vertices:
            found[:, self._names.index("area")] = np.nan
        label = (along.name, self._labels[along.pair])
        for p, (way, row) in enumerate(zip(along.way, found, strict=True)):
            yield (*label, p, float(way), *map(float, row))


def _names(values: dict[str, Floats]) -> Iterator[str]:
    """Names of the columns of arrays (v,) and (v, i)."""
    for name, array in values.items():
        if array.ndim == 1:
            yield name
        else:
            yield from (f"{name}_{x}" for x in AXES[: array.shape[1]])


def _along(nodes: ContactNodes, name: str, pair: int, points: int | None) -> _Along:
    """The points of a probe among the vertices of a pair."""
    mine = np.flatnonzero(nodes.values["pair"] == pair)
    if nodes.kind != "line":
        none = np.zeros(len(mine))
        return _Along(name, pair, mine, mine, none, np.full(len(mine), np.nan), True)
    facets = nodes.facets[np.isin(nodes.facets[:, 0], mine)]
    order, way = arc_length(facets, nodes.values["reference"])
    if points is None:
        return _Along(name, pair, order, order, np.zeros(len(order)), way, True)
    at = np.linspace(0.0, way[-1], points)
    left = np.clip(np.searchsorted(way, at, side="right") - 1, 0, len(way) - 2)
    length = way[left + 1] - way[left]
    share = (at - way[left]) / np.where(length > 0.0, length, 1.0)
    left += share > 1.0 - AT_VERTEX
    share[(share < AT_VERTEX) | (share > 1.0 - AT_VERTEX)] = 0.0
    second = order[np.minimum(left + 1, len(order) - 1)]
    return _Along(name, pair, order[left], second, share, at, False)


def arc_length(facets: Longs, place: Floats) -> tuple[Longs, Floats]:
    """Vertices of a surface in the plane one after the other, and their arc length.

    The vertices are numbered by place, x first, and pieces begin as :func:`chains` says. The arc
    length goes on from one piece to the next.

    Args:
        facets: (f, 2) vertices of the segments.
        place: (v, i), m.

    Returns:
        (n,) vertices and (n,), m.
    """
    order: list[Longs] = []
    way: list[Floats] = []
    end = 0.0
    for piece in chains(facets):
        steps = np.linalg.norm(np.diff(place[piece], axis=0), axis=1)
        order.append(piece)
        way.append(end + np.cumsum([0.0, *steps]))
        end = float(way[-1][-1])
    return np.concatenate(order), np.concatenate(way)
