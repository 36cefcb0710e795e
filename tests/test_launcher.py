"""The launcher ``./tribox`` and the image's entry, with stand-ins for the container engines."""

from __future__ import annotations

import contextlib
import os
import pty
import shutil
import subprocess
import time
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
COPIES = [
    line for line in (ROOT / "Dockerfile").read_text().splitlines() if line.startswith("COPY ")
]
# Of the files that the image is made from, one of each place.
SOURCES = (
    "forms/bodies/solid.py",
    "forms/native/plane_kernel.c",
    "geometry/meshes/mesh.py",
    "app/__init__.py",
    "app/errors.py",
    "app/precompile.py",
    "app/equilibrium/equilibrium.py",
    "app/results/__init__.py",
    "app/results/fields.py",
)

# Records each call, one argument per line. Images are files in $STATE/images; what else happens
# is decided by the environment.
ENGINE = r"""#!/bin/sh
{ printf '%s\n' "${0##*/}" "$@"; echo =====; } >>"$STATE/calls"
while [ "$1" = --runtime ]; do shift 2; done
case $1 in
    info) echo "[${SECURITY:-}]" ;;
    image) [ -e "$STATE/images/$(echo "$3" | tr '/:' '__')" ] ;;
    pull) [ -n "${PULL_WORKS:-}" ] && touch "$STATE/images/$(echo "$2" | tr '/:' '__')" ;;
    import) touch "$STATE/images/$(echo "$3" | tr '/:' '__')" ;;
    build)
        echo "STEP 1/1: FROM base"
        while [ "$1" != -t ]; do shift; done
        touch "$STATE/images/$(echo "$2" | tr '/:' '__')"
        exit "${BUILD_STATUS:-0}"
        ;;
    run)
        case " $* " in
            *" --entrypoint true "*) [ -z "${NEEDS:-}" ] || case " $* " in
                *"$NEEDS"*) ;;
                *) exit 126 ;;
            esac ;;
            *) exit "${RUN_STATUS:-0}" ;;
        esac
        ;;
esac
"""
MMDEBSTRAP = r"""#!/bin/sh
{ printf '%s\n' mmdebstrap "$@"; echo =====; } >>"$STATE/calls"
for argument; do case $argument in *.tar) touch "$argument" ;; esac; done
"""
ABSENT = "#!/bin/sh\nexit 1\n"


@dataclass
class Machine:
    """A home, a checkout and a search path with stand-ins."""

    home: Path
    checkout: Path
    bin: Path
    state: Path
    environment: dict[str, str] = field(default_factory=dict)

    def install(self, name: str, script: str) -> None:
        path = self.bin / name
        path.write_text(script)
        path.chmod(0o755)

    def launch(
        self, *arguments: str, cwd: Path | None = None, **environment: str
    ) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["/bin/sh", str(self.checkout / "tribox"), *arguments],
            cwd=cwd or self.checkout,
            env={**self.environment, **environment},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=60,
        )

    def calls(self) -> list[list[str]]:
        """All calls of stand-ins: name and arguments."""
        text = (self.state / "calls").read_text() if (self.state / "calls").exists() else ""
        return [call.split("\n") for call in text.split("\n=====\n") if call]

    def calls_of(self, *words: str) -> list[list[str]]:
        return [call for call in self.calls() if all(word in call for word in words)]

    def container(self) -> list[str]:
        """The arguments of the last container started for the program."""
        return [call for call in self.calls_of("run") if "--workdir" in call][-1]


def values(call: list[str], option: str) -> list[str]:
    return [b for a, b in pairwise(call) if a == option]


def mounted(call: list[str], mode: str) -> set[str]:
    """The paths that a container sees at their own place, in mode ``ro`` or ``rw``."""
    split = [value.split(":") for value in values(call, "--volume")]
    return {source for source, target, how in split if source == target and how == mode}


def image_of(call: list[str]) -> str:
    return next(word for word in call if word.startswith("localhost/tribox:"))


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    made = Machine(tmp_path / "home", tmp_path / "check out", tmp_path / "bin", tmp_path / "state")
    for directory in (made.home, made.checkout, made.bin, made.state / "images"):
        directory.mkdir(parents=True)
    for name in ("tribox", "Dockerfile", ".dockerignore"):
        shutil.copy(ROOT / name, made.checkout)
    shutil.copytree(ROOT / "docker", made.checkout / "docker")
    for name in (*SOURCES, "app/cli.py", "cases/sfa.toml"):
        (made.checkout / name).parent.mkdir(parents=True, exist_ok=True)
        (made.checkout / name).write_text("title = 'a'\n")
    for name in ("python3", "apt-get", "apt-config"):
        made.install(name, ABSENT)
    made.environment = {
        "PATH": f"{made.bin}:/usr/bin:/bin",
        "HOME": str(made.home),
        "STATE": str(made.state),
    }
    return made


@pytest.fixture
def docker(machine: Machine) -> Machine:
    """A machine with a Docker engine and all images."""
    machine.install("docker", ENGINE)
    machine.launch("check", PULL_WORKS="yes")
    return machine


def test_arguments_reach_the_program_unchanged(docker: Machine) -> None:
    words = ["run", "a b", 'c"d', "$HOME", "e'f", "", "*", "--set", "x=1e13 Pa/m"]
    docker.launch(*words)
    call = docker.container()
    assert call[call.index(image_of(call)) + 1 :] == words


def test_the_program_reads_checkout_and_working_directory(docker: Machine, tmp_path: Path) -> None:
    working = tmp_path / "some where"
    working.mkdir()
    docker.launch("check", "x.toml", cwd=working)
    call = docker.container()
    assert values(call, "--workdir") == [str(working)]
    assert values(call, "--volume") == [f"{docker.checkout}:/tribox:ro", f"{working}:{working}:ro"]
    assert f"TRIBOX_RESULTS={working}/results" in values(call, "--env")


@pytest.mark.parametrize("engine", ["docker", "podman"])
def test_every_container_is_tight(docker: Machine, engine: str) -> None:
    docker.install("podman", ENGINE)
    docker.launch("run", "cases/sfa.toml", TRIBOX_ENGINE=engine)
    for call in [call for call in docker.calls_of("run") if call[0] == engine]:
        assert values(call, "--network") == ["none"]
        assert values(call, "--cap-drop") == ["all"]
        assert "no-new-privileges" in values(call, "--security-opt")
        assert "--read-only" in call
        assert not {"--privileged", "--cap-add", "--device"} & set(call)
    # Podman limits the number of processes for root, and elsewhere with cgroups of version 2.
    version_2 = Path("/sys/fs/cgroup/cgroup.controllers").exists()
    if engine == "docker" or os.getuid() == 0 or version_2:
        assert values(docker.container(), "--pids-limit") == ["4096"]


def test_files_are_made_as_the_caller(docker: Machine) -> None:
    docker.launch("run", "cases/sfa.toml")
    assert values(docker.container(), "--user") == [f"{os.getuid()}:{os.getgid()}"]
    docker.launch("run", "cases/sfa.toml", SECURITY="name=seccomp name=rootless")
    assert values(docker.container(), "--user") == ["0:0"]


@pytest.mark.parametrize("status", ["0", "2", "3", "130"])
def test_exit_code_is_the_programs(docker: Machine, status: str) -> None:
    assert docker.launch("run", "cases/sfa.toml", RUN_STATUS=status).returncode == int(status)


def test_case_elsewhere_is_read_with_its_neighbours(docker: Machine, tmp_path: Path) -> None:
    (tmp_path / "mine/cases").mkdir(parents=True)
    case = tmp_path / "mine/cases/my case.toml"
    case.write_text("[geometry]\nmesh = '../meshes/a.msh'\n")
    docker.launch("run", str(case))
    call = docker.container()
    assert mounted(call, "ro") == {f"{tmp_path}/mine", str(docker.checkout)}
    assert mounted(call, "rw") == {f"{docker.checkout}/results/my case"}


def test_case_in_a_work_tree_is_read_with_the_tree(docker: Machine, tmp_path: Path) -> None:
    (tmp_path / "tree/.git").mkdir(parents=True)
    (tmp_path / "tree/a/b").mkdir(parents=True)
    (tmp_path / "tree/a/b/c.toml").touch()
    docker.launch("check", "../tree/a/b/c.toml")
    assert f"{tmp_path}/tree" in mounted(docker.container(), "ro")
    assert not mounted(docker.container(), "rw")


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
    assert {f"{tmp_path}/far/away/meshes/a.msh", f"{tmp_path}/laws"} <= read


def test_linked_case_is_read_where_it_is(docker: Machine, tmp_path: Path) -> None:
    (tmp_path / "real/cases").mkdir(parents=True)
    (tmp_path / "real/cases/c.toml").touch()
    (tmp_path / "links/here").mkdir(parents=True)
    (tmp_path / "links/here/c.toml").symlink_to(tmp_path / "real/cases/c.toml")
    docker.launch("run", str(tmp_path / "links/here/c.toml"))
    assert {f"{tmp_path}/real", f"{tmp_path}/links"} <= mounted(docker.container(), "ro")


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
    waited = time.monotonic() + 10.0
    while not writes and results.exists() and time.monotonic() < waited:
        time.sleep(0.01)
    assert results.exists() == writes


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


def test_image_is_made_once(docker: Machine) -> None:
    assert len(docker.calls_of("build")) == 1
    done = docker.launch("run", "cases/sfa.toml")
    assert len(docker.calls_of("build")) == 1
    assert done.stderr == ""
    build = docker.calls_of("build")[0]
    assert "BASE=docker.io/library/debian:trixie-slim" in values(build, "--build-arg")
    assert build[-1] == str(docker.checkout)


@pytest.mark.parametrize(
    ("name", "rebuilt"),
    [
        ("Dockerfile", True),
        ("docker/entry", True),
        *((source, True) for source in SOURCES),
        ("app/cli.py", False),
        ("cases/sfa.toml", False),
    ],
)
def test_only_dependencies_and_forms_rebuild_it(docker: Machine, name: str, rebuilt: bool) -> None:
    docker.launch("check")
    before = image_of(docker.container())
    with (docker.checkout / name).open("a") as stream:
        stream.write("# changed\n")
    docker.launch("check")
    assert (image_of(docker.container()) != before) == rebuilt
    assert len(docker.calls_of("build")) == 1 + rebuilt


@pytest.mark.parametrize("name", ["app/precompile.py", "geometry", ".dockerignore"])
def test_a_source_of_the_image_that_is_missing_is_named(docker: Machine, name: str) -> None:
    path, builds = docker.checkout / name, docker.calls_of("build")
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    done = docker.launch("check")
    assert done.returncode == 2
    assert f"{name} is missing; the image is made from it" in done.stderr
    assert docker.calls_of("build") == builds


def test_every_source_of_the_image_is_in_the_checkout() -> None:
    copied = [line.split()[1:-1] for line in COPIES if line.split()[1:-1] != ["."]]
    assert {source for sources in copied for source in sources} > {"forms", "docker/entry"}
    for source in (source for sources in copied for source in sources):
        assert (ROOT / source).exists(), source


def test_failed_build_is_one_line_and_the_log(machine: Machine) -> None:
    machine.install("docker", ENGINE)
    done = machine.launch("check", PULL_WORKS="yes", BUILD_STATUS="1")
    assert done.returncode == 2
    assert "tribox: the image could not be built (all of it: " in done.stderr.splitlines()[-1]
    assert not [call for call in machine.calls_of("run") if "--workdir" in call]


def test_base_that_cannot_be_pulled_is_made(machine: Machine) -> None:
    machine.install("docker", ENGINE)
    machine.install("mmdebstrap", MMDEBSTRAP)
    assert machine.launch("check").returncode == 0
    assert len(machine.calls_of("mmdebstrap")) == 1
    assert values(machine.calls_of("import")[0], "import")
    base = "BASE=localhost/tribox-base:trixie"
    assert base in values(machine.calls_of("build")[0], "--build-arg")
    # The next image is built on the same one.
    (machine.checkout / "forms/bodies/solid.py").write_text("# other forms\n")
    machine.launch("check")
    assert len(machine.calls_of("mmdebstrap")) == 1
    assert base in values(machine.calls_of("build")[1], "--build-arg")


def test_base_of_the_users_choice(machine: Machine) -> None:
    machine.install("docker", ENGINE)
    machine.launch("check", TRIBOX_BASE="my/base:1")
    assert "BASE=my/base:1" in values(machine.calls_of("build")[0], "--build-arg")
    assert not machine.calls_of("pull")


def test_proxy_reaches_the_build(machine: Machine) -> None:
    machine.install("docker", ENGINE)
    machine.install("apt-config", "#!/bin/sh\necho 'Acquire::http::Proxy \"http://p:1\";'\n")
    machine.launch("check", PULL_WORKS="yes", https_proxy="http://q:2")
    arguments = values(machine.calls_of("build")[0], "--build-arg")
    assert 'APT_OPTIONS=Acquire::http::Proxy "http://p:1";' in arguments
    assert "https_proxy=http://q:2" in arguments


def test_python_with_dolfinx_comes_first(docker: Machine) -> None:
    docker.install(
        "python3",
        "#!/bin/sh\n"
        'if [ "$1" = -c ]; then exit 0; fi\n'
        'printf "%s\\n" "$PYTHONPATH" "$PWD" "$@"\n'
        "exit 3\n",
    )
    before = len(docker.calls())
    done = docker.launch("run", "a b", cwd=docker.home, PYTHONPATH="/other")
    assert done.returncode == 3
    assert done.stdout.splitlines() == [
        f"{docker.checkout}:/other",
        str(docker.home),
        *("-m", "app", "run", "a b"),
    ]
    assert len(docker.calls()) == before


def test_podman_is_used_where_docker_does_not_answer(machine: Machine) -> None:
    machine.install("docker", "#!/bin/sh\nexit 1\n")
    machine.install("podman", ENGINE)
    machine.launch("run", "cases/sfa.toml", PULL_WORKS="yes")
    call = machine.container()
    assert call[0] == "podman"
    # The caller is an ordinary user in there, by a map of user ids.
    if os.getuid() == 0:
        assert values(call, "--user") == ["1000:1000"]
        assert "1000:0:1" in values(call, "--uidmap")
    else:
        assert values(call, "--userns") == ["keep-id"]


def test_options_podman_needs_are_found_once(machine: Machine) -> None:
    machine.install("podman", ENGINE)
    machine.environment |= {"TRIBOX_ENGINE": "podman", "PULL_WORKS": "yes"}
    machine.environment["NEEDS"] = "--ulimit nofile="
    machine.launch("check")
    trials = len(machine.calls_of("--entrypoint"))
    assert trials == 2
    assert values(machine.container(), "--ulimit")[0].startswith("nofile=")
    machine.launch("check")
    assert len(machine.calls_of("--entrypoint")) == trials
    assert values(machine.container(), "--ulimit")[0].startswith("nofile=")


@pytest.mark.parametrize(
    "words", ["--privileged", "limits --volume=/:/host", "limits *", "", "$(touch made)"]
)
def test_options_of_podman_are_known_words_only(machine: Machine, words: str) -> None:
    machine.install("podman", ENGINE)
    machine.environment |= {"TRIBOX_ENGINE": "podman", "PULL_WORKS": "yes"}
    machine.launch("check")
    kept = machine.home / ".cache/tribox/podman-words"
    key, good = kept.read_text().splitlines()
    kept.write_text(f"{key}\n{words}\n")
    machine.launch("check")
    assert not {"--privileged", "--volume=/:/host"} & set(machine.container())
    if words:
        assert kept.read_text().splitlines() == [key, good]


def test_podman_that_runs_nothing_is_reported(machine: Machine) -> None:
    machine.install("podman", ENGINE)
    done = machine.launch(
        "check", TRIBOX_ENGINE="podman", PULL_WORKS="yes", NEEDS="what nobody offers"
    )
    assert done.returncode == 2
    assert "podman cannot run a container here" in done.stderr


def bare_path(machine: Machine) -> str:
    """A search path with what every Unix has, and no way to run the program."""
    for name in (
        *("cat", "chmod", "cut", "date", "dirname", "find", "grep", "id", "mkdir", "mktemp"),
        *("readlink", "rm"),
    ):
        found = shutil.which(name, path="/usr/bin:/bin")
        assert found
        (machine.bin / name).symlink_to(found)
    return str(machine.bin)


def test_without_any_way_there_is_one_clear_line(machine: Machine) -> None:
    (machine.bin / "apt-get").unlink()
    done = machine.launch("run", "cases/sfa.toml", PATH=bare_path(machine))
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "neither a python3 with DOLFINx, nor a running Docker engine" in done.stderr


def installing(machine: Machine, answer: str | None, **environment: str) -> tuple[int, str]:
    """Exit code and what is said where Podman has to be installed, on a terminal if answered."""
    path = bare_path(machine)
    machine.install("env", '#!/bin/sh\nshift\nexec "$@"\n')
    machine.install("tail", '#!/bin/sh\nexec /usr/bin/tail "$@"\n')
    machine.install(
        "apt-get",
        '#!/bin/sh\n{ printf "%s\\n" apt-get "$@"; echo =====; } >>"$STATE/calls"\nexit 1\n',
    )
    if answer is None:
        done = machine.launch("run", "cases/sfa.toml", PATH=path, **environment)
        return done.returncode, done.stderr
    master, terminal = pty.openpty()
    os.write(master, answer.encode())
    done = subprocess.run(
        ["/bin/sh", str(machine.checkout / "tribox"), "run", "cases/sfa.toml"],
        env={**machine.environment, "PATH": path, **environment},
        cwd=machine.checkout,
        stdin=terminal,
        stdout=subprocess.PIPE,
        stderr=terminal,
        timeout=60,
    )
    os.close(terminal)
    said = b""
    with contextlib.suppress(OSError):  # the end of a terminal
        while part := os.read(master, 10000):
            said += part
    os.close(master)
    return done.returncode, said.decode()


as_root = pytest.mark.skipif(os.getuid() != 0, reason="only root installs packages")


@as_root
@pytest.mark.parametrize(
    ("answer", "environment"),
    [(None, {}), ("\n", {}), ("y\n", {}), ("", {"CI": "true"})],
    ids=["no terminal", "Enter", "yes", "nobody there"],
)
def test_podman_is_installed_after_saying_so(
    machine: Machine, answer: str | None, environment: dict[str, str]
) -> None:
    code, said = installing(machine, answer, **environment)
    assert code == 2
    assert "installing podman runc mmdebstrap debian-archive-keyring with apt-get, as root" in said
    assert ("go on? [Y/n]" in said) == (answer not in (None, ""))
    assert "apt-get could not install podman" in said.splitlines()[-1]
    assert machine.calls_of("apt-get", "install", "podman", "runc", "mmdebstrap")


@as_root
@pytest.mark.parametrize("answer", ["n\n", "what?\n", "\x04"])
def test_nothing_is_installed_against_the_users_will(machine: Machine, answer: str) -> None:
    code, said = installing(machine, answer)
    assert code == 2
    assert "nothing was installed" in said.splitlines()[-1]
    assert not machine.calls_of("apt-get")


@pytest.mark.parametrize("engine", ["kubernetes", "docker", "podman", "python"])
def test_engine_that_is_not_there_is_named(machine: Machine, engine: str) -> None:
    done = machine.launch("check", PATH=bare_path(machine), TRIBOX_ENGINE=engine)
    assert done.returncode == 2
    assert done.stderr.startswith(f"tribox: TRIBOX_ENGINE={engine}")
    assert done.stderr.count("\n") == 1


# --- the caller's own directories -----------------------------------------------------------------


def test_kept_options_of_others_are_not_used(machine: Machine) -> None:
    machine.install("podman", ENGINE)
    machine.environment |= {"TRIBOX_ENGINE": "podman", "PULL_WORKS": "yes"}
    machine.launch("check")
    good = (machine.home / ".cache/tribox/podman-words").read_text()
    trials = len(machine.calls_of("--entrypoint"))
    # A directory that everybody can write, where one used to be looked for without HOME.
    shared = machine.state / "shared"
    (shared / "tribox").mkdir(parents=True)
    (shared / "tribox").chmod(0o777)
    (shared / "tribox/podman-words").write_text(good)
    done = machine.launch("check", XDG_CACHE_HOME=str(shared))
    assert done.returncode == 0
    assert f"{shared}/tribox is not yours, or others can write it" in done.stderr
    assert len(machine.calls_of("--entrypoint")) == trials + 1
    assert os.listdir(shared / "tribox") == ["podman-words"]


def test_directory_that_can_be_exchanged_is_not_used(machine: Machine) -> None:
    machine.install("docker", ENGINE)
    shared = machine.state / "shared"
    shared.mkdir()
    shared.chmod(0o777)
    machine.launch("check", PULL_WORKS="yes", XDG_CACHE_HOME=str(shared))
    assert not (shared / "tribox/setup.log").exists()
    shared.chmod(0o1777)
    machine.launch("check", TRIBOX_BASE="b", XDG_CACHE_HOME=str(shared))
    assert (shared / "tribox").stat().st_mode & 0o077 == 0


def test_without_a_home_nothing_in_a_shared_directory_is_used(machine: Machine) -> None:
    machine.install("podman", ENGINE)
    machine.install("getent", ABSENT)
    machine.environment |= {"TRIBOX_ENGINE": "podman", "PULL_WORKS": "yes"}
    del machine.environment["HOME"]
    shared, own = Path("/tmp/.cache/tribox"), machine.state / "tmp"
    own.mkdir()
    before = shared.exists()
    done = machine.launch("check", TMPDIR=str(own))
    # What was kept by an earlier call would be there to be read again.
    machine.launch("check", TMPDIR=str(own))
    assert done.returncode == 0
    assert shared.exists() == before
    assert os.listdir(own) == []
    assert len(machine.calls_of("--entrypoint")) == 2


def test_settings_are_read_and_written_only_by_trust(docker: Machine) -> None:
    config = docker.home / ".config/tribox"
    docker.launch("run", "cases/sfa.toml")
    assert f"TRIBOX_CONFIG={config}" in values(docker.container(), "--env")
    assert not config.exists()
    docker.launch("trust", "cases")
    assert mounted(docker.container(), "rw") == {str(config)}
    assert config.stat().st_mode & 0o077 == 0
    docker.launch("run", "cases/sfa.toml")
    assert str(config) in mounted(docker.container(), "ro")
    # Not by a script in the home directory either.
    (docker.home / "s.py").touch()
    docker.launch("python", "s.py", cwd=docker.home)
    assert mounted(docker.container(), "rw") == {str(docker.home)}
    assert str(config) in mounted(docker.container(), "ro")
    done = docker.launch("mesh", "cases/sfa.toml", "--out", str(config / "x"))
    assert done.returncode == 2
    assert "settings of tribox" in done.stderr


def test_settings_of_the_users_choice(docker: Machine, tmp_path: Path) -> None:
    (tmp_path / "settings").mkdir()
    docker.launch("check", TRIBOX_CONFIG="../settings")
    assert f"TRIBOX_CONFIG={tmp_path}/settings" in values(docker.container(), "--env")
    assert f"{tmp_path}/settings" in mounted(docker.container(), "ro")


def test_a_reader_that_leaves_does_not_end_the_container(docker: Machine) -> None:
    lines = "yes 'a line' | head -n 100000"
    docker.install("docker", ENGINE.replace('exit "${RUN_STATUS:-0}"', lines + " || exit 126"))
    command = f"'{docker.checkout}/tribox' schema; echo $? >&2"
    done = subprocess.run(
        ["/bin/sh", "-c", f"{{ {command}; }} | head -n 1"],
        env=docker.environment,
        cwd=docker.checkout,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert (done.stdout, done.stderr) == ("a line\n", "0\n")


def test_output_comes_whole_and_apart(docker: Machine) -> None:
    script = "seq 100000; echo problem >&2; exit 3"
    docker.install("docker", ENGINE.replace('exit "${RUN_STATUS:-0}"', script))
    done = docker.launch("schema")
    assert done.returncode == 3
    assert done.stdout.split() == [str(n) for n in range(1, 100001)]
    assert done.stderr == "problem\n"


# --- the image's entry ------------------------------------------------------------------------


def enter(
    directory: Path, name: str, *arguments: str, uid: int = 0, owner: int = 0, **environment: str
) -> list[str]:
    """What the entry called ``name`` starts, with /results owned by ``owner``."""
    directory.mkdir(exist_ok=True)
    entry = directory / name
    shutil.copy(ROOT / "docker/entry", entry)
    report = '#!/bin/sh\nprintf "%s\\n" "${0##*/}" "$TRIBOX_RESULTS" "$@"\nenv >"$0.env"\n'
    stand_ins = {
        "id": f"#!/bin/sh\necho {uid}\n",
        "stat": f"#!/bin/sh\ncase $2 in %u) echo {owner} ;; %g) echo 77 ;; esac\n",
        "mountpoint": "#!/bin/sh\nexit ${NOT_MOUNTED:-0}\n",
        "python3": report,
        "setpriv": report,
    }
    for command, script in stand_ins.items():
        (directory / command).write_text(script)
        (directory / command).chmod(0o755)
    done = subprocess.run(
        ["/bin/sh", str(entry), *arguments],
        cwd=directory,
        env={"PATH": f"{directory}:/usr/bin:/bin", "TRIBOX_RESULTS": "/results", **environment},
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    return done.stdout.splitlines()


def test_entry_becomes_the_owner_of_the_results(tmp_path: Path) -> None:
    started = enter(tmp_path / "x", "tribox", "run", "a b", owner=1234)
    assert started[:2] == ["setpriv", "/results"]
    assert started[2:] == [
        *("--reuid", "1234", "--regid", "77", "--clear-groups", "--"),
        *("python3", "-m", "app", "run", "a b"),
    ]


def test_entry_starts_all_ranks_as_the_owner(tmp_path: Path) -> None:
    started = enter(tmp_path / "x", "mpirun", "-n", "2", "tribox", owner=1234)
    assert started[-5:] == ["--", "/usr/bin/mpirun", "-n", "2", "tribox"]
    # A rank is what its mpirun is.
    assert enter(tmp_path / "x", "tribox", "run", owner=1234, PMIX_RANK="0")[0] == "python3"


@pytest.mark.parametrize(("uid", "owner"), [(0, 0), (1234, 1234), (1234, 0)])
def test_entry_stays_who_it_is_otherwise(tmp_path: Path, uid: int, owner: int) -> None:
    assert enter(tmp_path / "x", "tribox", "run", uid=uid, owner=owner)[0] == "python3"


def test_entry_without_results_mount_writes_where_it_is(tmp_path: Path) -> None:
    started = enter(tmp_path / "x", "tribox", "run", NOT_MOUNTED="1")
    assert started[1] == f"{tmp_path}/x/results"


def test_entry_leaves_tests_to_their_own_directories(tmp_path: Path) -> None:
    assert enter(tmp_path / "x", "tribox", "test")[1] == ""


@pytest.mark.skipif(os.getuid() == 0, reason="root can write anywhere")
def test_entry_makes_caches_where_the_image_cannot_be_written(tmp_path: Path) -> None:
    image, temporary = tmp_path / "image", tmp_path / "tmp"
    for directory in (image / "fenics", image / "matplotlib", temporary):
        directory.mkdir(parents=True)
    (image / "fenics/form.so").touch()
    image.chmod(0o555)
    enter(tmp_path / "x", "tribox", "run", uid=1, XDG_CACHE_HOME=str(image), TMPDIR=str(temporary))
    seen = dict(
        line.split("=", 1) for line in (tmp_path / "x/python3.env").read_text().splitlines()
    )
    caches = [Path(seen[name]) for name in ("XDG_CACHE_HOME", "MPLCONFIGDIR", "HOME")]
    assert all(temporary in cache.parents and os.access(cache, os.W_OK) for cache in caches)
    assert (caches[0] / "fenics/form.so").resolve() == image / "fenics/form.so"
