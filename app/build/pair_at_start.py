"""A contact before anything has moved: what is refused of it, and what may surprise."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from tribox.app.case.boundary import COMPONENTS
from tribox.app.case.case import Case
from tribox.app.case.contact import DRAWN, Contact
from tribox.app.case.time_tables import TimeTable
from tribox.app.case.tools import Tool
from tribox.app.equilibrium.unknowns import place_text
from tribox.app.errors import InputError
from tribox.geometry.surfaces.body_facets import outward_facets
from tribox.geometry.surfaces.facets import Bools, Floats, unit_normals
from tribox.geometry.surfaces.projection import Projection
from tribox.geometry.surfaces.smoothing import corner_spacing
from tribox.geometry.surfaces.surface import ContactSurface, RigidMaster

ACROSS = 0.9  # component of the normal below which a motion along an axis lets bodies slide
CORNERED = 1.9  # spacing of a master's corners over the length of slave facets that feels them
EXACT = 10.0  # what chords change over the clearance from which on that is none but rounding
OFF_FIT = 0.02  # mean gap over interference from which a fit is said to be drawn otherwise
CHORDED = 0.05  # what chords take of a clearance, over it, from which they are told of
WAVED_FIT = 0.2  # height of a master's chords over interference that sliding over them is felt from
OVERLAP = 0.01  # depth over facet length up to which bodies only touch at the start
DENTED = 1e-4  # depth over facet length from which bodies are said to press at the start
APART = 2.0  # distance over facet length from which bodies are said to start apart
COARSE = 3.0  # length of slave facets over that of master facets from which they are too coarse
GRADED = 0.9  # length of a slave's facets near the master over their mean that tells them apart
ROUND = 0.5  # length of slave facets over the radius of a tool from which they are too coarse
SAME = 0.5  # cosine of the angle between outward normals from which they point the same way
ACROSS_FROM = -np.cos(np.radians(80.0))  # cosine of normals below which they oppose each other
# Angles, rad, between neighbouring facets of a master that are a round one's: from about 5 to 20
# degrees a surface may be drawn with corners, and more surely is.
STRAIGHT, SHARP = 1e-3, 0.35

CHORDS = (
    "; chords of arcs overlap so where their ends do not line up: a drawing of order = 2 keeps arcs"
)

TURN = {
    "plane": "its normal points out of it, towards the body",
    "polyline": "going along it, the body is on the left",
    "circle": "inside = true is for a body inside it",
    "cylinder": "inside = true is for a body inside it",
    "sphere": "inside = true is for a body inside it",
    "mesh": "turned_over = true turns it over",
}
"""How each shape of a tool says on which side the body is."""


@dataclass(frozen=True, slots=True)
class Corners:
    """Corners of a round master made of facets, as the slave beside it meets them."""

    # largest distance between corners over the length of the slave's facets beside them; 0 without
    # corners
    ratio: float
    degrees: float  # largest angle at which facets meet there
    height: float  # m, of arcs over the chords between such corners


@dataclass(frozen=True)
class PairAtStart:
    """The two surfaces of a contact at time 0; all that is asked of them is collective."""

    place: str  # of the contact in the case, "contact.0"
    contact: Contact  # its table
    surface: ContactSurface  # the pair
    at: Projection  # the slave's points on the master

    # -- How far apart, how fine, how round ---------------------------------------------------

    @cached_property
    def overlap(self) -> float:
        """Depth, m, of the deepest of the slave's points inside the master; 0 if none is."""
        return self._largest(-self.at.gap, self.at.on_surface)

    def where_deepest(self) -> str:
        """The place, as drawn, of that point, in words."""
        depth = np.where(self.at.on_surface, -self.at.gap, 0.0)
        at = int(np.argmax(depth)) if len(depth) else -1
        mine = (float(depth[at]), *self.surface.slave.position[at]) if at >= 0 else (0.0,)
        return place_text(max(self._comm.allgather(mine))[1:])

    @cached_property
    def distance(self) -> float:
        """Between the surfaces, m; infinite if no slave point is above the master."""
        return self._least(np.abs(self.at.gap), self.at.on_surface)

    @cached_property
    def lengths(self) -> tuple[float, float]:
        """Mean lengths, m, of slave and master facets where they are near.

        That of the slave is the mean of all where these are no finer, or none is near; that of a
        tool, or of a master that is not near, is infinite.
        """
        length, master = self.surface.slave.facet_length, self.surface.master
        near = self._within(length)
        beside = np.inf if isinstance(master, RigidMaster) else master.sizes()[self.at.facet]
        sums = [np.ones(len(length)), length, near, near * length, np.where(near, beside, 0.0)]
        count, whole, count_near, fine, other = self._comm.allreduce(
            np.array([np.sum(one) for one in sums])
        )
        if count_near == 0.0:
            return self.surface.facet_length, np.inf
        # All facets have as many points: means over these scale the mean over facets.
        share = (fine / count_near) / (whole / count)
        graded = share if share < GRADED else 1.0
        return graded * self.surface.facet_length, other / count_near

    def corners(self, distance: float) -> Corners:
        """Corners between `STRAIGHT` and `SHARP` of a faceted master within ``distance``, m."""
        at, surface, master = self.at, self.surface, self.surface.master
        if isinstance(master, RigidMaster) or self.contact.smoothing_angle is not None:
            return Corners(0.0, 0.0, 0.0)
        spacing, angle = corner_spacing(
            surface.shape, master.facets, master.position, STRAIGHT, SHARP
        )
        near = at.on_surface & (at.gap < distance + master.sizes()[at.facet])
        # A fine slave facet in the middle of a chord meets none of its corners.
        inward = -surface.shape.excess(at.xi) * master.widths()[at.facet]
        near &= inward < surface.slave.facet_length
        ratio = np.where(near, spacing[at.facet] / surface.slave.facet_length, 0.0)
        worst = int(np.argmax(ratio)) if len(ratio) else -1
        mine = (0.0, 0.0, 0.0)
        if worst >= 0 and ratio[worst] > 0.0:
            facet = at.facet[worst]
            # An arc that turns by ω over a chord c stands c ω/8 over it.
            height = spacing[facet] * angle[facet] / 8.0
            mine = (float(ratio[worst]), float(angle[facet]), float(height))
        largest, turned, height = max(self._comm.allgather(mine))
        return Corners(largest, float(np.degrees(turned)), height)

    def coarseness(self) -> float:
        """Length of slave facets over that of master facets where it is largest.

        In space long facets may lie across those of the master: of each slave facet the direction
        counts in which it reaches over the most master facets; the mean of all over the master.
        """
        surface, master = self.surface, self.surface.master
        mean = self.lengths[0] / self.lengths[1]
        if surface.dim == 2 or isinstance(master, RigidMaster):
            return mean
        over = np.flatnonzero(self._within(surface.slave.facet_length))
        facet, first = np.unique(surface.slave.facet[over], return_index=True)
        mesh_facet = surface.slave.mesh_facet[over[first]]
        _, slave = outward_facets(surface.space, surface.shape, mesh_facet)
        below = master.position[master.facets[self.at.facet[over[first]]]]
        # Of the affine pieces {x: xᵀ M⁻¹ x ≤ 1}; where the facets are not parallel, along the
        # master's.
        across = self._moments(slave) @ np.linalg.pinv(self._moments(below), rcond=1e-9)
        ratio = np.sqrt(np.linalg.eigvals(across).real.max(axis=1))
        total, count = self._comm.allreduce(np.array([ratio.sum(), len(facet)]))
        return max(mean, float(total / count)) if count else mean

    def _moments(self, position: Floats) -> Floats:
        """Second moments (f, i, i), m², of the corners of facets (f, a, i) about their middles."""
        corners = position[:, : self.surface.shape.corners]
        arm = corners - corners.mean(axis=1, keepdims=True)
        return np.einsum("fai,faj->fij", arm, arm)

    def _within(self, beyond: Floats | float) -> Bools:
        """Which of the slave's points (q,) are nearer than the nearest is, and so much, m, more."""
        return self.at.on_surface & (self.at.gap < self.distance + beyond)

    def _largest(self, values: Floats, where: Bools) -> float:
        """The largest of numbers (q,) of the slave's points on all ranks; 0 if there are none."""
        local = float(np.max(values, where=where, initial=0.0))
        return float(self._comm.allreduce(local, op=MPI.MAX))

    def _least(self, values: Floats, where: Bools) -> float:
        """The least of numbers (q,) of the slave's points on all ranks; infinite without any."""
        local = float(np.min(values, where=where, initial=np.inf))
        return float(self._comm.allreduce(local, op=MPI.MIN))

    @property
    def _comm(self) -> MPI.Comm:
        return self.surface.space.mesh.comm

    # -- What is refused -----------------------------------------------------------------------

    def check_facing(self, tool: Tool | None) -> None:
        """Refuse a slave that looks the way its master does where they are nearest (InputError).

        They press only if one turns over; ``tool``: the master's table; None: a body's surface.
        """
        # Surfaces that face each other have outward normals against one another, a cosine near −1.
        # At the master's ends the normal is the way to the point, whatever side that is on.
        at = self.at
        cosine = np.einsum("qi,qi->q", self._outward(), at.normal)
        beside = at.on_surface & ~at.clamped
        apart = np.abs(at.gap)
        beside &= apart <= self._least(apart, beside) + self.surface.facet_length
        counts = np.array([np.count_nonzero(beside), np.count_nonzero(beside & (cosine < SAME))])
        all_beside, facing = self._comm.allreduce(counts, op=MPI.SUM)
        if all_beside > 0 and facing == 0:
            slave, master = self.contact.slave, self.contact.master
            hint = f", or {master} is the wrong way round: {TURN[tool.shape]}" if tool else ""
            raise InputError(
                f"{self.place}: {slave} and {master} face the same way, so they cannot press on "
                f"each other; another surface is the slave{hint}"
            )

    def check_overlap(self, tool: Tool | None) -> None:
        """InputError on overlap before anything has moved; ``tool``: the master's table, if one."""
        depth, contact = self.overlap, self.contact
        if depth <= OVERLAP * self.surface.facet_length:
            return
        cure = self._on_chords()
        if tool is not None and depth > self.surface.facet_length:
            cure = (
                f"; move it off, unless {contact.master} is the wrong way round: {TURN[tool.shape]}"
            )
        if contact.smoothing_angle is not None:
            cure = (
                "; a smooth master bulges beyond its facets where flats and arcs meet: leave a gap "
                f"of {1.05 * depth:.2g} m, or lower smoothing_angle"
            )
        raise InputError(
            f"{self.place}: {contact.slave} starts {depth:.3g} m inside {contact.master} "
            f"at {self.where_deepest()}; the bodies may touch at the start, not overlap (but as a "
            f'press fit: interference = "{DRAWN}"){cure}'
        )

    def _on_chords(self) -> str:
        """What to say of an overlap on a master that is round and made of facets.

        Nothing of one that is smoothed, which takes cells of the first order.
        """
        return CHORDS if self.corners(0.0).ratio > 0.0 else ""

    def _outward(self) -> Floats:
        """Outward normals (q, i) of the slave's facets at their middles, undeformed."""
        shape = self.surface.shape
        _, position = outward_facets(self.surface.space, shape, self.surface.slave.mesh_facet)
        middle = np.mean(shape.points[: shape.corners], axis=0)
        tangents = np.einsum("ba,qai->qbi", shape.first(middle[None])[0], position)
        return unit_normals(tangents)

    # -- Notes: each yields a line, or none ----------------------------------------------------

    def notes(self, case: Case, alone: bool, unable: str | None) -> Iterator[str]:
        """Every line there is to say on these surfaces.

        ``alone``: no other surface of the slave's body meets this master; ``unable``: why not
        smooth.
        """
        yield from self._notes_on_distance()
        if alone:
            yield from self._note_on_facing()
        yield from self._note_on_radius()
        yield from self._note_on_fit()
        if self.contact.interference is None:
            yield from self._note_on_clearance()
            if case.acts_in(self.contact, case.stage[0].name):
                yield from self._note_on_overlap()
        yield from self._notes_on_corners(case, unable)

    def _notes_on_distance(self) -> Iterator[str]:
        """Lines on surfaces far apart, and on a slave too coarse to see its master."""
        if self.distance > APART * self.lengths[0]:
            far = np.isfinite(self.distance)
            where = f"{self.distance:.3g} m apart" if far else "beside each other"
            yield f"{self.place}: {self.contact.slave} and {self.contact.master} start {where}"
        ratio = self.coarseness()
        if ratio > COARSE:
            yield (
                f"{self.place}: the facets of the slave {self.contact.slave} are {ratio:.2g} times "
                f"as long as those of {self.contact.master}"
                f"{'' if self.surface.dim == 2 else ' in one direction'}, whose shape they cannot "
                "follow; refine the slave"
            )

    def _note_on_facing(self) -> Iterator[str]:
        """A line on surfaces that can press on each other only if one of them turns.

        No facet of the one has a normal that is opposed to that of a facet of the other, wherever
        they are: bodies that are moved without a turn do not press there.
        """
        at, slave = self.at, self._outward()
        cosine = np.einsum("qi,qi->q", slave, at.normal)
        beside = at.on_surface & ~at.clamped
        if self._least(cosine, beside) < ACROSS_FROM:
            return
        normals = np.concatenate(self._comm.allgather(np.unique(self._master_normals(), axis=0)))
        apart = cKDTree(normals).query(-slave)[0] if len(slave) else np.full(1, 2.0)
        # Of unit vectors d apart the cosine is 1 − d²/2; of one of them and the other's opposite,
        # less.
        least = 0.5 * self._comm.allreduce(float(np.min(apart)), op=MPI.MIN) ** 2 - 1.0
        if least > ACROSS_FROM:
            degrees = np.degrees(np.arccos(np.clip(least, -1.0, 1.0)))
            yield (
                f"{self.place}: no facet of {self.contact.slave} faces {self.contact.master}: "
                f"outward normals are up to {degrees:.3g} degrees apart (180 where surfaces meet), "
                "so they press only once one has turned; if none is to turn, name other surfaces "
                "(tribox mesh shows all)"
            )

    def _master_normals(self) -> Floats:
        """Outward normals (n, i) of the undeformed master; of facets, those this rank knows."""
        master, slave, dim = self.surface.master, self.surface.slave.position, self.surface.dim
        if not len(slave):
            return np.empty((0, dim))
        if isinstance(master, RigidMaster):
            outline = master.surface.outline(np.stack([slave.min(axis=0), slave.max(axis=0)]))
            corners = outline.points[outline.cells]
        else:
            corners = master.position[master.facets[:, : master.shape.corners]]
        with np.errstate(invalid="ignore"):  # triangles at the pole of a ball
            normals = unit_normals(corners[:, 1:dim] - corners[:, :1])
        return normals[np.isfinite(normals).all(axis=1)]

    def _note_on_radius(self) -> Iterator[str]:
        """A line on slave facets too long to follow the tightest rounding of a tool.

        Those count that are near the tool at the start, by half that radius beyond the nearest;
        where nothing is above the tool yet, all.
        """
        if not isinstance(self.surface.master, RigidMaster):
            return
        radius = self.surface.master.surface.least_radius
        near = self._within(ROUND * radius) | np.isinf(self.distance)
        length = self._largest(self.surface.slave.facet_length, near)
        if length > ROUND * radius * (1.0 + 1e-9):
            yield (
                f"{self.place}: the facets of the slave {self.contact.slave} are up to "
                f"{length / radius:.2g} times as long as the smallest radius of "
                f"{self.contact.master}, {radius:.3g} m, which they cannot follow; refine the "
                "slave where it bends round"
            )

    def _note_on_fit(self) -> Iterator[str]:
        """A line on a fit whose surfaces, as they are meshed, do not lie on each other.

        A cord that touches its plate along a line is drawn beside it: where one facet is nearer, in
        its own mean, than all are in theirs, its distance counts.
        """
        size = self._fit_size
        if size == 0.0:
            return
        at, slave = self.at, self.surface.slave
        near = at.on_surface & (np.abs(at.distance) < max(size, self.surface.facet_length))
        weight = slave.weight * near
        # Means by area of each facet, as one may lie nearer in its own mean than all do in theirs.
        areas = np.bincount(slave.facet, weight)
        moments = np.bincount(slave.facet, weight * np.where(near, at.distance, 0.0))
        moment, area = self._comm.allreduce(np.array([moments.sum(), areas.sum()]))
        mean = moment / area if area > 0.0 else 0.0
        own = np.sign(mean) * moments[areas > 0.0] / areas[areas > 0.0]
        nearest = self._comm.allreduce(float(np.min(own, initial=np.inf)), op=MPI.MIN)
        mean = np.sign(mean) * max(min(abs(mean), nearest), 0.0)
        if abs(mean) > OFF_FIT * size:
            where = "apart" if mean > 0.0 else "inside each other"
            yield (
                f"{self.place}: {self.contact.slave} and {self.contact.master} are not drawn "
                f"beside each other but in the mean {abs(mean):.2g} m {where}, "
                f"{100.0 * abs(mean) / size:.2g} % of the interference, which counts from there: "
                "chords of arcs do so (finer facets, on both surfaces at the same places), or the "
                "surfaces are drawn so"
            )

    @property
    def _fit_size(self) -> float:
        """Largest interference, m, that is given; 0 without one, or for one that is drawn."""
        fit = self.contact.interference
        return max(map(abs, fit.values)) if isinstance(fit, TimeTable) else 0.0

    def _note_on_overlap(self) -> Iterator[str]:
        """A line on surfaces that press before anything has moved."""
        advice = self._on_chords() if self.overlap > 0.0 else ""
        if self.overlap > DENTED * self.surface.facet_length:
            yield (
                f"{self.place}: {self.contact.slave} starts {self.overlap:.2g} m inside "
                f"{self.contact.master} at {self.where_deepest()} and presses there at once, which "
                "counts as no work: leave a gap, or let it come on as a press fit "
                f'(interference = "{DRAWN}"){advice}'
            )

    def _note_on_clearance(self) -> Iterator[str]:
        """A line on round surfaces that fit each other but for what their chords are off by.

        Of two radii that differ by c the gap is c + d·n, whatever the way d between the middles is,
        n the slave's normal. A chord h lies beside its arc by h²/12R in the mean.
        """
        surface, at, shape = self.surface, self.at, self.surface.shape
        if len(shape.points) > shape.corners:
            return
        normal, weight = self._outward(), surface.slave.weight * at.on_surface
        sizes, ways = np.linalg.eigh(self._comm.allreduce(normal.T @ (weight[:, None] * normal)))
        ways = ways[:, sizes > 1e-4 * sizes.sum()]  # not along the axis of a cylinder
        count = ways.shape[1]
        _, facets = outward_facets(surface.space, shape, surface.slave.mesh_facet)
        squares: Floats = self._chords(facets, ways)
        theirs: Floats = np.zeros(len(weight))
        master = surface.master
        if not isinstance(master, RigidMaster) and self.contact.smoothing_angle is None:
            theirs = self._chords(master.position[master.facets[at.facet]], ways)
        gap = at.gap * (weight > 0.0)
        basis = np.column_stack([np.ones(len(weight)), normal @ ways])
        columns = np.column_stack([basis, gap, surface.slave.position @ ways, theirs, squares])
        sums = self._comm.allreduce(columns.T @ (weight[:, None] * columns))
        own = slice(count + 1)
        if count < 2 or not np.linalg.cond(sums[own, own]) < 1e8:  # flat, or not above the master
            return
        known, squared = sums[own, count + 1 :], np.diag(sums)[count + 1 :]
        fit = np.linalg.solve(sums[own, own], known)
        left = (squared - np.sum(fit * known, axis=0)) / sums[0, 0]
        radius = np.trace(fit[1:, 1:-2]) / count
        master_off, own_off = sums[0, -2:] / sums[0, 0] / (12.0 * radius)
        off = own_off - master_off
        # Convex, the slave withdraws by its chords; the master does it the other way round.
        clearance = fit[0, 0] - off
        share = abs(off / clearance)
        # Along chords the gap has their sagittas, and its points are h/sqrt(12) from x = R n.
        uneven = left[0] > (0.2 * abs(clearance) + abs(own_off) + abs(master_off)) ** 2
        if uneven or left[1:-2].sum() > (0.2 * radius) ** 2 or share <= CHORDED:
            return
        play, part = f"{clearance:.2g}", f"{100.0 * share:.2g} %"
        if share > 1.0:
            play, part = "0" if share > EXACT else play, f"{abs(off):.2g} m"
        yield (
            f"{self.place}: {self.contact.slave} and {self.contact.master} are round and fit but "
            f"for {play} m, {'to' if off > 0.0 else 'of'} which chords "
            f"{'add' if off > 0.0 else 'take'} {part}: a given displacement is "
            "off by that, pressures under a force by up to a third of it, the area by half; a "
            "drawing of order = 2 keeps arcs, or shorter facets"
        )

    def _chords(self, position: Floats, ways: Floats) -> Floats:
        """Squares (f,), m², of chords that lie beside arcs as facets (f, a, i) do, turned as ways.

        Of second moments the corners of lines and quadrilaterals have three times those of the
        area between them, those of triangles four times: of a line h²/4 and h²/12.
        """
        corners = self.surface.shape.corners
        inside = 0.25 if corners == 3 else 1.0 / 3.0
        moments = np.einsum("fij,ik,jk->f", self._moments(position), ways, ways) / corners
        return np.asarray(6.0 * (1.0 - inside) * moments)

    def _notes_on_corners(self, case: Case, unable: str | None) -> Iterator[str]:
        """Lines on a faceted master whose corners a slave feels, or catches on as it slides.

        Args:
            unable: why the master cannot be smooth; None: it can.
        """
        corners, size = self.corners(self.distance), self._fit_size
        slave, master = self.contact.slave, self.contact.master
        if corners.ratio > CORNERED:
            yield (
                f"{self.place}: corners of {master}, of up to {corners.degrees:.2g} degrees, are "
                f"up to {corners.ratio:.2g} facets of the slave {slave} apart: each corner presses "
                'with a peak of its own; set smoothing_angle = "30 deg", and leave a small gap at '
                "the start, as a smooth master bulges; or draw the master with shorter facets "
                "(dividing its cells keeps the corners)"
            )
        if not self._slides(case):
            return
        if corners.height > WAVED_FIT * size > 0.0:
            yield (
                f"{self.place}: arcs of {master} stand {corners.height:.2g} m over its chords, "
                f"{100.0 * corners.height / size:.0f} % of the interference: forces wave as "
                f"{slave} slides over them; a drawing of order = 2 keeps arcs"
            )
        if self.surface.dim == 3 and 0.0 < corners.ratio <= CORNERED:
            cure = 'set smoothing_angle = "30 deg"'
            if unable is not None:
                cure = f"smoothing_angle {unable}; or draw {master} with shorter facets"
            yield (
                f"{self.place}: {slave} slides on {master}, which is round and whose facets meet "
                f"at {corners.degrees:.2g} degrees: the slave catches on their edges, forces wave, "
                f"and steps may fail; {cure}"
            )

    def _slides(self, case: Case) -> bool:
        """Whether boundaries move bodies across the mean normal of the pair, or turn them."""
        near = self._within(self.surface.facet_length)
        normal = self._comm.allreduce(self.at.normal[near].sum(axis=0))
        flat = np.abs(normal) <= ACROSS * np.linalg.norm(normal)
        for one in case.boundary:
            if one.rotation is not None or any(one.driven_keys()):
                return True
            for table in (one.displacement, one.velocity):
                for axis in np.nonzero(flat)[0]:
                    program = getattr(table, COMPONENTS[axis], None)
                    if isinstance(program, TimeTable) and any(program.values):
                        return True
        return False
