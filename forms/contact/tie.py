r"""A tie: surfaces that do not match, bonded by a penalty on their mean jump.

Axis letters: p points of the tie, q slave points, v vertices of the slave facets, n nodes of the
pair, i, j space.

Each slave point x_p keeps its place ξ_p on the master, found undeformed, and its offset o_p from
there, carried along by the master's tangents:

.. math:: g_A = \frac{1}{c_A} \sum_p w N_A (x_p - \bar y(\xi_p) - o_p), \quad
   c_A = \sum_p w N_A, \quad E = \tfrac12 \sum_A c_A K_A |g_A|^2.

The jump is zero in the undeformed state, whatever the gap, and for any rigid motion: offsets turn
with the master. It is averaged over the vertices with their linear shape functions (a mortar method
with linear multipliers, Puso & Laursen, Comput. Methods Appl. Mech. Engng 193 (2004) 601, whose
multiplier s_A = K_A g_A is eliminated), so that a fine slave does not lock a coarse master.

A rigid tool as master moves its own place of each point, X_p: ȳ = Σ_a N_a(X_p) y_a and o_p = 0, in
its control points y_a, which follow its displacement and angle (:mod:`.carried`).

In the plane x, ȳ and o are linear in the nodes, and so are the forces Bᵀ s, B = ∂(c g)/∂u; in
space the part of o along the normal is not: its first derivative is in the forces and in the
tangent, its second, of the order of gap over facet length, is left out of the tangent.
"""

from __future__ import annotations

from dataclasses import dataclass

import basix
import numpy as np
import scipy.sparse
from petsc4py import PETSc

from tribox.forms.contact.kinematics import Carried, ContactKinematics
from tribox.forms.contact.pair_loops import Entries
from tribox.forms.contact.penalty import ContactTerm, carried_by
from tribox.forms.contact.state import ContactMode, ContactState, ContactTrial, NormalContact
from tribox.forms.contact.tangent import Coupling
from tribox.forms.contact.vertex_rows import completed
from tribox.forms.friction.coulomb import FrictionlessLaw
from tribox.geometry.surfaces.body_facets import facet_nodes
from tribox.geometry.surfaces.facets import (
    Floats,
    Ints,
    Longs,
    facet_shape,
    measure,
    solve_small,
    unit_normals,
)
from tribox.geometry.surfaces.master import MasterFacets
from tribox.geometry.surfaces.projection import Projection
from tribox.geometry.surfaces.surface import ContactSurface, RigidMaster

# -- Integration points of a tie: on the slave facets, at places of the master that do not change
#
# Axis letters: p points, f slave facets, a nodes of a slave facet, k vertices of it, m nodes that
# move a master facet, i space, α surface directions.
#
# In the plane the slave facets are divided where a node of the master lies opposite, so that the
# integrals of products of both surfaces' shape functions are exact on straight facets, and a
# uniform stress passes exactly. In space each facet is divided into equal parts: what is left of
# the error falls with their number and that of the facets.

REACH = 0.1  # distance over the length of the longer facets up to which points are tied
_GAUSS = 4  # points of each part of a segment
_PARTS = 4  # of each side of a facet in space
_DEGREE = 3  # of the rule on each of these parts
_SHORT = 1e-9  # share of a facet below which a part of it is none


@dataclass(frozen=True, slots=True)
class TiePoints:
    """Points of this rank's slave facets that have a master beside them.

    Attributes:
        weight: (p,), quadrature weight times reference area: m, m² in space and for rings.
        rows: (p, a) rows of the pair's nodes that move the point, shape: (p, a) their shares.
        of_point: (p, k) vertices of the slave facet; vertex_shape: (p, k) their linear shapes.
        facet: (p,) master facets; xi: (p, α): the places opposite.
        master: (p, m) shares of the nodes that move that facet in ȳ + along^α τ_α; across: (p,):
            offset o = along^α τ_α + across J τ_1 from there in the plane, with J τ the tangent
            turned left; in space along^α τ_α + across n, across in m. A rigid tool has one place
            for every point, its own: no offset.
    """

    weight: Floats
    rows: Longs
    shape: Floats
    of_point: Longs
    vertex_shape: Floats
    facet: Ints
    xi: Floats
    master: Floats
    across: Floats


def tie_points(surface: ContactSurface) -> TiePoints:
    """Find the points of a pair, undeformed, that are tied."""
    shape, slave, master = surface.shape, surface.slave, surface.master
    _, first = np.unique(slave.facet, return_index=True)
    local = facet_nodes(surface.space, slave.mesh_facet[first])
    where = surface.space.tabulate_dof_coordinates()[:, : surface.dim][local]
    where = where.reshape(len(first), shape.count, surface.dim)
    facet, xi, weight = _divided(surface, master, where)
    values, tangents = shape.values(xi), np.einsum("pba,pai->pbi", shape.first(xi), where[facet])
    position = np.einsum("pa,pai->pi", values, where[facet])
    weight = weight * measure(tangents)
    if surface.axisymmetric:
        weight = weight * 2.0 * np.pi * position[:, 0]
    # Of meshes that do not match chords lie apart by a part of the longer facet, whoever has it.
    at = surface.project(position, master.position)
    reach = REACH * slave.facet_length[first][facet]
    if isinstance(master, MasterFacets):
        reach = np.maximum(reach, REACH * master.sizes()[at.facet])
    keep = np.nonzero(at.on_surface & (np.abs(at.gap) <= reach))[0]
    shares, across = _beside(surface, position[keep], at.of(keep))
    return TiePoints(
        weight=weight[keep],
        rows=surface.slave_rows[first][facet[keep]],
        shape=values[keep],
        of_point=surface.vertices.of_point[first][facet[keep]],
        vertex_shape=facet_shape(shape.cell, 1).values(xi[keep]),
        facet=at.facet[keep],
        xi=at.xi[keep],
        master=shares,
        across=across,
    )


def _beside(surface: ContactSurface, position: Floats, at: Projection) -> tuple[Floats, Floats]:
    """``master`` and ``across`` of :class:`TiePoints`, of places (p, i), m, beside the master."""
    if isinstance(surface.master, RigidMaster):
        return surface.master.surface.shares(position), np.zeros(len(position))
    along, across = _offset(position - at.foot, at.tangents)
    slopes = surface.target.slopes(at.facet, at.xi)
    shares = surface.target.weights(at.facet, at.xi) + np.einsum("pb,pbm->pm", along, slopes)
    return shares, across


def _divided(
    surface: ContactSurface, master: MasterFacets | RigidMaster, where: Floats
) -> tuple[Longs, Floats, Floats]:
    """Facets (p,), reference coordinates (p, α) and reference weights (p,) of all points."""
    count, shape = len(where), surface.shape
    if shape.directions == 1:
        return _segments(master, where)
    xi, weight = _parts(shape.cell)
    facet = np.repeat(np.arange(count), len(xi))
    return facet, np.tile(xi, (count, 1)), np.tile(weight, count)


def _segments(master: MasterFacets | RigidMaster, where: Floats) -> tuple[Longs, Floats, Floats]:
    """The points of segments, divided where master nodes are opposite."""
    ends: Floats = np.empty((0, 2))
    length = 0.0
    if isinstance(master, MasterFacets):
        # Kinks of the master's shape functions, projected onto the chords of the slave.
        ends = master.position[np.unique(master.facets[:, :2])]
        length = float(master.sizes().max())
    start = where[:, 0]
    chord = where[:, 1] - start
    squared = np.einsum("fi,fi->f", chord, chord)
    share = np.einsum("fi,ni->fn", chord, ends) - np.einsum("fi,fi->f", chord, start)[:, None]
    share = share / squared[:, None]
    apart = ends[None] - start[:, None] - share[..., None] * chord[:, None]
    reach = REACH * max(float(np.sqrt(squared.max(initial=0.0))), length)
    near = np.linalg.norm(apart, axis=2) <= reach
    facet, node = np.nonzero(near & (share > _SHORT) & (share < 1.0 - _SHORT))
    every = np.arange(len(where))
    number = np.concatenate([every, facet, every])
    place = np.concatenate([np.zeros(len(where)), share[facet, node], np.ones(len(where))])
    order = np.lexsort([place, number])
    number, place = number[order], place[order]
    parts = np.nonzero((number[1:] == number[:-1]) & (np.diff(place) > _SHORT))[0]
    points, weights = np.polynomial.legendre.leggauss(_GAUSS)
    part = place[parts + 1] - place[parts]
    xi = place[parts][:, None] + 0.5 * (1.0 + points) * part[:, None]
    weight = 0.5 * weights * part[:, None]
    return np.repeat(number[parts], _GAUSS), xi.reshape(-1, 1), weight.reshape(-1)


def _parts(cell: str) -> tuple[Floats, Floats]:
    """A rule (p, α), (p,) on a reference face that is divided into equal parts."""
    xi, weight = basix.make_quadrature(basix.CellType[cell], _DEGREE)
    steps = np.stack(np.meshgrid(*[np.arange(_PARTS)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    corners, turned = steps, np.empty((0, 2))
    if cell == "triangle":
        corners = steps[steps.sum(axis=1) < _PARTS]
        turned = steps[steps.sum(axis=1) < _PARTS - 1] + 1.0
    # A triangle falls into upright parts and, between them, ones turned by half a turn.
    upright = (corners[:, None] + xi).reshape(-1, 2)
    points = np.concatenate([upright, (turned[:, None] - xi).reshape(-1, 2)]) / _PARTS
    return points, np.tile(weight / _PARTS**2, len(corners) + len(turned))


def _offset(offset: Floats, tangents: Floats) -> tuple[Floats, Floats]:
    """Components (p, α) and (p,) of offsets (p, i) from the places with tangents (p, α, i)."""
    metric = np.einsum("pai,pbi->pab", tangents, tangents)
    along = solve_small(metric, np.einsum("pai,pi->pa", tangents, offset))
    across = np.einsum("pi,pi->p", offset, unit_normals(tangents))
    return along, across / np.sqrt(metric[:, 0, 0]) if tangents.shape[1] == 1 else across


_TURN_LEFT = np.array([[0.0, -1.0], [1.0, 0.0]])
_FLAT = 1e-10  # offset along the normal, over the length of a facet, that is none


class TieTerm(ContactTerm):
    """Residual, tangent and energy of one tied pair; it has no history and no friction.

    Attributes:
        tied_area: (v,), c_A: m, m² or, of rings, m².
    """

    tied = True

    def __init__(self, surface: ContactSurface, penalty: float | Floats) -> None:
        """Tie what lies beside each other undeformed; collective.

        Args:
            penalty: Pa/m: one number, or one for each slave vertex (v,).

        Raises:
            ValueError: on every rank, if nothing of the slave lies beside the master.
        """
        super().__init__(surface, FrictionlessLaw(), penalty)
        surface.follows = False  # what is tied stays where it is
        self._points = tie_points(surface)
        self.tied_area = self._vertex_sums(self._points.weight)
        if not np.any(self.tied_area > 0.0):
            raise ValueError("no point of the slave lies beside the master, so nothing is tied")
        self._matrix = self._linear_part()
        across = np.abs(self._points.across)
        self._bulges = surface.dim == 3 and bool(np.any(across > _FLAT * surface.facet_length))
        at = surface.project(surface.slave.position, surface.master.position)
        self._covered = self.tied_area[surface.vertices.of_point].min(axis=1) > 0.0
        self._covered &= at.on_surface
        self._normals: Floats = np.zeros((len(self._points.weight), surface.dim))
        if self._bulges:
            self._normals = self._point_normals(surface.master.position)

    @property
    def share(self) -> float:
        """Tied share of the slave's area."""
        return float(self.tied_area.sum() / self.surface.vertices.area.sum())

    # -- jumps --------------------------------------------------------------------------------

    def _vertex_sums(self, values: Floats) -> Floats:
        """Σ_p N_A f_p (v,) of point values (p,), over all ranks; collective."""
        points, vertices = self._points, self.surface.vertices
        weighted = (points.vertex_shape * values[:, None]).reshape(-1)
        local = np.bincount(points.of_point.reshape(-1), weighted, minlength=vertices.count)
        return vertices.total(local.astype(np.float64, copy=False))

    def _linear_part(self) -> scipy.sparse.csr_matrix:
        """B (v·i, n·j) of this rank's points, without the change of normals in space.

        Of a tool the nodes are its control points.
        """
        points, target = self._points, self.surface.target
        straight = np.concatenate([points.shape, -points.master], axis=1)
        dim = self.surface.dim
        out = scipy.sparse.kron(self._spread(straight), np.eye(dim))
        if dim == 2 and points.across.any():
            slopes = target.slopes(points.facet, points.xi)
            across = -points.across[:, None] * slopes[:, 0]
            turned = np.concatenate([np.zeros_like(points.shape), across], axis=1)
            out = out + scipy.sparse.kron(self._spread(turned), _TURN_LEFT)
        return scipy.sparse.csr_matrix(out)

    def _spread(self, shares: Floats) -> scipy.sparse.csr_matrix:
        """Σ_p w N_A c (v, n) of coefficients (p, a + m) of each point's nodes."""
        points, surface = self._points, self.surface
        values = (points.weight[:, None] * points.vertex_shape)[:, :, None] * shares[:, None, :]
        row, column = np.broadcast_arrays(points.of_point[:, :, None], self._rows()[:, None, :])
        place = row.reshape(-1), column.reshape(-1)
        shape = (surface.vertices.count, surface.first_master + len(surface.master.position))
        return scipy.sparse.csr_matrix((values.reshape(-1), place), shape=shape)

    def _rows(self) -> Longs:
        """Rows (p, a + m) of the nodes that move each point and its place on the master."""
        surface = self.surface
        stencil = surface.target.stencil[self._points.facet].astype(np.int64)
        return np.concatenate([self._points.rows, surface.first_master + stencil], axis=1)

    def _point_normals(self, nodes: Floats) -> Floats:
        """Master's normals (p, i) at the places of the points, on nodes (n, i), m."""
        return unit_normals(
            self.surface.target.places(self._points.facet, self._points.xi, nodes)[1]
        )

    def _jumps(self, values: Floats) -> Floats:
        """g_A (v, i), m, at displacements (n, i), m, of the pair's nodes; collective."""
        surface = self.surface
        master = surface.master_positions(values) - surface.master.position
        every = np.concatenate([values[: surface.first_master], master])
        moved = (self._matrix @ every.reshape(-1)).reshape(-1, surface.dim)
        if self._bulges:
            nodes = surface.master.position + values[surface.first_master :]
            turned = self._point_normals(nodes) - self._normals
            # In space o = along^α τ_α + across n: the part along n is not linear in the nodes, and
            # is taken anew.
            load = self._points.weight * self._points.across
            share = (self._points.vertex_shape * load[:, None])[:, :, None] * turned[:, None, :]
            np.subtract.at(moved, self._points.of_point, share)
        return self._means(moved)

    def _means(self, moved: Floats) -> Floats:
        """Sums (v, i) of this rank's points over all ranks, divided by c_A; collective."""
        total = self.surface.vertices.total(np.ascontiguousarray(moved.T)).T
        return total / np.where(self.tied_area > 0.0, self.tied_area, 1.0)[:, None]

    def _gradient(self, values: Floats) -> scipy.sparse.csr_matrix:
        """B (v·i, n·j), this rank's part, at displacements (n, i), m."""
        carried = carried_by(self.surface, values)
        if carried is not None:
            return self._matrix @ carried.operator(self.surface.first_master)
        if not self._bulges:
            return self._matrix
        points, surface = self._points, self.surface
        nodes = surface.master.position + values[surface.first_master :]
        tangents = surface.target.places(points.facet, points.xi, nodes)[1]
        normal = unit_normals(tangents)
        metric = np.linalg.inv(np.einsum("pai,pbi->pab", tangents, tangents))
        slopes = surface.target.slopes(points.facet, points.xi)
        # δn = −τ^α (n·δτ_α), and o holds across · n.
        contravariant = np.einsum("pab,pbi,pam->pmi", metric, tangents, slopes)
        change = (points.weight * points.across)[:, None, None, None] * (
            contravariant[..., None] * normal[:, None, None, :]
        )
        blocks = points.vertex_shape[:, :, None, None, None] * change[:, None]
        axes, dim = np.arange(surface.dim), surface.dim
        row = dim * points.of_point[:, :, None, None, None] + axes[:, None]
        master = self._rows()[:, points.shape.shape[1] :]
        column = dim * master[:, None, :, None, None] + axes
        row, column = np.broadcast_arrays(row, column)
        place = row.reshape(-1), column.reshape(-1)
        more = scipy.sparse.csr_matrix((blocks.reshape(-1), place), shape=self._matrix.shape)
        return self._matrix + more

    def stiffness(self) -> Floats:
        """K_A (v,), Pa/m, of the vertices that are tied at present."""
        return np.where(self.tied_area > 0.0, self.penalty, 0.0) * float(self.active)

    # -- evaluation ---------------------------------------------------------------------------

    def evaluate_at(self, values: Floats, dt: float) -> ContactTrial:
        """The tie at displacements (n, i), m, of the pair's nodes; collective."""
        surface = self.surface
        slave = values[surface.slave_rows]
        points = surface.slave_positions(slave)
        at = self._places(points, surface.master_positions(values))
        jump = self._jumps(values)
        # Jumps are means over what is tied of a vertex's area; as a traction at points, which is
        # per area of all facets, the pull counts for that share only.
        pull = self.stiffness()[:, None] * jump
        carried = self.tied_area / surface.vertices.area
        traction = -np.stack(
            [surface.vertices.at_points(carried * pull[:, i]) for i in range(surface.dim)], axis=1
        )
        # Nothing slips; the law's answer to that is there for all that reads trials of any contact.
        none = np.zeros(len(points))
        slip = np.zeros_like(points)
        response = self.law.update(slip, dt, none, none, self.state.friction, rate_dependent=False)
        return ContactTrial(
            position=points,
            area_ratio=surface.slave_area_ratio(surface.slave_tangents(slave), points),
            projection=at,
            kinematics=ContactKinematics(at.normal, at.gap, at.on_surface, slip, slip, slip.copy()),
            normal_contact=self._normal_contact(at, traction, jump),
            film=none,
            traction=traction,
            response=response,
            dt=dt,
            of_point=surface.vertices.of_point,
            pull=pull,
            moved=values,
            carried=carried_by(surface, values),
        )

    def _evaluate(self, values: Floats, dt: float, mode: ContactMode) -> ContactTrial:
        return self.evaluate_at(values, dt)

    def _places(self, points: Floats, nodes: Floats) -> Projection:
        """The places of the slave points on the master, where they have always been."""
        facet, xi = self.state.facet, self.state.xi
        foot, tangents = self.surface.target.places(facet, xi, nodes)
        master = self.surface.master
        if isinstance(master, RigidMaster):  # the tool's place of each point, which its force is at
            foot = master.surface.shares(self.surface.slave.position) @ nodes
        normal = unit_normals(tangents)
        gap = np.einsum("qi,qi->q", points - foot, normal)
        clamped = np.zeros(len(points), dtype=bool)
        closed = self._covered & self.active
        return Projection(facet, xi, foot, normal, tangents, gap, clamped, closed)

    def _normal_contact(self, at: Projection, traction: Floats, jump: Floats) -> NormalContact:
        """The traction along the normal, tension negative, and the length of the jump as depth."""
        pressure = np.einsum("qi,qi->q", traction, at.normal)
        depth = np.linalg.norm(jump, axis=1)
        held = (self.tied_area > 0.0) & self.active
        nodal = np.where(held, self.penalty * depth, 0.0)
        return NormalContact(at.on_surface, pressure, pressure, -depth, nodal, held)

    def commit(self, trial: ContactTrial) -> None:
        """Nothing is remembered."""
        self._last = None

    def adopt(self, state: ContactState) -> None:
        """Nothing is remembered."""
        self._last = None

    # -- forces -------------------------------------------------------------------------------

    def forces(self, trial: ContactTrial) -> Floats:
        """Residual Bᵀ s (n, i), N per unit thickness, of this rank's points at the pair's nodes."""
        assert trial.pull is not None and trial.moved is not None
        force = self._gradient(trial.moved).T @ trial.pull.reshape(-1)
        return force.reshape(-1, self.surface.dim)

    def forces_at_nodes(self, trial: ContactTrial) -> tuple[Longs, Floats, float]:
        """See :class:`ContactTerm`; a tool's angle counts not."""
        forces = self.forces(trial)
        each = forces if trial.carried is None else forces[:-1]
        return self.surface.nodes, forces, float(np.sum(each**2))

    def stiffness_times(self, values: Floats) -> Floats:
        """Stiffness of the undeformed tie times displacements (n, i) of the pair; collective."""
        gradient = self._gradient(np.zeros_like(values))
        moved = (gradient @ values.reshape(-1)).reshape(-1, self.surface.dim)
        pull = self.stiffness()[:, None] * self._means(moved)
        force = gradient.T @ pull.reshape(-1)
        return force.reshape(-1, self.surface.dim)

    def roundoff_squared(self, x: PETSc.Vec, trial: ContactTrial) -> float:
        """Square of the force, N per unit thickness, that rounding alone leaves here; collective.

        Of points that have moved by u each sum of the jump is rounded by about ε |u|. What has
        moved further than the slave is long counts as moved by that.
        """
        longest = float(np.ptp(self.surface.vertices.position, axis=0).max())
        # |B| |u| bounds the size of the sums that are rounded; ε of it is their error.
        moved = np.minimum(np.abs(self.surface.gather(x)), longest)
        plain = abs(self._gradient(np.zeros_like(moved)))
        jump = (plain @ moved.reshape(-1)).reshape(-1, self.surface.dim)
        area = np.where(self.tied_area > 0.0, self.tied_area, 1.0)
        pull = (self.stiffness() / area)[:, None] * jump
        force = np.finfo(float).eps * (plain.T @ pull.reshape(-1))
        return float(force @ force)

    def add_tangent(self, trial: ContactTrial, entries: Entries) -> list[Coupling]:
        """See :class:`ContactTerm`; nothing of it is added in place."""
        return [self.coupling(trial)]

    def coupling(self, trial: ContactTrial) -> Coupling:
        """Bᵀ (K/c) B; a vertex at the seam of two ranks needs the whole row on both; collective."""
        assert trial.moved is not None
        left = self._gradient(trial.moved)
        right, columns = self._whole(left)
        area = np.where(self.tied_area > 0.0, self.tied_area, 1.0)
        scale = np.repeat(self.stiffness() / area, self.surface.dim)
        product = (scipy.sparse.diags(scale) @ left).T.tocsr() @ right
        if trial.carried is not None:
            product = product + self._bending(trial, trial.carried, len(columns))
        return Coupling(self.surface.nodes, columns, product)

    def _bending(
        self, trial: ContactTrial, carried: Carried, columns: int
    ) -> scipy.sparse.csr_matrix:
        """What the angle's second derivatives add (n·i, columns·j), N/m, on this rank."""
        assert trial.pull is not None
        surface, dim = self.surface, self.surface.dim
        force = (self._matrix.T @ trial.pull.reshape(-1)).reshape(-1, dim)
        block = carried.bending(force[surface.first_master :])[0, 1, 0, 1, 0]
        angle, shape = dim * (surface.first_master + 1), (dim * len(surface.nodes), dim * columns)
        return scipy.sparse.csr_matrix(([block], ([angle], [angle])), shape=shape)

    def coupled_pairs(self) -> Longs:
        """Pairs (p, 2) of different global nodes that the tangent couples; collective."""
        points = self._points
        count = points.rows.shape[1] + self.surface.target.stencil.shape[1]
        every = np.ones((len(points.weight), count))
        # Divided by the weights that `_spread` multiplies by: positive numbers of the order of 1,
        # which neither cancel nor vanish in the pattern.
        left = self._spread(every / np.maximum(points.weight, 1e-300)[:, None])
        if isinstance(self.surface.master, RigidMaster):
            nodes = scipy.sparse.identity(self.surface.first_master)
            tool = np.ones((len(self.surface.master.position), 2))
            left = left @ scipy.sparse.block_diag([nodes, tool], format="csr")
        ones = scipy.sparse.csr_matrix(scipy.sparse.kron(left, np.eye(self.surface.dim)))
        right, columns = self._whole(ones)
        dim = self.surface.dim
        pattern = (left.T @ right[::dim, ::dim]).tocoo()
        pairs = np.stack([self.surface.nodes[pattern.row], columns[pattern.col]], axis=1)
        pairs = np.unique(np.sort(pairs, axis=1), axis=0)
        return pairs[pairs[:, 0] != pairs[:, 1]]

    def _whole(self, rows: scipy.sparse.csr_matrix) -> tuple[scipy.sparse.csr_matrix, Longs]:
        """Rows of vertices with the other ranks' parts, and their columns' nodes; collective."""
        surface = self.surface
        return completed(rows, surface.vertices, self._points.of_point, surface.nodes, surface.dim)

    def interface_energy(self, trial: ContactTrial) -> float:
        """Energy of the penalty, this rank's part, J per unit thickness."""
        assert trial.pull is not None
        stiffness = np.where(self.stiffness() > 0.0, self.stiffness(), 1.0)
        squared = np.einsum("vi,vi->v", trial.pull, trial.pull) / stiffness
        share = 0.5 * squared * self.tied_area / self.surface.vertices.area
        return float(self.surface.slave.weight @ self.surface.vertices.at_points(share))


__all__ = ["TiePoints", "TieTerm"]
