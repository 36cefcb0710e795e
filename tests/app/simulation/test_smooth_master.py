"""`smoothing_angle` of a contact: reaches the surface, and is refused where it cannot work."""

import math
import tomllib
from itertools import pairwise

import dolfinx
import numpy as np
import pytest
from mpi4py import MPI

from benchmarks.verify.result import CASES
from tests.app.read_log import read_log
from tests.contact_boxes import GAP, Scene
from tests.laws import coulomb
from tribox.app.build.model import build_model
from tribox.app.case.case import Case
from tribox.app.case.reading import check_case, load_case
from tribox.app.equilibrium.constraints import Prescribed
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.errors import InputError
from tribox.app.implicit.newton import ImplicitOptions
from tribox.app.implicit.stepper import ImplicitStepper
from tribox.app.results import read
from tribox.app.run.run import run_case
from tribox.app.simulation.contact_resultants import measure_contact
from tribox.forms.bodies.materials import NeoHookean
from tribox.forms.bodies.solid import Solid
from tribox.geometry.meshes.gmsh_model import gmsh_session

SMOOTH = 'contact.0.smoothing_angle="30 deg"'
COARSE = ("geometry.upper.elements=[4, 2]", "geometry.lower.elements=[5, 2]")


@pytest.mark.parametrize("option", [[], [SMOOTH]])
def test_the_key_makes_the_master_smooth(option):
    case = load_case(CASES / "block-slide.toml", [*COARSE, *option])
    assert case.contact[0].smoothing_angle == (pytest.approx(math.pi / 6) if option else None)
    surface = build_model(case, MPI.COMM_SELF).problem.contacts[0].surface
    assert surface.target.shape.degree == (3 if option else 1)


WRONG = [
    (["geometry.cell=triangle", SMOOTH], "does not work on triangles"),
    (["bodies.elastomer.formulation=q2", "bodies.aluminium.formulation=q2", SMOOTH], 'with "q2"'),
    (['contact.0.smoothing_angle="30 mm"'], '"mm" has the wrong dimension'),
    (["contact.0.smoothing_angle=0"], "must be > 0 rad"),
    (['contact.0.smoothing_angle="200 deg"'], "must be > 0 rad and <= 3.14"),
]


@pytest.mark.parametrize(("options", "message"), WRONG)
def test_mistakes_name_the_key(options, message):
    [line] = check_case(CASES / "block-slide.toml", options)
    assert "contact.0.smoothing_angle" in line and message in line


def test_a_mesh_of_triangles_is_refused(tmp_path):
    case = load_case(CASES / "block-slide.toml", [*COARSE, "geometry.cell=triangle"])
    with gmsh_session("triangles") as gmsh:
        case.geometry.shape().build()
        gmsh.write(str(tmp_path / "triangles.msh"))
    text = (CASES / "block-slide.toml").read_text(encoding="utf-8")
    head, rest = text.split("[geometry]")
    rest = rest[rest.index("[bodies") :].replace('formulation = "q1"', "#")
    path = tmp_path / "triangles.toml"
    path.write_text(f'{head}[geometry]\nmesh = "triangles.msh"\n{rest}', encoding="utf-8")
    with pytest.raises(InputError, match=r"contact\.0\.smoothing_angle: needs .* on triangles"):
        build_model(load_case(path, [SMOOTH]), MPI.COMM_SELF)


# -- A deformable pair pressed and dragged: in space, on second-order elements, on a smooth mas

SOFT = NeoHookean(shear_modulus=1.0, bulk_modulus=5.0)
STIFF = NeoHookean(shear_modulus=3.0, bulk_modulus=8.0)
MU = 0.3
FORMULATION = {"Q4": "q1", "T6": "q2", "tet4": "q1", "hex8": "q1", "hex27": "q2"}


def held(scene, side, component, value=0.0):
    """The bottom or the top, in one direction."""
    height = -0.5 if side == "bottom" else 0.5
    at = np.nonzero(np.isclose(scene.where[:, -1], height))[0]
    return Prescribed((at * scene.dim + component).astype(np.int32), value)


def problem_of(shape, smoothing_angle):
    """Both boxes as solids; the top is driven, the bottom fixed."""
    scene = Scene(shape, coulomb(MU), smoothing_angle=smoothing_angle)
    mesh = scene.space.mesh
    cells = np.arange(mesh.topology.index_map(mesh.topology.dim).size_local, dtype=np.int32)
    middle = dolfinx.mesh.compute_midpoints(mesh, mesh.topology.dim, cells)[:, scene.dim - 1]
    u = dolfinx.fem.Function(scene.space)
    solids = [
        Solid(name, u, cells[part], material, FORMULATION[shape])
        for name, part, material in (("upper", middle > 0.0, SOFT), ("lower", middle < 0.0, STIFF))
    ]
    bottom = [held(scene, "bottom", i) for i in range(scene.dim)]
    top = [held(scene, "top", i) for i in range(scene.dim)]
    return scene, top, Equilibrium(u, solids, [scene.term], [*bottom, *top])


@pytest.mark.parametrize(
    ("shape", "smoothing_angle"),
    [("T6", None), ("tet4", None), ("hex8", None), ("hex8", 0.5), ("Q4", 0.5), ("hex27", None)],
)
def test_pressed_and_dragged(shape, smoothing_angle):
    """Newton is quadratic; friction is μ times the load, against the motion; forces balance."""
    scene, top, problem = problem_of(shape, smoothing_angle)
    stepper = ImplicitStepper(problem, ImplicitOptions(tolerance=1e-12))
    way = np.array([1.0, 0.0] if scene.dim == 2 else [0.6, 0.8, 0.0])
    down = np.eye(scene.dim)[-1]
    path = [-(GAP + 0.01 * k) * down for k in (1, 2)]
    path += [path[-1] + 0.02 * k * way for k in (1, 2, 3, 4, 5)]
    counted = 0
    for move in path:
        for part, value in zip(top, move, strict=True):
            part.value = value
        result = stepper.attempt(1.0)
        assert result.converged, result
        measure = measure_contact(scene.term, problem.trials[0], MPI.COMM_SELF, way)
        for before, after in pairwise(result.residuals):
            if before < 1e-3:
                assert after < 50.0 * before**2 + 1e-12, result.residuals
                counted += 1
        stepper.commit()
    assert counted >= 5
    assert measure.stick == 0.0
    # Of the deformed, nearly flat interface: friction μ p everywhere, along the way on the whole.
    assert measure.tangential_force == pytest.approx(MU * measure.normal_force, rel=0.02)
    assert measure.friction_coefficient == pytest.approx(MU, rel=1e-12)
    reaction = problem.unbalanced.reshape(-1, scene.dim)
    below = np.isclose(scene.where[:, -1], -0.5)
    np.testing.assert_allclose(reaction[below].sum(axis=0), measure.force, rtol=0, atol=1e-10)


# -- Half a model: a smooth master goes on as its image beyond a plane of symmetry ----------------

HALVES = """
stage = [{ name = "press", duration = "1 s", steps = 3 }]
output = { figures = false }
solver = { tolerance = 1e-12 }
contact = [{ slave = "pad_bottom", master = "base_top", smoothing_angle = "30 deg" }]
bodies.pad = { material = "neo-hookean", E = "5 MPa", nu = 0.3 }
bodies.base = { material = "neo-hookean", E = "3 MPa", nu = 0.3 }
[geometry]
kind = "blocks"
"""
MAP = {"preset": "friction-map", "mu_s": 0.1, "K_T": "1e11 Pa/m"}
MAP |= {"V_star": "0.1 mm/s", "V_star_at": "30 nm"}
FILM = {"friction": MAP, "film": {"thickness": "180 nm"}}


def pressed_in(comm, directory, half, contact):
    """A pad that sinks deep into a wider base: its pressed vertices by place, from x = 0 on."""
    data = tomllib.loads(HALVES)
    data["contact"][0] |= contact
    side = 1 if half else 2
    data["geometry"]["blocks"] = {
        name: {"x": [0.0 if half else -wide, wide], "y": heights, "elements": [side * n, m]}
        for name, wide, heights, n, m in (
            ("base", 8e-3, [0.0, 6e-3], 14, 5),
            ("pad", 4e-3, [6e-3, 10e-3], 9, 4),
        )
    }
    down = [["0 s", "0 mm"], ["1 s", "-2 mm"]]
    data["boundary"] = [
        {"surface": "base_bottom", "displacement": {"x": 0, "y": 0}},
        {"surface": "pad_top", "displacement": {"x": 0, "y": down}},
    ]
    if half:
        data["boundary"].append({"surface": "pad_left", "symmetry": True})
        data["boundary"].append({"surface": "base_left", "displacement": {"x": 0}})
    run_case(Case.model_validate(data), directory / "out", quiet=True, force=True, comm=comm)
    comm.barrier()  # the first rank writes
    surface = read(directory / "out").contact()
    order = np.argsort(surface.points[:, 0])
    order = order[surface.points[order, 0] > -1e-9]
    values = [surface.point_data[name][order] for name in ("pressure", "slip_path", "gap")]
    return np.array(values).tolist(), read_log(directory / "out").replace("\n", " ")


@pytest.mark.parametrize(
    "contact",
    [
        {"friction": {"law": "coulomb", "mu": 0.3}},
        {"friction": {"law": "frictionless"}},
        FILM,
        {"friction": {"law": "coulomb", "mu": 0.3}, "fade_length": "2 mm"},
    ],
    ids=["coulomb", "frictionless", "film", "fading"],
)
def test_half_a_model_is_half_of_the_whole(tmp_path, contact):
    whole, _ = pressed_in(MPI.COMM_SELF, tmp_path, False, contact)
    half, log = pressed_in(MPI.COMM_SELF, tmp_path, True, contact)
    for mine, other in zip(half, whole, strict=True):
        np.testing.assert_allclose(mine, other, rtol=0.0, atol=1e-9 * max(np.abs(other)))
    assert whole[0][0] > 1e6 and "hands on too little" not in log


def sunk_in_space(comm, directory, cut, contact):
    """The same of boxes, without what lies beyond the planes across the axes ``cut``."""
    data = tomllib.loads(HALVES)
    data["contact"][0] |= contact
    data["stage"][0]["steps"] = 2
    data["geometry"]["blocks"] = {
        name: {
            **{axis: [0.0 if axis in cut else -wide, wide] for axis in "xz"},
            "y": heights,
            "elements": [n if "x" in cut else 2 * n, 2, n if "z" in cut else 2 * n],
        }
        for name, wide, heights, n in (
            ("base", 6e-3, [0.0, 4e-3], 5),
            ("pad", 3e-3, [4e-3, 7e-3], 3),
        )
    }
    still = {"x": 0, "y": 0, "z": 0}
    down = [["0 s", "0 mm"], ["1 s", "-1 mm"]]
    data["boundary"] = [
        {"surface": "base_bottom", "displacement": still},
        {"surface": "pad_top", "displacement": still | {"y": down}},
        *(
            {"surface": f"{body}_{side}", "displacement": {axis: 0}}
            for axis, side in (("x", "left"), ("z", "back"))
            for body in ("base", "pad")
            if axis in cut
        ),
    ]
    run_case(Case.model_validate(data), directory / "out", quiet=True, force=True, comm=comm)
    comm.barrier()  # the first rank writes
    surface = read(directory / "out").contact()
    quarter = np.nonzero((surface.points[:, [0, 2]] > -1e-9).all(axis=1))[0]
    order = quarter[np.lexsort(np.round(surface.points[quarter], 9).T)]
    values = [surface.point_data[name][order] for name in ("pressure", "slip_path", "gap")]
    return np.array(values).tolist(), read_log(directory / "out").replace("\n", " ")


FADING = {"fade_length": "2 mm"}


@pytest.mark.parametrize("contact", [{"friction": {"law": "coulomb", "mu": 0.3}}, FILM | FADING])
def test_parts_of_a_model_in_space_are_those_of_the_whole(tmp_path, contact):
    whole, _ = sunk_in_space(MPI.COMM_SELF, tmp_path, "", contact)
    for cut in ("z", "xz"):
        part, log = sunk_in_space(MPI.COMM_SELF, tmp_path, cut, contact)
        for mine, other in zip(part, whole, strict=True):
            np.testing.assert_allclose(mine, other, rtol=0.0, atol=1e-9 * max(np.abs(other)))
        assert whole[0][0] > 1e5 and "hands on too little" not in log


def half_model(comm, directory):
    return pressed_in(comm, directory, True, {"friction": {"law": "coulomb", "mu": 0.3}})[0]


def quarter_model(comm, directory):
    contact = {"friction": {"law": "coulomb", "mu": 0.3}} | FADING
    return sunk_in_space(comm, directory, "xz", contact)[0]


@pytest.mark.mpi(half_model, 2)
@pytest.mark.mpi(quarter_model, 3)
@pytest.mark.parametrize(("model", "ranks"), [(half_model, 2), (quarter_model, 3)])
def test_parts_of_a_model_on_ranks(on_ranks, model, ranks):
    for apart, alone in zip(on_ranks(model, ranks), on_ranks(model, 1), strict=True):
        np.testing.assert_allclose(apart, alone, rtol=0.0, atol=1e-9 * max(np.abs(alone)))
