"""Where a film's places are: on the facets of a surface, and how their gaps follow from vertices.

Axis letters: v vertices, f facets, or faces between places, f' facets that a film has, n places, m
those of a film.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse

from tribox.geometry.surfaces.facets import Bools, Floats, Longs

_NONE = np.zeros(0)
_KEPT = 8  # parts of the places


class Band:
    """Matrices (n, n) with entries of neighbours only, as bands.

    Places along a line have one neighbour on either side, those of a ring too once both its halves
    are numbered side by side. ``row``, ``column``: (e,), of each face of both ends (4 f), and the
    diagonal; ``number``: (n,) along the line, and ``order``: (n,) places by these.
    """

    def __init__(self, ends: Longs, count: int) -> None:
        """Number ``count`` places so that neighbours ``ends`` (f, 2) are near each other."""
        from scipy.sparse.csgraph import reverse_cuthill_mckee  # only films need it

        every = np.arange(count)
        self.row = np.concatenate([np.repeat(ends[:, 0], 2), np.repeat(ends[:, 1], 2), every])
        self.column = np.concatenate([ends.reshape(-1), ends.reshape(-1), every])
        entries = np.ones(len(self.row)), (self.row, self.column)
        pattern = scipy.sparse.csr_matrix(entries, (count, count))
        order = reverse_cuthill_mckee(pattern, symmetric_mode=True) if count else every
        self.order: Longs = order.astype(np.int64)
        self.number: Longs = np.empty(count, dtype=np.int64)
        self.number[order] = every
        apart = self.number[self.column] - self.number[self.row]
        self.reach = int(np.max(np.abs(apart), initial=0))
        self._by_row = np.argsort(self.row, kind="stable")
        self._start = np.concatenate([[0], np.cumsum(np.bincount(self.row, minlength=count))])

    def matrix(self, entries: Floats) -> scipy.sparse.csr_matrix:
        """The matrix (n, n) of these entries (e,)."""
        given = entries[self._by_row], self.column[self._by_row], self._start
        return scipy.sparse.csr_matrix(given, (len(self.number),) * 2)


@dataclass(frozen=True, slots=True)
class FilmCells:
    """Where the film's places are, and which are neighbours."""

    ends: Longs  # (f, 2) places that a face lies between
    length: Floats  # (f,), m, between them
    width: Floats  # (f,), m of rings, or 1 per unit thickness
    area: Floats  # (n,), m² per unit thickness, or of rings
    band: Band  # of matrices between neighbours

    @classmethod
    def on_line(cls, position: Floats, rings: bool = False) -> FilmCells:
        """Of places (n,), m, along a line, in order; ``rings``: these are radii."""
        number = np.arange(len(position) - 1)
        middle = 0.5 * (position[1:] + position[:-1])
        edges = np.concatenate([position[:1], middle, position[-1:]])
        area = np.pi * np.diff(edges**2) if rings else np.diff(edges)
        width = 2.0 * np.pi * middle if rings else np.ones(len(number))
        ends = np.stack([number, number + 1], axis=1)
        return cls(ends, np.diff(position), width, area, Band(ends, len(area)))

    def last(self) -> Bools:
        """Places (n,) with fewer than two neighbours: the ends of the film."""
        return np.bincount(self.ends.reshape(-1), minlength=len(self.area)) < 2


@dataclass(frozen=True, slots=True)
class FilmPart:
    """Places that a film has, of those that facets are divided into."""

    members: Bools  # (v,) vertices
    inside: Bools  # (f,) facets between them
    here: Bools  # (m,) of all places (n,)
    facets: Longs  # (f', 2) vertices of the facets inside
    shared: scipy.sparse.csr_matrix  # (v, m), shares of places that vertices get
    ends: Longs  # (e, 2) places, of these, that each face lies between
    faces: Longs  # (e,) numbers among all faces
    band: Band  # of matrices between neighbours
    per_facet: int  # k, cells on each facet
    # (x, 2) facets f' and their end (0, 1) beyond which the master ends: there the film has a place
    # more, and a face to it, behind the others
    edges: Longs
    ring: Longs  # (m,) numbers of the parts that hang together, from 0 on
    # (f', 2) the facet that follows beyond either end, itself where there is none
    beside: Longs
    turned: Floats  # (f', 2) whether it runs the same way (1) or not (-1)
    # (f',) 1 or -1, so that times it the facets of a ring all run the same way. A mesh numbers the
    # ends of its facets as it likes
    sense: Floats

    @property
    def count(self) -> int:
        """Number m − x of places that are also those of facets; they come first."""
        return self.shared.shape[1] - len(self.edges)

    @property
    def feels(self) -> Longs:
        """Facet f' (e,) that each face lies on, or beyond."""
        own = np.arange(len(self.faces)) // self.per_facet
        return np.concatenate([own, self.edges[:, 0]])

    @property
    def inner(self) -> Longs:
        """The places (x,) before the edges."""
        return self.ends[len(self.faces) :].min(axis=1)  # those at edges are numbered last

    def widest(self, film: Floats, among: Bools) -> Bools:
        """Places (m,) where ``film`` (m,) is thickest in those parts (r,) ``among`` which it is."""
        # Part by part, and in each the thickest place first.
        order = np.lexsort((-film, self.ring))
        first = order[np.searchsorted(self.ring[order], np.nonzero(among)[0])]
        out: Bools = np.zeros(len(film), dtype=bool)
        out[first] = True
        return out

    def of(self, cells: FilmCells, beyond: Floats = _NONE) -> FilmCells:
        """The cells of some places, of all, without outflow; ``beyond`` (x,), m, to the edges."""
        length, width = cells.length[self.faces], cells.width[self.faces]
        area: Floats = np.concatenate([cells.area[self.here], np.zeros(len(beyond))])
        if len(beyond):  # where width goes on growing as in the last cell
            facet, end = self.edges.T
            last = facet * self.per_facet + end * (self.per_facet - 1)
            other = last + (1 - 2 * end) if self.per_facet > 1 else last
            # Of a width w linear over a length l the hats of both ends have l (w_a/3 + w_b/6) and l
            # (w_a/6 + w_b/3).
            grows = (width[last] - width[other]) / length[last]
            high = width[last] + grows * (0.5 * length[last] + beyond)
            low = width[last] + grows * 0.5 * length[last]
            np.add.at(area, self.inner, beyond * (low / 3.0 + high / 6.0))
            area[self.count :] = beyond * (low / 6.0 + high / 3.0)
            length = np.concatenate([length, beyond])
            width = np.concatenate([width, 0.5 * (low + high)])
        return FilmCells(self.ends, length, width, area, self.band)

    def gaps(self, gap: Floats, length: Floats) -> Floats:
        """Gaps (m,), m, at the places from those at vertices (v,).

        Within a facet a cubic of the gaps and slopes at its ends; the slope at a vertex is a mean
        of those of the facets beside it, in which the smaller counts more (G. van Albada et al.,
        Astron. Astrophys. 108, 1982): with equal facets no gap lies beyond those of the ends by
        more than .004 of their difference, and Newton's method meets no kinks but in a gap that is
        the same at three vertices. Before the edge of a contact the gap grows as the distance to
        3/2: linear between vertices it would be half as large again in the middle of a facet, and
        friction in the mixed regime 4 % too high at 35 facets in the contact.

        Args:
            gap: (v,), of the members.
            length: (f',), m, of the facets inside.
        """
        at_vertices, (a, b) = gap[self.members], self.facets.T
        at_edges = gap[self.last]
        if self.per_facet == 1:
            return np.concatenate([at_vertices, at_edges])
        up, bent = self._cubic(length)
        slope = _vertex_slopes((gap[b] - gap[a]) / length, length, self.beside, self.turned)[0]
        inner = gap[a][:, None] * (1.0 - up) + gap[b][:, None] * up
        inner = inner + np.einsum("fes,fe->fs", bent, slope)
        return np.concatenate([at_vertices, inner.reshape(-1), at_edges])

    @property
    def last(self) -> Longs:
        """The vertices (x,) before the edges."""
        return self.facets[self.edges[:, 0], self.edges[:, 1]]

    def gap_slopes(self, gap: Floats, length: Floats) -> scipy.sparse.csr_matrix:
        """Derivatives (m, v) of :meth:`gaps`."""
        members, (a, b) = np.nonzero(self.members)[0], self.facets.T
        index, row = members, np.arange(len(members) + 1)
        data: Floats = np.ones(len(members))
        if self.per_facet > 1:
            up, bent = self._cubic(length)
            secant = (gap[b] - gap[a]) / length
            _, own, other = _vertex_slopes(secant, length, self.beside, self.turned)
            by_own = length[:, None] * up + np.einsum("fes,fe->fs", bent, own)
            # At a place inside a facet: by the secants of its own and of those beside.
            of_others: Floats = bent * other[:, :, None]
            by = np.concatenate([by_own[:, :, None], of_others.mT], axis=2)
            beside = np.column_stack([np.arange(len(length)), self.beside])
            by = by / length[beside][:, None]
            start = np.ones_like(by_own)[:, :, None]
            # 1 for the gap that the cubic starts from; of each secant −1/l and 1/l for its
            # vertices.
            inner = np.concatenate([start, -by, by], axis=2)
            at = np.column_stack([a, a[beside], b[beside]])[:, None]
            index = np.concatenate([index, np.broadcast_to(at, inner.shape).reshape(-1)])
            data = np.concatenate([data, inner.reshape(-1)])
            more = inner.shape[2] * np.arange(1, inner[:, :, 0].size + 1)
            row = np.concatenate([row, row[-1] + more])
        last = self.last
        index, data = np.concatenate([index, last]), np.concatenate([data, np.ones(len(last))])
        row = np.concatenate([row, row[-1] + 1 + np.arange(len(last))])
        return scipy.sparse.csr_matrix((data, index, row), (len(row) - 1, len(gap)))

    def _cubic(self, length: Floats) -> tuple[Floats, Floats]:
        """Weights at the places inside facets: (k − 1,) of the rise, m (f', 2, k − 1) of slopes."""
        t = np.arange(1, self.per_facet) / self.per_facet
        # Hermite's basis on the unit interval, for slopes times the length.
        bent = np.stack([t * (1.0 - t) ** 2, t**2 * (t - 1.0)])
        return t**2 * (3.0 - 2.0 * t), length[:, None, None] * bent

    def sums(self, area: Floats, values: Floats) -> Floats:
        """What vertices get (v, …) of values (m, …) per area (m,)."""
        return self.shared @ (values * (area if values.ndim == 1 else area[:, None]))

    def sums_of(self, weight: Floats) -> scipy.sparse.csr_matrix:
        """The matrix (v, m) of what vertices get of values times ``weight`` (m,)."""
        shared = self.shared
        given = shared.data * weight[shared.indices], shared.indices, shared.indptr
        return scipy.sparse.csr_matrix(given, shared.shape)

    def pulls(self, film: Floats, pressure: Floats, length: Floats) -> Floats:
        """Mean of h̄ ∂p/∂s (f',), Pa, of h̄ (e,), m, p (m,), Pa, facets of length (f',), m."""
        a, b = self.ends.T
        steps = film * (pressure[b] - pressure[a])
        return np.bincount(self.feels, steps, len(length)) / length

    def pull_slopes(
        self, film: Floats, d_film: Floats, pressure: Floats, length: Floats
    ) -> tuple[scipy.sparse.csr_matrix, scipy.sparse.csr_matrix]:
        """Derivatives (f', m) of :meth:`pulls` for h at the places, Pa/m, and pressure.

        With d_film (e, 2), those of ``film``.
        """
        (a, b), size = self.ends.T, (len(length), self.shared.shape[1])
        feels, over = self.feels, 1.0 / length[self.feels]
        rise = (pressure[b] - pressure[a]) * over
        order = np.argsort(feels, kind="stable")
        place = self.ends[order].reshape(-1)
        start = 2 * np.searchsorted(feels[order], np.arange(len(length) + 1))
        by_film, by_pressure = d_film * rise[:, None], np.outer(film * over, [-1.0, 1.0])
        return (
            scipy.sparse.csr_matrix((by_film[order].reshape(-1), place, start), size),
            scipy.sparse.csr_matrix((by_pressure[order].reshape(-1), place, start), size),
        )


def _vertex_slopes(
    secant: Floats, length: Floats, beside: Longs, turned: Floats
) -> tuple[Floats, Floats, Floats]:
    """Slopes (f, 2) at the ends of facets, and their derivatives for their own secants and others'.

    d = s s' (l s + l' s')/(l s² + l' s'²) of secants s and s' of facets l and l' long.
    """
    s, far = secant[:, None], turned * secant[beside]
    mine, theirs = length[:, None], length[beside]
    size = mine * s**2 + theirs * far**2
    flat = size == 0.0
    over = 1.0 / np.where(flat, 1.0, size)
    slope = s * far * (mine * s + theirs * far) * over
    by_own = (theirs * far**2 + 2.0 * mine * s * (far - slope)) * over
    by_other = (mine * s**2 + 2.0 * theirs * far * (s - slope)) * over
    total = mine + theirs
    # Two secants that vanish are 0/0: the limit of equal ones.
    by_own = np.where(flat, theirs / total, by_own)
    return slope, by_own, turned * np.where(flat, mine / total, by_other)


def _together(ends: Longs, count: int) -> Longs:
    """Numbers (n,) of the parts that so many places with neighbours ``ends`` (f, 2) make."""
    from scipy.sparse.csgraph import connected_components  # only films need it

    entries = np.ones(len(ends)), (ends[:, 0], ends[:, 1])
    pattern = scipy.sparse.csr_matrix(entries, (count, count))
    return connected_components(pattern, directed=False)[1].astype(np.int64)


def _senses(beside: Longs, turned: Floats) -> Floats:
    """Signs (f,) by which facets that follow each other run the same way.

    Of each facet there are two, one that runs as it is and one that is turned round. Those that
    hang together make two chains for each line, of which one is taken.
    """
    count = len(beside)
    own, ends = np.arange(2 * count), np.concatenate([beside, beside + count])
    # A facet that follows itself, its image at a plane of symmetry, says nothing of the line.
    same = (turned > 0.0) | (beside == np.arange(count)[:, None])
    other = np.where(np.concatenate([same, same]), ends, (ends + count) % (2 * count))
    chain = _together(np.stack([np.repeat(own, 2), other.reshape(-1)], axis=1), 2 * count)
    return np.where(chain[:count] < chain[count:], 1.0, -1.0)


def _beside(facets: Longs, closed: Bools) -> tuple[Longs, Floats]:
    """Which facet (f, 2) follows beyond either end, itself without any, and whether as directed.

    At vertices that are ``closed`` (v,) its image follows, which runs the other way.
    """
    beside = np.repeat(np.arange(len(facets))[:, None], 2, axis=1)
    turned = np.where(closed[facets], -1.0, 1.0)
    vertex = facets.reshape(-1)
    order = np.argsort(vertex, kind="stable")
    same = np.nonzero(vertex[order[1:]] == vertex[order[:-1]])[0]
    for one, two in ((order[same], order[same + 1]), (order[same + 1], order[same])):
        # Ends are numbered 2 f + e: two that both begin, or both end, at a vertex run opposite
        # ways.
        beside.reshape(-1)[one] = two // 2
        turned.reshape(-1)[one] = np.where(one % 2 == two % 2, -1.0, 1.0)
    return beside, turned


class FilmPlaces:
    """Places of a film on facets: their vertices, and places between these.

    What they take is shared out to the vertices by functions linear in a facet: forces and moments
    are kept, and a body feels the pressure of each place.

    Attributes:
        facets: (f, 2) vertices; per_facet: k, cells of the film on each.
        beside, turned: (f, 2), as those of a part.
        count: of places, v + (k − 1) f: the vertices, and those inside the facets, in order.
        closed: (v,) vertices at planes of symmetry or on the axis of revolution.
    """

    def __init__(self, facets: Longs, vertices: int, per_facet: int) -> None:
        """Divide ``facets`` (f, 2) of so many vertices."""
        self.facets, self.per_facet = facets, per_facet
        self.closed: Bools = np.zeros(vertices, dtype=bool)
        self.beside, self.turned = _beside(facets, self.closed)
        inner = vertices + np.arange(len(facets) * (per_facet - 1)).reshape(len(facets), -1)
        self.count = vertices + inner.size
        line = np.concatenate([facets[:, :1], inner, facets[:, 1:]], axis=1)
        self._ends = np.stack([line[:, :-1], line[:, 1:]], axis=2).reshape(-1, 2)
        self._band = Band(self._ends, self.count)
        share = np.tile(np.arange(1, per_facet) / per_facet, len(facets))
        every = np.arange(vertices)
        row = np.concatenate([every, inner.reshape(-1), inner.reshape(-1)])
        ends = [np.repeat(end, per_facet - 1) for end in facets.T]
        data = np.concatenate([np.ones(vertices), 1.0 - share, share])
        place = row, np.concatenate([every, *ends])
        self._shares = scipy.sparse.csr_matrix((data, place), (self.count, vertices))
        self._parts: dict[tuple[bytes, bytes, bool], FilmPart] = {}

    def close(self, vertices: Bools) -> None:
        """Let the film go on as its image beyond the ``vertices`` (v,), before it has parts."""
        self.closed = vertices
        self.beside, self.turned = _beside(self.facets, vertices)

    def part(self, members: Bools, covered: Bools | None = None, fed: bool = False) -> FilmPart:
        """Places between vertices (v,) that are members; those asked for last are kept.

        ``covered``: (f,) with master below, None: all; ``fed``: by reservoirs where it ends.
        """
        covered = np.ones(len(self.facets), dtype=bool) if covered is None else covered
        asked = (members.tobytes(), covered.tobytes(), fed)
        if asked in self._parts:  # they may come and go with each evaluation
            part = self._parts[asked] = self._parts.pop(asked)
            return part
        inside: Bools = covered & np.all(members[self.facets], axis=1)
        own = np.arange(len(inside))[:, None]
        bare = fed & inside[:, None] & (self.beside != own) & ~covered[self.beside]
        facet, end = np.nonzero(bare)
        edges = np.stack([(np.cumsum(inside) - 1)[facet], end], axis=1)
        here = np.concatenate([members, np.repeat(inside, self.per_facet - 1)])
        faces = np.nonzero(np.repeat(inside, self.per_facet))[0]
        number, facets, count = np.cumsum(here) - 1, self.facets[inside], int(here.sum())
        last = number[facets[edges[:, 0], edges[:, 1]]]
        beyond = np.stack([last, count + np.arange(len(edges))], axis=1)
        # Faces run as their facet does.
        beyond = np.where(edges[:, 1:] == 1, beyond, beyond[:, ::-1])
        ends = np.concatenate([number[self._ends[faces]], beyond])
        shared = self._shares[here]
        # What presses at an edge of the master is felt by the slave's vertex before it.
        shared = scipy.sparse.vstack([shared, shared[last]]).T.tocsr()
        band = Band(ends, count + len(edges))
        beside = _beside(facets, self.closed)
        given = members.copy(), inside, here, facets, shared, ends, faces, band, self.per_facet
        senses = _senses(*beside)
        part = FilmPart(*given, edges, _together(ends, len(band.number)), *beside, senses)
        self._parts[asked] = part
        if len(self._parts) > _KEPT:
            del self._parts[next(iter(self._parts))]
        return part

    def part_of(self, facets: Bools) -> Bools:
        """Places (n,) that these facets (f,) have."""
        out: Bools = np.zeros(self.count, dtype=bool)
        out[self._ends[np.repeat(facets, self.per_facet)]] = True
        return out

    def cells(self, length: Floats, parts: Floats, counted: Bools | None = None) -> FilmCells:
        """Cells of facets (f,), m long, of which the vertices have the areas ``parts`` (f, 2).

        The width of rings is linear along a facet. Areas are of the facets (f,) that are
        ``counted``, or all.
        """
        k, (a, b) = self.per_facet, parts.T / length
        # Widths whose shares l (w_a/3 + w_b/6) and l (w_a/6 + w_b/3) are the vertices' areas.
        ends = np.stack([4.0 * a - 2.0 * b, 4.0 * b - 2.0 * a], axis=1)
        at = np.arange(k + 1) / k
        width = ends[:, :1] * (1.0 - at) + ends[:, 1:] * at
        low, high, size = width[:, :-1], width[:, 1:], length[:, None] / k
        one: Floats = size * (low / 3 + high / 6)
        two: Floats = size * (low / 6 + high / 3)
        shares = np.stack([one, two], axis=2)
        if counted is not None:
            shares = shares * counted[:, None, None]
        summed = np.bincount(self._ends.reshape(-1), shares.reshape(-1), self.count)
        middle, area = 0.5 * (low + high).reshape(-1), summed.astype(np.float64)
        return FilmCells(self._ends, np.repeat(length / k, k), middle, area, self._band)
