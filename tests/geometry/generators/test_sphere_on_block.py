"""The sphere on a block: shape, names, counts and quality of every part of it, and mistakes."""

from dataclasses import replace

import dolfinx
import gmsh
import numpy as np
import pytest
import ufl
from mpi4py import MPI

from tribox.app.build.mesh import bodies_sharing_nodes
from tribox.geometry.generators.sphere_on_block import SphereOnBlock
from tribox.geometry.meshes.gmsh_model import gmsh_session
from tribox.geometry.meshes.mesh import generate

R, BLOCK_R, H, WIDTH = 1.0, 0.8, 0.6, 0.3
SPHERE = SphereOnBlock(R, BLOCK_R, H, WIDTH, 0.05, 1.3)
PARTS = [
    ("axisymmetric", "quadrilateral"), ("axisymmetric", "triangle"), ("quarter", "hexahedron"),
    ("half", "hexahedron"), ("full", "hexahedron"), ("quarter", "tetrahedron"),
]  # fmt: skip
SHARE = {"axisymmetric": 1.0, "quarter": 0.25, "half": 0.5, "full": 1.0}


def made(part, cell, **changes):
    return generate(replace(SPHERE, part=part, cell=cell, **changes), MPI.COMM_SELF)


def nodes(named, surface):
    mesh, dim = named.mesh, named.mesh.topology.dim
    facets = named.facets(surface)
    mesh.topology.create_connectivity(dim - 1, dim)
    return mesh.geometry.x[np.unique(dolfinx.mesh.entities_to_geometry(mesh, dim - 1, facets))]


def measure(named, entities, dim):
    """Volume of cells or area of facets; of a section those of the whole ring."""
    mesh = named.mesh
    tdim = mesh.topology.dim
    marks = dolfinx.mesh.meshtags(mesh, dim, np.sort(entities), np.ones(len(entities), np.int32))
    over = ufl.Measure("dx" if dim == tdim else "ds", domain=mesh, subdomain_data=marks)(1)
    around = 2.0 * np.pi * ufl.SpatialCoordinate(mesh)[0]
    weight = around if tdim == 2 else dolfinx.fem.Constant(mesh, 1.0)
    return dolfinx.fem.assemble_scalar(dolfinx.fem.form(weight * over))


@pytest.mark.parametrize(("part", "cell"), PARTS)
def test_shape_and_names(part, cell):
    named = made(part, cell)
    share, dim = SHARE[part], named.mesh.topology.dim
    assert named.mesh.topology.cell_name() == cell
    volumes = {"elastomer": 2.0 / 3.0 * np.pi * R**3, "aluminium": np.pi * BLOCK_R**2 * H}
    for name, volume in volumes.items():
        found = measure(named, named.cells(name), dim)
        # Chords cut off a part of the round that falls with the square of their length.
        assert 0.96 < found / (share * volume) < 1.001
    areas = {
        "top": np.pi * R**2,
        "bottom": np.pi * BLOCK_R**2,
        "aluminium_contact": np.pi * BLOCK_R**2,
        "aluminium_side": 2.0 * np.pi * BLOCK_R * H,
    }
    for name, area in areas.items():
        assert measure(named, named.facets(name), dim - 1) == pytest.approx(share * area, rel=0.03)
    zone, rest = nodes(named, "elastomer_contact"), nodes(named, "elastomer_side")
    for x in (zone, rest):
        np.testing.assert_allclose(np.linalg.norm(x - [0.0, R, 0.0], axis=1), R, rtol=1e-9)
    assert zone[np.abs(zone[:, 2]) < 1e-12, 0].max() == pytest.approx(0.5 * WIDTH)
    assert np.abs(zone[:, [0, 2]]).max() == pytest.approx(0.5 * WIDTH, rel=5e-3)  # great circles
    np.testing.assert_allclose(zone[np.argmin(zone[:, 1])], 0.0, atol=1e-12)
    np.testing.assert_allclose(nodes(named, "aluminium_contact")[:, 1], 0.0, atol=1e-12)
    np.testing.assert_allclose(nodes(named, "bottom")[:, 1], -H, rtol=1e-12)
    assert bodies_sharing_nodes(named) == {}


def test_planes_of_symmetry():
    quarter, half, full = (made(part, "hexahedron") for part in ("quarter", "half", "full"))
    assert not any("symmetry" in name for name in full.surfaces)
    assert not any("symmetry_x" in name for name in half.surfaces)
    for body in ("elastomer", "aluminium"):
        np.testing.assert_allclose(nodes(quarter, f"{body}_symmetry_x")[:, 0], 0.0, atol=1e-12)
        flat = [nodes(named, f"{body}_symmetry_z") for named in (quarter, half)]
        for x in flat:
            np.testing.assert_allclose(x[:, 2], 0.0, atol=1e-12)
        assert flat[0][:, 0].min() > -1e-12 and flat[1][:, 0].min() < -0.7
        sections = made("axisymmetric", "quadrilateral")
        assert len(quarter.facets(f"{body}_symmetry_x")) == len(sections.cells(body))
        assert len(half.facets(f"{body}_symmetry_z")) == 2 * len(sections.cells(body))


def test_cells_are_small_at_the_contact_and_well_shaped_everywhere():
    for part, cell in PARTS:
        with gmsh_session("sphere"):
            replace(SPHERE, part=part, cell=cell).build()
            dim = 2 if part == "axisymmetric" else 3
            tags = np.concatenate(gmsh.model.mesh.getElements(dim)[1])
            kind = "minSICN" if cell in ("tetrahedron", "triangle") else "minSJ"
            quality = np.abs(gmsh.model.mesh.getElementQualities(tags, kind))
            assert quality.min() > 0.15, (part, cell)
    named = made("quarter", "hexahedron")
    assert len(named.facets("elastomer_contact")) == 3**2
    x = np.unique(nodes(named, "elastomer_contact")[:, 0].round(9))
    assert np.diff(x).max() < 0.06


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"radius": 0.0}, "radius = 0.0 is not allowed"),
        ({"block_height": -1.0}, "block_height = -1.0 is not allowed"),
        ({"contact_width": 0.9}, "contact_width = 0.9 m is not allowed; at most the smaller"),
        ({"contact_size": 0.2}, "contact_size = 0.2 m is not allowed; at most half"),
        ({"growth": 3.0}, "growth = 3.0 is not allowed"),
        ({"part": "third"}, "part = 'third' is not allowed; choose from axisymmetric, quarter"),
        ({"part": "half"}, "cell = 'quadrilateral' is not allowed; choose from hexahedron"),
        ({"lower_name": "elastomer"}, "two different names"),
        ({"contact_size": 1e-5, "growth": 1.0}, "at most 10000000 are allowed"),
    ],
)
def test_mistakes_are_named(change, said):
    with pytest.raises(ValueError, match=said):
        replace(SPHERE, **change)
