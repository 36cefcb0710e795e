"""PETSc options of a case: what may be given, and that nothing else may."""

from __future__ import annotations

import pytest

from tribox.app.case.reading import check_case
from tribox.app.case.solver import option_problems


def refused(name, value):
    """The reason why an option is refused; empty if it is not."""
    problems = list(option_problems({name: value}))
    assert all(problem.place == (name,) for problem in problems)
    return " ".join(problem.reason for problem in problems)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("ksp_type", "gmres"),
        ("ksp_rtol", 1e-8),
        ("ksp_rtol", "1e-8"),
        ("ksp_initial_guess_nonzero", True),
        ("ksp_initial_guess_nonzero", "false"),
        ("pc_gamg_threshold", "0.1,0.05"),
        ("mat_mumps_icntl_14", 60),
        ("mat_mumps_cntl_1", 0.01),
        ("sub_mat_mumps_icntl_24", 1),
        ("mg_levels_ksp_max_it", 2),
        ("mg_levels_2_pc_sor_omega", 0.9),
        ("mg_coarse_sub_pc_type", "lu"),
        ("mg_levels_esteig_ksp_max_it", 5),
        ("pc_hypre_boomeramg_relax_type_all", "l1scaled-SOR/Jacobi"),
        ("snes_linesearch_type", "l2"),
        ("snes_ksp_ew", True),
    ],
)
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
        ("pc_type", "shell", "must be one of"),
        ("sub_ksp_type", "python", "must be one of"),
        ("snes_type", "python", 'must be one of "newtonls", "newtontr"'),
        ("pc_type", True, "must be one of"),
        ("ksp_rtol", "binary:x", "must be a number"),
        ("ksp_rtol", True, "must be a number"),
        ("ksp_rtol", "nan", "must be a number"),
        ("ksp_rtol", "1,2", "must be a number"),
        ("ksp_rtol", "1" * 99, "must be a number"),
        ("pc_gamg_threshold", "0.1,", "must be a number, or several"),
        ("ksp_initial_guess_nonzero", ":x", "must be true or false"),
        ("ksp_typ", "gmres", 'did you mean "ksp_type"'),
        ("mg_levels_ksp_typ", "gmres", 'did you mean "mg_levels_ksp_type"'),
        ("-ksp_type", "gmres", 'write it without the hyphen: "ksp_type"'),
    ],
)
def test_what_is_allowed_is_said(name, value, said):
    assert said in refused(name, value)


def test_the_case_names_the_key(case_file, block):
    path = case_file(block + '[solver.petsc]\npc_type = "python"\nksp_rtol = 1e-3\n')
    [line] = check_case(path)
    assert line.startswith(f'{path}: solver.petsc.pc_type = "python": must be one of "none"')
