"""Data of the contact points of all pairs, gathered to the first rank in an order of their own.

Nodal values, the contact pressure to look at among them: :mod:`tribox.app.results.contact_nodes`.
"""

from __future__ import annotations

import numpy as np

from tribox.app.build.model import Model
from tribox.app.results.gathered_mesh import gathered
from tribox.app.results.vtu import Array
from tribox.app.simulation.contact_resultants import turned_right
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.state import ContactTrial
from tribox.geometry.surfaces.facets import Floats, Longs
from tribox.geometry.surfaces.ordering import order_by_place


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
        "cover": np.where(trial.pressure > 0.0, trial.normal_contact.cover, 0.0),
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
        signed: Floats = np.einsum("qi,qi->q", vectors, turned_right(normal))
        return signed
    return np.linalg.norm(vectors, axis=1)
