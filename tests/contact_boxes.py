"""Two boxes that do not match at their interface, and their contact, without a solid."""

from functools import lru_cache

import dolfinx
import numpy as np
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from tests import numpy_pair
from tests.grid import coordinate_element, grid
from tribox.forms.contact.pair_loops import Entries
from tribox.forms.contact.penalty import AS_IS, ContactTerm
from tribox.forms.friction.coulomb import FrictionlessLaw
from tribox.geometry.compat import cell_nodes
from tribox.geometry.surfaces.facet_search import RaySearch
from tribox.geometry.surfaces.surface import ContactSurface

GAP = 0.05
PENALTY = 50.0
SHAPES = {
    "T3": ("triangle", 1), "Q4": ("quadrilateral", 1), "T6": ("triangle", 2),
    "Q9": ("quadrilateral", 2), "tet4": ("tetrahedron", 1), "hex8": ("hexahedron", 1),
    "tet10": ("tetrahedron", 2), "hex27": ("hexahedron", 2),
}  # fmt: skip


def box(cell, count, low, high):
    """Corners and cells of a box, (n, i) and (c, v)."""
    mesh = grid(cell, count, high, low)
    return mesh.geometry.x[:, : len(low)], cell_nodes(mesh).astype(np.int64)


def unknowns_of(nodes, dim):
    """Numbers (..., a dim) of the unknowns of nodes (..., a)."""
    return (dim * nodes[..., None] + np.arange(dim)).reshape(*nodes.shape[:-1], -1)


def nodal_forces(term, trial, count):
    """Contact residual (n, i) of so many nodes; numpy must give the same as compiled loops."""
    nodes, sums, _ = term.forces_at_nodes(trial)
    made = np.zeros((count, sums.shape[1]))
    np.add.at(made, nodes, sums)
    if not term.tied and np.isfinite(made).all():
        nodes, values = numpy_pair.nodal_forces(term, trial)
        out = np.zeros_like(made)
        np.add.at(out, nodes.reshape(-1), values.reshape(-1, values.shape[-1]))
        np.testing.assert_allclose(made, out, rtol=0, atol=1e-13 * np.abs(values).max(initial=0.0))
    return made


def dense_tangent(term, trial, count):
    """Tangent (n dim, n dim) of so many nodes."""
    matrix = Dense(term.surface.dim, count)
    return matrix.with_rest(term.add_tangent(trial, matrix.entries()))


class Dense:
    """A full matrix as entries, in which some nodes are not.

    Before its unknowns there is one of no node, which each node's first row alone is coupled to:
    rows of a node then have other columns.
    """

    def __init__(self, dim, count, outside=()):
        self.dim, self.outside = dim, np.asarray(outside, dtype=np.int64)
        self.pattern = _pattern(dim, dim * count)
        self.values = np.zeros(self.pattern.nnz)

    def entries(self):
        indptr, columns = self.pattern.indptr, self.pattern.indices
        return Entries(indptr.astype(np.int32), columns.astype(np.int32), self.values, self.first)

    def first(self, nodes):
        inside = 1 + self.dim * nodes
        return np.where(np.isin(nodes, self.outside), -1, inside).astype(np.int32)

    def with_rest(self, couplings):
        """The whole, with what is not in the matrix added."""
        parts = self.values, self.pattern.indices, self.pattern.indptr
        out = scipy.sparse.csr_matrix(parts, shape=self.pattern.shape).toarray()
        assert not out[0].any() and not out[:, 0].any()
        out = out[1:, 1:]
        at = unknowns_of(self.outside, self.dim).reshape(-1)
        assert not out[at].any() and not out[:, at].any()  # nothing of nodes that are not in it
        return with_couplings(out, couplings, self.dim)


@lru_cache
def _pattern(dim, size):
    rows = np.arange(size)[:, None] % dim == 0
    full = np.concatenate([rows, np.ones((size, size), dtype=bool)], axis=1)
    full = np.concatenate([np.eye(1, size + 1, dtype=bool), full])
    return scipy.sparse.csr_matrix(full)


def with_couplings(out, couplings, dim):
    """A dense matrix to which couplings between nodes are added."""
    for part in couplings:
        rows, columns = (unknowns_of(nodes, dim).reshape(-1) for nodes in (part.rows, part.columns))
        entries = part.matrix.tocoo()
        np.add.at(out, (rows[entries.row], columns[entries.col]), entries.data)
    return out


def slope_error(exact, along, steps=(1e-5, 2e-6)):
    """Largest difference of a slope from central differences of ``along(h)``, over the largest.

    The best of some steps: truncation and round-off are both bounded so.
    """
    found = []
    for h in steps:
        ahead, near, behind, far = (along(k * h) for k in (2.0, 1.0, -1.0, -2.0))
        slope = (8.0 * (near - behind) - (ahead - far)) / (12.0 * h)
        found.append(np.abs(exact - slope).max() / np.abs(slope).max())
    return min(found)


def take_all_for_kinked(patch):
    """Flat masters in the plane count as kinked: points are projected along the slave's normals."""
    make_ready = RaySearch.__init__

    def kinked(self, *arguments):
        make_ready(self, *arguments)
        self.has_kinks = True

    patch.setattr(RaySearch, "__init__", kinked)


@lru_cache
def two_boxes(cell, fine, master=None, parallel=False):
    """The mesh of a small box above a larger one with a gap, and the facets of slave and master."""
    dim = 2 if cell in ("triangle", "quadrilateral") else 3
    many = (5, 4) if fine else (2, 3)
    upper = box(cell, [*many[: dim - 1], 1], [0.3] * (dim - 1) + [GAP], [0.8] * (dim - 1) + [0.5])
    ends = [1.0, 1.1][: dim - 1]
    wide = [master or 3, master or 2][: dim - 1]
    lower = box(cell, [*wide, 1], [0.0] * (dim - 1) + [-0.5], [*ends, 0.0])
    x = np.concatenate([upper[0], lower[0]])
    middle = upper[0].mean(axis=0)
    if dim == 3:  # the slave's facets lie askew over the master's
        turn = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
        x[: len(upper[0]), :2] = (upper[0] - middle)[:, :2] @ turn.T + middle[:2]
    cells = np.concatenate([upper[1], lower[1] + len(upper[0])])
    comm = MPI.COMM_WORLD if parallel else MPI.COMM_SELF
    if comm.rank > 0:
        cells, x = cells[:0], x[:0]
    mesh = dolfinx.mesh.create_mesh(comm, cells, x=x, e=coordinate_element(cell, dim))
    slave, master = (
        dolfinx.mesh.locate_entities_boundary(
            mesh, dim - 1, lambda X, h=h: np.isclose(X[dim - 1], h)
        )
        for h in (GAP, 0.0)
    )
    return mesh, slave, master


def held_ends(shape, master, fine=False):
    """By axis, nodes of the lower box that stay in the planes of its vertical sides."""
    where = Scene(shape, FrictionlessLaw(), fine=fine, master=master).where
    lower, last = where[:, -1] < 0.5 * GAP, where.shape[1] - 1
    ends = [np.isclose(where[:, i, None], [0.0, 1.0 + 0.1 * i]).any(axis=1) for i in range(last)]
    return [*(np.nonzero(end & lower)[0] for end in ends), np.empty(0, dtype=np.int64)]


class Scene:
    """One contact of two boxes and a way to move them."""

    def __init__(
        self,
        shape,
        law,
        degree=3,
        fine=False,
        film=0.0,
        master=None,
        parallel=False,
        pressure="averaged",
        **options,
    ):
        cell, order = SHAPES[shape]
        mesh, slave, master = two_boxes(cell, fine, master, parallel)
        self.dim = mesh.geometry.dim
        self.space = dolfinx.fem.functionspace(mesh, ("Lagrange", order, (self.dim,)))
        self.surface = ContactSurface(self.space, slave, master, degree, **options)
        self.term = ContactTerm(self.surface, law, PENALTY, film, pressure)
        self.where = self.space.tabulate_dof_coordinates()[:, : self.dim]
        self.size = self.where.size

    def vector(self, shift, bend, phase, upper_only=0.0):
        """Unknowns: both bodies bent and warped, the upper one shifted, and bent a bit more."""
        x, y, z = self.where[:, 0], self.where[:, self.dim - 2], self.where[:, -1]
        values = np.zeros_like(self.where)
        values[:, -1] = bend * np.sin(4.1 * x + phase) * np.cos(3.3 * y - 0.3) * (1.0 - 0.3 * z)
        values[:, 0] += 0.3 * bend * np.cos(2.7 * y + x - phase)
        upper = z > 0.5 * GAP
        values[upper] += np.asarray(shift, dtype=float)
        values[upper, -1] += upper_only * np.sin(9.0 * x[upper] + y[upper])
        return self._unknowns(values)

    def moved(self, motion, depth=0.02):
        """Unknowns: the upper box pressed in by ``depth`` and moved by a function of place."""
        values = np.zeros_like(self.where)
        upper = self.where[:, -1] > 0.5 * GAP
        values[upper] = motion(self.where[upper])
        values[upper, -1] -= GAP + depth
        return self._unknowns(values)

    def _unknowns(self, values):
        """Owned unknowns from displacements (n, i) of all local nodes."""
        owned = self.space.dofmap.index_map.size_local
        comm = self.space.mesh.comm
        out = PETSc.Vec().createMPI((self.dim * owned, None), bsize=self.dim, comm=comm)
        out.array[:] = values[:owned].reshape(-1)
        return out

    def residual(self, x, dt=1.0, mode=AS_IS):
        trial = self.term.evaluate(x, dt, mode)
        return nodal_forces(self.term, trial, len(self.where)).reshape(-1), trial

    def tangent(self, x, dt=1.0, mode=AS_IS):
        return dense_tangent(self.term, self.term.evaluate(x, dt, mode), len(self.where))

    def error(self, x, steps=(1e-5, 2e-6), mode=AS_IS, free=1.0):
        """Largest error of the tangent in random directions; ``free``: 0 of held unknowns."""
        K = self.tangent(x, mode=mode)
        rng = np.random.default_rng(0)
        moved, worst = x.copy(), 0.0
        for _ in range(2):
            d = rng.normal(size=self.size) * free

            def along(h, d=d):
                moved.array[:] = x.array_r + h * d
                return self.residual(moved, mode=mode)[0] * free

            worst = max(worst, slope_error(K @ d * free, along, steps))
        return worst
