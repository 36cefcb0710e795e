"""Each class that a case may hold builds something of its own, and an unknown one nothing."""

from typing import Any, get_args

import numpy as np
import pytest
from mpi4py import MPI
from pydantic import TypeAdapter

from tests.own_law import documented_law, documented_material
from tests.tool_cases import block_mesh
from tribox.app.build.contacts import resolved_contact
from tribox.app.build.tools import tool_surface
from tribox.app.case.bodies import Body, Hardening, Rate
from tribox.app.case.contact import Contact
from tribox.app.case.friction import Friction
from tribox.app.case.library import LAWS
from tribox.app.case.own_code import OwnMaterial
from tribox.app.case.table import Model
from tribox.app.case.tools import AnyTool
from tribox.forms.bodies import hardening as yields
from tribox.forms.bodies import materials
from tribox.forms.bodies.elastoplastic import ElastoPlastic
from tribox.forms.friction.coulomb import CoulombLaw, FrictionlessLaw
from tribox.forms.friction.friction_map import FrictionMap
from tribox.forms.friction.guarded_law import GuardedLaw
from tribox.forms.friction.stribeck import StribeckLaw
from tribox.geometry.surfaces.rigid_mesh import MeshSurface
from tribox.geometry.surfaces.rigid_polyline import Polyline
from tribox.geometry.surfaces.rigid_shapes import Circle, Cylinder, Plane, Sphere

SOFT = materials.NeoHookean(1e6, 1e9)
STEEL = {"E": "70 GPa", "nu": 0.3}
FLOWS = {"law": "linear", "yield_stress": 3e7}
ROUND = {"radius": 1.0, "centre": [0.0, 0.0, 0.0]}
GENT = {"G": 2, "K": 9, "Jm": 1}
# Of each union: the keys that name a class, what else it needs, and what it builds.
BODIES = {
    "neo-hookean": (STEEL, materials.NeoHookean),
    "hencky": (STEEL, materials.Hencky),
    "mooney-rivlin": ({"C10": 2, "C01": 1, "K": 9}, materials.MooneyRivlin),
    "yeoh": ({"C10": 2, "C30": 1, "K": 9}, materials.Yeoh),
    "ogden": ({"mu": [2], "alpha": [2], "K": 9}, materials.Ogden),
    "elastoplastic": (STEEL | {"hardening": FLOWS}, ElastoPlastic),
    "python": ({"class": "gent.py:Gent", "parameters": GENT, "G": 2, "K": 9}, OwnMaterial),
}
HARDENINGS = {
    "linear": ({"yield_stress": 3}, yields.Linear),
    "voce": ({"yield_stress": 3, "saturation_stress": 5, "exponent": 9}, yields.Voce),
    "swift": ({"K": 3, "strain0": 0.1, "n": 0.2}, yields.Swift),
    "table": ({"points": [[0, 3], [0.1, 4]]}, yields.Table),
}
RATES = {
    "johnson-cook": ({"C": 0.02}, yields.JohnsonCook),
    "perzyna": ({"reference_rate": 40, "exponent": 0.2}, yields.Perzyna),
}
MAP = {"mu_s": 0.2, "mu_d": 0.1, "A_d": 1e-6, "B": 1e6, "K_T": 1e11, "eta_b": 0.8}
MAP |= {"alpha": 0.5, "V_star": 1e-3, "V_star_at": 1e-8, "D_max": 1e-7}
LAWS_OF_FRICTION = {
    "friction-map": (MAP, FrictionMap),
    "coulomb": ({"mu": 0.2}, CoulombLaw),
    "stribeck": ({"mu_s": 0.3, "mu_d": 0.2, "V_s": 1e-3}, StribeckLaw),
    "python": ({"class": "my_law.py:MyLaw", "parameters": {"mu": 0.3, "speed": 1e-6}}, GuardedLaw),
    "frictionless": ({}, FrictionlessLaw),
}
TOOLS = {
    "plane": ({"point": [0.0, 0.0], "normal": [0.0, 1.0]}, Plane),
    "circle": ({"radius": 1.0, "centre": [0.0, 0.0]}, Circle),
    "cylinder": (ROUND | {"axis": [0.0, 1.0, 0.0]}, Cylinder),
    "sphere": (ROUND, Sphere),
    "polyline": ({"points": [[0.0, 0.0], [1.0, 0.0]]}, Polyline),
    "mesh": ({"file": "block.msh", "surface": "top"}, MeshSurface),
}
SPACE = {"cylinder", "sphere"}


def law_of(friction: Any) -> object:
    contact = Contact.model_construct(friction=friction, slave="a", master="b", name=None)
    return resolved_contact(contact, SOFT, 1e-4, 0.0).friction.friction_law()


def surface_of(tool: Any) -> object:
    box = np.array([[0.0] * 3, [1.0] * 3])[:, : 3 if tool.shape in SPACE else 2]
    return tool_surface(tool, box, MPI.COMM_SELF)


UNIONS = {
    "bodies": (Body, "material", BODIES, lambda body: body.material_of()),
    "hardening": (Hardening, "law", HARDENINGS, lambda table: table.parameters()),
    "rate": (Rate, "law", RATES, lambda table: table.parameters()),
    "friction": (Friction, "law", LAWS_OF_FRICTION, law_of),
    "tools": (AnyTool, "shape", TOOLS, surface_of),
}


def members(union: Any) -> tuple[type[Model], ...]:
    """The classes of an annotated union."""
    return get_args(get_args(union)[0])


def words(union: Any, key: str) -> set[str]:
    """What may stand in the key that tells the classes of a union apart."""
    return {word for m in members(union) for word in get_args(m.model_fields[key].annotation)}


@pytest.mark.parametrize("name", UNIONS)
def test_each_class_of_a_case_builds_its_own(name, tmp_path, monkeypatch):
    union, key, table, build = UNIONS[name]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_law.py").write_text(documented_law())
    (tmp_path / "gent.py").write_text(documented_material())
    if name == "tools":
        block_mesh(tmp_path / "block.msh")
    assert words(union, key) == set(table), "a class that this test does not know"
    for word, (keys, kind) in table.items():
        source = {"source": tmp_path / "case.toml"}
        asked = TypeAdapter(union).validate_python({key: word, **keys}, context=source)
        assert type(build(asked)) is kind, word
    assert len({kind for _, kind in table.values()}) == len(members(union))


def test_every_material_is_a_word_of_the_library():
    assert words(Body, "material") == set(LAWS)
