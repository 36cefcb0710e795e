"""The bodies of a case: their materials, and the formulation of their elements."""

from __future__ import annotations

from collections.abc import Mapping

import dolfinx

from app.case.bodies import Body, HenckyBody, MooneyRivlinBody, formulation_problems, formulations
from app.errors import InputError
from forms.bodies.kinematics import Section
from forms.bodies.materials import Hencky, Material, MooneyRivlin, NeoHookean
from forms.bodies.solid import DEGREE, Solid
from geometry.meshes.mesh import NamedMesh

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


def displacement_on(named: NamedMesh, bodies: Bodies) -> dolfinx.fem.Function:
    """The displacement (m) of all bodies, of the degree that their formulations ask for."""
    degree = max(DEGREE[body.formulation] for body in bodies.values() if body.formulation)
    element = ("Lagrange", degree, (named.mesh.geometry.dim,))
    return dolfinx.fem.Function(dolfinx.fem.functionspace(named.mesh, element), name="displacement")


def material_of(body: Body) -> Material:
    """The strain energy of a body."""
    if isinstance(body, MooneyRivlinBody):
        return MooneyRivlin(body.C10, body.C01, body.K)
    kind = Hencky if isinstance(body, HenckyBody) else NeoHookean
    return kind(body.shear_modulus, body.bulk_modulus)


def make_solids(
    bodies: Bodies, named: NamedMesh, u: dolfinx.fem.Function, section: Section
) -> list[Solid]:
    """The forms of resolved bodies.

    Args:
        bodies: from :func:`resolved_bodies`.
        named: the mesh.
        u: displacement, m.
        section: what the mesh stands for.
    """
    made = []
    for name, body in bodies.items():
        assert body.formulation is not None
        material, cells, density = material_of(body), named.cells(name), body.density or 0.0
        made.append(Solid(name, u, cells, material, body.formulation, density, section))
    return made
