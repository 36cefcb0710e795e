"""Cases whose mesh is a drawing, a .geo or a STEP file: sizes, names, and runs that go on."""

import gmsh
import numpy as np
import pytest
from mpi4py import MPI

from tests.geometry.meshes.test_mesh import resultants
from tribox.app.build.mesh import make_mesh
from tribox.app.case.reading import load_case
from tribox.app.errors import InputError
from tribox.app.results import read
from tribox.app.run.run import run_case
from tribox.geometry.meshes.gmsh_model import gmsh_session

GEO = """
SetFactory("OpenCASCADE");
Disk(1) = {0, 0, 0, 10};
Physical Surface("round bar") = {1};
Physical Curve("rim") = {1};
"""
CASE = """
[geometry]
mesh = "bar.geo"
scale = "mm"
size = "8 mm"
{keys}
[bodies."round bar"]
material = "neo-hookean"
E = "5 MPa"
nu = 0.3
[[boundary]]
surface = "rim"
displacement = {{ x = 0, y = [["0 s", "0 mm"], ["1 s", "-1 mm"]] }}
[[stage]]
name = "move"
duration = "1 s"
[output]
figures = false
"""


@pytest.fixture
def drawn(tmp_path):
    """Writes a case with a drawing."""

    def write(keys="", geo=GEO, text=CASE):
        (tmp_path / "bar.geo").write_text(geo)
        path = tmp_path / "bar.toml"
        path.write_text(text.format(keys=keys))
        return path

    return write


@pytest.mark.parametrize(
    ("keys", "cell", "order"),
    [
        ("", "triangle", 1),
        ("order = 2", "triangle", 2),
        ('cell = "quadrilateral"', "quadrilateral", 1),
        ('cell = "quadrilateral"\norder = 2', "quadrilateral", 2),
    ],
)
def test_a_drawing_is_meshed_as_the_case_says(drawn, keys, cell, order):
    named = make_mesh(load_case(drawn(keys)), MPI.COMM_SELF)
    assert (named.mesh.topology.cell_name(), named.order) == (cell, order)
    found = resultants(named)
    assert found["round bar"] == pytest.approx(np.pi * 1e-4, rel=0.2 if order == 1 else 5e-3)
    assert found["rim"] == pytest.approx(0.02 * np.pi, rel=0.05 if order == 1 else 2e-3)


@pytest.mark.parametrize("keys", ["", 'sizes = { "round bar" = "1 mm" }'])
def test_a_forgotten_unit_is_told_before_it_is_meshed(drawn, keys):
    """20 m across in cells of some mm: gmsh would go on for hours."""
    text = CASE.replace('scale = "mm"\n', "").replace("8 mm", "2 mm")
    with pytest.raises(InputError, match=r"some \de\+07 cells.* is scale missing"):
        make_mesh(load_case(drawn(keys, text=text)), MPI.COMM_SELF)


def test_sizes_on_surfaces_and_in_bodies_are_those_of_the_cells(drawn):
    def lengths(keys, name):
        named = make_mesh(load_case(drawn(keys)), MPI.COMM_SELF)
        named.mesh.topology.create_connectivity(1, 0)
        facets, cells = named.facets("rim"), named.cells("round bar")
        return named.mesh.h(1, facets) if name == "rim" else named.mesh.h(2, cells)

    assert lengths("", "rim").mean() > 4e-3
    rim = lengths('sizes = { rim = "1 mm" }', "rim")
    assert rim == pytest.approx(1e-3, rel=0.2)
    inside = lengths('sizes = { rim = "1 mm" }', "round bar")
    assert inside.max() > 2.0 * rim.mean()  # it grows away from the rim
    body = lengths('sizes = { "round bar" = "2 mm" }', "round bar")
    assert 1e-3 < body.mean() < 2.6e-3 and body.max() < 3.5e-3


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ('sizes = { rm = "1 mm" }', 'sizes: no body or surface named "rm"; did you mean "rim"?'),
        ('cell = "hexahedron"', 'cell = "hexahedron": here "triangle" or "quadrilateral"'),
        ('surfaces = { far = [["30 mm", "0 mm"]] }', "surfaces.far: no curve at (30, 0, 0)"),
        ("surfaces = { far = [9] }", "surfaces.far: no curve 9; there are 1"),
        ('surfaces = { "other" = [1] }', "may be in one only"),
        ('sizes = { rim = "9 mm" }', "geometry.sizes.rim = 0.009: is larger than size = 0.008 m"),
        ("order = 3", "geometry.order = 3"),
        ("surfaces = { far = [] }", "geometry.surfaces.far"),
    ],
)
def test_what_a_drawing_cannot_have_is_one_line(drawn, keys, said):
    with pytest.raises(InputError) as error:
        make_mesh(load_case(drawn(keys)), MPI.COMM_SELF)
    assert said in str(error.value) and len(error.value.lines) == 1


def test_a_drawing_with_cells_of_its_own_takes_no_triangles(drawn):
    path = drawn('cell = "triangle"', geo=GEO + "Recombine Surface{1};\n")
    with pytest.raises(InputError, match=r"the drawing itself asks for other cells \(Recombine\)"):
        make_mesh(load_case(path), MPI.COMM_SELF)


def test_keys_of_drawings_do_not_go_with_a_mesh_file(drawn, tmp_path):
    path = drawn()
    (tmp_path / "bar.msh").write_text("")
    path.write_text(path.read_text().replace("bar.geo", "bar.msh"))
    with pytest.raises(InputError, match=r"geometry\.size: goes with a drawing"):
        load_case(path)
    path.write_text(path.read_text().replace('size = "8 mm"', 'sizes = { rim = "1 mm" }'))
    with pytest.raises(InputError, match=r"geometry\.sizes: goes with a drawing"):
        load_case(path)


def test_a_run_goes_on_with_the_mesh_it_began_with(drawn, tmp_path, monkeypatch):
    path, out = drawn("order = 2"), tmp_path / "out"
    run_case(load_case(path), out, quiet=True)
    began = read(out)
    assert began.case.geometry.meshed == out / "inputs" / "bar.msh"
    assert (out / "inputs" / "bar.geo").read_text() == GEO
    # Nothing is drawn again, neither of the results ...
    monkeypatch.setattr("tribox.app.run.run.mesh_drawing", None)
    monkeypatch.setattr("tribox.geometry.meshes.mesh.mesh_drawing", None)
    again = run_case(load_case(out / "case.toml"), tmp_path / "again", quiet=True)
    assert np.array_equal(read(tmp_path / "again").fields().points, began.fields().points)
    assert [row.strain_energy for row in again.rows] == began.history["strain_energy"].tolist()
    # ... nor to go on; but of a drawing that has changed since.
    more = path.read_text() + '[[stage]]\nname = "rest"\nduration = "1 s"\n'
    path.write_text(more)
    run_case(load_case(path), out, quiet=True, extend=True)
    assert read(out).history["stage"].tolist() == 10 * ["move"] + 10 * ["rest"]
    path.write_text(more + '[[stage]]\nname = "end"\nduration = "1 s"\n')
    (tmp_path / "bar.geo").write_text(GEO.replace("10", "11"))
    with pytest.raises(TypeError):
        run_case(load_case(path), out, quiet=True, extend=True)
    monkeypatch.undo()
    with pytest.raises(InputError, match="mesh"):
        run_case(load_case(path), out, quiet=True, extend=True)


STEP = """
[geometry]
mesh = "parts.step"
size = "6 mm"
[geometry.bodies]
"lower block" = [["5 mm", "-5 mm", "5 mm"]]
upper = [2]
[geometry.surfaces]
"lower face" = [["9 mm", "0 mm", "1 mm"]]
ends = [["4 mm", "6 mm", "4 mm"], ["4 mm", "-10 mm", "4 mm"]]
[bodies.upper]
material = "neo-hookean"
E = "5 MPa"
nu = 0.3
[bodies."lower block"]
material = "neo-hookean"
E = "5 MPa"
nu = 0.3
[[boundary]]
surface = "lower face"
displacement = { x = 0, y = 0, z = 0 }
[[stage]]
name = "rest"
duration = "1 s"
"""


def write_step(path):
    """Two blocks, 10 and 6 mm high, in a file in mm; the upper one is narrower."""
    with gmsh_session("parts"):
        gmsh.model.occ.addBox(0, -10, 0, 10, 10, 10)
        gmsh.model.occ.addBox(0, 0, 0, 8, 6, 8)
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))


def test_parts_of_a_step_file_are_named_by_number_or_by_points(tmp_path):
    path = tmp_path / "parts.toml"
    write_step(tmp_path / "parts.step")
    path.write_text(STEP)
    found = resultants(make_mesh(load_case(path), MPI.COMM_SELF))
    lower = "lower block"
    assert found == pytest.approx(
        {lower: 1e-6, "upper": 8 * 6 * 8e-9, "lower face": 1e-4, "ends": 1.64e-4}, rel=1e-6
    )
    for line, said in (
        ('scale = "mm"\n', "geometry.scale = 0.001: a STEP file says its unit itself"),
        ('cell = "hexahedron"\norder = 2\n', "is of order 1"),
    ):
        path.write_text(STEP.replace('size = "6 mm"\n', f'size = "6 mm"\n{line}'))
        with pytest.raises(InputError, match=said):
            make_mesh(load_case(path), MPI.COMM_SELF)
    path.write_text(STEP.replace('size = "6 mm"\n', 'size = "6 mm"\ncell = "hexahedron"\n'))
    named = make_mesh(load_case(path), MPI.COMM_SELF)
    assert named.mesh.topology.cell_name() == "hexahedron"
    assert resultants(named) == pytest.approx(found, rel=1e-6)


def test_mesh_shows_the_numbers_of_a_step_file(tmp_path, tribox):
    write_step(tmp_path / "parts.step")
    done = tribox("mesh", tmp_path / "parts.step")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "parts.png").is_file() and (tmp_path / "parts.msh").is_file()
    lines = done.stdout.splitlines()
    assert "body 2: x 0 to 8, y 0 to 6, z 0 to 8 mm" in lines
    assert sum(line.startswith("surface ") for line in lines) == 12


def test_a_damaged_step_file_is_one_line(tmp_path):
    path = tmp_path / "parts.toml"
    path.write_text(STEP)
    (tmp_path / "parts.step").write_text("ISO-10303-21;\nHEADER;\nnothing")
    with pytest.raises(InputError, match=r"parts\.step: ") as error:
        make_mesh(load_case(path), MPI.COMM_SELF)
    assert len(error.value.lines) == 1
