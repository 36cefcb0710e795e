"""Meshes of a case that cannot be used, or hold more than was meant."""

import re
from copy import deepcopy

import pytest
from mpi4py import MPI

from tests.geometry.meshes.test_damaged import CRASHING
from tests.tool_cases import block_case, block_mesh, case_of, plane
from tribox.app.build.mesh import make_mesh
from tribox.app.build.mesh_notes import many_cells
from tribox.app.build.model import build_model
from tribox.app.case.case import Case
from tribox.app.case.reading import load_case
from tribox.app.errors import InputError
from tribox.app.results import read
from tribox.app.run.run import run_case
from tribox.geometry.generators.two_blocks import Block, TwoBlocks
from tribox.geometry.meshes.gmsh_model import write_msh

BLOCKS = TwoBlocks(Block(1e-3, 5e-4, (3, 2)), Block(1e-3, 5e-4, (3, 2)))


@pytest.fixture
def own_mesh(case_file, block):
    """The small block with a mesh file, which is still to be written."""
    (head, rest) = block.split("[geometry]")[0], block.split("[bodies.elastomer]", 1)[1]

    def write(lines=""):
        path = case_file(f'{head}[geometry]\nmesh = "own.msh"\n{lines}\n[bodies.elastomer]{rest}')
        return path, path.with_name("own.msh")

    case_file("").with_name("own.msh").write_text(CRASHING)
    return write


@pytest.mark.parametrize("command", ["check", "run", "mesh"])
def test_a_mesh_that_gmsh_breaks_down_on_is_wrong_input(own_mesh, tribox, command):
    path, msh = own_mesh()
    done = tribox(command, path)
    assert done.returncode == 2
    [line] = done.stderr.splitlines()
    assert line.startswith(f"tribox: {path}: geometry.mesh: {msh}: gmsh broke down on it (SIG")


def test_more_cells_than_the_case_allows_are_refused(own_mesh):
    path, msh = own_mesh("max_cells = 11")
    write_msh(BLOCKS, msh)
    with pytest.raises(InputError, match=r"12 cells; geometry\.max_cells = 11 allows no more"):
        make_mesh(load_case(path), MPI.COMM_SELF)
    path, _ = own_mesh("max_cells = 23")
    case = load_case(path)
    named = make_mesh(case, MPI.COMM_SELF)
    assert list(many_cells(case, named)) == ["the mesh has 12 cells; geometry.max_cells allows 23"]
    path, _ = own_mesh("max_cells = 24")
    assert not list(many_cells(load_case(path), named))


# -- Notes on values that are hardly meant ---------------------------------------------------------

METAL = {"material": "elastoplastic", "E": "70 GPa", "nu": 0.33}


def notes(tmp_path, **tables):
    mesh = block_mesh(tmp_path / "block.msh", (2, 1))
    return build_model(case_of(block_case(mesh, **tables)), MPI.COMM_SELF).notes


def down(way):
    """A plane, and a side of the block, 4 mm wide, that go down by ``way``."""
    program = {"displacement": {"y": [["0 s", "0 m"], ["1 s", way]]}}
    sides = [{"surface": "bottom"} | program, {"surface": "left", "displacement": {"x": 0}}]
    return {"tools": {"punch": plane(**program)}, "boundary": sides}


def test_a_displacement_far_beyond_the_mesh_is_told(tmp_path):
    found = [note for note in notes(tmp_path, **down(-20)) if "goes as far" in note]
    assert [note.split(":")[0] for note in found] == [
        "boundary.0.displacement.y",
        "tools.punch.displacement.y",
    ]
    assert "as far as 20 m, 5e+03 times the extent of the mesh" in found[0]
    assert not any("goes as far" in note for note in notes(tmp_path, **down("-40 mm")))


@pytest.mark.parametrize(
    ("thickness", "said"),
    [
        (10, "10 m: 2.5e+03 times the extent of the mesh, 0.004 m"),
        ("3 um", "3e-06 m: 0.00075 times"),
        ("5 um", None), ("0.3 m", None), (1.0, None), (None, None),
    ],
)  # fmt: skip
def test_a_slab_far_from_the_size_of_its_parts_is_told(tmp_path, thickness, said):
    """Not one of 1 m, the default, of which forces are those per metre."""
    geometry = {"mesh": str(block_mesh(tmp_path / "block.msh", (2, 1))), "thickness": thickness}
    found = [note for note in notes(tmp_path, geometry=geometry) if "thickness" in note]
    assert len(found) == (said is not None)
    assert all(note.startswith(f"geometry.thickness = {said}") for note in found)


@pytest.mark.parametrize(
    ("stress", "said"),
    [(100, "yields at 100 Pa, 1.4e-09 of"), ("10 GPa", "yields at 1e+10 Pa"), ("20 MPa", None)],
)
def test_a_yield_stress_out_of_proportion_is_told(tmp_path, stress, said):
    hardening = {"law": "linear", "yield_stress": stress}
    found = notes(tmp_path, bodies={"block": METAL | {"hardening": hardening}})
    told = [note for note in found if "yields at" in note]
    assert len(told) == (said is not None)
    assert all(note.startswith(f"bodies.block: {said}") for note in told)


def test_a_metal_all_in_megapascals_without_units_is_told(tmp_path):
    metal = METAL | {"E": 70000, "hardening": {"law": "linear", "yield_stress": 60}}
    [note] = [one for one in notes(tmp_path, bodies={"block": metal}) if "bodies.block" in one]
    assert "Young's modulus is 7e+04 Pa" in note and "without a unit is in Pa" in note


def test_steps_beyond_the_mesh_and_coefficients_that_nothing_has_are_told(tmp_path):
    """The block is 4 mm wide."""
    sides = [{"surface": "bottom", "displacement": {"x": "driven", "y": 0}}]

    def told(mu, **stage):
        tables = {"boundary": sides, "stage": [{"name": "slide", **stage}]}
        data = block_case(block_mesh(tmp_path / "block.msh", (2, 1)), **tables)
        data["contact"][0]["friction"] = {"law": "coulomb", "mu": mu}
        found = build_model(case_of(data), MPI.COMM_SELF).notes
        return [note for note in found if "in one step" in note or "friction.mu" in note]

    far = {"velocities": ["1 mm/s"], "slip_step": 10}
    step, *_ = told(0.3, **far)
    assert step.startswith("stage.0.slip_step: driven boundaries move 10 m in one step, 2.5e+03")
    assert told(0.3, **far | {"slip_step": "3.9 mm"}) == []
    one = {"velocity": "1 m/s", "duration": "8 ms"}
    assert told(0.3, **one, steps=1)[0].startswith("stage.0.velocity: driven boundaries move 0.008")
    assert told(0.3, **one, steps=3) == []
    [mu] = told([["0 s", 1], ["8 ms", 15]], **one, steps=3)
    assert mu.startswith("contact.0.friction.mu = 15: rubber")


# -- Notes on slender bodies that linear cells bend too hard or too easily ------------------------

STRIP = {
    "geometry": {"kind": "blocks", "blocks": {"strip": {"x": [0, 20e-3], "y": [0, 1e-3]}}},
    "bodies": {"strip": {"material": "hencky", "E": 1e9}},
    "boundary": [
        {"surface": "strip_left", "displacement": {"x": 0, "y": 0}},
        {"surface": "strip_right", "displacement": {"y": [[0, 0], [1, -2e-5]]}},
    ],
    "stage": [{"name": "bend", "duration": 1, "steps": 1}],
    "output": {"fields_every": 0, "figures": False},
}


def bent(out, nu, elements, cell="quadrilateral", formulation=None):
    """Force at the end of a cantilever, N, and what the notes say its stiffness is off by."""
    data = deepcopy(STRIP)
    data["geometry"] |= {"cell": cell}
    data["geometry"]["blocks"]["strip"]["elements"] = elements
    data["bodies"]["strip"] |= {"nu": nu} | ({"formulation": formulation} if formulation else {})
    run = run_case(Case.model_validate(data), out, quiet=True, force=True)
    force = read(out).surfaces.query("surface == 'strip_right'")["force_y"].iloc[-1]
    said = [note for note in run.model.notes if "where it bends" in note]
    signs = {"stiff": 0.01, "soft": -0.01}
    found = [re.search(r"some ([\d.]+) % too (\w+)", note) for note in said]
    return abs(force), [float(one[1]) * signs[one[2]] for one in found]


@pytest.mark.parametrize("nu", [0.3, 0.49])
def test_how_much_too_stiff_or_soft_linear_cells_bend_is_said(tmp_path, nu):
    true, none = bent(tmp_path, nu, [40, 2], formulation="q2")
    assert none == []
    coarse = [([20, 4], "quadrilateral"), ([80, 2], "quadrilateral"), ([40, 4], "triangle")]
    for elements, cell in coarse:
        force, [said] = bent(tmp_path, nu, elements, cell)
        assert said == pytest.approx(force / true - 1.0, abs=0.04)
    force, none = bent(tmp_path, nu, [80, 4])
    assert none == [] and force == pytest.approx(true, rel=0.04)


@pytest.mark.parametrize("how", ["held", "symmetric", "rod", "free"])
def test_a_strip_that_is_held_along_a_side_does_not_bend(how):
    """Nor half of one, along its plane of symmetry, nor a rod on its axis."""
    data = deepcopy(STRIP)
    data["geometry"]["blocks"]["strip"]["elements"] = [5, 1]
    data["bodies"]["strip"] |= {"nu": 0.3}
    clamp, pull = data["boundary"]
    if how == "held":
        data["boundary"] = [clamp | {"surface": "strip_bottom"}]
    elif how == "symmetric":
        side = {"surface": "strip_bottom", "symmetry": True}
        data["boundary"] = [side, clamp | {"displacement": {"x": 0}}]
    elif how == "rod":
        data["geometry"] |= {"section": "axisymmetric"}
        data["geometry"]["blocks"]["strip"] |= {"x": [0, 1e-3], "y": [0, 20e-3], "elements": [1, 5]}
        data["boundary"] = [pull | {"surface": f"strip_{end}"} for end in ("bottom", "top")]
    model = build_model(Case.model_validate(data), MPI.COMM_SELF)
    said = [note for note in model.notes if "where it bends" in note]
    assert [" 482 % too stiff" in note for note in said] == [True] * (how == "free")


def bar(elements, width=1e-3, **more):
    """The same strip as a bar in space, 20 mm long and 1 mm thick."""
    data = deepcopy(STRIP)
    sides = {"x": [0, 20e-3], "y": [0, 1e-3], "z": [0, width], "elements": elements}
    data["geometry"]["blocks"]["strip"] = sides
    data["bodies"]["strip"] |= {"nu": 0.3, "formulation": "q1-sri"} | more
    data["boundary"][0]["displacement"] = {"x": 0, "y": 0, "z": 0}
    return data


# Cells as long as the bar is thick and twice as long, one to four layers, and sound ones.
@pytest.mark.parametrize("elements", [(20, 1, 1), (10, 2, 2), (20, 2, 2), (20, 4, 4), (80, 4, 4)])
def test_how_much_too_stiff_or_soft_a_bar_in_space_bends_is_said(tmp_path, elements):
    def force(data):
        run = run_case(Case.model_validate(data), tmp_path, quiet=True, force=True)
        one = read(tmp_path).surfaces.query("surface == 'strip_right'")["force_y"].iloc[-1]
        return abs(one), [note for note in run.model.notes if "where it bends" in note]

    true, none = force(bar([40, 2, 2], formulation="q2"))
    found, said = force(bar(list(elements)))
    off = found / true - 1.0
    assert none == [] and len(said) == (abs(off) > 0.1)
    for note in said:
        percent, way = re.search(r"some ([\d.]+) % too (\w+)", note).groups()
        assert float(percent) / 100.0 == pytest.approx(abs(off), abs=0.08)
        assert way == ("stiff" if off > 0.0 else "soft")


def test_a_bar_that_is_held_or_a_thick_block_does_not_bend():
    """Tied halves do as one, and so does what is held across; a plane strain slab is as said."""

    def said(data):
        model = build_model(Case.model_validate(data), MPI.COMM_SELF)
        return [note for note in model.notes if "where it bends" in note]

    free = bar([10, 1, 1])
    assert ["98 % too stiff" in note for note in said(free)] == [True]
    held = deepcopy(free)
    held["boundary"][1] = {"surface": "strip_right", "displacement": {"x": 1e-5}}
    for side in ("bottom", "front"):
        held["boundary"].append({"surface": f"strip_{side}", "symmetry": True})
    held["boundary"][0]["displacement"] = {"x": 0}
    assert said(held) == []
    slab = deepcopy(free)
    for side in ("back", "front"):
        slab["boundary"].append({"surface": f"strip_{side}", "symmetry": True})
    assert ["87 % too stiff" in note for note in said(slab)] == [True]
    thick = deepcopy(free)
    thick["geometry"]["blocks"]["strip"] |= {"y": [0, 3e-3], "z": [0, 3e-3]}
    assert said(thick) == []
    halves = deepcopy(free)
    half = halves["geometry"]["blocks"]["strip"]
    halves["geometry"]["blocks"] |= {
        "strip": half | {"y": [0, 5e-4], "elements": [10, 1, 4]},
        "upper": half | {"y": [5e-4, 1e-3], "elements": [20, 1, 4]},
    }
    halves["bodies"]["upper"] = halves["bodies"]["strip"]
    halves["contact"] = [{"slave": "upper_bottom", "master": "strip_top", "tied": True}]
    [note] = said(halves)
    assert note.startswith("body strip with upper:") and "2 over a thickness of 0.001 m" in note
