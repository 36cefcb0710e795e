"""Contact surfaces: points, weights, operators and master facets, on any mesh and rank count."""

from __future__ import annotations

import dolfinx
import gmsh
import numpy as np
import pytest
import ufl
from mpi4py import MPI
from petsc4py import PETSc

from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.friction.coulomb import CoulombLaw, CoulombParameters
from tribox.geometry.compat import integration_facets
from tribox.geometry.generators.two_blocks import Block, TwoBlocks
from tribox.geometry.meshes.gmsh_model import gmsh_session
from tribox.geometry.meshes.mesh import generate, read
from tribox.geometry.surfaces.body_facets import facet_nodes
from tribox.geometry.surfaces.surface import ContactSurface

SLAVE, MASTER = "elastomer_contact", "aluminium_contact"
A = np.array([[0.31, -0.47], [0.22, 0.18]])
SHIFT = np.array([0.05, -0.02])


def unstructured(path, recombine):
    """Two bodies with slanted contact sides, meshed freely; returns the file."""
    with gmsh_session("test"):
        geo = gmsh.model.geo
        bodies = (
            ("elastomer", [(0.5, 0.02), (1.4, 0.29), (1.3, 1.0), (0.4, 0.9)], 0.17),
            ("aluminium", [(0.0, -0.8), (2.0, -0.9), (2.0, 0.45), (0.0, -0.15)], 0.23),
        )
        for name, corners, size in bodies:
            p = [geo.addPoint(x, y, 0.0, size) for x, y in corners]
            c = [geo.addLine(p[i], p[(i + 1) % 4]) for i in range(4)]
            face = geo.addPlaneSurface([geo.addCurveLoop(c)])
            geo.synchronize()
            gmsh.model.addPhysicalGroup(2, [face], name=name)
            side = c[0] if name == "elastomer" else c[2]
            gmsh.model.addPhysicalGroup(1, [side], name=f"{name}_contact")
        gmsh.option.setNumber("Mesh.RecombineAll", int(recombine))
        gmsh.model.mesh.generate(2)
        gmsh.write(str(path))
    return path


@pytest.fixture(
    scope="session", params=["quadrilateral", "triangle", "free quads", "free triangles"]
)
def mesh(request, tmp_path_factory):
    if request.param.startswith("free"):
        path = tmp_path_factory.mktemp("meshes") / "free.msh"
        return read(unstructured(path, "quads" in request.param), MPI.COMM_SELF)
    blocks = TwoBlocks(Block(1.0, 0.5, (6, 2)), Block(2.0, 0.5, (7, 2)), 0.3, cell=request.param)
    return generate(blocks, MPI.COMM_SELF)


def space_on(named):
    return dolfinx.fem.functionspace(named.mesh, ("Lagrange", 1, (2,)))


def surface_on(space, named, degree):
    return ContactSurface(space, named.facets(SLAVE), named.facets(MASTER), degree)


def ends(named, name):
    """End points of the facets of a surface, (f, 2, i), by another way: from the geometry."""
    geometry = dolfinx.mesh.entities_to_geometry(named.mesh, 1, named.facets(name))
    return named.mesh.geometry.x[geometry][..., :2]


def interpolated(space, motion):
    u = dolfinx.fem.Function(space)
    u.interpolate(lambda X: motion(X[:2].T).T)
    return u


@pytest.mark.parametrize("degree", [1, 3, 5])
def test_points_weights_and_shape_functions(mesh, degree):
    space = space_on(mesh)
    slave = surface_on(space, mesh, degree).slave
    corners = ends(mesh, SLAVE)
    length = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
    points = degree // 2 + 1
    assert len(slave.weight) == points * len(length)
    np.testing.assert_allclose(slave.shape.sum(axis=1), 1.0, rtol=1e-13)
    np.testing.assert_allclose(slave.shape_derivative.sum(axis=2), 0.0, atol=1e-12)
    assert (slave.shape > 0.0).all()
    # Weights and lengths facet by facet, found again by the facets' middles.
    for facet in range(len(length)):
        mine = slave.facet == facet
        assert np.count_nonzero(mine) == points
        centre = np.average(slave.position[mine], weights=slave.weight[mine], axis=0)
        at = np.argmin(np.linalg.norm(corners.mean(axis=1) - centre, axis=1))
        np.testing.assert_allclose(centre, corners[at].mean(axis=0), atol=1e-14)
        np.testing.assert_allclose(slave.weight[mine].sum(), length[at], rtol=1e-13)
        along = (corners[at, 1] - corners[at, 0]) / length[at]
        np.testing.assert_allclose(np.abs(slave.tangents[mine, 0] @ along), 1.0, rtol=1e-13)
        # Gauss points of the facet, from a table of their own.
        gauss, weights = np.polynomial.legendre.leggauss(points)
        t = (slave.position[mine] - corners[at, 0]) @ along / length[at]
        order = np.argsort(t)
        np.testing.assert_allclose(t[order], 0.5 + 0.5 * gauss, atol=1e-13)
        np.testing.assert_allclose(
            slave.weight[mine][order], 0.5 * weights * length[at], rtol=1e-12
        )


def test_positions_and_stretch_of_a_homogeneous_deformation(mesh):
    space = space_on(mesh)
    surface = surface_on(space, mesh, 3)
    u = interpolated(space, lambda X: X @ A.T + SHIFT)
    slave, master = surface.displacements(u.x.petsc_vec)
    now = surface.slave_positions(slave)
    X = surface.slave.position
    np.testing.assert_allclose(now, X + X @ A.T + SHIFT, atol=1e-14)
    F = np.eye(2) + A
    stretch = np.linalg.norm(surface.slave.tangents[:, 0] @ F.T, axis=1)
    np.testing.assert_allclose(surface.slave_area_ratio(slave), stretch, rtol=1e-13)
    Y = surface.master.position
    np.testing.assert_allclose(master, Y @ A.T + SHIFT, atol=1e-14)


def test_stretch_is_the_square_root_of_nanson(mesh):
    """da/dA = J |F⁻ᵀ N| of a deformation that varies: against UFL at the surface."""
    space = space_on(mesh)
    surface = surface_on(space, mesh, 3)
    u = interpolated(space, lambda X: 0.1 * np.sin(2.0 * X[:, ::-1] + X))
    slave, _ = surface.displacements(u.x.petsc_vec)
    F = ufl.Identity(2) + ufl.grad(u)
    ds = ufl.Measure(
        "ds",
        domain=mesh.mesh,
        subdomain_data=[(1, integration_facets(mesh.mesh, mesh.facets(SLAVE)))],
        metadata={"quadrature_degree": 3},
    )(1)
    area = ufl.det(F) * ufl.inv(F).T * ufl.FacetNormal(mesh.mesh)
    exact = dolfinx.fem.assemble_scalar(dolfinx.fem.form(ufl.sqrt(ufl.dot(area, area)) * ds))
    assert surface.slave.weight @ surface.slave_area_ratio(slave) == pytest.approx(exact, rel=1e-12)


def test_nodal_forces_of_a_varying_traction(mesh):
    """Order of the points on each facet: vectors of nodal forces against a form without points.

    A wrong order leaves every sum over a facet right and the nodal forces wrong.
    """
    space = space_on(mesh)
    surface = surface_on(space, mesh, 5)
    slave = surface.slave

    def traction(X, sin=np.sin):
        x, y = X[..., 0], X[..., 1]
        return np.stack([sin(3.0 * x) + y, x * y - 2.0 * x**2], axis=-1)

    forces = np.zeros((space.dofmap.index_map.size_local, 2))
    load = slave.weight[:, None] * traction(slave.position)
    np.add.at(forces, slave.nodes, slave.shape[:, :, None] * load[:, None, :])

    X = ufl.SpatialCoordinate(mesh.mesh)
    exact = ufl.as_vector([ufl.sin(3.0 * X[0]) + X[1], X[0] * X[1] - 2.0 * X[0] ** 2])
    ds = ufl.Measure(
        "ds",
        domain=mesh.mesh,
        subdomain_data=[(1, integration_facets(mesh.mesh, mesh.facets(SLAVE)))],
        metadata={"quadrature_degree": 5},
    )(1)
    form = dolfinx.fem.form(ufl.inner(exact, ufl.TestFunction(space)) * ds)
    direct = dolfinx.fem.assemble_vector(form).array.reshape(-1, 2)
    np.testing.assert_allclose(forces, direct, rtol=0, atol=1e-13 * np.abs(direct).max())
    # The measure of the test itself: with the points of each facet swapped it is far off.
    swapped = np.zeros_like(forces)
    swap = np.concatenate([np.nonzero(slave.facet == f)[0][::-1] for f in np.unique(slave.facet)])
    own = np.concatenate([np.nonzero(slave.facet == f)[0] for f in np.unique(slave.facet)])
    np.add.at(swapped, slave.nodes[own], slave.shape[own][:, :, None] * load[swap][:, None, :])
    assert np.abs(swapped - direct).max() > 1e-3 * np.abs(direct).max()


def test_slope_along_the_facet(mesh):
    """∂u/∂s of a linear field, with the sign of the tangent."""
    space = space_on(mesh)
    surface = surface_on(space, mesh, 3)
    u = interpolated(space, lambda X: X @ A.T)
    slave, _ = surface.displacements(u.x.petsc_vec)
    slope = np.einsum("qa,qai->qi", surface.slave.shape_derivative[:, 0], slave)
    np.testing.assert_allclose(slope, surface.slave.tangents[:, 0] @ A.T, atol=1e-13)


def test_master_facets_have_the_body_on_their_right(mesh):
    surface = surface_on(space_on(mesh), mesh, 3)
    master = surface.master
    corners = ends(mesh, MASTER)
    assert master.facets.shape == (len(corners), 2)
    assert len(master.position) == len(corners) + 1
    found = master.position[master.facets]
    middles = corners.mean(axis=1)
    for segment in found:
        at = np.argmin(np.linalg.norm(middles - segment.mean(axis=0), axis=1))
        np.testing.assert_allclose(
            np.sort(segment, axis=0), np.sort(corners[at], axis=0), atol=1e-14
        )
    tau = found[:, 1] - found[:, 0]
    # The master is a lower body: its outward normal, left of the tangent, points up.
    assert (tau[:, 0] > 0.0).all()
    assert surface.target.neighbours.nnz == 3 * len(corners) - 2


def test_master_nodes_are_those_of_the_displacement(mesh):
    space = space_on(mesh)
    surface = surface_on(space, mesh, 3)
    where = space.tabulate_dof_coordinates()[surface.master.nodes][:, :2]
    np.testing.assert_allclose(where, surface.master.position, atol=1e-15)
    local = facet_nodes(space, mesh.facets(MASTER))
    assert set(local.reshape(-1)) == set(surface.master.nodes)


def test_a_surface_without_facets_is_refused(mesh):
    none = np.empty(0, dtype=np.int32)
    space = space_on(mesh)
    with pytest.raises(ValueError, match="the slave surface has no facet"):
        ContactSurface(space, none, mesh.facets(MASTER), 3)
    with pytest.raises(ValueError, match="the master surface has no facet"):
        ContactSurface(space, mesh.facets(SLAVE), none, 3)


def test_cubic_displacements_are_refused(mesh):
    space = dolfinx.fem.functionspace(mesh.mesh, ("Lagrange", 3, (2,)))
    with pytest.raises(ValueError, match="degree 1 or 2"):
        surface_on(space, mesh, 3)


def contact_facts(comm, directory):
    """Contact forces of a deformed pair, summarised so that no numbering enters; collective."""
    blocks = TwoBlocks(Block(1.0, 0.5, (6, 6)), Block(2.0, 0.5, (19, 4)), 0.47)
    named = generate(blocks, comm)
    space = space_on(named)
    term = ContactTerm(
        surface_on(space, named, 3), CoulombLaw(CoulombParameters(mu=0.3, K_T=40.0)), 50.0
    )
    down = np.where(space.tabulate_dof_coordinates()[:, 1] > -1e-9, 1.0, 0.0)
    u = dolfinx.fem.Function(space)
    u.interpolate(lambda X: 0.03 * np.stack([np.cos(3.0 * X[1]), np.sin(4.0 * X[0])]))
    u.x.array[1::2] -= 0.03 * down * np.isin(np.arange(len(down)), upper_nodes(named, space))
    x = PETSc.Vec().createMPI((2 * space.dofmap.index_map.size_local, None), bsize=2, comm=comm)
    x.array[:] = u.x.array[: x.getLocalSize()]
    trial = term.evaluate(x, 1.0)
    f = x.duplicate()
    f.set(0.0)
    nodes, values = term.nodal_forces(trial)
    dofs = (nodes[..., None] * 2 + np.arange(2)).astype(PETSc.IntType)
    f.setValues(dofs.reshape(-1), values.reshape(-1), addv=PETSc.InsertMode.ADD_VALUES)
    f.assemble()
    where = space.tabulate_dof_coordinates()[: space.dofmap.index_map.size_local, 0]
    # Sum and first moment vanish (action and reaction); the second moment does not.
    force = f.array_r.reshape(-1, 2)
    return {
        "norm": f.norm(),
        "second moment x": comm.allreduce(float(force[:, 0] @ where**2)),
        "second moment y": comm.allreduce(float(force[:, 1] @ where**2)),
        "pressed": comm.allreduce(int(np.count_nonzero(trial.pressure))),
        "energy": comm.allreduce(term.interface_energy(trial)),
        "points": comm.allgather(len(term.surface.slave.weight)),
        "masters": comm.allgather(
            term.surface.master.position[term.surface.master.facets].tolist()
        ),
    }


def upper_nodes(named, space):
    return np.unique(space.dofmap.list[named.cells("elastomer")])


@pytest.mark.mpi(contact_facts, 3)
def test_contact_forces_do_not_depend_on_the_ranks(on_ranks):
    """Three ranks, of which one at least owns no slave facet, against one."""
    one, three = on_ranks(contact_facts, 1), on_ranks(contact_facts, 3)
    assert min(three["points"]) == 0 < max(three["points"]), three["points"]
    assert sum(three["points"]) == one["points"][0]
    assert three["pressed"] == one["pressed"] > 0
    for name in ("norm", "second moment x", "second moment y", "energy"):
        assert three[name] == pytest.approx(one[name], rel=1e-10, abs=0.0)
    # The facets have the same order too, on every rank and however many there are.
    for facets in three["masters"]:
        np.testing.assert_allclose(facets, one["masters"][0], rtol=0, atol=1e-15)
