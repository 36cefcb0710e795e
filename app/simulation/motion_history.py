"""Motion of surfaces and bodies, and the forces on them: ``surfaces.csv`` and ``bodies.csv``.

Means are over the undeformed surface or body. Forces are what the surroundings do to a body. Where
two boundaries prescribe the same at a node that they share, its force is the first one's.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import dolfinx
import numpy as np
from mpi4py import MPI

from tribox.app.build.model import Model
from tribox.app.build.tools import extent
from tribox.app.case.boundary import COMPONENTS
from tribox.app.equilibrium.equilibrium import Equilibrium, load_residuals
from tribox.app.equilibrium.snapshot import Nodal, Snapshot, scattered
from tribox.app.equilibrium.supports import bonded_groups
from tribox.app.explicit.stepper import ExplicitStepper
from tribox.app.simulation.contact_resultants import ContactResultants
from tribox.forms.bodies.weights import body_weights, surface_weights
from tribox.geometry.surfaces.facets import Floats, Ints
from tribox.geometry.surfaces.surface import NodalVector

# -- Forces of supports, platens and loads on the bodies, unknown by unknown -----------------------


@dataclass(frozen=True, slots=True)
class OutsideForces:
    """What the surroundings do to the bodies, at a state or in the mean over an interval."""

    held: Floats  # (c,), N per unit thickness, on the unknowns of :func:`held_dofs`
    # of each load, those at nodes last, N likewise, on all local unknowns (n,): what this rank
    # gives, so that sums over ranks are whole
    loads: list[Floats]

    @classmethod
    def at(cls, problem: Equilibrium, held: Ints) -> OutsideForces:
        """The forces of the state that was evaluated last."""
        return cls(problem.unbalanced[held], [-load for load in load_residuals(problem)])


def held_dofs(problem: Equilibrium) -> Ints:
    """Owned unknowns that supports or platens act on, sorted."""
    parts = [part.dofs for part in problem.prescribed]
    parts += [platen.dofs for platen in problem.platens]
    return np.unique(np.concatenate([*parts, np.empty(0, dtype=np.int32)]))


class OutsideMean:
    """Mean of the outside forces over an interval of explicit steps.

    What holds an unknown balances the other forces on it and moves its mass.
    """

    def __init__(self, stepper: ExplicitStepper) -> None:
        self._stepper, problem = stepper, stepper.problem
        self._held = held_dofs(problem)
        self._mass = stepper.dynamics.mass[self._held]
        self._residual = np.zeros(len(self._held))
        self._pulls = np.zeros(len(problem.platens))
        self._loads = [np.zeros(len(problem.u.x.array)) for _ in stepper.load_residuals]
        self._time = 0.0
        self._speed, self._place = self._motion()

    def snapshot(self) -> Snapshot:
        """The sums so far; collective."""
        owned = len(self._stepper.dynamics.mass)
        sums = {"residual": self._residual, "speed": self._speed, "place": self._place}
        return {
            **{name: scattered(self._held, values, owned) for name, values in sums.items()},
            "pulls": self._pulls,
            "loads": [Nodal(self._collected(values)) for values in self._loads],
            "time": self._time,
        }

    def restore(self, kept: Snapshot) -> None:
        """Go on from what :meth:`snapshot` has seen."""
        self._residual, self._speed, self._place = (
            kept[name][self._held] for name in ("residual", "speed", "place")
        )
        self._pulls, self._time = kept["pulls"], kept["time"]
        for total, values in zip(self._loads, kept["loads"], strict=True):
            total[:] = 0.0
            total[: len(values)] = values

    def _collected(self, local: Floats) -> Floats:
        """Values (n,) of the owned unknowns, with what the ranks have for one another's."""
        vector = NodalVector(self._stepper.problem.space)
        vector.array[:] = local
        vector.collect_ghosts()
        return vector.owned.copy()

    def enter(self, dt: float) -> None:
        """Enter the step of ``dt`` (s) just made; local to the rank."""
        stepper = self._stepper
        self._time += dt
        self._residual += dt * stepper.residual[self._held]
        self._pulls += dt * stepper.loads.platens
        for total, load in zip(self._loads, stepper.load_residuals, strict=True):
            total -= dt * load

    def close(self) -> OutsideForces:
        """The means since the beginning; collective."""
        stepper, residual = self._stepper, self._residual / self._time
        speed, place = self._motion()
        # Newton's law in the mean over the interval: the support gives what the other forces leave,
        # the change of momentum, and what damping took, c m times the way moved.
        change = (speed - self._speed) + stepper.options.damping * (place - self._place)
        force = residual + self._mass * change / self._time
        whole = np.zeros(len(stepper.dynamics.mass))
        whole[self._held] = residual
        platens = stepper.problem.platens
        # A platen's nodes share its acceleration: what holds each to the others moves its own mass
        # with it.
        accelerations = self._pulls / self._time - stepper.dynamics.sums(whole)
        accelerations /= stepper.dynamics.platen_mass
        for platen, acceleration in zip(platens, accelerations, strict=True):
            at = np.searchsorted(self._held, platen.dofs)
            force[at] = residual[at] + self._mass[at] * acceleration
        return OutsideForces(force, [np.asarray(load / self._time) for load in self._loads])

    def _motion(self) -> tuple[Floats, Floats]:
        """Velocities, m/s, and displacements, m, of the unknowns that are held."""
        stepper = self._stepper
        return stepper.v[self._held].copy(), stepper.x.array_r[self._held].copy()


# -- Motion of surfaces and bodies, and the forces on them: ``surfaces.csv`` and ``bodies.csv`` ----

KEYS = ("step", "time", "stage")


class MotionHistory:
    """Rows of both tables, added together so that ranks talk once; ``extent``: m, of all bodies.

    ``held``: owned unknowns that :class:`OutsideForces` are wanted at.
    """

    def __init__(self, model: Model) -> None:
        """Find nodes, weights and who holds what; collective."""
        self._model, self._dim = model, model.problem.dim
        axes = COMPONENTS[: self._dim]
        self._turning = "xyz" if self._dim == 3 else "z"
        box = extent(model.named)
        self._middle: Floats = box.mean(axis=0)
        self.extent = float(np.linalg.norm(box[1] - box[0]))
        self.held = held_dofs(model.problem)
        slots = [tool.dofs[tool.here] for tool in model.problem.tools]
        self._on_bodies = np.setdiff1d(self.held, np.concatenate([self.held[:0], *slots]))
        self._means = _Means(model)
        self._forces = _SurfaceForces(model, self._means, self.held)
        self._bodies = [solid.name for solid in model.problem.solids]
        self._groups = [
            [self._bodies.index(solid.name) for solid in group]
            for group in bonded_groups(model.problem)
        ]
        self._on = [model.named.bodies_of(surface) for surface in self._means.surfaces]
        self._pairs = [
            [model.named.body_of(s) for s in (pair.slave, pair.master) if s not in model.case.tools]
            for pair in model.case.contact
        ]
        motion = [f"{name}_{a}" for name in ("displacement", "velocity", "force") for a in axes]
        moments = [f"moment_{a}" for a in self._turning]
        about = [f"centre_{a}" for a in axes]
        radial = ["radial_force"] if model.section == "axisymmetric" else []
        self.surface_columns = (*KEYS, "surface", "body", *motion, *radial, *moments, *about)
        forces = [f"{name}_force_{a}" for name in ("boundary", "contact") for a in axes]
        self.body_columns = (*KEYS, "body", *motion[: 2 * self._dim], *forces)
        self.surface_rows: list[tuple[int | float | str, ...]] = []
        self.body_rows: list[tuple[int | float | str, ...]] = []

    def add(
        self,
        key: tuple[int, float, str],
        motion: tuple[Floats, Floats],
        outside: OutsideForces,
        pairs: Sequence[ContactResultants],
    ) -> None:
        """Add a step's rows: ``key`` of number, time, stage; u, m, and velocities, m/s, (n,)."""
        here = self._means.of(*motion)
        there = self._forces.sums(outside)  # of the surfaces, and then of what acts on whole bodies
        local = np.concatenate([here.reshape(-1), there.reshape(-1)])
        total = self._model.problem.comm.allreduce(local)
        means = total[: here.size].reshape(here.shape)
        forces = total[here.size :].reshape(there.shape) * self._model.thickness
        self._add_surfaces(key, means[: len(self._on)], forces)
        self._add_bodies(key, means[len(self._on) :], forces, pairs)

    def fastest(self, velocity: Floats) -> float:
        """Speed, m/s, of the fastest node of supports and platens, from (n,), m/s; collective."""
        held = self._on_bodies
        squares = np.bincount(held // self._dim, velocity[held] ** 2, minlength=1)
        fastest = float(np.sqrt(squares.max()))
        return self._model.problem.comm.allreduce(fastest, op=MPI.MAX)

    @property
    def surfaces(self) -> list[str]:
        """Names of the surfaces, in the order of their rows."""
        return self._means.surfaces

    def force_balance(
        self, stages: Collection[str], noise: float = 0.0, largest: float = 0.0
    ) -> float | None:
        """Largest resultant force on a body over the largest force of the same stages; or None.

        Bodies that are bonded count as one: the forces between them are in no table. A moment
        counts as a pair of forces at the ends of its lever: under moments alone the resultant of
        each surface is what the solver leaves. ``noise``: N, of rounding, or springs in no table;
        ``largest``: N, of forces in other tables: those on both sides of a body cancel in its row.
        """
        dim, stage = self._dim, KEYS.index("stage")
        forces = np.array([row[-2 * dim :] for row in self.body_rows if row[stage] in stages])
        largest = np.abs(forces).max(initial=max(largest, self._largest_on_surfaces(stages)))
        if largest == 0.0 or largest <= noise:
            return None
        resultant: Floats = forces[:, :dim] + forces[:, dim:]
        resultant = resultant.reshape(-1, len(self._bodies), dim)
        of_groups = np.stack([resultant[:, group].sum(axis=1) for group in self._groups])
        most = float(np.abs(of_groups).max())
        return 0.0 if most <= noise else most / largest

    def _largest_on_surfaces(self, stages: Collection[str]) -> float:
        """Largest component of a force on a surface, N, or force of a moment (see `force_balance`).

        Radial forces on bodies of revolution count too.
        """
        names = ("radial_force", *(f"force_{axis}" for axis in COMPONENTS))
        columns = [self.surface_columns.index(n) for n in names if n in self.surface_columns]
        stage = KEYS.index("stage")
        rows = [row for row in self.surface_rows if row[stage] in stages]
        forces = [abs(float(row[at])) for row in rows for at in columns]
        return max([*forces, *(self._force_of_moment(row) for row in rows)], default=0.0)

    def _force_of_moment(self, row: Sequence[Any]) -> float:
        """Moment on a surface over the largest lever that the bodies offer about its centre, N."""
        turned, dim = len(self._turning), self._dim
        moment, centre = row[-turned - dim : -dim], row[-dim:]
        lever = self.extent + np.linalg.norm(np.array(centre) - self._middle)
        return float(np.linalg.norm(moment) / lever)

    def of_surface(self, name: str, column: str) -> Floats:
        """Values (r,) of a column for one surface, row by row."""
        return _column(self.surface_columns, self.surface_rows, "surface", name, column)

    def of_body(self, name: str, column: str) -> Floats:
        """Values (r,) of a column for one body, row by row."""
        return _column(self.body_columns, self.body_rows, "body", name, column)

    def _add_surfaces(self, key: tuple[int, float, str], means: Floats, forces: Floats) -> None:
        """Rows of the surfaces: ``forces`` (s, 3 + 3) are those, and moments about the origin."""
        dim, round_axis = self._dim, self._model.section == "axisymmetric"
        names = zip(self._means.surfaces, self._on, strict=True)
        for number, (name, bodies) in enumerate(names):
            centre = self._forces.centre(number, means[number, :dim])
            force: Floats = forces[number, :3].copy()
            arm = np.append(centre, [0.0] * (3 - dim))
            # Moments are summed about the origin, which needs no centre beforehand, and moved: M_C
            # = M_0 − C × F.
            moment: Floats = forces[number, 3:] - np.cross(arm, force)
            radial = [force[0]] if round_axis else []
            if round_axis:  # What points outwards cancels round the ring.
                force[0], moment = 0.0, np.zeros(3)
            turned = moment if dim == 3 else moment[2:]
            values = (*means[number].reshape(-1), *force[:dim], *radial, *turned, *centre)
            on = " and ".join(bodies)
            self.surface_rows.append((*key, name, on, *map(float, values)))

    def _add_bodies(
        self,
        key: tuple[int, float, str],
        means: Floats,
        forces: Floats,
        pairs: Sequence[ContactResultants],
    ) -> None:
        """Rows of the bodies: forces of all boundaries, gravity among them, and of all contacts.

        The force of a surface that spreads over bonded bodies is counted to the first of them.
        """
        dim, thickness = self._dim, self._model.thickness
        pushed = {name: np.zeros(dim) for name in self._bodies}
        pressed = {name: np.zeros(dim) for name in self._bodies}
        on = [*(bodies[0] for bodies in self._on), *self._forces.bodies]
        for number, name in enumerate(on):
            pushed[name] += forces[number, :dim]
        for bodies, pair in zip(self._pairs, pairs, strict=True):
            for name, sign in zip(bodies, (1.0, -1.0), strict=False):  # a tool is no body
                pressed[name] += sign * np.array(pair.force) * thickness
        for name, mean in zip(self._bodies, means, strict=True):
            if self._model.section == "axisymmetric":
                pushed[name][0] = 0.0
            values = (*mean.reshape(-1), *pushed[name], *pressed[name])
            self.body_rows.append((*key, name, *map(float, values)))


def _column(
    columns: Sequence[str], rows: Sequence[Sequence[Any]], kind: str, name: str, column: str
) -> Floats:
    which, at = columns.index(kind), columns.index(column)
    return np.array([row[at] for row in rows if row[which] == name])


class _Means:
    """Mean displacements and velocities of surfaces with a boundary or released, and of bodies.

    Attributes:
        surfaces: names, in the order in which the case names them.
    """

    def __init__(self, model: Model) -> None:
        problem, named, section = model.problem, model.named, model.section
        released = model.loads.nodal_surfaces if model.loads is not None else ()
        self.surfaces = list(dict.fromkeys([*(b.surface for b in model.case.boundary), *released]))
        self._dim, space = problem.dim, problem.space
        weights = [
            named.groups[s].shares(space)
            if s in named.groups
            else surface_weights(space, named.facets(s), section)
            for s in self.surfaces
        ]
        weights += [body_weights(space, solid.cells, section) for solid in problem.solids]
        sizes = problem.comm.allreduce(np.array([w.sum() for w in weights]))
        self._parts = []
        for weight, size in zip(weights, sizes, strict=True):
            nodes = np.nonzero(weight)[0]
            self._parts.append((nodes, weight[nodes] / size))

    def of(self, *vectors: Floats) -> Floats:
        """This rank's part of the means (s, k i) of k vectors of unknowns (n,)."""
        nodal = [v.reshape(-1, self._dim) for v in vectors]
        return np.array(
            [np.concatenate([w @ v[nodes] for v in nodal]) for nodes, w in self._parts]
        ).reshape(len(self._parts), len(nodal) * self._dim)


class _SurfaceForces:
    """Sums of forces, and of their moments, over surfaces with a boundary and bodies with weight.

    Attributes:
        bodies: names of those that loads act on all over; they come after the surfaces.
    """

    def __init__(self, model: Model, means: _Means, held: Ints) -> None:
        assert model.loads is not None
        self._problem, self._loads = model.problem, model.loads
        forms = model.loads.forms
        self.bodies = list(dict.fromkeys(name for name in forms.bodies if name))
        self._surfaces = len(means.surfaces)
        self._count = self._surfaces + len(self.bodies)
        self._number = {name: number for number, name in enumerate(means.surfaces)}
        self._reference = model.problem.space.tabulate_dof_coordinates()
        self._held, self._acting = held, model.problem.constraints.controls
        self._owner = self._owners()
        # Of each load the number of its surface or body, and the nodes (n,) that it acts on, ghosts
        # included.
        self._pressed = [
            self._on_surface(model, surface) if surface else self._on_body(model, body)
            for surface, body in zip(forms.surfaces, forms.bodies, strict=True)
        ]
        for load, name in zip(model.loads.nodal_loads, model.loads.nodal_surfaces, strict=True):
            nodes = np.unique(load.dofs // model.problem.dim).astype(np.int32)
            self._pressed.append((self._number[name], nodes))
        self._centres, self._fixed = self._centres_of(model, means)

    def _owners(self) -> Ints:
        """Number of the surface whose force each held unknown's is; −1 for the axis."""
        owner = np.full(len(self._held), -1, dtype=np.int32)
        for constraint in reversed(self._loads.constraints):
            if constraint.part.acts:
                number = self._number.get(constraint.surface, -1)
                owner[np.searchsorted(self._held, constraint.dofs)] = number
        return owner

    def _on_surface(self, model: Model, surface: str) -> tuple[int, Ints]:
        space, facets = model.problem.space, model.named.facets(surface)
        fdim = space.mesh.topology.dim - 1
        nodes = dolfinx.fem.locate_dofs_topological(space, fdim, np.sort(facets), remote=False)
        return self._number[surface], nodes.astype(np.int32)

    def _on_body(self, model: Model, body: str) -> tuple[int, Ints]:
        nodes = np.unique(model.problem.space.dofmap.list[model.named.cells(body)])
        return self._surfaces + self.bodies.index(body), nodes.astype(np.int32)

    def _centres_of(self, model: Model, means: _Means) -> tuple[Floats, list[bool]]:
        """Where moments are about (s, i), and whether that stays: the centre of a rotation."""
        problem, dim = model.problem, model.problem.dim
        places = self._reference[: problem.owned // dim, :dim].reshape(-1)
        centres: Floats = problem.comm.allreduce(means.of(places)[: self._surfaces])
        fixed = [False] * self._surfaces
        for boundary in model.case.boundary:
            if boundary.rotation is not None:
                number = self._number[boundary.surface]
                given = boundary.rotation.centre
                centres[number] = 0.0
                centres[number, : len(given or ())] = given or 0.0
                fixed[number] = True
        return centres, fixed

    def centre(self, number: int, displacement: Floats) -> Floats:
        """Place (i,), m, that a surface's moment is about."""
        place: Floats = self._centres[number].copy()
        if not self._fixed[number]:
            place += displacement
        return place

    def sums(self, outside: OutsideForces) -> Floats:
        """This rank's forces and moments about the origin (s, 3 + 3), N and N m per thickness."""
        out = np.zeros((self._count, 6))
        dim = self._problem.dim
        if self._acting != self._problem.constraints.controls:
            self._acting = self._problem.constraints.controls
            self._owner = self._owners()
        nodes, component = self._held // dim, self._held % dim
        vectors = np.zeros((len(self._held), 3))
        vectors[np.arange(len(self._held)), component] = outside.held
        mine = self._owner >= 0
        self._add(out, self._owner[mine], nodes[mine], vectors[mine])
        for (surface, pressed), load in zip(self._pressed, outside.loads, strict=False):
            vectors = np.zeros((len(pressed), 3))
            vectors[:, :dim] = load.reshape(-1, dim)[pressed]
            self._add(out, np.full(len(pressed), surface), pressed, vectors)
        return out

    def _add(self, out: Floats, surface: Ints, nodes: Ints, vectors: Floats) -> None:
        """Add forces (n, 3) on local nodes (n,) of surfaces (n,), where these are at present."""
        dim = self._problem.dim
        place = self._reference[nodes].copy()
        place[:, :dim] += self._problem.u.x.array.reshape(-1, dim)[nodes]
        np.add.at(out, surface, np.concatenate([vectors, np.cross(place, vectors)], axis=1))
