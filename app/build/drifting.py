"""Bodies that nothing holds any more once supports have vanished or are released."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from mpi4py import MPI

from tribox.app.build.boundary_conditions import Constraint, Loads
from tribox.app.case.case import Case
from tribox.app.case.stage import solver_of
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.joined_bodies import Grip, joined_bodies
from tribox.app.equilibrium.prescribed import Prescribed
from tribox.app.equilibrium.slanted import SlantedPlaten
from tribox.app.equilibrium.supports import body_nodes
from tribox.forms.bodies.loads import Foundation
from tribox.geometry.meshes.mesh import NamedMesh
from tribox.geometry.surfaces.facets import Floats, Ints

NOTHING = 1e-9  # stiffness of a rigid motion, over the largest, up to which nothing resists it


def drifting(case: Case, named: NamedMesh, problem: Equilibrium, loads: Loads) -> Iterator[str]:
    """A line on each implicit stage from which on bodies can drift; collective.

    Only cases whose supports change are looked at: of the others other notes say what contact
    alone holds.
    """
    if not any(b.stages for b in case.boundary) and not any(s.release for s in case.stage):
        return
    rigid, said = RigidMotions(problem), set()
    for stage in case.stage:
        if solver_of(stage, case.solver.kind) != "implicit":
            continue
        rows = [rigid.held(one, stage.name) for one in loads.acting(stage.name)]
        for load, surface in zip(loads.forms.loads, loads.forms.surfaces, strict=True):
            tables = [b for b in case.boundary if b.surface == surface and b.foundation]
            if isinstance(load, Foundation) and any(b.acts_in(stage.name) for b in tables):
                rows.append(rigid.rows(load.held))
        tied = [one.tied and case.acts_in(one, stage.name) for one in case.contact]
        for joined in joined_bodies(problem, tied):
            bodies = joined.names
            grips = [rigid.gripped(grip) for grip in joined.grips]
            free = tuple(rigid.free(bodies, [*rows, *grips]))
            if free and (bodies, free) not in said:
                said.add((bodies, free))
                touching = any(_touch(case, named, stage.name, name) for name in bodies)
                yield _line(stage.name, " and ".join(bodies), ", ".join(free), touching)


def _line(stage: str, bodies: str, free: str, touching: bool) -> str:
    """What is said of bodies that can drift."""
    what = f"stage {stage}: no boundary holds {bodies} against {free}"
    if touching:
        return f"{what}; only contact does, and weak springs where it opens"
    return (
        f"{what}; springs too weak for any load do; if a load acts, give a [[boundary]] for this "
        "stage, such as displacement = { x = 0 } of a point or surface that carries next to nothing"
    )


def _touch(case: Case, named: NamedMesh, stage: str, body: str) -> bool:
    """Whether a body is in a contact of a stage; collective."""
    surfaces = {
        surface
        for one in case.contact
        if case.acts_in(one, stage)
        for surface in (one.slave, *([] if one.master in case.tools else [one.master]))
    }
    return any([body in named.bodies_of(surface) for surface in sorted(surfaces)])


class RigidMotions:
    """Rigid motions of the mesh, those of each body from what holds it."""

    def __init__(self, problem: Equilibrium) -> None:
        """Find the motions about the middle of the mesh; collective."""
        self._problem, dim = problem, problem.dim
        count = problem.owned // dim
        place = problem.space.tabulate_dof_coordinates()[:count, :dim]
        sums = problem.comm.allreduce(np.array([*place.sum(axis=0), len(place)]))
        arm = place - sums[:-1] / sums[-1]
        size = problem.comm.allreduce(float(np.abs(arm).max(initial=0.0)), op=MPI.MAX)
        motions, self.names = [], []
        for axis in range(dim):
            motions.append(np.tile(np.eye(dim)[axis], (count, 1)))
            self.names.append(f"moving in {'xyz'[axis]}")
        for axis in (2,) if dim == 2 else (0, 1, 2):
            across = np.zeros((count, 3))
            across[:, :dim] = arm / size
            motions.append(np.cross(np.eye(3)[axis], across)[:, :dim])
            self.names.append(f"turning about {'xyz'[axis]}")
        self._motions: Floats = np.stack(motions, axis=-1).reshape(count * dim, -1)
        self._nodes = {s.name: body_nodes(problem, s.cells) for s in problem.solids}
        if problem.solids and problem.solids[0].section == "axisymmetric":
            self._motions, self.names = self._motions[:, 1:2], self.names[1:2]

    def rows(self, dofs: Ints) -> tuple[Ints, Floats]:
        """Unknowns that are held, and their displacements (c, k) in each motion."""
        return dofs, self._motions[dofs]

    def held(self, one: Constraint, stage: str) -> tuple[Ints, Floats]:
        """What a constraint resists in a stage: unknowns (one of each node), displacements."""
        part = one.part
        dofs, moved = self.rows(part.dofs)
        if isinstance(part, SlantedPlaten):
            dim = len(part.normal)
            dofs = dofs[::dim]
            moved = moved.reshape(len(dofs), dim, moved.shape[1])  # a rank may have none
            moved = np.einsum("i,mik->mk", part.normal, moved)
        if not isinstance(part, Prescribed) and not one.given(stage):
            # Its nodes move as one, but how far is free.
            comm = self._problem.comm
            count = comm.allreduce(len(dofs))
            moved = moved - comm.allreduce(moved.sum(axis=0)) / max(count, 1)
        return dofs, moved

    def gripped(self, grip: Grip) -> tuple[Ints, Floats]:
        """The same of a surface tied to a tool, which what drives it does not hold; collective."""
        dim = self._problem.dim
        dofs = (grip.nodes[:, None] * dim + np.arange(dim)).reshape(-1).astype(np.int32)
        moved = self._motions[dofs].reshape(len(grip.nodes), dim, -1)
        left = grip.resisted(self._problem, moved, grip.tool.free)
        return dofs, left.reshape(len(dofs), -1)

    def free(self, bodies: Sequence[str], held: Sequence[tuple[Ints, Floats]]) -> list[str]:
        """Motions of joined bodies that nothing resists, in words; collective."""
        nodes = np.unique(np.concatenate([self._nodes[name] for name in bodies]))
        kinds = len(self.names)
        gram = np.zeros((kinds, kinds))
        for dofs, moved in held:
            mine = moved[np.isin(dofs // self._problem.dim, nodes)]
            gram += mine.T @ mine
        values, vectors = np.linalg.eigh(self._problem.comm.allreduce(gram))
        loose = vectors[:, values <= NOTHING * max(values.max(), NOTHING)]
        share = np.sqrt(np.sum(loose**2, axis=1))
        return [name for name, part in zip(self.names, share, strict=True) if part > 0.05]
