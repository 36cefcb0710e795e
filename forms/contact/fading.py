r"""Energy that a contact gives up where points leave the end of the master bit by bit.

Axis letters: q slave points. A point with the share σ presses with σ s, s = Σ_A N_A s_A. As σ falls
it sinks below the surface that carries it less and less; the work of its pressure on the way down
comes back to nobody: with the penalty's energy ½ Σ_A a_A s_A²/K_A, whose change is
−Σ_q w s (σ dg + g dσ), there is left

.. math:: \int \sum_q w \, s \, g \, d\sigma, \qquad g < 0,

per step by the trapezoidal rule. It is what the pressing of the bodies had stored of what slides
off: a rounded edge would give it back as a push, a fading one loses it. Where points come in over
an end it is negative.
"""

from __future__ import annotations

import numpy as np

from tribox.forms.contact.state import ContactState, Fading, NormalContact
from tribox.geometry.surfaces.projection import Projection
from tribox.geometry.surfaces.vertices import SlaveVertices


def fading(
    at: Projection, normal: NormalContact, vertices: SlaveVertices, before: ContactState
) -> Fading | None:
    """What fades in a step; None with the pressure point by point.

    Args:
        at: the points on the master.
        normal: their contact.
        vertices: of the slave.
        before: state of the last step.
    """
    if normal.nodal_pressure is None:
        return None
    share = np.where(at.on_surface, 1.0 if at.share is None else at.share, 0.0)
    full = vertices.at_points(normal.nodal_pressure)
    sunk = np.where(at.on_surface, full * np.minimum(at.gap, 0.0), 0.0)
    # Of a point that is over the master at one end of the step only, that end counts.
    mean = 0.5 * (sunk + before.sunk)
    mean = np.where(share > 0.0, np.where(before.share > 0.0, mean, sunk), before.sunk)
    return Fading(share, sunk, mean * (share - before.share))
