"""Data of the contact points of all pairs, gathered to the first rank in an order of their own.

Nodal values, the contact pressure to look at among them: :mod:`tribox.app.results.contact_points`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from tribox.app.build.model import Model
from tribox.app.results.fields import gathered
from tribox.app.results.vtu import Array
from tribox.app.simulation.contact_resultants import turned_right
from tribox.forms.contact.lubricated import LubricatedTerm
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.pressure import nodal_pressure as pressure_at_nodes
from tribox.forms.contact.state import ContactTrial
from tribox.geometry.surfaces.facets import Floats, Ints, Longs, order_by_place


class ContactPoints:
    """The contact points of all pairs, one after the other, and what never changes of them.

    Attributes:
        pair: (q,) numbers of the pairs; reference: (q, i), m; weight: (q,), quadrature weight times
            reference area, m², of rings the whole 2πR, in the plane m. Empty but on the first rank.
    """

    def __init__(self, model: Model) -> None:
        """Find the order of the points; collective."""
        terms = model.problem.contacts
        slaves = [term.surface.slave for term in terms]
        self._comm = model.problem.comm
        pair = np.repeat(np.arange(len(terms)), [len(slave.weight) for slave in slaves])
        fixed = np.column_stack(
            [
                pair,
                np.concatenate([slave.weight for slave in slaves]),
                np.concatenate([slave.position for slave in slaves]),
            ]
        )
        # Of each rank all pairs one after the other.
        fixed = gathered(self._comm, fixed)
        self._order: Longs = np.empty(0, dtype=np.int64)
        if len(fixed):
            # By pair, and in each by place: an order that ranks do not change.
            order = order_by_place(fixed[:, 2:])
            self._order = order[np.argsort(fixed[order, 0], kind="stable")]
        fixed = fixed[self._order]
        self.pair = fixed[:, 0].astype(np.int32)
        self.weight, self.reference = fixed[:, 1], fixed[:, 2:]

    def arrays(self, model: Model) -> dict[str, Array] | None:
        """As :func:`contact_arrays`; collective."""
        problem = model.problem
        pairs = zip(problem.contacts, problem.committed, strict=True)
        parts = [point_values(term, trial) for term, trial in pairs]
        widths = {name: values.shape[1:] for name, values in parts[0].items()}
        rows = gathered(self._comm, np.concatenate([_rows(part) for part in parts]))
        if self._comm.rank > 0:
            return None
        rows, at = rows[self._order], 0
        out: dict[str, Array] = {
            "position": np.empty(0),
            "reference": self.reference,
            "pair": self.pair,
            "weight": self.weight,
        }
        for name, width in widths.items():
            count = width[0] if width else 1
            out[name] = rows[:, at : at + count].reshape(-1, *width)
            at += count
        return out


def _rows(part: dict[str, Floats]) -> Floats:
    """All arrays of points side by side (q, k)."""
    return np.column_stack(list(part.values()))


def contact_arrays(model: Model) -> dict[str, Array] | None:
    """Data at all contact points after the last converged step; collective.

    Returns:
        On the first rank, arrays by name (SI), points sorted by pair and reference position:
        ``position`` and ``reference`` (q, i), m; ``pair``; ``weight``, m² (m in the plane);
        ``normal`` (q, i), out of the master; 0 with none below; ``gap``, ``slip_increment``,
        ``slip_path``, ``film_thickness``, m; ``slip_rate``, m/s; ``pressure``,
        ``tangential_traction``, Pa;
        ``cover``, share that touches; ``alpha``; ``regime``; ``dissipation``, J/m² in the last
        step. Where the film is an unknown, ``cover`` is its filling θ and ``alpha`` the share of
        the pressure that it carries.
        In the plane slip and friction count positive to the right of the normal; in space they are
        lengths, beside the vectors ``slip_vector``, m, and ``friction_traction``, Pa, (q, i).
        None on the others.
    """
    return ContactPoints(model).arrays(model)


def point_values(term: ContactTerm, trial: ContactTrial) -> dict[str, Floats]:
    """Arrays of :func:`contact_arrays` that change, of this rank's points of one pair."""
    k, response = trial.kinematics, trial.response
    state = response.state
    slip, friction = _along(k.slip, k.normal), _along(response.traction, k.normal)
    out = {
        "position": trial.position,
        "normal": np.where(trial.projection.on_surface[:, None], k.normal, 0.0),
        "gap": np.where(trial.projection.on_surface, k.gap, np.nan),
        "pressure": trial.pressure,
        "cover": np.where(trial.pressure > 0.0, term.cover(trial), 0.0),
        "tangential_traction": friction,
        "slip_increment": slip,
        "slip_rate": np.where(trial.pressure > 0.0, slip / trial.dt, 0.0),
        "slip_path": state.slip_path,
        "film_thickness": trial.film,
        "alpha": state.alpha,
        "regime": response.regime.astype(float),
        "dissipation": response.dissipation.total,
    }
    film = trial.normal_contact.lubrication
    if film is not None:
        at_points = term.surface.vertices.at_points
        carried = at_points(film.asperity + film.pressure)
        share = np.divide(at_points(film.pressure), carried, out=carried * 0.0, where=carried > 0.0)
        out |= {"alpha": share, "cover": at_points(np.where(film.members, film.filled, 0.0))}
    if term.surface.dim == 3:
        out |= {"slip_vector": k.slip, "friction_traction": response.traction}
    return out


def _along(vectors: Floats, normal: Floats) -> Floats:
    """Vectors in the contact's plane as numbers (q,): signed in the plane, lengths in space."""
    if normal.shape[1] == 2:
        return np.einsum("qi,qi->q", vectors, turned_right(normal))
    return np.linalg.norm(vectors, axis=1)


# -- Data of all pairs at the vertices of their slave facets, on the first rank --------------------
#
# Axis letters: v vertices, q points, f facets, k vertices of a facet. Values of points are averaged
# to the vertices with the weights of the contact pressure, (1/m_A) Σ_q w N_A f_q, so that pressure
# or friction times ``area`` add up to the forces.

# What a cell is called in files, and the order of its corners there.
_CELLS = {
    "interval": ("line", [0, 1]),
    "triangle": ("triangle", [0, 1, 2]),
    "quadrilateral": ("quad", [0, 1, 3, 2]),
}
VTK_KINDS = {"line": 3, "triangle": 5, "quad": 9}
_AVERAGED = (
    *("cover", "slip_increment", "slip_rate", "slip_path"),
    *("film_thickness", "alpha", "dissipation"),
)


@dataclass(frozen=True, slots=True)
class SlaveFacets:
    """The slave facets of all pairs, one after the other, in an order that ranks do not change."""

    nodes: Longs  # (f, k) rows of the vertices of each facet, round it
    pair: Ints  # (f,) number of its pair
    kind: str  # "line", "triangle" or "quad"


def slave_facets(model: Model) -> SlaveFacets:
    """The facets between the nodes of :func:`contact_nodes`, on all ranks; collective."""
    terms = model.problem.contacts
    facets = [_facets(term) for term in terms]
    first = np.cumsum([0, *(term.surface.vertices.count for term in terms)])
    kind, corners = _CELLS[terms[0].surface.shape.cell]
    rows = np.concatenate([start + f for start, f in zip(first[:-1], facets, strict=True)])
    pair = np.repeat(np.arange(len(terms), dtype=np.int32), [len(f) for f in facets])
    return SlaveFacets(rows[:, corners], pair, kind)


def contact_nodes(model: Model) -> dict[str, Array] | None:
    """Nodal values of all pairs after the last converged step, ordered; collective.

    Returns:
        On the first rank, by name: ``position`` and ``reference`` (v, i), m; ``pair``; ``area``,
        m_A: m² (m in the plane); ``normal`` (v, i), out of the master; ``gap``, m, mean; 0 and
        NaN with no master below; ``pressure``, ``tangential_traction``, Pa, and in space the vector
        ``friction_traction`` (v, i), Pa; means of the other values of
        :func:`tribox.app.results.contact_points.contact_arrays`, but for the regime; where a film
        is an unknown ``film_pressure`` and ``asperity_pressure``, Pa, per current area. None on the
        others.
    """
    problem = model.problem
    pairs = list(zip(problem.contacts, problem.committed, strict=True))
    parts = [_values(index, model, term, trial) for index, (term, trial) in enumerate(pairs)]
    if problem.comm.rank > 0:
        return None
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def nodal_pressure(term: ContactTerm, trial: ContactTrial) -> Floats:
    """Contact pressure (v,), Pa, at the slave's vertices: force over area; collective."""
    return pressure_at_nodes(term.surface, trial.pressure)


def _values(index: int, model: Model, term: ContactTerm, trial: ContactTrial) -> dict[str, Array]:
    """Values of one pair, on all ranks; collective."""
    vertices, of_points = term.surface.vertices, point_values(term, trial)
    # Mean unit normals (v, i) of those at the points (q, i); 0 where these are; collective
    mean = _mean_vectors(term, of_points["normal"])
    length = np.linalg.norm(mean, axis=1, keepdims=True)
    # Mean gaps (v,), m, that the pressure answers to; NaN with no master below; collective
    above = trial.projection.on_surface
    # Where a part of the surroundings has no master below, the mean is over the rest.
    covered = _mean(term, above.astype(np.float64))
    gap = trial.nodal_gap
    if gap is None:
        own = _mean(term, np.where(above, trial.kinematics.gap, 0.0))
        gap = own / np.where(covered > 0.0, covered, 1.0)
    out: dict[str, Array] = {
        "position": vertices.position + displacement_at(model, vertices.nodes),
        "reference": vertices.position,
        "pair": np.full(vertices.count, index, dtype=np.int32),
        "area": vertices.area,
        "normal": (mean / np.where(length > 0.0, length, 1.0)),
        "gap": np.where(covered > 0.0, gap, np.nan),
        "pressure": nodal_pressure(term, trial),
    }
    if term.surface.dim == 2:
        out["tangential_traction"] = _mean(term, of_points["tangential_traction"])
    else:
        vectors = _mean_vectors(term, of_points["friction_traction"])
        out |= {
            "tangential_traction": np.linalg.norm(vectors, axis=1),
            "friction_traction": vectors,
        }
    out |= {name: _mean(term, of_points[name]) for name in _AVERAGED}
    if any(isinstance(other, LubricatedTerm) for other in model.problem.contacts):
        out |= _film(trial, out)
    return out


def _film(trial: ContactTrial, values: dict[str, Array]) -> dict[str, Array]:
    """The film's own values at the vertices, and its pressures; of other pairs all is dry."""
    film = trial.normal_contact.lubrication
    if film is None:
        return {
            "film_pressure": np.zeros_like(values["pressure"]),
            "asperity_pressure": values["pressure"],
        }
    wet, dry = (np.where(film.members, p, 0.0) for p in (film.pressure, film.asperity))
    return {
        "film_thickness": np.where(film.members, film.film, 0.0),
        "cover": np.where(film.members, film.filled, 0.0),
        "alpha": np.divide(wet, wet + dry, out=np.zeros_like(wet), where=wet + dry > 0.0),
        "film_pressure": wet,
        "asperity_pressure": dry,
    }


def _mean(term: ContactTerm, values: Floats) -> Floats:
    """Means (v,) of point values (q,); collective."""
    vertices = term.surface.vertices
    return vertices.sums(term.surface.slave.weight * values) / vertices.area


def _mean_vectors(term: ContactTerm, vectors: Floats) -> Floats:
    """Means (v, i) of point values (q, i); collective."""
    return np.stack([_mean(term, component) for component in vectors.T], axis=1)


def displacement_at(model: Model, nodes: Longs) -> Floats:
    """Displacements (v, i), m, of global nodes, on all ranks; collective."""
    problem = model.problem
    index = problem.space.dofmap.index_map
    local = index.global_to_local(nodes)
    mine = (local >= 0) & (local < index.size_local)
    out = np.zeros((len(nodes), problem.dim))
    out[mine] = problem.u.x.array.reshape(-1, problem.dim)[local[mine]]
    # Each node is one rank's own: the sum is its value.
    problem.comm.Allreduce(MPI.IN_PLACE, out, op=MPI.SUM)
    return out


def _facets(term: ContactTerm) -> Longs:
    """Vertices (f, k) of all slave facets, ordered by place; collective."""
    surface = term.surface
    # Points of one facet have the same vertices: its first stands for it.
    _, first = np.unique(surface.slave.facet, return_index=True)
    gathered = surface.vertices.comm.allgather(surface.vertices.of_point[first])
    facets: Longs = np.concatenate(gathered)
    return facets[order_by_place(surface.vertices.position[facets].mean(axis=1))]
