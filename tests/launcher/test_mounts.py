"""What the launcher lets the container see, and write."""

import os
import subprocess
import time
from pathlib import Path

import pytest

from tests.launcher.stand_ins import ENGINE, Machine, mounted, values


def test_of_a_case_elsewhere_no_more_is_read_than_its_directory(
    docker: Machine, tmp_path: Path
) -> None:
    """And what it names: not the directories beside it, nor the work tree around it."""
    for name in ("mine/.git", "mine/cases", "mine/meshes", "mine/drawings", "mine/secrets"):
        (tmp_path / name).mkdir(parents=True)
    for name in ("meshes/a.msh", "meshes/b.MSH", "drawings/c.geo"):
        (tmp_path / "mine" / name).touch()
    case = tmp_path / "mine/cases/my case.toml"
    named = ("meshes/a.msh", "meshes/b.MSH", "drawings/c.geo")
    case.write_text("".join(f"mesh = '../{name}'\n" for name in named))
    docker.launch("run", str(case))
    call, mine = docker.container(), f"{tmp_path}/mine"
    read = {f"{mine}/cases", f"{mine}/meshes/a.msh", f"{mine}/meshes/b.MSH", f"{mine}/drawings"}
    assert mounted(call, "ro") == {*read, str(docker.checkout)}
    assert mounted(call, "rw") == {f"{docker.checkout}/results/my case"}


def test_files_far_from_their_case_are_read(docker: Machine, tmp_path: Path) -> None:
    for name in ("far/away/meshes/a.msh", "laws/mine/my_law.py"):
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).touch()
    (tmp_path / "mine/cases").mkdir(parents=True)
    case = tmp_path / "mine/cases/c.toml"
    case.write_text(
        f'[geometry]\nmesh = "{tmp_path}/far/away/meshes/a.msh"\n[[contact]]\n'
        "friction = { class = '../../laws/mine/my_law.py:MyLaw' }\n"
    )
    docker.launch("run", str(case))
    read = mounted(docker.container(), "ro")
    assert {f"{tmp_path}/far/away/meshes/a.msh", f"{tmp_path}/laws/mine"} <= read


def test_linked_case_is_read_where_it_is(docker: Machine, tmp_path: Path) -> None:
    (tmp_path / "real/cases").mkdir(parents=True)
    (tmp_path / "real/cases/c.toml").touch()
    (tmp_path / "links/here").mkdir(parents=True)
    (tmp_path / "links/here/c.toml").symlink_to(tmp_path / "real/cases/c.toml")
    docker.launch("run", str(tmp_path / "links/here/c.toml"))
    read = mounted(docker.container(), "ro")
    assert {f"{tmp_path}/real/cases", f"{tmp_path}/links/here"} <= read


# What each command may write; W is the working directory, with what WORK names in it.
WORK = ("case.toml", "a.b.toml", "data.csv", "draw/pad.geo", "script.py", "run/case.toml", "new/")


WRITTEN = [
    ("check case.toml", []),
    ("schema", []),
    ("test", []),
    ("run case.toml --help", []),
    ("run nothing.toml", []),
    ("run case.toml", ["results/case"]),
    ("run --set a.b=1 a.b.toml --np 2", ["results/a.b"]),
    ("run case.toml --out out/new", ["out/new"]),
    ("run case.toml --out=out/new", ["out/new"]),
    ("run case.toml --out run", ["run"]),
    ("run case.toml --out draw", []),  # holds other things, which the program says
    ("map", ["results/built-in-map"]),
    ("map case.toml", ["results/case-map"]),
    ("fit data.csv --fix mu=0.3", ["results/data-fit"]),
    ("mesh case.toml", ["results/case-mesh"]),
    ("mesh draw/pad.geo", ["draw"]),
    ("mesh draw/pad.geo --out new/pad.msh", ["new"]),
    ("verify", []),
    ("verify --out proof", ["proof"]),
    ("bench 1", []),
    ("bench 1 --out new", ["new"]),
    ("plot run", ["run"]),
    ("report run", ["run"]),
    ("report run --out new/page.html", ["new"]),
    ("init", [""]),
    ("init forming new", ["new"]),
    ("init forming new/my.toml", ["new"]),
    ("python script.py --out elsewhere --help", [""]),
]


@pytest.mark.parametrize(("words", "paths"), WRITTEN, ids=[words for words, _ in WRITTEN])
def test_only_what_a_command_writes_is_writable(
    docker: Machine, tmp_path: Path, words: str, paths: list[str]
) -> None:
    working = tmp_path / "W"
    for name in WORK:
        path = working / name
        path.mkdir(parents=True) if name.endswith("/") else path.parent.mkdir(
            parents=True, exist_ok=True
        )
        if not name.endswith("/"):
            path.touch()
    docker.launch(*words.split(), cwd=working)
    expected = {f"{working}/{path}".rstrip("/") for path in paths}
    assert mounted(docker.container(), "rw") == expected


@pytest.mark.parametrize("writes", [False, True])
def test_results_directory_without_results_goes_away(docker: Machine, writes: bool) -> None:
    if writes:
        docker.install("docker", ENGINE.replace("exit", "touch results/sfa/log.txt; exit", 3))
    docker.launch("run", "cases/sfa.toml")
    results = docker.checkout / "results/sfa"
    waited = time.monotonic() + 100.0
    while not writes and results.exists() and time.monotonic() < waited:
        time.sleep(0.01)
    assert results.exists() == writes


def test_a_file_that_runs_as_its_owner_is_made_a_plain_one(docker: Machine) -> None:
    results = docker.checkout / "results/sfa"
    left = "touch results/sfa/tool; chmod 6755 results/sfa/tool; exit"
    docker.install("docker", ENGINE.replace("exit", left, 3))
    docker.launch("run", "cases/sfa.toml")
    waited = time.monotonic() + 100.0
    while (mode := (results / "tool").stat().st_mode) & 0o6000 and time.monotonic() < waited:
        time.sleep(0.01)
    assert mode & 0o7777 == 0o755


def test_the_program_cannot_be_written_from_its_checkout(docker: Machine) -> None:
    docker.launch("init")
    call = docker.container()
    assert mounted(call, "rw") == {str(docker.checkout)}
    parts = ("Dockerfile", "app", "cases", "docker", "forms", "geometry", "tribox")
    assert {f"{docker.checkout}/{part}" for part in parts} <= mounted(call, "ro")
    docker.launch("init", cwd=docker.checkout.parent)
    assert str(docker.checkout) in mounted(docker.container(), "ro")


def test_the_program_cannot_be_written_by_another_name(docker: Machine, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(docker.checkout)
    docker.launch("init", "forming", str(tmp_path / "link"), cwd=docker.home)
    call = docker.container()
    assert {f"{tmp_path}/link", str(docker.checkout)} == mounted(call, "rw")
    assert {f"{tmp_path}/link/app", f"{docker.checkout}/app"} <= mounted(call, "ro")


@pytest.mark.parametrize("out", ["app", "app/new", "geometry", "docker"])
def test_output_into_the_program_is_refused(docker: Machine, out: str) -> None:
    before = docker.calls_of("run")
    done = docker.launch("mesh", "cases/sfa.toml", "--out", out)
    assert done.returncode == 2
    assert "is a part of the program" in done.stderr
    assert docker.calls_of("run") == before


def test_path_with_a_colon_is_mounted_in_the_long_form(docker: Machine, tmp_path: Path) -> None:
    working = tmp_path / "at 12:30"
    working.mkdir()
    (working / "x.toml").touch()
    docker.launch("run", "x.toml", cwd=working)
    results = f"{working}/results/x"
    assert set(values(docker.container(), "--mount")) == {
        f"type=bind,source={working},target={working},readonly",
        f"type=bind,source={results},target={results}",
    }


@pytest.mark.parametrize("words", [["run", "x.toml"], ["run", "a\nb/c.toml"], ["plot", "a\nb/d"]])
def test_path_with_a_line_break_is_refused(
    docker: Machine, tmp_path: Path, words: list[str]
) -> None:
    working = tmp_path / "w" if "\n" in words[1] else tmp_path / "w\n--privileged"
    (working / "a\nb/d").mkdir(parents=True)
    for name in ("x.toml", "a\nb/c.toml", "a\nb/d/case.toml"):
        (working / name).touch()
    before = docker.calls_of("run")
    done = docker.launch(*words, cwd=working)
    assert done.returncode == 2
    assert "a path with a line break" in done.stderr
    assert done.stderr.count("\n") == 1
    assert docker.calls_of("run") == before


@pytest.mark.parametrize("name", ["-x.toml", "-", "* ?.toml", "$(touch made).toml", "--out.toml"])
def test_names_of_cases_are_only_names(docker: Machine, tmp_path: Path, name: str) -> None:
    (tmp_path / "w").mkdir()
    (tmp_path / "w" / name).write_text("mesh = 'far.msh'")
    (tmp_path / "w/other.toml").touch()
    done = docker.launch("run", "--", name, cwd=tmp_path / "w", CDPATH="/usr")
    assert done.stderr == ""
    results = f"{tmp_path}/w/results/{name.removesuffix('.toml')}"
    assert mounted(docker.container(), "rw") == {results}
    assert sorted(os.listdir(tmp_path / "w")) == sorted([name, "other.toml", "results"])


def test_what_is_mounted_below_an_input_is_read_only_too(docker: Machine, tmp_path: Path) -> None:
    below = tmp_path / "w/be low"
    below.mkdir(parents=True)
    script = f"""
        mount --bind '{docker.home}' '{below}' || exit 99
        cd '{tmp_path}/w' && exec /bin/sh '{docker.checkout}/tribox' check x.toml
    """
    done = subprocess.run(
        ["unshare", "--mount", "sh", "-c", script], env=docker.environment, check=False
    )
    if done.returncode != 0:
        pytest.skip("mounts cannot be made here")
    assert {f"{tmp_path}/w", str(below)} <= mounted(docker.container(), "ro")


def test_directory_the_container_needs_is_refused(docker: Machine) -> None:
    done = docker.launch("run", "x.toml", cwd=Path("/usr"))
    assert done.returncode == 2
    assert done.stderr.startswith("tribox: /usr cannot be used")
    assert done.stderr.count("\n") == 1
