"""Values that a case may have and that are hardly meant: a bare number in another unit, mostly."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from mpi4py import MPI

from tribox.app.case.bodies import ElastoPlasticBody
from tribox.app.case.boundary import COMPONENTS
from tribox.app.case.case import Case
from tribox.app.case.time_tables import TimeTable
from tribox.geometry.meshes.mesh import NamedMesh

FAR = 10.0  # displacement over the extent of the mesh from which it is told
ROUGHEST = 5.0  # coefficient of friction that rubber, stickiest of all, stays below by far
YIELD_STRAIN = (1e-5, 0.1)  # yield stress over Young's modulus: of metals from 1e-4 to 2e-2


def notes_on_slips(case: Case, named: NamedMesh) -> Iterator[str]:
    """A line on each value that is out of proportion; collective."""
    yield from _yield_strains(case)
    yield from _coefficients(case)
    x = named.mesh.geometry.x
    ends = np.concatenate([x.max(axis=0, initial=-np.inf), -x.min(axis=0, initial=np.inf)])
    named.mesh.comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MAX)
    extent = float(np.max(ends[:3] + ends[3:]))
    for key, program in _displacements(case):
        way = max(map(abs, program.values))
        if way > FAR * extent:
            yield (
                f"{key}: goes as far as {way:.3g} m, {way / extent:.2g} times the extent of the "
                "mesh; a number without a unit is in m"
            )
    for index, key, step in _driven_steps(case):
        if step > extent:
            yield (
                f"stage.{index}.{key}: driven boundaries move {step:.3g} m in one step, "
                f"{step / extent:.2g} times the extent of the mesh; a number without a unit is in m"
            )


def _coefficients(case: Case) -> Iterator[str]:
    """A line on each coefficient of friction that no pair of bodies has."""
    for index, contact in enumerate(case.contact):
        for key in ("mu", "mu_s"):
            value = getattr(contact.friction, key, 0.0)
            most = max(map(abs, value.values)) if isinstance(value, TimeTable) else value
            if most > ROUGHEST:
                yield (
                    f"contact.{index}.friction.{key} = {most:g}: rubber on dry metal has 1 to 3, "
                    "lubricated 0.05 to 0.3; is it in per cent?"
                )


def _driven_steps(case: Case) -> Iterator[tuple[int, str, float]]:
    """Number of the stage, key and way (m) of a step of every driven stage that is implicit."""
    for index, stage in enumerate(case.stage):
        if stage.slip_step is not None:
            yield index, "slip_step", stage.slip_step
        elif (stage.solver or case.solver.kind) == "explicit":
            continue  # its steps are many to a row
        elif stage.velocity and stage.duration is not None:
            yield index, "velocity", abs(stage.velocity) * stage.duration / stage.steps


def _yield_strains(case: Case) -> Iterator[str]:
    """A line on each body that yields at a strain that no metal yields at."""
    least, most = YIELD_STRAIN
    for name, body in case.bodies.items():
        if not isinstance(body, ElastoPlasticBody):
            continue
        stress = float(body.hardening.law_of().stress(np.zeros(1))[0])
        shear, bulk = body.shear_modulus, body.bulk_modulus
        modulus = 9.0 * bulk * shear / (3.0 * bulk + shear)
        if not least <= stress / modulus <= most:
            yield (
                f"bodies.{name}: yields at {stress:.3g} Pa, {stress / modulus:.2g} of Young's "
                f"modulus, {modulus:.3g} Pa; metals yield at 0.0001 to 0.02 of it, and a number "
                "without a unit is in Pa"
            )


def _displacements(case: Case) -> Iterator[tuple[str, TimeTable]]:
    """The programs of displacement of boundaries and tools, by their keys."""
    tables = [(f"boundary.{n}", one.displacement) for n, one in enumerate(case.boundary)]
    tables += [(f"tools.{name}", tool.displacement) for name, tool in case.tools.items()]
    for place, table in tables:
        for component in COMPONENTS if table is not None else ():
            program = getattr(table, component)
            if isinstance(program, TimeTable):
                yield f"{place}.displacement.{component}", program
