"""Data of all pairs at the vertices of their slave facets, on the first rank, and their files.

Axis letters: v vertices, q points, f facets, k vertices of a facet. Values of points are averaged
to the vertices with the weights of the contact pressure, (1/m_A) Σ_q w N_A f_q, so that pressure or
friction times ``area`` add up to the forces.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import meshio
import numpy as np
from mpi4py import MPI

from app.build.model import Model
from app.results.contact_points import point_values
from forms.contact.penalty import ContactTerm
from forms.contact.pressure import nodal_pressure as pressure_at_nodes
from forms.contact.state import ContactTrial
from geometry.surfaces.facets import Floats, Longs
from geometry.surfaces.ordering import order_by_place

# What a cell is called in files, and the order of its corners there.
_CELLS = {
    "interval": ("line", [0, 1]),
    "triangle": ("triangle", [0, 1, 2]),
    "quadrilateral": ("quad", [0, 1, 3, 2]),
}
_AVERAGED = (
    *("cover", "slip_increment", "slip_rate", "slip_path"),
    *("film_thickness", "alpha", "dissipation"),
)


@dataclass(frozen=True, slots=True)
class ContactNodes:
    """Slave surfaces of all pairs, one after the other, in an order that ranks do not change.

    Attributes:
        values: arrays (v,) or (v, i) by name, SI, as :func:`contact_nodes` says.
        facets: (f, k) rows of the vertices of each slave facet, round it; kind: "line", "triangle"
            or "quad".
    """

    values: dict[str, Floats]
    facets: Longs
    kind: str


def contact_nodes(model: Model) -> ContactNodes | None:
    """Nodal values of all pairs after the last converged step; collective.

    Returns:
        On the first rank, by name: ``position`` and ``reference`` (v, i), m; ``pair``; ``area``,
        m_A: m² (m in the plane); ``gap``, m, mean; NaN with no master below; ``pressure``,
        ``tangential_traction``, Pa, and in space the vector ``friction_traction`` (v, i), Pa;
        means of the other values of :func:`app.results.contact_points.contact_arrays`, but for the
        regime. None on the others.
    """
    problem = model.problem
    pairs = list(zip(problem.contacts, problem.committed, strict=True))
    parts = [_values(index, model, term, trial) for index, (term, trial) in enumerate(pairs)]
    facets = [_facets(term) for term, _ in pairs]
    if problem.comm.rank > 0:
        return None
    first = np.cumsum([0, *(len(part["pair"]) for part in parts)])
    kind, corners = _CELLS[problem.contacts[0].surface.shape.cell]
    rows = np.concatenate([start + f for start, f in zip(first[:-1], facets, strict=True)])
    values = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return ContactNodes(values, rows[:, corners], kind)


def nodal_pressure(term: ContactTerm, trial: ContactTrial) -> Floats:
    """Contact pressure (v,), Pa, at the slave's vertices: force over area; collective."""
    return pressure_at_nodes(term.surface, trial.pressure)


def write_contact_nodes(path: Path, nodes: ContactNodes) -> None:
    """Write the deformed slave surfaces with their values, for ParaView."""
    values = dict(nodes.values)
    position = values.pop("position")
    points = np.zeros((len(position), 3))
    points[:, : position.shape[1]] = position
    part = path.with_suffix(".part.vtu")
    meshio.Mesh(points, [(nodes.kind, nodes.facets)], point_data=values).write(part)
    part.replace(path)


def _values(index: int, model: Model, term: ContactTerm, trial: ContactTrial) -> dict[str, Floats]:
    """Values of one pair, on all ranks; collective."""
    vertices, of_points = term.surface.vertices, point_values(term, trial)
    out = {
        "position": vertices.position + _displacement(model, vertices.nodes),
        "reference": vertices.position,
        "pair": np.full(vertices.count, float(index)),
        "area": vertices.area,
        "gap": _gap(term, trial),
        "pressure": nodal_pressure(term, trial),
    }
    if term.surface.dim == 2:
        out["tangential_traction"] = _mean(term, of_points["tangential_traction"])
    else:
        traction = of_points["friction_traction"]
        vectors = np.stack([_mean(term, component) for component in traction.T], axis=1)
        out |= {
            "tangential_traction": np.linalg.norm(vectors, axis=1),
            "friction_traction": vectors,
        }
    return out | {name: _mean(term, of_points[name]) for name in _AVERAGED}


def _mean(term: ContactTerm, values: Floats) -> Floats:
    """Means (v,) of point values (q,); collective."""
    vertices = term.surface.vertices
    out: Floats = vertices.sums(term.surface.slave.weight * values) / vertices.area
    return out


def _gap(term: ContactTerm, trial: ContactTrial) -> Floats:
    """Mean gaps (v,), m, that the pressure answers to; NaN with no master below; collective."""
    above = trial.projection.on_surface
    covered = _mean(term, above.astype(np.float64))
    gap = trial.nodal_gap
    if gap is None:
        own = _mean(term, np.where(above, trial.kinematics.gap, 0.0))
        gap = own / np.where(covered > 0.0, covered, 1.0)
    out: Floats = np.where(covered > 0.0, gap, np.nan)
    return out


def _displacement(model: Model, nodes: Longs) -> Floats:
    """Displacements (v, i), m, of global nodes, on all ranks; collective."""
    problem = model.problem
    index = problem.space.dofmap.index_map
    local = index.global_to_local(nodes)
    mine = (local >= 0) & (local < index.size_local)
    out = np.zeros((len(nodes), problem.dim))
    out[mine] = problem.u.x.array.reshape(-1, problem.dim)[local[mine]]
    problem.comm.Allreduce(MPI.IN_PLACE, out, op=MPI.SUM)
    return out


def _facets(term: ContactTerm) -> Longs:
    """Vertices (f, k) of all slave facets, ordered by place; collective."""
    surface = term.surface
    _, first = np.unique(surface.slave.facet, return_index=True)
    gathered = surface.vertices.comm.allgather(surface.vertices.of_point[first])
    facets: Longs = np.concatenate(gathered)
    middle = surface.vertices.position[facets].mean(axis=1)
    return facets[order_by_place(middle)]
