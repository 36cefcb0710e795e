"""The bodies of a case: their materials, and the formulation of their elements."""

from __future__ import annotations

from collections.abc import Mapping
from typing import assert_never

import dolfinx

from tribox.app.case.bodies import (
    Body,
    ElastoPlasticBody,
    HenckyBody,
    MooneyRivlinBody,
    NeoHookeanBody,
    OgdenBody,
    YeohBody,
    formulation_problems,
    formulations,
)
from tribox.app.errors import InputError
from tribox.forms.bodies.elastoplastic import ElastoPlastic
from tribox.forms.bodies.kinematics import Section
from tribox.forms.bodies.materials import Hencky, Material, MooneyRivlin, NeoHookean, Ogden, Yeoh
from tribox.forms.bodies.plastic_solid import make_solid
from tribox.forms.bodies.solid import DEGREE, Solid
from tribox.forms.bodies.stability import stability_limits
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


def displacement_on(named: NamedMesh, bodies: Bodies) -> dolfinx.fem.Function:
    """The displacement (m) of all bodies, of the degree that their formulations ask for."""
    degree = max(DEGREE[body.formulation] for body in bodies.values() if body.formulation)
    element = ("Lagrange", degree, (named.mesh.geometry.dim,))
    return dolfinx.fem.Function(dolfinx.fem.functionspace(named.mesh, element), name="displacement")


def material_of(body: Body) -> Material:
    """The strain energy of a body, and its yield stress if it flows."""
    match body:
        case NeoHookeanBody():
            return NeoHookean(body.shear_modulus, body.bulk_modulus)
        case HenckyBody():
            return Hencky(body.shear_modulus, body.bulk_modulus)
        case MooneyRivlinBody():
            return MooneyRivlin(body.C10, body.C01, body.K)
        case YeohBody():
            return Yeoh(body.C10, body.C20, body.C30, body.K)
        case OgdenBody():
            return Ogden(body.mu, body.alpha, body.K)
        case ElastoPlasticBody():
            moduli = body.shear_modulus, body.bulk_modulus
            rate = body.rate.law_of() if body.rate is not None else None
            return ElastoPlastic(*moduli, body.hardening.law_of(), rate)
        case _:
            assert_never(body)


def notes_on_materials(bodies: Bodies) -> list[str]:
    """Elastomers whose energy is not stable within stretches that a run may reach."""
    notes = []
    for name, body in bodies.items():
        if isinstance(body, NeoHookeanBody | HenckyBody | ElastoPlasticBody):  # always stable
            continue
        if limits := stability_limits(material_of(body)):
            where = ", ".join(f"{test} beyond a stretch of {at:.3g}" for test, at in limits.items())
            notes.append(
                f"bodies.{name}: the {body.material} energy with these constants is not stable "
                f"(Drucker) in {where}: there more strain needs less stress, and steps may fail"
            )
    return notes


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
        made.append(make_solid(name, u, cells, material, body.formulation, density, section))
    return made
