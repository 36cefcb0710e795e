"""Materials and deformations that the tests of plastic points share.

Moduli of aluminium in GPa, so that strains at yield are a thousandth, as of metals.
"""

import numpy as np

from tribox.forms.bodies.elastoplastic import ElastoPlastic
from tribox.forms.bodies.hardening import (
    Backstress,
    JohnsonCook,
    Linear,
    Perzyna,
    Swift,
    Table,
    Voce,
)

SHEAR, BULK = 26.3, 68.6
LAWS = {
    "linear": Linear(0.06, 0.2),
    "voce": Voce(0.06, 0.16, 12.0, 0.05),
    "swift": Swift(0.18, 0.01, 0.22),
    "table": Table([(0.0, 0.06), (0.02, 0.09), (0.1, 0.12), (2.0, 0.2)]),
}
RATES = {"no rate": None, "johnson-cook": JohnsonCook(0.015, 0.01), "perzyna": Perzyna(50.0, 0.25)}
BRANCHES = {
    "none": (),
    "one": (Backstress(2.0, 50.0),),
    "linear": (Backstress(0.3),),
    "slow and fast": (Backstress(0.4, 5.0), Backstress(20.0, 800.0)),
}
PLANE = [0, 1, 3, 4, 8]  # places of the plane's components among the nine
PAIRS = [0, 4, 8, 1, 5, 2]  # places of C_p^-1 (11, 22, 33, 12, 23, 13)


def material(law="voce", rate="no rate", branches="none"):
    return ElastoPlastic(SHEAR, BULK, LAWS[law], RATES[rate], BRANCHES[branches])


def in_plane(tensors):
    """Whether (n, 3, 3) tensors are given to a plane: without 13, 23, 31, 32."""
    kept = np.zeros((3, 3))
    kept[:2, :2] = kept[2, 2] = 1.0
    return tensors * kept


def gradients(n, space, seed, size=0.1):
    """Deformation gradients (n, 3, 3) I + noise, with a rotation."""
    noise = np.random.default_rng(seed).uniform(-size, size, (n, 3, 3))
    return (np.eye(3) + noise) @ rotation(0.4) if space else in_plane(np.eye(3) + noise)


def rotation(angle, axis=(1.0, 2.0, -0.5)):
    """Rotation by an angle about an axis."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def components(tensors, space):
    """Tensors (n, 3, 3) as rows of 9 or 5 components."""
    rows = tensors.reshape(-1, 9)
    return rows if space else rows[:, PLANE]


def tensors(rows):
    """Rows of 9 or 5 components as tensors (n, 3, 3)."""
    if rows.shape[1] == 9:
        return rows.reshape(-1, 3, 3)
    full = np.zeros((len(rows), 9))
    full[:, PLANE] = rows
    return full.reshape(-1, 3, 3)


def metric(state):
    """C_p^-1 (n, 3, 3) of states without backstress."""
    return metrics(state, state.shape[1] == 7)[:, 0]


def metrics(state, space):
    """C_p^-1 and C_pi of the branches (n, 1 + k, 3, 3) of states."""
    places = PAIRS if space else PAIRS[:4]
    rows = state[:, :-1].reshape(len(state), -1, len(places))
    full = np.zeros((*rows.shape[:2], 9))
    full[..., places] = rows
    C = full.reshape(*rows.shape[:2], 3, 3)
    return C + np.swapaxes(np.triu(C, 1), 2, 3)


def power(symmetric, exponent):
    """A power of symmetric positive tensors (n, 3, 3)."""
    values, axes = np.linalg.eigh(symmetric)
    return np.einsum("nia,na,nja->nij", axes, values**exponent, axes)


def worked(points, n, seed=1, dt=0.1):
    """Gradients (n, 3, 3) and state of points that have flowed in two steps."""
    F = gradients(n, points.space, seed)
    state = points.update(components(F, points.space), points.start(n), dt, False).state
    F = gradients(n, points.space, seed + 1, 0.03) @ F
    return F, points.update(components(F, points.space), state, dt, False).state


def samples(points):
    """Gradients (n, p) and states, by what they are.

    Elastic, plastic, with equal stretches and nearly equal ones. Those with chosen stretches have
    trial b = Q diag(w) Qᵀ: F = Q √w Qᵀ C_p^(1/2).
    """
    space, found = points.space, {}
    F, state = worked(points, 6)
    plastic = metrics(state, space)[:, 0]
    half = F @ plastic @ np.swapaxes(F, 1, 2)
    found["elastic"] = components(power(half, -0.25) @ F, space), state
    found["plastic"] = components(gradients(6, space, 5, 0.05) @ F, space), state
    root = power(plastic, -0.5)
    Q = rotation(0.7) if space else rotation(0.7, (0.0, 0.0, 1.0))
    for name, pair in (("first", (0, 1)), ("last", (1, 2))):
        for apart in (0.0, 1e-12, 1e-8, 1e-5, 1e-3, 0.03):
            stretch = np.array([1.05, 1.05, 0.93])
            stretch = stretch if pair == (0, 1) else stretch[[2, 0, 1]]
            stretch[pair[0]] *= 1.0 + apart
            tensor = Q @ np.diag(stretch) @ Q.T @ root
            found[f"{name} two stretches {apart:g} apart"] = components(tensor, space), state
    found["same stretch"] = components(1.02 * Q @ root, space), state
    found["undeformed"] = components(np.tile(np.eye(3), (6, 1, 1)), space), points.start(6)
    return found
