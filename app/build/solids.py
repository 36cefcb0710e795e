"""The bodies of a case: their materials, and the formulation of their elements."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import dolfinx
from mpi4py import MPI

from tribox.app.case.bodies import Body, Elastomer, formulation_problems, formulations
from tribox.app.case.own_code import OwnCodeError
from tribox.app.case.stage import Stage
from tribox.app.errors import InputError
from tribox.forms.bodies.kinematics import Section
from tribox.forms.bodies.materials import Material
from tribox.forms.bodies.memory_solid import make_solid
from tribox.forms.bodies.solid import DEGREE, Solid
from tribox.forms.bodies.stability import stability_limits
from tribox.geometry.meshes.blocks import Block, with_blocks
from tribox.geometry.meshes.mesh import NamedMesh

Bodies = Mapping[str, Body]


def resolved_bodies(bodies: Bodies, named: NamedMesh) -> dict[str, Body]:
    """The bodies, each with the formulation that suits the elements where none is given.

    Raises:
        InputError: a formulation does not go with the elements or with another body's.
    """
    cell = named.mesh.topology.cell_name()
    for name, reason in formulation_problems(bodies, cell):
        raise InputError(f"bodies.{name}.formulation: {reason}")
    # On curved cells first order would not follow the surface that the integrals are over.
    curved = named.order == 2
    chosen = dict.fromkeys(bodies, "q2") if curved else formulations(bodies, cell)
    return {
        name: body.model_copy(update={"formulation": chosen[name]}) for name, body in bodies.items()
    }


def displacement_on(
    named: NamedMesh, bodies: Bodies, blocks: Sequence[Block] = ()
) -> dolfinx.fem.Function:
    """The displacement (m) of all bodies, of the degree that formulations ask for; collective."""
    degree = max(DEGREE[body.formulation] for body in bodies.values() if body.formulation)
    element = ("Lagrange", degree, (named.mesh.geometry.dim,))
    space = with_blocks(dolfinx.fem.functionspace(named.mesh, element), blocks)
    return dolfinx.fem.Function(space, name="displacement")


def materials_of(bodies: Bodies, comm: MPI.Comm, runs_code: bool = True) -> dict[str, Material]:
    """The materials of all bodies; collective.

    Raises:
        InputError: an energy in Python cannot be used, on some rank.
    """
    made: dict[str, Material] = {}
    problem: str | None = None
    for name, body in bodies.items():
        try:
            made[name] = body.material_of(runs_code)
        except OwnCodeError as error:
            problem = problem or f"bodies.{name}.{error.key}: {error}"
    problem = next((p for p in comm.allgather(problem) if p), None)
    if problem is not None:
        raise InputError(problem)
    return made


def notes_on_branches(bodies: Bodies, stages: Sequence[Stage]) -> Iterator[str]:
    """Where branches are relaxed, and what the temperature makes of their times."""
    for name, body in bodies.items():
        if getattr(body, "prony", None) is None:
            continue
        assert isinstance(body, Elastomer)
        without = [stage.name for stage in stages if not stage.rate_dependent]
        if without and len(without) == len(stages):
            yield (
                f"bodies.{name}.prony: no stage feels rates (rate_dependent = false): the body is "
                "relaxed throughout, with its long-term moduli"
            )
        elif without:
            yield (
                f"bodies.{name}.prony: relaxed in stages without rates ({', '.join(without)}), "
                "which have the long-term moduli"
            )
        if body.shift is not None:
            factor = math.exp(body.shift.log_factor)
            times = ", ".join(f"{time:.3g} s" for time in body.branch_times())
            yield (
                f"bodies.{name}.shift: relaxation times are {factor:.3g} times those of prony at "
                f"{body.shift.temperature:.5g} K: {times}"
            )


def notes_on_materials(bodies: Bodies, materials: Mapping[str, Material]) -> list[str]:
    """Elastomers whose energy is not stable within stretches that a run may reach."""
    notes = []
    for name, body in bodies.items():
        if getattr(materials[name].elastic, "always_stable", False):
            continue
        try:
            limits = stability_limits(materials[name])
        except NotImplementedError as error:
            notes.append(
                f"bodies.{name}: moduli and stability of its energy are not known ({error})"
            )
            continue
        if limits:
            where = ", ".join(f"{test} beyond a stretch of {at:.3g}" for test, at in limits.items())
            notes.append(
                f"bodies.{name}: the {body.called} energy with these constants is not stable "
                f"(Drucker) in {where}: there more strain needs less stress, and steps may fail"
            )
    return notes


def make_solids(
    bodies: Bodies,
    named: NamedMesh,
    u: dolfinx.fem.Function,
    section: Section,
    materials: Mapping[str, Material],
) -> list[Solid]:
    """The forms of resolved bodies.

    Args:
        u: displacement, m.

    Raises:
        InputError: an energy in Python depends on what there is not in this section.
    """
    made = []
    for name, body in bodies.items():
        assert body.formulation is not None
        material, cells, density = materials[name], named.cells(name), body.density or 0.0
        try:
            made.append(make_solid(name, u, cells, material, body.formulation, density, section))
        except OwnCodeError as error:
            raise InputError(f"bodies.{name}.{error.key}: {error}") from None
    return made
