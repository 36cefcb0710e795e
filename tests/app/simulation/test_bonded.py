"""Bodies that share nodes, cases without contact, names with spaces: run from the case file."""

import gmsh
import numpy as np
import pytest
from mpi4py import MPI

from tests.geometry.meshes.test_mesh import group, write_built
from tests.ranks import command
from tribox.app.build.model import build_model
from tribox.app.case.reading import load_case
from tribox.app.errors import InputError
from tribox.app.results import read

CASE = """
title = "two materials, one piece"
[geometry]
mesh = "own.msh"
scale = "mm"
thickness = "1 mm"
[bodies."rubber pad"]
material = "neo-hookean"
E = "5 MPa"
nu = 0.3
[bodies."steel plate"]
material = "neo-hookean"
E = "10 MPa"
nu = 0.3
[[boundary]]
surface = "lower side"
displacement = { y = 0 }
[[boundary]]
surface = "left side"
displacement = { x = 0 }
[[boundary]]
surface = "upper side"
displacement = { y = [["0 s", "0 mm"], ["1 s", "-0.003 mm"]] }
[[probe]]
name = "tip"
point = ["2 mm", "2 mm"]
[[stage]]
name = "press"
duration = "1 s"
steps = 2
"""


def layers():
    """A pad of 2 by 1, in mm, under a plate of 2 by 1, of the same nodes between them."""
    occ, model = gmsh.model.occ, gmsh.model
    occ.fragment([(2, occ.addRectangle(0, 0, 0, 2, 1))], [(2, occ.addRectangle(0, 1, 0, 2, 1))])
    occ.synchronize()
    for _, tag in model.getEntities(2):
        group(2, [tag], "rubber pad" if occ.getCenterOfMass(2, tag)[1] < 1 else "steel plate")
    at = {tag: occ.getCenterOfMass(1, tag) for _, tag in model.getEntities(1)}
    group(1, [t for t, c in at.items() if c[1] < 1e-9], "lower side")
    group(1, [t for t, c in at.items() if c[1] > 2 - 1e-9], "upper side")
    group(1, [t for t, c in at.items() if c[0] < 1e-9], "left side")
    group(1, [t for t, c in at.items() if abs(c[1] - 1) < 1e-9], "interface")
    for tag in at:
        model.mesh.setTransfiniteCurve(tag, 3)
    for _, tag in model.getEntities(2):
        model.mesh.setTransfiniteSurface(tag)
        model.mesh.setRecombine(2, tag)
    model.mesh.generate(2)


@pytest.fixture
def layered(tmp_path):
    def write(text=CASE):
        write_built(layers, tmp_path / "own.msh")
        path = tmp_path / "own.toml"
        path.write_text(text)
        return path

    return write


def pressed(comm, directory):
    """Numbers of a run."""
    path = directory / "own.toml"
    if comm.rank == 0:
        write_built(layers, directory / "own.msh")
        path.write_text(CASE)
    comm.barrier()
    command(comm, "run", path, "--out", directory / "out")
    if comm.rank > 0:
        return None
    found = read(directory / "out")
    last = found.history.iloc[-1]
    forces = found.bodies.set_index("body")["boundary_force_y"].iloc[-2:]
    return {
        "files": sorted(str(p.relative_to(found.directory)) for p in found.directory.rglob("*.*")),
        "said": found.summary["warnings"],
        "balance": found.summary["force_balance_relative"],
        "work": float(last["external_work"]),
        "energy": float(last["strain_energy"]),
        "forces": forces.to_dict(),
        "on": dict(zip(found.surfaces["surface"], found.surfaces["body"], strict=True)),
        "names": found.fields().cell_data["body"][0].tolist(),
        "tip": float(found.probes["displacement_x"].iloc[-1]),
    }


@pytest.mark.mpi(pressed, 2)
def test_a_piece_of_two_materials_without_contact_runs_and_balances(on_ranks):
    one, two = on_ranks(pressed, 1), on_ranks(pressed, 2)
    assert "bodies rubber pad and steel plate share 3 nodes: they are bonded there" in one["said"]
    assert not {"contacts.csv", "contact.pvd", "figures/history.png"} & set(one["files"])
    assert {"figures/deformed.png", "figures/energy.png", "surfaces.csv"} <= set(one["files"])
    assert one["on"]["left side"] == "rubber pad and steel plate"
    # Small strain, free to widen: two springs in series, but for what the interface holds.
    stress = 3e-6 / (1e-3 / 5e6 + 1e-3 / 10e6) / (1.0 - 0.3**2)
    series = stress * 2e-3 * 1e-3
    assert one["forces"]["rubber pad"] == pytest.approx(series, rel=0.02)
    assert one["forces"]["steel plate"] == pytest.approx(-one["forces"]["rubber pad"], rel=1e-9)
    assert one["balance"] < 1e-9
    assert one["work"] == pytest.approx(one["energy"], rel=2e-3)
    assert sorted(one["names"]) == 4 * [0] + 4 * [1]
    for key in ("work", "energy", "tip"):
        assert two[key] == pytest.approx(one[key], rel=1e-9)
    assert two["balance"] < 1e-9


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ('[[contact]]\nslave = "interface"\nmaster = "upper side"\n',
         'surface "interface": 2 of its 2 facets lie inside the mesh'),
        ('[[boundary]]\nsurface = "interface"\ndisplacement = { x = 0 }\n',
         "bodies that share nodes are bonded and have no surface there"),
        ('[[contact]]\nslave = "left side"\nmaster = "upper side"\n',
         'surface "left side" must lie on one body; it lies on rubber pad, steel plate'),
    ],
)  # fmt: skip
def test_a_contact_where_bodies_are_bonded_is_refused(layered, lines, said):
    friction = 'friction = { law = "frictionless" }\n' if "contact" in lines else ""
    path = layered(CASE.replace("[[probe]]", lines + friction + "[[probe]]"))
    with pytest.raises(InputError) as error:
        build_model(load_case(path), MPI.COMM_SELF)
    assert said in str(error.value)
    assert len(error.value.lines) == 1


@pytest.mark.parametrize(
    ("scale", "length"),
    [("", 2.0), ('scale = "mm"', 2e-3), ("scale = 0.001", 2e-3), ('scale = "2.5 cm"', 0.05)],
)
def test_scale_is_the_unit_of_the_files_coordinates(layered, scale, length):
    text = CASE.replace('scale = "mm"', scale)
    text = text[: text.index("[[probe]]")] + text[text.index("[[stage]]") :]
    model = build_model(load_case(layered(text)), MPI.COMM_SELF)
    assert np.ptp(model.named.mesh.geometry.x[:, 0]) == pytest.approx(length, rel=1e-14)
    told = [note for note in model.notes if 'set geometry.scale = "mm"' in note]
    assert len(told) == (1 if not scale else 0)
