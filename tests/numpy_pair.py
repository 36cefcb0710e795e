"""The formulas of a contact pair's slip and forces in numpy, all points at once.

The program has them in compiled loops (forms/native/pair_tangent.h), which are compared with these;
its tangents are compared with differences of the forces.
"""

import numpy as np

from tribox.forms.contact.kinematics import Anchor, ContactKinematics, in_plane


def relate(points, projection, anchor, closed):
    """Contact kinematics of the slave points against their projections.

    The slip of a step is as long as the way on a curved master. That of a point that closes within
    the step counts in full, from the place that it was opposite: a share of it would depend on
    penalty and step. An open point does not slip.

    Args:
        points: (q, i), m, current: slave points.
        projection: their closest points on the deformed master.
        anchor: state of the last converged step, moved with the current master.
        closed: (q,) points in contact.
    """
    n = projection.normal
    way = in_plane(n, _apart(points, projection, anchor))
    way *= _stretch(way, points, projection, anchor)[:, None]
    slip = np.where(closed[:, None], way, 0.0)
    elastic = _rescaled(in_plane(n, anchor.slip_image), anchor)
    return ContactKinematics(n, projection.gap, closed, slip, way, elastic)


def _stretch(slip, points, at, anchor):
    r"""How much longer (q,) the way on a curved master is than its image v in the tangent plane.

    With the depth ν of the last step's place below that plane the arc has the length
    :math:`\sqrt{v^2 + 4\nu^2/3}`, up to the fifth power of the angle it turns by: a roll of the
    radius R that turns by Δθ rubs over R Δθ, of which the image is R sin Δθ. Across a corner, or
    clamped to an end, images stay.
    """
    length = np.linalg.norm(slip, axis=1)
    sunk = np.einsum("qi,qi->q", at.normal, points - anchor.foot) - at.distance
    # ν/v = tan(Δθ/2) of a master of constant curvature: a half of it is a turn by 53° within a
    # step, beyond which it is a corner.
    bent = ~at.clamped & (np.abs(sunk) < 0.5 * length)
    slope = np.where(bent, sunk, 0.0) / np.where(bent, length, 1.0)
    return np.sqrt(1.0 + 4.0 / 3.0 * slope**2)


def _apart(points, projection, anchor):
    """Way (q, i), m, from the last step's material point to the current place.

    Clamped to an edge or a corner the foot moves, not x: a motionless point in a groove, with a
    normal that turns freely, would slip.
    """
    if not projection.clamped.any():
        return points - anchor.foot
    return np.where(projection.clamped[:, None], projection.foot, points) - anchor.foot


def _rescaled(image, anchor):
    """The elastic slip (q, i) along its image, of the length L that it had.

    Neither the projection nor a stretch of the master may create or lose elastic energy.
    """
    length = np.linalg.norm(image, axis=1)
    alive = (length > 0.0) & (anchor.slip_length > 0.0)
    scale = np.where(alive, anchor.slip_length, 0.0) / np.where(alive, length, 1.0)
    return scale[:, None] * image


def anchor_of(term, nodes):
    """Places of the last step on the master's ``nodes`` (n, i), m, without other masters."""
    state, target = term.state, term.surface.target
    foot, tangents = target.places(state.facet, state.xi, nodes)
    foot = foot + np.einsum("qb,qbi->qi", state.ahead, tangents)
    image = np.einsum("qb,qbi->qi", state.slip_components, tangents)
    return Anchor(foot, state.slip_components, image, state.slip_length)


def nodal_forces(term, trial):
    """Global nodes (q, m) and the residual −Gᵀ(w t) there (q, m, i)."""
    surface, at = term.surface, trial.projection
    slave = surface.slave
    master = surface.target.weights(at.facet, at.xi)
    force = -(slave.weight[:, None] * trial.traction)
    if trial.carried is not None:
        tool = np.broadcast_to(surface.master.nodes, (len(force), 2))
        own = slave.shape[:, :, None] * force[:, None, :]
        parts = own, trial.carried.forces(master, -force)
        return np.concatenate([slave.nodes, tool], axis=1), np.concatenate(parts, axis=1)
    shape = np.concatenate([slave.shape, -master], axis=1)
    moved = surface.master.nodes[surface.target.stencil[at.facet]]
    nodes = np.concatenate([slave.nodes, moved], axis=1)
    values = shape[:, :, None] * force[:, None, :]
    if (images := surface.images) is None:
        return nodes, values
    # Forces on images are their nodes'; what that turns round comes from the planes.
    rows = surface.target.stencil[at.facet]
    own = len(surface.master.nodes) - len(images.of)
    image, is_image = np.maximum(rows - own, 0), rows >= own
    signs = np.where(is_image[:, :, None], images.signs[image], 1.0)
    beyond = values[:, slave.shape.shape[1] :]
    turned = (1.0 - signs) * beyond
    beyond *= signs
    every = [values]
    for axis in range(surface.dim):
        only = np.zeros_like(turned)
        only[:, :, axis] = turned[:, :, axis]
        plane = np.where(is_image, images.across[image, axis], rows)
        nodes = np.concatenate([nodes, surface.master.nodes[plane]], axis=1)
        every.append(only)
    return nodes, np.concatenate(every, axis=1)
