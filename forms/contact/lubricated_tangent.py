r"""The tangent of a contact whose film is an unknown, see :mod:`tribox.forms.contact.lubricated`.

The film's equations are solved at every evaluation. With the dense :math:`\partial p_f/\partial g`
and :math:`\partial p_f/\partial u` of their solution

.. math:: K = -\sum_X L_X^T (X_g R + X_u S), \qquad X = j(p_a + p_f),\ j p_a,\ h,\ \theta,\ p_f

with R the rows of the gaps, S those of half the sliding speeds of the facets, and L_X those of
:math:`\partial t/\partial X`.

Axis letters: p points, v vertices of the slave, f its facets, f' those that the film feels, k
vertices of a facet, i space, m nodes of the pair, c columns.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse

from tribox.forms.contact.asperities import AsperityPressure
from tribox.forms.contact.pair_loops import Entries
from tribox.forms.contact.state import ContactState, ContactTrial, Lubrication
from tribox.forms.contact.tangent import PairTangent, PointGroups
from tribox.forms.contact.vertex_rows import Coupling, with_others
from tribox.forms.film.places import FilmPart
from tribox.forms.film.reynolds import wedge_film
from tribox.geometry.surfaces.facets import Bools, Floats, Longs


class LubricatedTangent(PairTangent):
    """Makes the tangent of a pair whose film is an unknown."""

    def _see_all(self, state: ContactState, trial: ContactTrial) -> None:
        """See :class:`PairTangent`: what the gradient draws turns with the normal."""
        super()._see_all(state, trial)
        film = trial.normal_contact.lubrication
        self._pair.set(drawn=None if film is None else film.turned * film.drawn)

    def _through_vertices(
        self, state: ContactState, trial: ContactTrial, entries: Entries
    ) -> list[Coupling]:
        """See :class:`PairTangent`: the sum over the vertices, which the film all couples."""
        normal, film = trial.normal_contact, trial.normal_contact.lubrication
        if film is None or not film.members.any():
            return []
        count, needs = len(self.surface.nodes), normal.needs()
        every = self._grouped(trial, state, trial.coupled())
        known = self._places(every, self.surface.vertices.of_point, needs)
        gaps = self._gap_rows(trial, every, known).matrix(count)
        gaps.data /= np.repeat(self.area_of(trial), np.diff(gaps.indptr))
        closed = self._grouped(trial, state, trial.kinematics.closed)
        known = self._places(closed, self.surface.vertices.of_point, needs)
        own, pressed, filled = (
            self._rows(closed, known, vectors).matrix(count)
            for vectors in self._field_vectors(trial, film, closed.take)
        )
        pulled, speeds = self._pull_rows(state, film, closed), self._speed_rows(trial, closed.take)
        left = stacked([own, pressed, filled, pulled])
        # Every rank has a part of the points around the film, which feels all of them.
        right, vertices = stacked([gaps, speeds]), gaps.shape[0]
        every_row = np.ones(right.shape[0], dtype=bool)
        nodes, dim, comm = self.surface.nodes, self.surface.dim, self.surface.vertices.comm
        right, others = with_others(right, (every_row, every_row), nodes, dim, comm)
        # What is multiplied by the rows of t is dense.
        (left, rows), (right, columns) = _used(left, nodes, dim), _used(right, others, dim)
        if film.solution is None:
            return [Coupling(rows, columns, (left[:vertices].T @ right).tocsr())]
        felt = self._through_film(state, trial, right.shape[0] - vertices)
        fields = np.concatenate([right[:vertices].toarray(), (right.T @ felt.T).T])
        product = np.asarray(left.T @ fields)
        height, width = product.shape
        start = np.arange(height + 1, dtype=np.int32) * np.int32(width)
        index = np.tile(np.arange(width, dtype=np.int32), height)
        matrix = scipy.sparse.csr_matrix((product.reshape(-1), index, start), product.shape)
        return [Coupling(rows, columns, matrix)]

    def _through_film(self, state: ContactState, trial: ContactTrial, speeds: int) -> Floats:
        """Change of pressure and filling (v,) and of the pull (f′,), one below the other.

        Args:
            state: of the last step.
            trial: of the tangent.
            speeds: number s of the speeds that the film feels.

        Returns:
            (2 v + f′, v + s), by the gaps and the speeds.
        """
        film, history, gap = trial.normal_contact.lubrication, state.film, trial.normal_contact.gap
        assert film is not None and film.solver is not None and film.step is not None
        assert film.solution is not None and history is not None and gap is not None
        assert isinstance(self.rule, AsperityPressure)
        part, area = film.part, film.solver.cells.area
        length, slopes = history.length[part.inside], film.solver.slopes(film.step, film.solution)
        # The film's unknowns follow gaps and speeds such that the mass balance stays zero: its
        # derivative by these goes through the factors of the balance's own (implicit functions).
        by_gap = part.gap_slopes(gap, length)
        assert film.step.by_gap is not None
        by_gap.data *= np.repeat(film.step.by_gap, np.diff(by_gap.indptr))
        number, _, sense = felt_speeds(not np.isfinite(film.step.dt), part, self.rule.whole)
        by_speed = slopes.by_speed(number[part.feels], sense[part.feels], speeds)
        balance = np.concatenate([(slopes.by_film @ by_gap).toarray(), by_speed], axis=1)
        d_unknown = slopes.unknown(balance)
        whole = np.where(film.members, part.sums(area, np.ones(len(area))), 1.0)
        own = film.ratio * self.area_of(trial)
        by_film, by_pressure = part.pull_slopes(
            *wedge_film(film.step.film[part.ends]), film.solution.pressure, length
        )
        by_pressure.data *= slopes.by_pressure[by_pressure.indices]
        pressed, filled = (part.sums_of(area * by) for by in (slopes.by_pressure, slopes.by_filled))
        out: Floats = stacked([pressed, filled, by_pressure]) @ d_unknown
        out[: len(gap)] /= own[:, None]
        out[len(gap) : 2 * len(gap)] /= whole[:, None]
        out[2 * len(gap) :, : len(gap)] += (by_film @ by_gap).toarray()
        return out

    def _field_vectors(
        self, trial: ContactTrial, film: Lubrication, take: Longs
    ) -> tuple[Floats, Floats, Floats]:
        """Vectors −∂t/∂X_B (p, k, i) of closed points ``take`` (p,).

        Of gaps without the film's equations, and of the film's pressure and filling.
        """
        vertices, n = self.surface.vertices, trial.kinematics.normal[take]
        shape, at = vertices.shape[take][:, :, None], vertices.of_point[take]
        assert isinstance(self.rule, AsperityPressure)
        ratio, spread = film.ratio[at][:, :, None], self.rule.spread[take][:, :, None]
        carried = -spread * n[:, None]
        by_asperity = carried + shape * trial.response.d_traction_d_pressure[take][:, None, :]
        own = (film.ratio * film.d_asperity)[at][:, :, None] * by_asperity
        own += film.d_film[at][:, :, None] * shape * film.by_film[take][:, None, :]
        pressed: Floats = ratio * carried
        pressed += shape * film.by_pressure[take][:, None, :]
        return own, pressed, shape * film.by_filled[take][:, None, :]

    def _pull_rows(
        self, state: ContactState, film: Lubrication, closed: PointGroups
    ) -> scipy.sparse.csr_matrix:
        """Rows (f′, n·i) of −∂t/∂G for the mean of h ∂p_f/∂s of the film's facets."""
        assert isinstance(self.rule, AsperityPressure)
        inside, face, take = film.part.inside, self.rule.facet_of, closed.take
        number = np.maximum(np.cumsum(inside) - 1, 0)[face]
        needs: Bools = np.ones(int(np.count_nonzero(inside)), dtype=bool)
        if not len(needs):
            return scipy.sparse.csr_matrix((0, self.surface.dim * len(self.surface.nodes)))
        share = np.where(inside[face[take]], film.sign * 0.5 * state.area_ratio[take], 0.0)
        known = self._places(closed, number[:, None], needs)
        rows = self._rows(closed, known, (share[:, None] * film.along[take])[:, None])
        return rows.matrix(len(self.surface.nodes))

    def _speed_rows(self, trial: ContactTrial, take: Longs) -> scipy.sparse.csr_matrix:
        """S: change (f′, n·i) of half the sliding speed that the film's facets feel."""
        film, count, dim = trial.normal_contact.lubrication, len(self.surface.nodes), 2
        assert film is not None and isinstance(self.rule, AsperityPressure)
        if film.step is None or film.solution is None:
            return scipy.sparse.csr_matrix((0, count * dim))
        face, total, inside = self.rule.facet_of[take], self.rule.whole, film.part.inside
        number, share, _ = felt_speeds(not np.isfinite(film.step.dt), film.part, total)
        take, facet = take[inside[face]], (np.cumsum(inside) - 1)[face[inside[face]]]
        scale = (share / total[inside])[facet] * self.surface.slave.weight[take]
        nodes, values = self.slip_rows(take, (-0.5 / trial.dt * scale)[:, None] * film.along[take])
        size = int(number.max(initial=-1)) + 1, count * dim
        place = number[facet][:, None, None] * size[1] + nodes[:, :, None] * dim + np.arange(dim)
        summed = np.bincount(place.reshape(-1), values.reshape(-1), size[0] * size[1])
        return scipy.sparse.csr_matrix(summed.reshape(size))


def felt_speeds(steady: bool, part: FilmPart, weight: Floats) -> tuple[Longs, Floats, Floats]:
    """To which speed (f′,) that a film feels a facet inside adds, by which share, and its sense.

    In a steady state facets inside that hang together have one speed, their mean: where a part of
    them sticks there is no steady state. It runs as the facets do whose sense is 1; of the others
    shares are negative.

    Args:
        steady: whether all of them feel their mean.
        part: the film's places.
        weight: (f,), m², of the facets.
    """
    if not steady:
        own: Floats = np.ones(len(part.facets))
        return np.arange(len(part.facets)), own, own
    number, own = part.ring[part.ends[: len(part.faces) : part.per_facet, 0]], weight[part.inside]
    return number, part.sense * own / np.bincount(number, own)[number], part.sense


def _used(
    rows: scipy.sparse.csr_matrix, nodes: Longs, dim: int
) -> tuple[scipy.sparse.csr_matrix, Longs]:
    """Rows (r, n·i) without the columns of nodes (n,) that have no entry, and the other nodes."""
    used, number = np.unique(rows.indices // dim, return_inverse=True)
    given = rows.data, number * dim + rows.indices % dim, rows.indptr
    return scipy.sparse.csr_matrix(given, (rows.shape[0], len(used) * dim)), nodes[used]


def stacked(parts: Sequence[scipy.sparse.csr_matrix]) -> scipy.sparse.csr_matrix:
    """Matrices of as many columns, one below the other."""
    starts = [
        part.indptr[1:] + before
        for part, before in zip(parts, np.cumsum([0] + [part.nnz for part in parts]), strict=False)
    ]
    data, index = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("data", "indices")
    )
    start = np.concatenate([[0], *starts])
    return scipy.sparse.csr_matrix((data, index, start), (len(start) - 1, parts[0].shape[1]))
