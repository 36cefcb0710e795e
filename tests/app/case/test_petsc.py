"""PETSc options of a case: what may be given, and that nothing else may."""

import tomllib

import pytest
from pydantic import ValidationError

from tests.app.conftest import BLOCK
from tribox.app.case.case import Case
from tribox.app.case.reading import check_case, format_problem, problems_of
from tribox.app.case.solver import option_problems
from tribox.app.case.toml_files import set_value


def refused(name, value):
    """The reason why an option is refused; empty if it is not."""
    problems = list(option_problems({name: value}))
    assert all(problem.place == (name,) for problem in problems)
    return " ".join(problem.reason for problem in problems)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("ksp_type", "gmres"), ("ksp_rtol", 1e-8), ("ksp_rtol", "1e-8"),
        ("ksp_initial_guess_nonzero", True), ("ksp_initial_guess_nonzero", "false"),
        ("pc_gamg_threshold", "0.1,0.05"), ("mat_mumps_icntl_14", 60), ("mat_mumps_cntl_1", 0.01),
        ("sub_mat_mumps_icntl_24", 1), ("mg_levels_ksp_max_it", 2),
        ("mg_levels_2_pc_sor_omega", 0.9), ("mg_coarse_sub_pc_type", "lu"),
        ("mg_levels_esteig_ksp_max_it", 5),
        ("pc_hypre_boomeramg_relax_type_all", "l1scaled-SOR/Jacobi"),
        ("snes_linesearch_type", "l2"), ("snes_ksp_ew", True),
    ],
)  # fmt: skip
def test_options_of_solvers_are_allowed(name, value):
    assert not refused(name, value)


@pytest.mark.parametrize(
    "name",
    [
        "ksp_view_mat", "ksp_view", "ksp_monitor", "mg_levels_ksp_monitor", "log_view", "info",
        "options_file", "snes_monitor_solution", "pc_python_type", "mat_view",
        "viewer_binary_filename",
        "mat_mumps_icntl_1", "mat_mumps_icntl_2", "mat_mumps_icntl_3", "mat_mumps_icntl_19",
        "mat_mumps_icntl_22",
        "mat_mumps_ooc_tmpdir", "mat_mumps_icntl_140", "mat_mumps_icntl_14 ", "pc_hypre_euclid_bj",
        "dll_append", "malloc_view", "on_error_attach_debugger", "ksp_rtol\n-log_view", "", "-",
    ],
)  # fmt: skip
@pytest.mark.parametrize("value", [True, 1, "gmres", "binary:/tmp/x", "ascii:x"])
def test_options_that_print_write_or_run_are_refused(name, value):
    assert "no PETSc option that a case may give" in refused(name, value)


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("pc_type", "python", 'must be one of "none", "jacobi"'),
        ("pc_type", "shell", "must be one of"), ("sub_ksp_type", "python", "must be one of"),
        ("snes_type", "python", 'must be one of "newtonls", "newtontr"'),
        ("pc_type", True, "must be one of"), ("ksp_rtol", "binary:x", "must be a number"),
        ("ksp_rtol", True, "must be a number"), ("ksp_rtol", "nan", "must be a number"),
        ("ksp_rtol", "1,2", "must be a number"), ("ksp_rtol", "1" * 99, "must be a number"),
        ("pc_gamg_threshold", "0.1,", "must be a number, or several"),
        ("ksp_initial_guess_nonzero", ":x", "must be true or false"),
        ("ksp_typ", "gmres", 'did you mean "ksp_type"'),
        ("mg_levels_ksp_typ", "gmres", 'did you mean "mg_levels_ksp_type"'),
        ("-ksp_type", "gmres", 'write it without the hyphen: "ksp_type"'),
    ],
)  # fmt: skip
def test_what_is_allowed_is_said(name, value, said):
    assert said in refused(name, value)


def test_the_case_names_the_key(case_file, block):
    path = case_file(block + '[solver.petsc]\npc_type = "python"\nksp_rtol = 1e-3\n')
    [line] = check_case(path)
    assert line.startswith(f'{path}: solver.petsc.pc_type = "python": must be one of "none"')


# -- Each mistake in a boundary's loads, stages and releases is one line that names the key --------

SIDE = {"surface": "elastomer_left"}
OBLIQUE = {"surface": "top", "platen": {"direction": [1, 1], "force": 0}}
HOLD = {"direction": "y", "hold_force": True}
MISTAKES = [
    ({"boundary.2": SIDE}, "boundary.2: does nothing; give displacement, velocity, platen, spring"),
    ({"boundary.2": SIDE | {"traction": {}}}, "boundary.2.traction: has no component; give x, y"),
    ({"boundary.2": SIDE | {"traction": {"z": "1 MPa"}}},
     "boundary.2.traction.z: there is no z in a mesh in the plane"),
    ({"boundary.2": SIDE | {"force": {"x": "1 Pa"}}}, 'boundary.2.force.x = "1 Pa": "Pa" has the'),
    ({"boundary.2": SIDE | {"force": {"x": "1 N"}}, "geometry.section": "axisymmetric",
     "geometry.thickness": None},
     "boundary.2.force.x: forces across the axis cancel round the ring; give a traction"),
    ({"boundary.2": SIDE | {"foundation": {}}},
     'boundary.2.foundation: has no stiffness; give normal, tangential or both, in "Pa/m"'),
    ({"boundary.2": SIDE | {"foundation": {"normal": -1}}},
     "boundary.2.foundation.normal = -1: must be >= 0 Pa/m"),
    ({"boundary.2": SIDE | {"foundation": {"normal": 1, "base": {"x": "driven"}}}},
     'boundary.2.foundation.base.x = "driven": never moves: no stage has velocity'),
    ({"boundary.2": SIDE | {"symmetry": "yes"}},
     'boundary.2.symmetry = "yes": must be true or false'),
    ({"boundary.2": SIDE | {"pressure": 1, "stages": ["pres"]}},
     'boundary.2.stages = "pres": no stage has this name; there are press, slide'),
    ({"boundary.2": {"surface": "top", "displacement": {"x": 0}, "stages": ["slide"]}},
     'boundary.2.displacement.x: "top" is already moved in x by boundary.1.displacement.x'),
    ({"boundary.2": OBLIQUE},
     'boundary.2.platen.direction: "top" is already moved in x by boundary.1.displacement.x'),
    ({"boundary.1": OBLIQUE | {"platen": {"direction": [1], "force": 0}}},
     "boundary.1.platen.direction = [1]: must have two components in the plane, three in space"),
    ({"boundary.1": OBLIQUE | {"platen": {"direction": [1, 2, 3], "force": 0}}},
     "boundary.1.platen.direction = [1.0, 2.0, 3.0]: must have 2 components in this mesh"),
    ({"boundary.1": OBLIQUE | {"platen": {"direction": [0, 0], "force": 0}}},
     "boundary.1.platen.direction = [0, 0]: must not be zero in all components"),
    ({"boundary.1": OBLIQUE | {"platen": {"direction": "up", "force": 0}}},
     'boundary.1.platen.direction = "up": must be "x", "y" or "z", or components such as'),
    ({"boundary.1": {"surface": "top", "platen": HOLD}},
     "boundary.1.platen.hold_force = true: holds what displacement_stages end with"),
    ({"gravity": {}}, "gravity: has no component"),
    ({"gravity": {"y": -9.81}},
     'bodies.elastomer.density: missing; gravity needs the mass of each body, in "kg/m^3"'),
    ({"gravity": {"y": "-9.81 m/s"}}, 'gravity.y = "-9.81 m/s": "m/s" has the wrong dimension'),
    ({"gravity": {"z": 1}}, "gravity.z: there is no z in a mesh in the plane"),
    ({"gravity": {"y": 1, "stages": ["no"]}},
     'gravity.stages = "no": no stage has this name; there are press, slide'),
    ({"stage.0.release": ["top"]},
     'stage.0.release = ["top"]: the first stage has no reactions or contact forces to '),
    ({"stage.1.release": ["elastomer_left"]},
     'stage.1.release = "elastomer_left": no boundary holds or moves a surface of '),
    ({"stage.2": {"name": "b", "duration": 1, "release": ["top"]}, "stage.1.release": ["top"]},
     'stage.2.release = "top": is released in stage slide already'),
    ({"stage.1": {"name": "v", "velocities": [1], "slip_step": 1, "release": ["top"]}},
     "stage.1.release: goes with duration only: reactions are taken off over it"),
]  # fmt: skip
EXPLICIT = {"solver.kind": "explicit", "bodies.elastomer.density": 1, "bodies.aluminium.density": 1}
MISTAKES += [
    (
        EXPLICIT | {"boundary.1": OBLIQUE},
        "boundary.1.platen.direction = [1.0, 1.0]: does not go with explicit stages unless",
    ),
    (EXPLICIT | {"stage.1.release": ["top"]}, 'release = ["top"]: goes with implicit stages only'),
    (
        EXPLICIT
        | {"boundary.1": OBLIQUE | {"platen": {"direction": "y", "force": 0}, "stages": ["press"]}},
        'boundary.1.stages = ["press"]: with a platen does not go with explicit stages',
    ),
]


def problems(keys: dict[str, object]) -> list[str]:
    """The lines on a small case with some keys changed; one past the end of an array is added."""
    data = tomllib.loads(BLOCK)
    for key, value in keys.items():
        array, _, number = key.rpartition(".")
        if number.isdigit() and int(number) == len(data[array]):
            data[array].append(value)
        elif value is None:
            del data[array][number]
        else:
            set_value(data, key, value)
    try:
        Case.model_validate(data)
    except ValidationError as error:
        return [format_problem(problem) for problem in problems_of(error, Case, data)]
    return []


@pytest.mark.parametrize(("keys", "line"), MISTAKES)
def test_a_mistake_is_one_line(keys, line):
    found = problems(keys)
    assert any(line in one for one in found), found
    assert all("\n" not in one for one in found)


def test_what_acts_in_other_stages_may_decide_the_same():
    again = {"surface": "top", "displacement": {"x": 0, "y": 0}, "stages": ["slide"]}
    assert problems({"boundary.2": again, "boundary.1.stages": ["press"]}) == []


@pytest.mark.parametrize("direction", [[0, 3], [0, -1.0], "y"])
def test_a_direction_along_an_axis_is_its_letter(direction):
    data = tomllib.loads(BLOCK)
    data["boundary"][1] = {"surface": "top", "platen": {"direction": direction, "force": 1}}
    case = Case.model_validate(data)
    assert case.boundary[1].platen.direction == "y"
    again = Case.model_validate(case.model_dump(mode="json", exclude_none=True))
    assert again == case
