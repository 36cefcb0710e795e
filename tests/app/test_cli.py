"""The command line as a user meets it: files that appear, lines on stderr, exit codes."""

import csv
import json
import math
import sys
from pathlib import Path

import gmsh
import meshio
import pytest
from mpi4py import MPI

from tests.app.read_log import read_log
from tribox.app.build.model import build_model
from tribox.app.case.reading import load_case
from tribox.app.results.reading import read_table

LENGTH = 1e-3


def swap(text: str, old: str, new: str) -> str:
    """The text with one thing replaced, which must be there."""
    assert old in text
    return text.replace(old, new, 1)


def snapshot(directory: Path) -> dict[str, bytes]:
    return {
        str(p.relative_to(directory)): p.read_bytes()
        for p in sorted(directory.rglob("*"))
        if p.is_file()
    }


def assert_refused(result, *fragments):
    """Exit code 2, nothing on stdout, one line on stderr that says all the fragments."""
    lines = result.stderr.splitlines()
    assert (result.returncode, result.stdout, len(lines)) == (2, "", 1), result
    assert lines[0].startswith("tribox: ")
    for fragment in fragments:
        assert fragment in lines[0]


MISTAKES = {
    "unknown key": ("block", "mu = 0.2", "nu = 0.2", ["nu", "contact.0.friction", "mu"]),
    "no TOML": ("block", "[[contact]]", "[[contact]", ["not valid TOML"]),
    "explicit": ("block", "[output]", '[solver]\nkind = "explicit"\n[output]', ["density"]),
    "negative film": ("film", '"30 nm"', '"-30 nm"', ["contact.0.film.thickness"]),
}


@pytest.mark.parametrize(("base", "old", "new", "said"), MISTAKES.values(), ids=MISTAKES)
def test_wrong_case_is_one_line_and_check_finds_the_same(
    request, tribox, case_file, tmp_path, base, old, new, said
):
    path = case_file(swap(request.getfixturevalue(base), old, new))
    before = snapshot(tmp_path)
    result = tribox("run", path)
    assert_refused(result, path.name, *said)
    checked = tribox("check", path)
    assert checked.returncode == 2 and checked.stdout == ""
    found = [line.removeprefix("tribox: ") for line in checked.stderr.splitlines()]
    reported = result.stderr.strip().removeprefix("tribox: ").split(" (and ")[0]
    assert reported in found
    assert snapshot(tmp_path) == before


@pytest.mark.parametrize("words", [["check", "nowhere.toml"], ["schema"]])
def test_a_process_does_as_the_call_does(tribox, words):
    """Most tests here call the command; what its users start is a process."""
    called, started = tribox(*words), tribox(*words, process=True)
    assert (called.returncode, called.stdout) == (started.returncode, started.stdout)
    assert called.stderr == started.stderr
    assert called.returncode == (0 if words == ["schema"] else 2)


@pytest.mark.parametrize("command", ["run", "check", "mesh"])
def test_missing_case_file_or_drawing(tribox, command):
    for name in ("nowhere.toml", "nowhere.geo"):
        result = tribox(command, name)
        assert result.returncode == 2 and result.stdout == ""
        assert len(result.stderr.splitlines()) == 1
        assert f"{name}: no such file" in result.stderr


def test_wrong_usage_is_code_2(tribox):
    result = tribox("run", "a.toml", "--np", "0", process=True)
    assert result.returncode == 2
    assert "Error: " in result.stderr and "Traceback" not in result.stderr


def test_wrong_override_is_one_line(tribox, case_file, block):
    path = case_file(block)
    assert_refused(tribox("run", path, "--set", "contact.3.friction.mu=0.1"), "contact")
    assert_refused(tribox("run", path, "--set", "nonsense"), "key=value")


# -- results that are there -----------------------------------------------------------------------


def test_results_are_replaced_only_when_forced(tribox, case_file, block, tmp_path):
    path = case_file(block)
    out = tmp_path / "out"
    assert tribox("run", path, "--out", out).returncode == 0
    before = snapshot(out)
    assert_refused(tribox("run", path, "--out", out), str(out), "--out", "--force")
    assert snapshot(out) == before

    short = tribox("run", path, "--out", out, "--force", "--set", "stage.1.steps=1")
    assert short.returncode == 0, short.stderr
    assert len(read_table(out / "history.csv")) == 4
    assert len(list((out / "contact").glob("*.vtu"))) == 4

    (out / "thesis.tex").write_text("years of work")
    before = snapshot(out)
    assert_refused(tribox("run", path, "--out", out, "--force"), "thesis.tex")
    assert snapshot(out) == before


def test_results_go_below_the_working_directory(tribox, case_file, block, tmp_path):
    path = case_file(block, "my-block.toml")
    assert tribox("run", path, "--set", "stage.1.steps=1").returncode == 0
    assert (tmp_path / "home" / "results" / "my-block" / "summary.json").is_file()


# -- the user's own mesh --------------------------------------------------------------------------


def with_mesh(text: str, mesh: str) -> str:
    """The case with a mesh file in the place of the generator."""
    start, end = text.index("[geometry]"), text.index("[bodies.elastomer]")
    geometry = f'[geometry]\nmesh = "{mesh}"\nthickness = "1 mm"\n'
    return text[:start] + geometry + text[end:]


def write_mesh(path: Path, hole: str = "") -> None:
    """Two squares, one on the other, of four triangles or so each; ``hole`` has no name."""
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        occ, model = gmsh.model.occ, gmsh.model
        lower = occ.addRectangle(0.0, -LENGTH, 0.0, LENGTH, LENGTH)
        upper = occ.addRectangle(0.0, 0.0, 0.0, LENGTH, LENGTH)
        occ.synchronize()
        heights = (
            {"aluminium_contact": 0.0, "bottom": -LENGTH},
            {"elastomer_contact": 0.0, "top": LENGTH},
        )
        for name, tag, sides in zip(
            ("aluminium", "elastomer"), (lower, upper), heights, strict=True
        ):
            model.addPhysicalGroup(2, [tag], name=name)
            around = [abs(t) for _, t in model.getBoundary([(2, tag)])]
            for label, height in sides.items():
                at = [t for t in around if abs(occ.getCenterOfMass(1, t)[1] - height) < 1e-9]
                if label != hole:
                    model.addPhysicalGroup(1, at, name=label)
        gmsh.option.setNumber("Mesh.MeshSizeMin", LENGTH / 2)
        gmsh.option.setNumber("Mesh.MeshSizeMax", LENGTH / 2)
        model.mesh.generate(2)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()


@pytest.mark.parametrize("case", ["missing", "no top", "no top, swept"])
def test_unusable_mesh_is_one_line_and_check_finds_the_same(
    tribox, case_file, block, tmp_path, case
):
    text = with_mesh(block, "own.msh")
    if case.endswith("swept"):
        text += '[sweep]\nkey = "contact.0.friction.mu"\nvalues = [0.1, 0.2]\n'
    path = case_file(text)
    if case != "missing":
        write_mesh(tmp_path / "own.msh", hole="top")
    before = snapshot(tmp_path)
    result = tribox("run", path)
    assert_refused(result, "no such file" if case == "missing" else "'top'")
    checked = tribox("check", path)
    assert (checked.returncode, checked.stdout) == (2, "")
    assert checked.stderr.removeprefix("tribox: ") == result.stderr.removeprefix("tribox: ")
    assert snapshot(tmp_path) == before


@pytest.mark.parametrize(
    "words",
    [
        ["run", "CASE", "--out", "LONG"], ["map", "--out", "LONG"],
        ["mesh", "CASE", "--out", "LONG"], ["mesh", "LONG.geo"], ["plot", "LONG"],
        ["report", "LONG"], ["init", "two-blocks", "LONG.toml"],
    ],
    ids=" ".join,
)  # fmt: skip
def test_a_name_of_400_letters_is_one_line(tribox, case_file, block, words):
    path = case_file(block)
    done = tribox(*(word.replace("LONG", "a" * 400).replace("CASE", str(path)) for word in words))
    [line] = done.stderr.splitlines()
    assert done.returncode == 2 and line.startswith("tribox: aaaa")
    assert line.endswith("File name too long")


def test_all_names_that_a_mesh_has_not_are_told_at_once_after_the_case_file(
    tribox, case_file, block, tmp_path
):
    write_mesh(tmp_path / "own.msh")
    text = swap(with_mesh(block, "own.msh"), '"bottom"', '"botom"')
    path = case_file(swap(text, 'slave = "elastomer_contact"', 'slave = "elastomer_contakt"'))
    done = tribox("check", path)
    lines = done.stderr.splitlines()
    assert done.returncode == 2 and len(lines) == 2
    for line, said in zip(lines, ("contact.0.slave", "boundary.0.surface"), strict=True):
        assert line.startswith(f"tribox: {path}: {said}: no surface named")
    done = tribox("run", path)
    assert done.returncode == 2 and "(and 1 more; tribox check lists them)" in done.stderr


def test_check_puts_a_part_of_a_long_sweep_together(tribox, case_file, block, monkeypatch):
    monkeypatch.setattr("tribox.app.run.building.MOST_BUILT", 2)
    values = [0.1 + 0.01 * n for n in range(5)]
    path = case_file(f'{block}\n[sweep]\nkey = "contact.0.friction.mu"\nvalues = {values}\n')
    done = tribox("check", path)
    assert done.returncode == 0, done.stderr
    assert "note: 2 of 5 values were put together, the others only read" in done.stdout
    assert done.stdout.endswith("correct (5 runs, 2 stages)\n")  # PETSc says nothing at its end


def test_own_mesh_gives_the_history_of_the_generator(tribox, case_file, block, tmp_path):
    made = tribox("mesh", case_file(block), "--out", tmp_path / "mesh")
    assert made.returncode == 0, made.stderr
    (tmp_path / "mesh" / "mesh.msh").rename(tmp_path / "own.msh")
    own = case_file(with_mesh(block, "own.msh"), "own.toml")
    assert tribox("check", own).returncode == 0
    tight = ("--set", "solver.tolerance=1e-11")
    for path, name in ((own, "a"), (tmp_path / "case-file.toml", "b")):
        result = tribox("run", path, "--out", tmp_path / name, *tight)
        assert result.returncode == 0, result.stderr
    mine, theirs = (read_table(tmp_path / name / "history.csv") for name in "ab")
    for column in ("normal_force", "tangential_force", "external_work", "contact_area"):
        largest = max(abs(row[column]) for row in theirs)
        assert [row[column] for row in mine] == pytest.approx(
            [row[column] for row in theirs], rel=0.0, abs=1e-9 * largest
        )


# -- the other commands ---------------------------------------------------------------------------


def test_check_says_what_is_correct_and_notes_what_may_surprise(tribox, case_file, film, tmp_path):
    path = case_file(film)
    before = snapshot(tmp_path)
    result = tribox("check", path)
    assert result.returncode == 0 and result.stderr == ""
    assert "correct" in result.stdout and "note:" not in result.stdout
    noted = tribox("check", path, "--set", 'contact.0.friction.B="1e9 1/m"')
    assert noted.returncode == 0
    assert "note: contact.0: " in noted.stdout
    assert snapshot(tmp_path) == before


def test_schema_is_json_with_all_tables(tribox):
    result = tribox("schema")
    assert result.returncode == 0 and result.stderr == ""
    schema = json.loads(result.stdout)
    tables = {"title", "geometry", "bodies", "contact", "boundary", "stage"}
    more = {"tools", "gravity", "probe", "solver", "output", "sweep"}
    assert tables | more == set(schema["properties"])
    assert set(schema["required"]) == tables - {"title", "contact", "boundary"}


def test_mesh_writes_file_and_picture_and_keeps_what_is_there(tribox, case_file, block, tmp_path):
    path = case_file(block)
    out = tmp_path / "mesh"
    result = tribox("mesh", path, "--out", out)
    assert result.returncode == 0, result.stderr
    assert {p.name for p in out.iterdir()} == {"mesh.msh", "mesh.png"}
    mesh = meshio.read(out / "mesh.msh")
    assert sum(len(c.data) for c in mesh.cells if c.type == "quad") == 10 * 5 + 15 * 4
    assert (out / "mesh.png").read_bytes().startswith(b"\x89PNG")
    before = snapshot(out)
    assert_refused(tribox("mesh", path, "--out", out), "mesh.msh", "--force")
    assert snapshot(out) == before
    below = tribox("mesh", path, "--out", path / "mesh")  # no directory can be below a file
    assert below.returncode == 4 and "cannot be written" in below.stderr.splitlines()[0]
    assert "is no case (.toml)" in tribox("check", out / "mesh.msh").stderr
    assert tribox("mesh", path, "--out", out, "--force").returncode == 0


def test_plot_draws_again(tribox, case_file, block, tmp_path):
    out = tmp_path / "out"
    assert tribox("run", case_file(block), "--out", out).returncode == 0
    assert not (out / "figures").exists()
    result = tribox("plot", out)
    assert result.returncode == 0, result.stderr
    drawn = {
        *("history.png", "energy.png", "force_displacement.png"),
        *("mesh.png", "deformed-1-press.png", "deformed.png"),
    }
    assert {p.name for p in (out / "figures").iterdir()} == drawn
    assert_refused(tribox("plot", tmp_path / "nowhere"), "nowhere")
    assert_refused(tribox("plot", out, "--field", "stress"), "--field stress", "von_mises_stress")
    moving = tribox("plot", out, "--animate", "--field", "displacement")
    assert moving.returncode == 0 and "animation-displacement.gif: 9 frames" in moving.stdout
    own = {f"{kind}-displacement{rest}" for kind, rest in (
        ("deformed", "-1-press.png"), ("deformed", ".png"), ("animation", ".gif")
    )}  # fmt: skip
    assert {p.name for p in (out / "figures").iterdir()} == drawn | own


@pytest.mark.parametrize("found", [True, False])
@pytest.mark.parametrize("every", [True, False])
@pytest.mark.parametrize("words", [(), ("tests/forms", "-k", "tangent")])
def test_all_tests_run_two_files_at_a_time(tribox, monkeypatch, found, every, words):
    started = []
    monkeypatch.setattr("os.execv", lambda program, command: started.append(command))
    monkeypatch.setattr("tribox.app.cli.find_spec", lambda name: object() if found else None)
    assert tribox("test", *["--all"] * every, *words).returncode == 0
    [command] = started
    assert command[:3] == [sys.executable, "-m", "pytest"]
    # Words of the caller come after, so that an -m of theirs holds.
    assert ("not long" in command) != every and "--all" not in command
    assert command[len(command) - len(words) :] == [*words]
    assert ("-n" in command) == (found and not words)
    assert Path.cwd() == Path(__file__).parents[2]


# -- a run ----------------------------------------------------------------------------------------

REQUIRED = (
    "time, stage, dt, velocity, normal_force, tangential_force, friction_coefficient, "
    "effective_viscosity, contact_area, stick_fraction, viscous_fraction, max_penetration, "
    "newton_iterations, strain_energy, kinetic_energy, interface_energy, dissipation, "
    "external_work, energy_error"
).split(", ")


def test_run_prints_plain_lines_while_it_goes_and_changes_by_set(tribox, case_file, film, tmp_path):
    out = tmp_path / "out"
    override = ("--set", "contact.0.film.thickness=20 nm", "--set", "output.figures=true")
    result = tribox("run", case_file(film), "--out", out, *override, process=True)
    assert result.returncode == 0 and result.stderr == "", result.stderr
    assert "\x1b" not in result.stdout and "\r" not in result.stdout
    lines = result.stdout.splitlines()
    rows = read_table(out / "history.csv")
    steps = [line for line in lines if line.startswith("step")]
    assert len(steps) == len(rows)
    assert lines.index(steps[0]) <= 2 and "Newton" in steps[0]
    assert lines[-1] == f"results in {out}"
    assert read_log(out).splitlines() == lines

    given = json.loads((out / "summary.json").read_text())["given"]
    assert {"contact.0.film.thickness", "boundary.1.platen.pressure"} < set(given)
    assert "contact.0.friction.eta_b" not in given  # of the preset
    with (out / "history.csv").open() as stream:
        header = next(csv.reader(stream))
    assert not set(REQUIRED) - set(header)
    assert [row["stage"] for row in rows if math.isnan(row.pop("velocity"))] == ["press"] * 3
    numbers = [v for row in rows for key, v in row.items() if key != "stage"]
    assert all(math.isfinite(v) for v in numbers)
    films = [row["film_thickness"] for row in rows if row["stage"] == "slide"]
    assert films == pytest.approx([20e-9] * len(films), rel=1e-12)
    figures = {p.name for p in (out / "figures").iterdir()}
    assert figures == {
        *("history.png", "energy.png", "force_displacement.png"),
        *("mesh.png", "deformed-1-press.png", "deformed.png"),
        *("effective_viscosity.png", "friction_map.png", "stribeck.png"),
    }
    again = load_case(out / "case.toml")
    asked = load_case(tmp_path / "case-file.toml", [w for w in override if "=" in w])
    assert again == build_model(asked, MPI.COMM_SELF).case


@pytest.mark.parametrize("command", ["check", "run"])
def test_a_change_that_the_sweep_undoes_is_refused(tribox, case_file, block, command):
    path = case_file(block + '[sweep]\nkey = "contact.0.friction.mu"\nvalues = [0.1, 0.3]\n')
    done = tribox(command, path, "--set", 'contact."0".friction.mu=0.2')
    assert done.returncode == 2 and not (path.parent / "home" / "results").exists()
    assert 'contact."0".friction.mu: the [sweep] sets this key' in done.stderr
    assert "sweep.values=[...]" in done.stderr
    assert tribox("check", path, "--set", "sweep.values=[0.2]").returncode == 0


def test_sweep_collates_its_parts(tribox, case_file, block, tmp_path):
    text = block + '[sweep]\nkey = "contact.0.friction.mu"\nvalues = [0.1, 0.3]\n'
    out = tmp_path / "out"
    figures = ("--set", "output.figures=true")
    result = tribox("run", case_file(text), "--out", out, *figures)
    assert result.returncode == 0, result.stderr
    rows = read_table(out / "sweep.csv")
    labels = ["mu=0.1", "mu=0.3"]
    assert [row["label"] for row in rows] == [label for label in labels for _ in range(2)]
    assert [row["friction_coefficient"] for row in rows[1::2]] == pytest.approx([0.1, 0.3], 1e-3)
    for label in labels:
        assert (out / label / "history.csv").is_file()
        assert f"[{label}] step    1" in result.stdout
        assert load_case(out / label / "case.toml").contact[0].friction.K_T is not None
    assert load_case(out / "case.toml") == load_case(tmp_path / "case-file.toml", figures[1:])
    assert {p.name for p in (out / "figures").iterdir()} == {"sweep.png"}
    assert set(json.loads((out / "summary.json").read_text())["parts"]) == set(labels)

    alone = tribox("run", tmp_path / "case-file.toml", "--part", 1, "--out", tmp_path / "alone")
    assert alone.returncode == 0
    mine, theirs = (d / "history.csv" for d in (tmp_path / "alone", out / "mu=0.3"))
    assert mine.read_bytes() == theirs.read_bytes()
    assert_refused(tribox("run", tmp_path / "case-file.toml", "--part", 2), "--part 2")
    assert tribox("plot", out).returncode == 0


def test_a_script_finds_the_packages_and_its_arguments(tribox, tmp_path):
    script = tmp_path / "my.py"
    script.write_text(
        "import sys\nfrom tribox.app.results import read\nprint(read.__name__, sys.argv[1:])\n"
    )
    done = tribox("python", script, "a", "--out", "b", process=True)
    assert (done.returncode, done.stdout) == (0, "read ['a', '--out', 'b']\n")
    missing = tribox("python", tmp_path / "none.py")
    assert missing.returncode == 2 and "none.py: no such file" in missing.stderr


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("rnu", "x.toml"), "No such command 'rnu'; did you mean \"run\"?"),
        (("x.toml",), 'did you mean "tribox run x.toml"?'),
        (("plot",), "Missing argument 'DIR'"),
    ],
)
def test_a_command_that_is_none_gets_the_one_that_was_meant(tribox, words, said):
    done = tribox(*words)
    assert done.returncode == 2 and said in done.stderr and "Traceback" not in done.stderr
