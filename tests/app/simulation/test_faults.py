"""Faults end as they should: nothing lost, one line, the right exit code."""

import csv
import json
import re

import numpy as np
import pytest

from tribox.app.build.model import build_model
from tribox.app.case.reading import load_case
from tribox.app.errors import InputError, SolutionError
from tribox.app.run import sweep_runs
from tribox.app.run.building import notes_on_building
from tribox.app.run.ranks import RunOptions
from tribox.app.run.run import run_case
from tribox.app.simulation.simulation import Simulation

SINGULAR = """
[[boundary]]
surface = "top"
displacement = { x = "driven" }
platen = { direction = "y", pressure = [["0 s", "0 MPa"], ["1 s", "-0.2 MPa"]] }
[[stage]]
name = "press"
duration = "1 s"
steps = 2
[[stage]]
name = "slide"
velocity = "0.1 mm/s"
duration = "1 s"
[output]
figures = false
"""


def test_a_singular_tangent_ends_with_code_3(tribox, case_file, block):
    """A loose body pulled away: MUMPS fails, and would fail again on the factor it kept."""
    text = block.split('[[boundary]]\nsurface = "top"')[0]
    text = re.sub(r"elements = \[\d+, \d+\]", "elements = [1, 1]", text)
    text = text.replace('kind = "two-blocks"', 'kind = "two-blocks"\ngap = "5 mm"')
    text = text.replace('"neo-hookean"\nE = "70 GPa"', '"hencky"\nE = "70 GPa"')
    text += "[solver]\nmin_step_fraction = 0.3\n"
    done = tribox("run", case_file(text + SINGULAR), "--out", "out")
    assert done.returncode == 3, done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert "stage press" in done.stderr


def test_an_error_of_the_program_keeps_the_history(monkeypatch, case_file, block, tmp_path):
    from tribox.app.results.recorder import Recorder

    def broken(self, simulation, row, result):
        if row.step == 2:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(Recorder, "step", broken)
    with pytest.raises(OSError, match="No space"):
        run_case(load_case(case_file(block)), tmp_path / "out", quiet=True)
    with (tmp_path / "out" / "history.csv").open() as stream:
        assert len(list(csv.DictReader(stream))) == 2


def test_a_failed_value_of_a_sweep_leaves_the_others_collated(case_file, block, monkeypatch):
    """In turn, as on ranks of an mpirun, in this process."""
    sweep = '[sweep]\nkey = "boundary.1.displacement.y"\nvalues = ["-0.01 mm", "-0.6 mm"]\n'
    text = block.replace("steps = 3", "steps = 1").replace("steps = 6", "steps = 1")
    path = case_file(text + "[solver]\nmin_step_fraction = 0.3\nmax_iterations = 8\n" + sweep)
    out = path.parent / "out"
    monkeypatch.setattr(sweep_runs, "ranks_around", lambda: 2)
    with pytest.raises(SolutionError, match=r"1 runs of the sweep failed: y=-0.6mm \(stage press"):
        sweep_runs.run_sweep(load_case(path), path, out, RunOptions())
    with (out / "sweep.csv").open() as stream:
        assert {row["label"] for row in csv.DictReader(stream)} == {"y=-0.01mm"}
    parts = json.loads((out / "summary.json").read_text())["parts"]
    assert parts["y=-0.01mm"]["status"] == "done"
    assert parts["y=-0.6mm"]["status"] == "failed"


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (
            '[[boundary]]\nsurface = "top"',
            '[[boundary]]\nsurface = "elastomer_left"\ndisplacement = { x = 0 }\n'
            '[[boundary]]\nsurface = "top"',
            r'"elastomer_left" and "top" share a node, at \(0.0005, 0.0005\) m, and both '
            "decide its displacement in x",
        ),
        ('master = "aluminium_contact"', 'master = "top"', "m inside top"),
        ('master = "aluminium_contact"', 'master = "bottom"', "face the same way"),
    ],
)
def test_what_cannot_be_is_refused_before_the_run(case_file, block, old, new, expected):
    from mpi4py import MPI

    case = load_case(case_file(block.replace(old, new)))
    with pytest.raises(InputError, match=expected):
        build_model(case, MPI.COMM_SELF)


def test_equal_prescriptions_may_share_a_node(case_file, block):
    from mpi4py import MPI

    held = '[[boundary]]\nsurface = "aluminium_left"\ndisplacement = { x = 0 }\n'
    text = block.replace('[[boundary]]\nsurface = "top"', held + '[[boundary]]\nsurface = "top"')
    build_model(load_case(case_file(text)), MPI.COMM_SELF)


def test_a_pair_given_twice_is_refused(case_file, block):
    pair = (
        '[[contact]]\nslave = "aluminium_contact"\nmaster = "elastomer_contact"\n'
        '[contact.friction]\nlaw = "frictionless"\n'
    )
    with pytest.raises(InputError, match=r"this pair of surfaces is contact\.0 already"):
        load_case(case_file(block.replace("[[boundary]]", pair + "[[boundary]]", 1)))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ('pc_factor_mat_solver_type = "pastix"', r"solver\.petsc: .*pastix"),
        (
            "pc_gamg_threshold = 0.1",
            r'pc_gamg_threshold: not used by PETSc with ksp_type "preonly"',
        ),
        ("sub_mat_mumps_icntl_14 = 40", r"sub_mat_mumps_icntl_14: not used by PETSc"),
    ],
)
def test_options_that_petsc_has_no_use_for_are_wrong_input(
    case_file, block, tmp_path, options, said
):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "history.csv").write_text("old")
    case = load_case(case_file(f"{block}[solver.petsc]\n{options}\n"))
    with pytest.raises(InputError, match=said):
        run_case(case, tmp_path / "out", force=True, quiet=True)
    with pytest.raises(InputError, match=said):
        notes_on_building(case)
    assert (tmp_path / "out" / "history.csv").read_text() == "old"


def test_options_of_one_run_do_not_reach_the_next(case_file, block):
    from mpi4py import MPI

    limited = load_case(case_file(block + "[solver.petsc]\nsnes_max_it = 1\n"))
    first = Simulation(build_model(limited, MPI.COMM_SELF))
    assert first.stepper.snes.getTolerances()[3] == 1
    second = Simulation(build_model(load_case(case_file(block)), MPI.COMM_SELF))
    assert second.stepper.snes.getTolerances()[3] == 25


def test_no_film_at_all_has_figures_too(case_file, film, tmp_path):
    text = film.replace('"30 nm"', '"0 nm"').replace("figures = false", "figures = true")
    text = text.replace('["1e-5 m/s", "2e-3 m/s"]', '["1e-5 m/s"]')
    simulation = run_case(load_case(case_file(text)), tmp_path / "out", quiet=True)
    assert simulation.rows[-1].tangential_force > 0.0
    figures = {path.name for path in (tmp_path / "out" / "figures").iterdir()}
    assert "friction_map.png" in figures
    assert "effective_viscosity.png" not in figures


def test_a_load_step_whose_steps_are_all_cut_still_becomes_steady(monkeypatch, case_file, film):
    from mpi4py import MPI

    from tribox.app.implicit.stepper import ImplicitStepper
    from tribox.app.simulation.run_state import Observer

    case = load_case(case_file(film.replace('["1e-5 m/s", "2e-3 m/s"]', '["1e-5 m/s"]')))
    attempt = ImplicitStepper.attempt
    whole = 4e-6 / 1e-5

    def choosy(self, dt):
        result = attempt(self, dt)
        if np.isclose(dt, whole):
            result.converged = False
        return result

    monkeypatch.setattr(ImplicitStepper, "attempt", choosy)
    ends = []

    class LoadSteps(Observer):
        def load_step(self, simulation, load_step, row, steady):
            ends.append(steady)

    Simulation(build_model(case, MPI.COMM_SELF)).run(LoadSteps())
    assert ends == [None, True]


def test_plot_without_a_summary_and_with_a_broken_history(tribox, case_file, block):
    path = case_file(block)
    assert tribox("run", path, "--out", "out").returncode == 0
    out = path.parent / "home" / "out"
    (out / "summary.json").unlink()
    assert tribox("plot", "out").returncode == 0
    (out / "history.csv").write_text("step,time\n1,ab\n")
    done = tribox("plot", "out")
    assert done.returncode == 2
    assert "cut off or not a table" in done.stderr


def test_low_pressure_on_a_thick_onset_is_warned_of(case_file, film, tmp_path):
    """Of the film, not of asperities: F_T is 5.37 % lower than with an onset of 1 mPa."""
    text = film.replace("mu_s = 0.12", 'film_onset_pressure = "0.3 MPa"\nmu_s = 0.12')
    text = text.replace('"1e-5 m/s", ', "")
    run_case(load_case(case_file(text)), tmp_path / "out", quiet=True)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    [line] = [line for line in summary["warnings"] if "film_onset_pressure" in line]
    lost = re.search(r"stage slide 0.002 m/s: (\S+) % of the film's force is lost where", line)
    assert lost is not None and float(lost[1]) == pytest.approx(5.37, abs=0.1)
    assert summary["film_onset_pressure"] == [0.3e6]
