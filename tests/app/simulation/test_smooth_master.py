"""`smoothing_angle` of a contact: reaches the surface, and is refused where it cannot work."""

import math

import pytest
from mpi4py import MPI

from tribox.app.build.model import build_model
from tribox.app.case.reading import check_case, load_case
from tribox.app.errors import InputError
from tribox.app.verify.result import CASES
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
