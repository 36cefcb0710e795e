"""A gmsh model to build shapes in, and the nodes of its groups."""

import gmsh
import numpy as np
import pytest

from tribox.geometry.meshes.gmsh_model import gmsh_session


@pytest.fixture
def model():
    with gmsh_session("test"):
        yield gmsh.model


def group_points(name, dim):
    """Coordinates (n, 3) of the nodes of a named group of the current model, sorted by x then y."""
    for d, tag in gmsh.model.getPhysicalGroups(dim):
        if gmsh.model.getPhysicalName(d, tag) == name:
            x = np.asarray(gmsh.model.mesh.getNodesForPhysicalGroup(dim, tag)[1]).reshape(-1, 3)
            return x[np.lexsort((x[:, 1], x[:, 0]))]
    raise KeyError(name)
