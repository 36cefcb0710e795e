"""What the warnings of a contact go by, pair by pair, against closed forms."""

from dataclasses import replace
from types import SimpleNamespace

import dolfinx
import numpy as np
import pytest

from tests.contact_boxes import PENALTY
from tests.geometry.surfaces.test_vertices import graded
from tests.grid import grid
from tribox.app.simulation.contact_warnings import FEW, PairProbe, _few_facets
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.friction.coulomb import FrictionlessLaw
from tribox.geometry.surfaces.surface import ContactSurface


def trial_of(surface, pressure):
    """Averaged contact with these pressures (v,) at its vertices."""
    gap = -pressure / PENALTY
    at_points = surface.vertices.at_points(pressure)
    count = len(at_points)
    below = SimpleNamespace(facet=np.zeros(count, dtype=np.int32), on_surface=np.ones(count, bool))
    return SimpleNamespace(
        pressure=at_points,
        nodal_pressure=pressure,
        nodal_gap=gap,
        projection=below,
        kinematics=SimpleNamespace(gap=-at_points / PENALTY),
        area_ratio=np.ones(count),
    )


@pytest.mark.parametrize("shape", ["Q4", "hex8"])
@pytest.mark.parametrize("pressed", [1, 2, 4])
def test_the_half_width_is_judged_by_the_facets_at_the_rim(shape, pressed):
    """On a slave whose facets widen along x; its end is no rim, and in space the rim is a line."""
    surface = graded(shape)
    probe = PairProbe(ContactTerm(surface, FrictionlessLaw(), PENALTY))
    x = surface.vertices.position[:, 0]
    ends = np.unique(np.round(x, 12))
    state = probe.measure(trial_of(surface, np.where(x < ends[pressed] - 1e-9, 1.0, 0.0)))
    crossed = ends[pressed] - ends[pressed - 1]
    rim = crossed if shape == "Q4" else np.sqrt(crossed * 0.5)  # the side of a square of that area
    half = ends[pressed] - ends[0]
    assert state.rim == pytest.approx(rim, rel=1e-9)
    # In space points of a face are further from the nearest open vertex than from the rim.
    vertices, points = surface.vertices.position, surface.slave.position
    places = np.concatenate(
        [vertices[x < ends[pressed] - 1e-9], points[points[:, 0] < ends[pressed - 1]]]
    )
    outside = vertices[x > ends[pressed] - 1e-9]
    furthest = np.linalg.norm(places[:, None] - outside[None], axis=2).min(axis=1).max()
    across = {"Q4": 0.0, "hex8": 0.25}[shape]  # half a face along the rim
    assert half * (1.0 - 1e-9) <= furthest <= np.hypot(half, across) * (1.0 + 1e-9)
    assert state.half_width == pytest.approx(max(furthest - 0.5 * rim, 0.5 * rim), rel=1e-9)
    assert state.uncertain == pytest.approx(0.5 * crossed / (half - 0.5 * crossed), rel=1e-9)


def test_many_short_facets_within_a_long_one_are_few():
    """Eight of 0.04, and the rim in one of 0.68: from its middle to the end of the slave."""
    mesh = grid("quadrilateral", [9, 1])
    x = mesh.geometry.x[:, 0]
    x[:] = np.where(x < 0.99, 0.36 * x, 1.0)
    space = dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (2,)))
    sides = [
        dolfinx.mesh.locate_entities_boundary(mesh, 1, lambda X, h=h: np.isclose(X[1], h))
        for h in (0.0, 1.0)
    ]
    surface = ContactSurface(space, *sides, 5)
    probe = PairProbe(ContactTerm(surface, FrictionlessLaw(), PENALTY))
    state = probe.measure(trial_of(surface, np.append(np.ones(9), 0.0)))
    assert state.facets == pytest.approx(0.66 / 0.68) and state.facets < FEW
    assert (
        "0.97 slave facets wide from its rim to its middle (0.66 m; those at its rim are 0.68 m "
        "long): its area, and what a film carries, are uncertain by 52 %"
    ) in _few_facets(2, state)
    assert "are uncertain by 103 %" in _few_facets(2, replace(state, uncertain=1.03))
