"""Stiffness and viscosity of a contact pair, for the stable step of an explicit integration."""

from __future__ import annotations

import itertools

import numpy as np
from mpi4py import MPI

from tribox.forms.contact.explicit import ExplicitContact, ExplicitTie
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.friction.factored_law import strongest
from tribox.geometry.surfaces.facets import Floats
from tribox.geometry.surfaces.surface import NodalVector

PROBES = (1e-9, 1e-6, 1e-3, 1.0)  # m/s, slip speeds at which the law is evaluated


class PairStiffness:
    """K of one pair, as if all its points were closed: they may be at the next step.

    Per point K_N n⊗n + k_T (I − n⊗n), with k_T the law's stiffness before it slips. An averaged
    pressure is nowhere stiffer than K_N = Σ_A N_A K_A at the points.
    """

    def __init__(self, contact: ExplicitContact) -> None:
        """Evaluate the law's stiffness at rest and its largest viscosity in motion; collective."""
        self.contact = contact
        term = contact.term
        self.normal = term.rule.point_stiffness()
        comm = term.surface.space.mesh.comm
        self.tangential = comm.allreduce(elastic_stiffness(term), op=MPI.MAX)
        self.viscosity = comm.allreduce(largest_viscosity(term), op=MPI.MAX)
        if term.tied:
            largest = float(np.max(term.penalty, initial=0.0))
            self.tangential, self.viscosity = comm.allreduce(largest, op=MPI.MAX), 0.0

    def add(self, w: NodalVector, out: NodalVector) -> None:
        """Add K w to ``out``; collective."""
        contact = self.contact
        assert contact.trial is not None
        n = contact.trial.kinematics.normal
        values = np.zeros((len(contact.exchange.nodes), contact.term.surface.dim))
        contact.exchange.gather(w, values)
        if isinstance(contact, ExplicitTie):
            contact.exchange.add(contact.tie.stiffness_times(values), out)
            return
        jump = contact.jump(values)
        across = np.einsum("qi,qi->q", n, jump)[:, None] * n
        along = self.tangential * (jump - across)
        contact.spread(-(self.normal[:, None] * across + along), out)

    def add_bound(self, out: NodalVector) -> None:
        """Add to ``out`` a diagonal that is nowhere softer than K (its row sums); collective."""
        self.contact.spread_weights(np.maximum(self.normal, self.tangential), out)


def elastic_stiffness(term: ContactTerm) -> float:
    """Largest stiffness against slip of any point of this rank at rest, Pa/m."""
    q, dim = len(term.surface.slave.weight), term.surface.dim
    if q == 0:
        return 0.0
    pressure, law = _pressures(term)[-1], strongest(term.law)
    response = law.update(
        np.zeros((q, dim)),
        1.0,
        pressure,
        term.film.at(pressure)[0],
        law.initial_state(q, dim),
        rate_dependent=False,
    )
    return float(np.abs(response.d_traction_d_slip).max(initial=0.0))


def largest_viscosity(term: ContactTerm) -> float:
    """Largest viscous traction per slip speed of any point here, Pa s/m, over ``PROBES``."""
    q, dim = len(term.surface.slave.weight), term.surface.dim
    largest, area_ratio, law = 0.0, term.state.area_ratio, strongest(term.law)
    for speed, pressure in itertools.product(PROBES, _pressures(term)) if q else ():
        slip = np.zeros((q, dim))
        slip[:, 0] = speed
        film = term.film.at(pressure)[0]
        state = law.initial_state(q, dim)
        state.speed[:] = speed
        response = law.update(slip, 1.0, pressure, film, state, area_ratio=area_ratio)
        largest = max(largest, float(response.dissipation.viscous.max()) / speed**2)
    return largest


def _pressures(term: ContactTerm) -> tuple[Floats, Floats]:
    """A low and a high pressure (q,), Pa: a hundredth and a tenth of the facet deep in the penalty.

    Each point's own: they depend neither on the grading of the mesh nor on the ranks.
    """
    stiffness = term.rule.point_stiffness() * term.surface.slave.facet_length
    return 1e-2 * stiffness, 1e-1 * stiffness
