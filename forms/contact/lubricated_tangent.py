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

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
import scipy.sparse

from tribox.forms.contact.asperities import AsperityPressure
from tribox.forms.contact.kinematics import Variations
from tribox.forms.contact.state import ContactState, ContactTrial, Lubrication
from tribox.forms.contact.tangent import PairTangent
from tribox.forms.contact.vertex_rows import Coupling, VertexRows, with_others
from tribox.forms.film.places import FilmPart
from tribox.forms.film.reynolds import wedge_film
from tribox.geometry.surfaces.facets import Bools, Floats, Longs

_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class LubricatedTangent(PairTangent):
    """Makes the tangent of a pair whose film is an unknown."""

    _made: dict[str, list[tuple[ContactTrial, Longs, Any]]] = field(
        default_factory=lambda: {"varied": [], "rows": []}, repr=False
    )
    _pulls: list[tuple[FilmPart, VertexRows]] = field(default_factory=list, repr=False)

    def varied(self, trial: ContactTrial, take: Longs) -> Variations:
        """See :class:`PairTangent`; kept, as tractions and speeds ask for those of all points."""
        return self._once("varied", trial, take, lambda: PairTangent.varied(self, trial, take))

    def generalised_rows(
        self, state: ContactState, trial: ContactTrial, take: Longs
    ) -> tuple[Floats, Longs]:
        """See :class:`PairTangent`; kept likewise."""
        return self._once(
            *("rows", trial, take), lambda: PairTangent.generalised_rows(self, state, trial, take)
        )

    def _once(self, kind: str, trial: ContactTrial, take: Longs, make: Callable[[], _T]) -> _T:
        """What was made of these points of the trial, or is now."""
        kept = self._made[kind]
        for of, points, known in kept:
            if of is trial and np.array_equal(points, take):
                found: _T = known
                return found
        made = make()
        kept[:] = [(trial, take, made), *kept[:1]]
        return made

    def traction_variation(self, trial: ContactTrial, take: Longs) -> tuple[Floats, Variations]:
        """See :class:`PairTangent`: what the gradient draws turns with the normal."""
        out, v = PairTangent.traction_variation(self, trial, take)
        film = trial.normal_contact.lubrication
        if film is not None:
            drawn = (film.turned * film.drawn)[take]
            turned = np.stack([v.d_normal[:, 1], -v.d_normal[:, 0]], axis=1)
            out = out - drawn[:, None, None] * turned
        return out, v

    def vertex_coupling(self, state: ContactState, trial: ContactTrial) -> Coupling | None:
        """See :class:`PairTangent`: the sum over the vertices, which the film all couples."""
        normal, film = trial.normal_contact, trial.normal_contact.lubrication
        if film is None or not film.members.any():
            return None
        take, needs = np.nonzero(trial.kinematics.closed)[0], normal.needs()
        gaps = self._gap_rows(state, trial, needs)
        gaps.data /= np.repeat(self.area_of(trial), np.diff(gaps.indptr))
        own, pressed, filled = (
            self._vertex_rows(trial, take, vectors, needs)
            for vectors in self._field_vectors(trial, film, take)
        )
        pulled, speeds = self._pull_rows(state, trial, take), self._speed_rows(state, trial, take)
        left = self.of_nodes(stacked([own, pressed, filled, pulled]), trial)
        right = self.of_nodes(stacked([gaps, speeds]), trial)
        # Every rank has a part of the points around the film, which feels all of them.
        every, vertices = np.ones(right.shape[0], dtype=bool), gaps.shape[0]
        nodes, dim, comm = self.surface.nodes, self.surface.dim, self.surface.vertices.comm
        right, others = with_others(right, (every, every), nodes, dim, comm)
        # What is multiplied by the rows of t is dense.
        (left, rows), (right, columns) = _used(left, nodes, dim), _used(right, others, dim)
        if film.solution is None:
            return Coupling(rows, columns, (left[:vertices].T @ right).tocsr())
        felt = self._through_film(state, trial, right.shape[0] - vertices)
        fields = np.concatenate([right[:vertices].toarray(), (right.T @ felt.T).T])
        product = np.asarray(left.T @ fields)
        height, width = product.shape
        start = np.arange(height + 1, dtype=np.int32) * np.int32(width)
        index = np.tile(np.arange(width, dtype=np.int32), height)
        matrix = scipy.sparse.csr_matrix((product.reshape(-1), index, start), product.shape)
        return Coupling(rows, columns, matrix)

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
        pressed = ratio * carried + shape * film.by_pressure[take][:, None, :]
        return own, pressed, shape * film.by_filled[take][:, None, :]

    def _pull_rows(
        self, state: ContactState, trial: ContactTrial, take: Longs
    ) -> scipy.sparse.csr_matrix:
        """Rows (f′, m·i) of −∂t/∂G for the mean of h ∂p_f/∂s of the film's facets."""
        film, surface, slave = trial.normal_contact.lubrication, self.surface, self.surface.slave
        assert film is not None and isinstance(self.rule, AsperityPressure)
        inside = film.part.inside
        number = (np.cumsum(inside) - 1)[self.rule.facet_of[take]]
        facet = trial.projection.facet[take]
        master = surface.target.weights(facet, trial.projection.xi[take])
        shape = np.concatenate([slave.shape[take], -master], axis=1)
        share = film.sign * 0.5 * (slave.weight * state.area_ratio)[take]
        values = (share[:, None] * shape)[:, :, None] * film.along[take][:, None, :]
        for part, known in self._pulls:
            if part is film.part and known.fits(take, facet, known.needs):
                return known.matrix(values[:, None])
        key = number * np.int64(len(surface.target.stencil)) + facet
        nodes = np.concatenate([surface.slave_rows[take], self._master_rows(facet)], axis=1)
        needs: Bools = np.ones(int(np.count_nonzero(inside)), dtype=bool)
        numbers, size = (key, number[:, None], nodes), (self._places, surface.dim)
        found = VertexRows(take, facet, needs, numbers, size)
        self._pulls[:] = [(film.part, found), *self._pulls[:1]]
        return found.matrix(values[:, None])

    def _of_facets(
        self, number: Longs, nodes: Longs, values: Floats, count: int
    ) -> scipy.sparse.csr_matrix:
        """Rows (f, m·i) of facets ``number`` (p,) from values (p, m, i) at nodes (p, m)."""
        dim = self.surface.dim
        size = count, self._places * dim
        place = number[:, None, None] * size[1] + nodes[:, :, None] * dim + np.arange(dim)
        summed = np.bincount(place.reshape(-1), values.reshape(-1), size[0] * size[1])
        return scipy.sparse.csr_matrix(summed.reshape(size))

    def _speed_rows(
        self, state: ContactState, trial: ContactTrial, take: Longs
    ) -> scipy.sparse.csr_matrix:
        """S: change (f′, m·i) of half the sliding speed that the film's facets feel."""
        film, surface = trial.normal_contact.lubrication, self.surface
        assert film is not None and trial.anchor is not None
        assert isinstance(self.rule, AsperityPressure)
        if film.step is None or film.solution is None:
            return scipy.sparse.csr_matrix((0, self._places * surface.dim))
        face, total = self.rule.facet_of, self.rule.whole
        inside = film.part.inside
        number, share, _ = felt_speeds(not np.isfinite(film.step.dt), film.part, total)
        facet = (np.cumsum(inside) - 1)[face[take]]
        v = self.varied(trial, take)
        rows, places = self.generalised_rows(state, trial, take)
        d_slip = np.einsum("pi,pir->pr", film.along[take], v.d_slip)
        d_slip = d_slip.reshape(len(take), rows.shape[1], surface.dim)
        scale = (share / total[inside])[facet] * surface.slave.weight[take] * (-0.5 / trial.dt)
        scale = np.where(inside[face[take]], scale, 0.0)
        values = rows.mT @ (scale[:, None, None] * d_slip)
        return self._of_facets(number[facet], places, values, int(number.max(initial=-1)) + 1)


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
