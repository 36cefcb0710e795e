"""Small cases, each with something in it that a run has to remember when it goes on."""

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.app.conftest import BLOCK, BOXES, FILM, SLID
from tests.app.simulation.test_explicit_run import THROWN
from tests.own_law import documented_law
from tests.rectangles import Rectangle, Rectangles
from tribox.app.case.toml_files import set_value
from tribox.geometry.meshes.gmsh_model import write_msh

Data = dict[str, Any]
Maker = Callable[[Path], Data]

COARSE = {"geometry.upper.elements": [5, 3], "geometry.lower.elements": [7, 2]}
BOTTOM = {"surface": "bottom", "displacement": {"x": 0, "y": 0}}
TRAVEL = [["1 s", "0 mm"], ["2 s", "0.15 mm"]]
STAGES = [
    {"name": "press", "duration": "1 s", "steps": 2},
    {"name": "slide", "duration": "1 s", "steps": 4},
]
MAP = {
    **{"law": "friction-map", "mu_s": 0.12, "mu_d": 0.10, "A_d": "1 um", "B": "1e6 1/m"},
    **{"K_T": "1e12 Pa/m", "alpha": 0.5, "V_star": "1 mm/s", "V_star_at": "10 nm"},
    "preset": "friction-map",
}
PROBES = [
    {"name": "corner", "point": ["1 mm", "0.4 mm"]},
    {"name": "upper", "body": "elastomer"},
    {"name": "along", "contact": "elastomer_contact-aluminium_contact"},
    {"name": "shape", "surface": "elastomer_contact", "opposite": "top"},
]


def changed(text: str, keys: Data) -> Data:
    """A case of a text, as plain data, with the values of some keys changed."""
    data = tomllib.loads(text)
    for key, value in keys.items():
        set_value(data, key, value)
    return data


def plain(text: str, keys: Data | None = None) -> Maker:
    """A case that needs no files."""
    return lambda directory: changed(text, keys or {})


def block(*boundaries: Data, **keys: Any) -> Maker:
    """The small block, pressed and slid, under other boundaries; two underscores for a dot."""
    more = {name.replace("__", "."): value for name, value in keys.items()}
    more |= {"boundary": [BOTTOM, *boundaries]} if boundaries else {}
    return plain(BLOCK, COARSE | {"stage": STAGES} | more)


# A law whose state has an array of its own, on which its answer depends.
WORN = """
@dataclass(slots=True)
class Worn(FrictionState):
    wear: np.ndarray


class MyLaw:"""
OF_WEAR = {
    "import numpy as np\n": "from dataclasses import dataclass\n\nimport numpy as np\n",
    "\nclass MyLaw:": WORN,
    "return FrictionState.zeros(n, dim)": (
        "return Worn(**FrictionState.zeros(n, dim).arrays(), wear=np.zeros(n))"
    ),
    "factor = self.mu * pressure": (
        "mu = self.mu + 1e3 * state.wear\n        factor = mu * pressure"
    ),
    "self.mu * along": "mu[:, None] * along",
    "state=FrictionState(": "state=Worn(wear=state.wear + length,",
}


def own_law(directory: Path) -> Data:
    """Friction that grows with wear, as a law in Python."""
    source = documented_law()
    for old, new in OF_WEAR.items():
        assert source.count(old) == 1, old
        source = source.replace(old, new)
    path = directory / "my_law.py"
    path.write_text(source, encoding="utf-8")
    law = {"law": "python", "class": f"{path}:MyLaw", "parameters": {"mu": 0.1, "speed": 1e-6}}
    return changed(BLOCK, COARSE | {"stage": STAGES, "contact.0.friction": law})


def gripped(directory: Path, **solver: Any) -> Data:
    """A bar between two tools that it is tied to: one is fixed, one pulled and turned."""
    pull = {
        "force": {"x": [["0 s", 0], ["2 s", "2 N"]], "y": [["0 s", 0], ["2 s", "0.1 N"]]},
        "rotation": {"angle": [["1 s", 0], ["2 s", 0.2]], "centre": [4e-3, 1e-3]},
    }
    if solver:
        pull = {"displacement": {"x": [["0 s", 0], ["2 us", "2 um"]]}}
    ends = {"left": (0.0, 1.0, {}), "right": (4e-3, -1.0, pull)}
    return {
        "geometry": {
            "kind": "blocks",
            "blocks": {"bar": {"x": [0, 4e-3], "y": [0, 1e-3], "elements": [6, 2]}},
            "thickness": "2 mm",
        },
        "bodies": {"bar": {"material": "neo-hookean", "E": "5 MPa", "nu": 0.4, "density": 1100}},
        "tools": {
            name: {"shape": "plane", "point": [x, 0], "normal": [n, 0], **motion}
            for name, (x, n, motion) in ends.items()
        },
        "contact": [{"slave": f"bar_{name}", "master": name, "tied": True} for name in ends],
        "boundary": [{"surface": "bar_top", "pressure": 0}],
        "stage": [one | {"duration": "1 us"} for one in STAGES] if solver else STAGES,
        "output": {},
        **({"solver": solver} if solver else {}),
    }


def pairs(directory: Path, **solver: Any) -> Data:
    """A pad tied to a plate slides from one die to the next and off its end, ever less rubbed."""
    bodies = {
        "plate": Rectangle(0.0, 0.5e-3, 1e-3, 0.7e-3, (4, 1)),
        "pad": Rectangle(0.0, 0.0, 1e-3, 0.5e-3, (6, 3)),
        "left": Rectangle(-0.3e-3, -0.3e-3, 0.63e-3, 0.0, (5, 1)),
        "right": Rectangle(0.63e-3, -0.3e-3, 1.2e-3, 0.0, (3, 1)),
    }
    mesh = directory / "mesh.msh"
    write_msh(Rectangles(bodies), mesh)
    soft = {"material": "neo-hookean", "E": "5 MPa", "nu": 0.3, "density": 1100}
    factor = [["0 s", 1], ["1.5 s", 0.5], ["2 s", 0.8]]
    travel, down = [["1 s", "0 mm"], ["2 s", "0.35 mm"]], [["0 s", 0], ["1 s", "-0.02 mm"]]
    if solver:
        factor, travel, down = (
            [[f"{t[0]}us", v] for t, v in rows] for rows in (factor, travel, down)
        )
        travel[1][1], down[1][1] = "0.01 mm", "-2 um"
        factor[1][0] = "1.5 us"
    slides = {"slave": "pad_bottom", "friction_factor": factor, "fade_length": "0.15 mm"}
    slides["friction"] = {"law": "coulomb", "mu": 0.3, "K_T": "1e11 Pa/m"}
    held = {"x": 0, "y": 0}
    return {
        "geometry": {"mesh": str(mesh)},
        "bodies": {"plate": soft | {"E": "50 MPa"}, "pad": soft, "left": soft, "right": soft},
        "contact": [
            {"slave": "pad_top", "master": "plate_bottom", "tied": True},
            slides | {"master": "left_top"},
            slides | {"master": "right_top", "stages": ["press", "slide"]},
        ],
        "boundary": [
            {"surface": "plate_top", "displacement": {"x": travel, "y": down}},
            {"surface": "left_bottom", "displacement": held},
            {"surface": "right_bottom", "displacement": held},
        ],
        "stage": [one | {"duration": "1 us"} for one in STAGES] if solver else STAGES,
        "output": {},
        **({"solver": solver} if solver else {}),
    }


_TOP = {"surface": "top", "displacement": {"x": TRAVEL}}
_ROUND = """
bodies.elastomer = { material = "hencky", E = "70 GPa", nu = 0.33 }
bodies.aluminium = { material = "neo-hookean", E = "5 MPa", nu = 0.45 }
stage = [
 { name = "press", duration = "1 s", steps = 2 },
 { name = "turn", duration = "1 s", steps = 4 },
]
output = {}
[geometry]
kind = "cylinder-on-block"
thickness = "1 mm"
contact_width = "1.6 mm"
contact_size = "0.2 mm"
growth = 2
cylinder = { radius = "5 mm" }
block = { width = "12 mm", height = "4 mm", contact_size = "0.2 mm" }
[[contact]]
slave = "aluminium_contact"
master = "elastomer_contact"
smoothing_angle = "30 deg"
friction = { law = "coulomb", mu = 0.3 }
[[boundary]]
surface = "bottom"
displacement = { x = 0, y = [["0 s", 0], ["1 s", "0.05 mm"]] }
[[boundary]]
surface = "top"
rotation = { centre = ["0 mm", "5 mm"], angle = [["1 s", "0 deg"], ["2 s", "4 deg"]] }
"""
_BOXES = {
    "geometry.upper.elements": [2, 2, 2],
    "geometry.lower.elements": [3, 2, 3],
    "stage": STAGES,
    "output": {},
}
# Far enough for a wider pattern.
_KRYLOV = {
    "solver": {"linear": "krylov"},
    "geometry.lower.elements": [16, 1, 2],
    "boundary.1.displacement": {"x": [["1 s", "0 mm"], ["2 s", "0.2 mm"]], "z": 0},
}
_THIN = {"geometry.upper.elements": [5, 2], "geometry.lower.elements": [8, 2]}
_FLUNG = {**COARSE, "stage.0.steps": 4, "stage.0.duration": "12 us"}
_DENSE = {"bodies.elastomer.density": 1100, "bodies.aluminium.density": 2700}
_SOFT = {
    "bodies.aluminium.E": "50 MPa",
    "solver": {"kind": "explicit"},
    "contact.0.penalty_factor": 1,
}

_RELAXED = {
    "boundary.1.displacement": {"x": 0, "y": [["0 s", 0], ["20 us", "-0.02 mm"]]},
    "stage": [{"name": "press", "duration": "40 us", "steps": 4, "relax": True}],
}
_RAMPED = {
    **{"name": "slide", "velocities": ["0.2 m/s", "0.4 m/s"], "ramp": "3 us"},
    **{"slip_step": "0.3 um", "min_steps": 2, "max_steps": 3},
}

_SLOWED = [  # through V*, with steps that are too long
    {"name": "slide", "velocity": "2 mm/s", "duration": "4 ms", "steps": 2},
    {"name": "back", "velocity": "-0.1 mm/s", "duration": "4 ms", "steps": 2},
]
_WEIGHT = {"gravity": {"y": [["0 s", 0], ["1 s", "-10 m/s^2"]]}}
_LET_GO = {"name": "let go", "duration": "1 s", "steps": 3, "release": ["aluminium_right"]}
# Loads that come and go, a force that is held, a support that appears and is released.
_BY_STAGE = [
    {"surface": "bottom", "foundation": {"normal": "1e12 Pa/m", "tangential": "1e12 Pa/m"}},
    {**_TOP, "platen": {**{"direction": "y", "displacement": [["0 s", 0], ["1 s", "0.03 mm"]]},
     **{"displacement_stages": ["press"], "hold_force": True}}},
    {"surface": "aluminium_left", "traction": {"x": "20 MPa"}, "stages": ["slide"]},
    {"surface": "aluminium_right", "velocity": {"x": 0}, "stages": ["slide", "let go"]},
]  # fmt: skip
_OBLIQUE = [
    BOTTOM,
    {"surface": "top", "platen": {"direction": [-0.2, 1], "force": [["0 s", 0], ["2 s", "1 N"]]},
     "stages": ["slide", "let go"]},
    {"surface": "top", "displacement": {"x": 0, "y": [["0 s", 0], ["1 s", "-0.02 mm"]]},
     "stages": ["press"]},
    {"surface": "elastomer_left", "foundation": {"tangential": "1e9 Pa/m", "normal": "1e9 Pa/m"}},
]  # fmt: skip

_FAR = {
    "x": [["1 s", "0 mm"], ["2 s", "0.2 mm"]],
    "y": [["0 s", "0 mm"], ["1 s", "-0.05 mm"]],
}
_BY_BOTH = {
    **{"direction": "y", "force": [["0 s", 0], ["1 s", "1 N"]]},
    **{"displacement": [["1 s", "0.02 mm"], ["2 s", "0.03 mm"]], "displacement_stages": ["slide"]},
}
_WHILE_IT_FLIES = [
    BOTTOM,
    {"surface": "elastomer_left", "velocity": {"x": 0}, "stages": ["hold"]},
    {"surface": "elastomer_right", "traction": {"y": "1 kPa"}, "foundation": {"normal": 1e9},
     "stages": ["hold", "off"]},
]  # fmt: skip

IMPLICIT: dict[str, Maker] = {
    "coulomb": block(probe=PROBES),
    "cut": block(
        {"surface": "top", "displacement": _FAR},
        {"surface": "elastomer_right", "pressure": "5 kPa", "stages": ["slide"]},
        stage=[STAGES[0], STAGES[1] | {"steps": 2}],
        solver={"max_iterations": 2},
    ),
    "frozen": block(stage=[STAGES[0], STAGES[1] | {"steps": 1}], solver={"max_iterations": 4}),
    "slowed out of the film": plain(FILM, {**_THIN, "stage": [STAGES[0], *_SLOWED]}),
    "film until steady": plain(FILM, {**_THIN, "stage.1.max_steps": 8}),
    "platen by both": block({**_TOP, "platen": _BY_BOTH}),
    "spring": block(
        {"surface": "top", "displacement": {"y": [["0 s", 0], ["1 s", "-0.03 mm"]]}},
        {"surface": "top", "spring": {"direction": "x", "stiffness": "5 N/mm", "end": TRAVEL}},
    ),
    "round": plain(_ROUND),
    "q2": block(bodies__elastomer__formulation="q2", bodies__aluminium__formulation="q2"),
    "own law": own_law,
    "boundaries by stage": plain(
        BLOCK, {**COARSE, **_DENSE, **_WEIGHT, "boundary": _BY_STAGE, "stage": [*STAGES, _LET_GO]}
    ),
    "oblique": block(*_OBLIQUE[1:], stage=[*STAGES, _LET_GO | {"release": ["top"], "steps": 2}]),
    "pairs": pairs,
    "gripped": gripped,
    "film": block(contact__0__film={"thickness": "30 nm"}, contact__0__friction=MAP),
    "space by Krylov": plain(BOXES, _BOXES | _KRYLOV),
}
EXPLICIT: dict[str, Maker] = {
    "pairs": lambda directory: pairs(directory, kind="explicit"),
    "gripped": lambda directory: gripped(directory, kind="explicit"),
    "film": plain(SLID, {**_THIN, "stage.1.steps": 4, "stage.1.duration": "4 us"}),
    "thrown": plain(THROWN, {**_FLUNG, "probe": PROBES}),
    "scaled": plain(THROWN, {**_FLUNG, "solver.mass_scaling": {"step": "0.2 us"}}),
    "relaxed": plain(BLOCK, {**COARSE, **_DENSE, **_SOFT, **_RELAXED}),
    "until steady": plain(SLID, {**_THIN, "stage.1": _RAMPED}),
    "boundaries by stage": plain(
        THROWN,
        COARSE
        | {"gravity": {"y": -1e6, "stages": ["fly"]}, "boundary": _WHILE_IT_FLIES}
        | {"stage": [{"name": n, "duration": "5 us", "steps": 2} for n in ("fly", "hold", "off")]},
    ),
    "own law": lambda directory: (
        changed(THROWN, _FLUNG) | {"contact": own_law(directory)["contact"]}
    ),
    "space": plain(
        BOXES,
        {
            **_BOXES,
            **_DENSE,
            **_SOFT,
            "boundary.1.displacement.x": [["20 us", "0 mm"], ["60 us", "0.02 mm"]],
            "boundary.1.platen.pressure": [["0 s", 0], ["20 us", "0.4 MPa"]],
            "stage": [{"name": "all", "duration": "60 us", "steps": 4}],
        },
    ),
}
