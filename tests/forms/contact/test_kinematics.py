"""Places opposite to open points, on the slave's normals."""

import numpy as np
import pytest

from tribox.forms.contact.kinematics import opposite
from tribox.geometry.surfaces.facets import facet_shape
from tribox.geometry.surfaces.projection import FacetSurface

SEGMENT = facet_shape("interval", 1)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_open_points_of_equal_bodies_are_opposite_their_images(sign):
    """A straight master falls by 0.2 radians, its image rises; also past its end, at x = 1."""
    fall = np.array([np.cos(0.2), -np.sin(0.2)])
    image = np.array([1.0, -1.0])
    along = np.array([0.3, 0.8, 1.3])
    points = along[:, None] * fall * image + [0.0, 0.3]
    line = FacetSurface(SEGMENT, np.array([[0, 1]], dtype=np.int32), np.array([[0.0, 0.0], fall]))
    at = line.project(points, np.array([[0.0, 0.0], fall]))
    normal = at.normal[0]
    ahead, way = opposite(
        at, points, np.tile(sign * normal * -image, (3, 1)), np.tile(normal, (3, 1))
    )
    np.testing.assert_allclose(at.xi[:, 0] + ahead[:, 0], along, atol=1e-14)
    assert not np.allclose(ahead[:2], 0.0)
    np.testing.assert_array_equal(at.on_surface, [True, True, False])
    np.testing.assert_allclose(way, [0.0, 0.0, 0.3], atol=1e-14)


def test_where_surfaces_do_not_face_each_other_closest_points_serve():
    nodes = np.array([[0.0, 0.0], [1.0, 0.0]])
    points = np.array([[0.4, 0.1], [1.3, 0.1]])
    at = FacetSurface(SEGMENT, np.array([[0, 1]], dtype=np.int32), nodes).project(points, nodes)
    normal = np.tile([0.0, 1.0], (2, 1))
    ahead, way = opposite(at, points, np.tile([-1.0, 0.1], (2, 1)), normal)
    # Past the end the place is that below the point.
    np.testing.assert_allclose(at.xi[:, 0] + ahead[:, 0], points[:, 0], atol=1e-14)
    np.testing.assert_allclose(way, [0.0, 0.3], atol=1e-14)
