"""Contact surfaces in space and of second-order displacements, on unstructured meshes."""

import dolfinx
import gmsh
import numpy as np
import pytest
import ufl
from mpi4py import MPI

from tests.grid import grid
from tribox.geometry.compat import distributed_mesh, integration_facets
from tribox.geometry.meshes.extraction import arrays_of
from tribox.geometry.meshes.gmsh_model import gmsh_session
from tribox.geometry.surfaces.surface import ContactSurface

CELLS = ("triangle", "quadrilateral", "tetrahedron", "hexahedron")
KINDS = [(cell, degree) for cell in CELLS for degree in (1, 2)]


def free_mesh(cell, bend=0.1):
    """A mesh without structure of the unit square or cube, sheared; hexahedra: shifted nodes."""
    dim = 2 if cell in ("triangle", "quadrilateral") else 3
    if cell == "hexahedron":
        mesh = grid(cell, (3, 2, 2))
        x = mesh.geometry.x
        inner = (np.abs(x[:, :2] - 0.5) < 0.4).all(axis=1)
        shift = 0.08 * np.random.default_rng(0).uniform(-1.0, 1.0, x.shape)
        x[inner, :2] += shift[inner, :2]
    else:
        with gmsh_session("free"):
            if dim == 2:
                gmsh.model.occ.addRectangle(0.0, 0.0, 0.0, 1.0, 1.0)
            else:
                gmsh.model.occ.addBox(0.0, 0.0, 0.0, 1.0, 1.0, 1.0)
            gmsh.model.occ.synchronize()
            gmsh.model.addPhysicalGroup(dim, [1], 1, "body")
            gmsh.option.setNumber("Mesh.MeshSizeMax", 0.4)
            gmsh.option.setNumber("Mesh.RecombineAll", int(cell == "quadrilateral"))
            gmsh.model.mesh.generate(dim)
            arrays = arrays_of(gmsh, "free")
        body = arrays.bodies["body"]
        cells = body.nodes, np.full(len(body.nodes), 1, dtype=np.int32)
        place = arrays.position[:, :dim]
        mesh = distributed_mesh(MPI.COMM_SELF, (arrays.cell, 1), place, cells, None)[0]
    x = mesh.geometry.x
    x[:, dim - 1] += 0.3 * x[:, 0] - bend * x[:, 0] * x[:, dim - 2]
    return mesh


@pytest.fixture(scope="module", params=KINDS, ids=lambda kind: f"{kind[0]}{kind[1]}")
def space(request):
    cell, degree = request.param
    mesh = free_mesh(cell)
    return dolfinx.fem.functionspace(mesh, ("Lagrange", degree, (mesh.geometry.dim,)))


def sides(mesh, bend=0.1):
    """Facets of the lower and of the upper side: slave and master of one body will do."""
    dim = mesh.geometry.dim

    def at(h):
        def on(X):
            return np.isclose(X[dim - 1] - 0.3 * X[0] + bend * X[0] * X[dim - 2], h)

        return on

    found = [dolfinx.mesh.locate_entities_boundary(mesh, dim - 1, at(h)) for h in (0.0, 1.0)]
    assert min(map(len, found)) >= 2
    return found


def surface_of(space, degree=4):
    return ContactSurface(space, *sides(space.mesh), degree)


def measure_on(mesh, facets, degree):
    return ufl.Measure(
        "ds",
        domain=mesh,
        subdomain_data=[(1, integration_facets(mesh, facets))],
        metadata={"quadrature_degree": degree},
    )(1)


def wavy(space):
    u = dolfinx.fem.Function(space)
    dim = space.mesh.geometry.dim
    u.interpolate(lambda X: 0.1 * np.sin(2.0 * X[:dim][::-1] + 3.0 * X[:dim]))
    return u


def test_weights_add_up_to_the_area_and_shapes_reproduce_positions(space):
    slave = surface_of(space).slave
    ds = measure_on(space.mesh, sides(space.mesh)[0], 4)
    one = dolfinx.fem.Constant(space.mesh, 1.0)
    area = dolfinx.fem.assemble_scalar(dolfinx.fem.form(one * ds))
    assert slave.weight.sum() == pytest.approx(area, rel=1e-13)
    assert (slave.weight > 0.0).all()
    np.testing.assert_allclose(slave.shape.sum(axis=1), 1.0, rtol=1e-13)
    np.testing.assert_allclose(slave.shape_derivative.sum(axis=2), 0.0, atol=1e-11)
    metric = np.einsum("qai,qbi->qab", slave.tangents, slave.tangents)
    size = metric.shape[1]
    np.testing.assert_allclose(metric, np.broadcast_to(np.eye(size), metric.shape), atol=1e-13)


def test_stretch_is_that_of_nanson(space):
    """∫ da = ∫ |J F⁻ᵀ N| dA of a displacement that varies, at the same points."""
    surface = surface_of(space)
    u = wavy(space)
    slave = surface.gather(u.x.petsc_vec)[surface.slave_rows]
    F = ufl.Identity(surface.dim) + ufl.grad(u)
    ds = measure_on(space.mesh, sides(space.mesh)[0], 4)
    area = ufl.det(F) * ufl.inv(F).T * ufl.FacetNormal(space.mesh)
    exact = dolfinx.fem.assemble_scalar(dolfinx.fem.form(ufl.sqrt(ufl.dot(area, area)) * ds))
    stretch = surface.slave_area_ratio(
        surface.slave_tangents(slave), surface.slave_positions(slave)
    )
    assert surface.slave.weight @ stretch == pytest.approx(exact, rel=1e-12)
    assert np.ptp(stretch) > 0.01


def test_rings_of_an_axisymmetric_surface():
    """A conical side: weights are areas of the frustum, the stretch includes that of the hoop."""
    mesh = free_mesh("quadrilateral", bend=0.0)
    space = dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (2,)))
    surface = ContactSurface(space, *sides(mesh, bend=0.0), 4, axisymmetric=True)
    slant = np.hypot(1.0, 0.3)
    assert surface.slave.weight.sum() == pytest.approx(np.pi * slant, rel=1e-13)
    u = dolfinx.fem.Function(space)
    u.interpolate(lambda X: np.stack([0.2 * X[0], -0.1 * X[1]]))
    slave = surface.gather(u.x.petsc_vec)[surface.slave_rows]
    area = surface.slave.weight @ surface.slave_area_ratio(
        surface.slave_tangents(slave), surface.slave_positions(slave)
    )
    assert area == pytest.approx(np.pi * 1.2 * np.hypot(1.2, 0.27), rel=1e-12)
