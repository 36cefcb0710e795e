"""Data of the contact points of all pairs, gathered to the first rank in an order of their own.

Nodal values, the contact pressure to look at among them: :mod:`app.results.contact_nodes`.
"""

from __future__ import annotations

import numpy as np

from app.build.model import Model
from app.simulation.contact_resultants import turned_right
from forms.contact.penalty import ContactTerm
from forms.contact.state import ContactTrial
from geometry.surfaces.facets import Floats
from geometry.surfaces.ordering import order_by_place


def contact_arrays(model: Model) -> dict[str, Floats] | None:
    """Data at all contact points after the last converged step; collective.

    Returns:
        On the first rank, arrays by name (SI), points sorted by pair and reference position:
        ``position`` and ``reference`` (q, i), m; ``pair``; ``gap``, ``slip_increment``,
        ``slip_path``, ``film_thickness``, m; ``slip_rate``, m/s; ``pressure``,
        ``tangential_traction``, Pa; ``cover``, share that touches; ``alpha``; ``regime``;
        ``dissipation``, J/m² in the last step.
        In the plane slip and friction count positive to the right of the normal; in space they are
        lengths, beside the vectors ``slip_vector``, m, and ``friction_traction``, Pa, (q, i).
        None on the others.
    """
    problem = model.problem
    mine = [
        {"pair": np.full(len(trial.pressure), float(index)), **point_values(term, trial)}
        for index, (term, trial) in enumerate(zip(problem.contacts, problem.committed, strict=True))
    ]
    gathered = problem.comm.gather(mine)
    if gathered is None:
        return None
    parts = [arrays for rank in gathered for arrays in rank]
    joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    order = order_by_place(joined["reference"])
    order = order[np.argsort(joined["pair"][order], kind="stable")]
    return {name: values[order] for name, values in joined.items()}


def point_values(term: ContactTerm, trial: ContactTrial) -> dict[str, Floats]:
    """Arrays of :func:`contact_arrays`, but for ``pair``, of this rank's points of one pair."""
    k, response = trial.kinematics, trial.response
    state = response.state
    slip, friction = _along(k.slip, k.normal), _along(response.traction, k.normal)
    out = {
        "position": trial.position,
        "reference": term.surface.slave.position,
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
    if term.surface.dim == 3:
        out |= {"slip_vector": k.slip, "friction_traction": response.traction}
    return out


def _along(vectors: Floats, normal: Floats) -> Floats:
    """Vectors in the contact's plane as numbers (q,): signed in the plane, lengths in space."""
    if normal.shape[1] == 2:
        signed: Floats = np.einsum("qi,qi->q", vectors, turned_right(normal))
        return signed
    return np.linalg.norm(vectors, axis=1)
