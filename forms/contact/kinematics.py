"""Kinematics of a contact point, and the coordinates that it varies with.

Axis letters: q points, i, j space, α, β surface directions.

Per point the motion enters through vectors that are linear in the nodal displacements,

    a   = δu¹ − δu²(ξ̄)      relative motion at the current closest point ξ̄,
    b_α = δu²_,α(ξ̄)          change of the master's tangents there,
    c   = δu¹ − δu²(Ȳ_n)     relative motion at the master material point Ȳ_n of the last step,
                             which the point was on, or opposite while it was open,
    d   = e^α δu²_,α(Ȳ_n)    change of the advected elastic slip,
    f_e = δe_A, δe_B        change of the slave's chords, of points projected along rays only,

stacked as z = (a, b_α, c, d, f_e). The loops that vary it are in ``forms/native/pair_tangent.h``.
Closest-point variation: Laursen & Simo, Int. J. Numer. Meth. Engng 36 (1993) 3451; the slip against
the advected material point Ȳ_n is this project's, objective because both its ends move with the
bodies.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy.sparse

from tribox.geometry.surfaces.facets import Bools, Floats, solve_small, unit_normals
from tribox.geometry.surfaces.projection import Projection
from tribox.geometry.surfaces.rigid import RigidMotion

_FACING = 0.5  # cosine between the surfaces from which on they face each other


@dataclass(slots=True)
class Anchor:
    """State of the last converged step at each point, moved with the current master."""

    # (q, i), m, current: φ²(Ȳ_n), where the material point that the slave point was on, or opposite
    # while it was open, is now: see :func:`opposite`
    foot: Floats
    components: Floats  # (q, α), e^α of the elastic slip; 0 where it came over from another master
    slip_image: Floats  # (q, i), m, current: e^α τ_α(Ȳ_n), the advected elastic slip
    slip_length: Floats  # (q,), m: L, the length of the elastic slip, kept by the transport


@dataclass(slots=True)
class ContactKinematics:
    """Current gap, slip increment and elastic slip."""

    normal: Floats  # (q, i)
    gap: Floats  # (q,), m
    closed: Bools  # (q,) whether the point carries pressure, or touches
    slip: Floats  # (q, i), m: Δg_T, 0 of open points
    way: Floats  # (q, i), m: the same of all points, also of those that have opened in the step
    elastic_slip: Floats  # (q, i), m: g_e in the current tangent plane


def _dot(u: Floats, v: Floats) -> Floats:
    return np.einsum("qi,qi->q", u, v)


def opposite(
    at: Projection, points: Floats, slave_normal: Floats, master_normal: Floats
) -> tuple[Floats, Floats]:
    """Where open points are opposite the master: what their next slip is measured from.

    That is where the line along the mean of both surfaces' normals meets the tangent plane of the
    master. The closest point would be off by the gap times half the angle between the surfaces,
    which is no slip: equal bodies pressed on each other would rub. Past the end the tangent plane
    goes on, so that the slip of a step is that of its speed.

    Args:
        at: the points (q,) on the master.
        points: (q, i), m, current.
        slave_normal: (q, i), current, of either sign, and
        master_normal: (q, i), those of smooth surfaces
            (:meth:`tribox.geometry.surfaces.surface.ContactSurface.smooth_normals`).

    Returns:
        Way (q, α) to there from the projection, in components of the tangents there; and its length
        (q,), m, of points past the end, 0 of the others.
    """
    tau, past, apart = at.tangents, ~at.on_surface, points - at.foot
    normal, cosine = unit_normals(tau), _dot(slave_normal, master_normal)
    faces = np.abs(cosine) > _FACING
    # The slave's normal may point either way: it is turned to the side of the master's first.
    mean = master_normal + np.sign(cosine)[:, None] * slave_normal
    mean = np.where(faces[:, None], mean, normal)
    way = apart - (_dot(apart, normal) / _dot(mean, normal))[:, None] * mean
    way = np.where((faces | past)[:, None], way, 0.0)
    metric = np.einsum("qai,qbi->qab", tau, tau)
    ahead = solve_small(metric, np.einsum("qai,qi->qa", tau, way))
    return ahead, np.where(past, np.linalg.norm(way, axis=1), 0.0)


def on_facet(slip: Floats, at: Projection) -> Floats:
    """Vectors (q, i) in the facets' planes whose images in the plane across n are ``slip`` (q, i).

    Where the projection is clamped, n is not the facet's normal n_f: q = g_e − n (n_f·g_e)/(n_f·n)
    gives (I − n⊗n) q = g_e again. A normal almost in the facet's plane
    changes nothing.
    """
    rows = np.nonzero(at.clamped)[0]
    if not len(rows):
        return slip
    out = slip.copy()
    n, facet = at.normal[rows], unit_normals(at.tangents[rows])
    between = np.einsum("qi,qi->q", n, facet)
    share = np.where(
        np.abs(between) > 0.1,
        np.einsum("qi,qi->q", slip[rows], facet) / np.where(between == 0.0, 1.0, between),
        0.0,
    )
    out[rows] -= share[:, None] * n
    return out


def in_plane(n: Floats, v: Floats) -> Floats:
    """(I − n⊗n) v."""
    return v - _dot(n, v)[:, None] * n


# -- From the control points of a rigid tool to its own unknowns, displacement and angle -----------
#
# Axis letters: a control points, p points, m, n nodes of a block, i, j space, k the 2·i unknowns of
# the two reference nodes, which hold (c, θL), see :mod:`tribox.geometry.surfaces.rigid`.
#
# All of a contact between kinematics and assembly is written in the control points y_a, as if they
# were nodes. Their forces F_a and blocks K_ab become those of q = (c, θL) by the chain rule,
#
# .. math:: F_q = T^T F, \qquad K_{qq} = T^T K T + \sum_a F_a \cdot \partial^2 y_a/\partial q^2,
#    \qquad T = \partial y_a/\partial q;
#
# without the last term, which the angle alone has, Newton's method would not be quadratic.


@lru_cache
def _turned(motion: RigidMotion, theta: float) -> tuple[Floats, Floats]:
    """T (a, i, k) and ∂²y_a/∂(θL)² (a, i), 1/m, at an angle, rad: most tools keep theirs."""
    return motion.tangent(theta), motion.bend(theta)


@dataclass(frozen=True, slots=True, eq=False)
class Carried:
    """How control points follow the unknowns of their tool, at one state."""

    tangent: Floats  # (a, i, k), no unit: T
    bend: Floats  # (a, i), 1/m: ∂²y_a/∂(θL)²
    centre: Floats  # (i,), m, current: about which the tool turns

    @classmethod
    def at(cls, motion: RigidMotion, values: Floats) -> Carried:
        """At the reference nodes' values (2, i), m."""
        displacement, theta = motion.read(values)
        return cls(*_turned(motion, theta), motion.centre + displacement)

    @property
    def dim(self) -> int:
        """Of space."""
        return int(self.tangent.shape[1])

    def forces(self, shares: Floats, force: Floats) -> Floats:
        """Forces (p, 2, i), N, on the reference nodes of forces (p, i) shared by (p, a)."""
        moved = np.einsum("pa,aik->pik", shares, self.tangent)
        return np.einsum("pik,pi->pk", moved, force).reshape(len(force), 2, self.dim)

    def motions(self, values: Floats) -> Floats:
        """Velocities (a, i) of the control points of those (2, i) of the reference nodes."""
        return self.tangent @ values.reshape(-1)

    def bending(self, forces: Floats) -> Floats:
        """Block (1, 2, i, 2, j), N/m, of the angle, from forces (a, i), N, at control points."""
        # Only the angle, the first component of the second reference node, enters y_a nonlinearly.
        out = np.zeros((1, 2, self.dim, 2, self.dim))
        out[0, 1, 0, 1, 0] = np.sum(forces * self.bend)
        return out

    def operator(self, first: int) -> scipy.sparse.csr_matrix:
        """T of all unknowns (nodes and control points · i, nodes of the pair · i)."""
        nodes = scipy.sparse.identity(first * self.dim, format="csr")
        tool = self.tangent.reshape(-1, 2 * self.dim)
        return scipy.sparse.block_diag([nodes, tool], format="csr")
