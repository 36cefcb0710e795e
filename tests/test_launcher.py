"""The launcher ``./tribox`` and the image's entry, with stand-ins for the container engines."""

from __future__ import annotations

import os
import shutil
import subprocess
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


def test_the_program_sees_checkout_and_working_directory(docker: Machine, tmp_path: Path) -> None:
    working = tmp_path / "some where"
    working.mkdir()
    docker.launch("run", "x.toml", cwd=working)
    call = docker.container()
    assert values(call, "--workdir") == [str(working)]
    assert set(values(call, "--volume")) == {
        f"{docker.checkout}:/tribox:ro",
        f"{working}:{working}",
    }
    assert f"TRIBOX_RESULTS={working}/results" in values(call, "--env")


def test_files_are_made_as_the_caller(docker: Machine) -> None:
    docker.launch("run", "cases/sfa.toml")
    assert values(docker.container(), "--user") == [f"{os.getuid()}:{os.getgid()}"]
    docker.launch("run", "cases/sfa.toml", SECURITY="name=seccomp name=rootless")
    assert values(docker.container(), "--user") == ["0:0"]


@pytest.mark.parametrize("status", ["0", "2", "3", "130"])
def test_exit_code_is_the_programs(docker: Machine, status: str) -> None:
    assert docker.launch("run", "cases/sfa.toml", RUN_STATUS=status).returncode == int(status)


def test_case_elsewhere_is_mounted_with_its_neighbours(docker: Machine, tmp_path: Path) -> None:
    (tmp_path / "mine/cases").mkdir(parents=True)
    case = tmp_path / "mine/cases/my case.toml"
    case.write_text("[geometry]\nmesh = '../meshes/a.msh'\n")
    docker.launch("run", str(case))
    assert f"{tmp_path}/mine:{tmp_path}/mine" in values(docker.container(), "--volume")


def test_case_in_a_work_tree_is_mounted_with_the_tree(docker: Machine, tmp_path: Path) -> None:
    (tmp_path / "tree/.git").mkdir(parents=True)
    (tmp_path / "tree/a/b").mkdir(parents=True)
    (tmp_path / "tree/a/b/c.toml").touch()
    docker.launch("check", "../tree/a/b/c.toml")
    assert f"{tmp_path}/tree:{tmp_path}/tree" in values(docker.container(), "--volume")


def test_mesh_far_from_its_case_is_mounted(docker: Machine, tmp_path: Path) -> None:
    mesh = tmp_path / "far/away/meshes/a.msh"
    mesh.parent.mkdir(parents=True)
    mesh.touch()
    (tmp_path / "mine/cases").mkdir(parents=True)
    case = tmp_path / "mine/cases/c.toml"
    case.write_text(f'[geometry]\nmesh = "{mesh}"\n')
    docker.launch("run", str(case))
    assert f"{tmp_path}/far/away:{tmp_path}/far/away" in values(docker.container(), "--volume")


def test_a_starter_written_elsewhere_is_mounted(docker: Machine, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    docker.launch("init", "forming", f"{tmp_path}/mine/new/case.toml")
    assert f"{tmp_path}/mine:{tmp_path}/mine" in values(docker.container(), "--volume")


def test_linked_case_is_mounted_where_it_is(docker: Machine, tmp_path: Path) -> None:
    (tmp_path / "real/cases").mkdir(parents=True)
    (tmp_path / "real/cases/c.toml").touch()
    (tmp_path / "links/here").mkdir(parents=True)
    (tmp_path / "links/here/c.toml").symlink_to(tmp_path / "real/cases/c.toml")
    docker.launch("run", str(tmp_path / "links/here/c.toml"))
    mounts = values(docker.container(), "--volume")
    assert f"{tmp_path}/real:{tmp_path}/real" in mounts
    assert f"{tmp_path}/links:{tmp_path}/links" in mounts


@pytest.mark.parametrize("form", [["--out", "{}"], ["--out={}"], ["-o", "{}"]])
def test_output_directory_is_made_where_asked(
    docker: Machine, tmp_path: Path, form: list[str]
) -> None:
    (tmp_path / "disk").mkdir()
    docker.launch(
        "run", "cases/sfa.toml", *[word.format(tmp_path / "disk/new/run") for word in form]
    )
    assert f"{tmp_path}/disk:{tmp_path}/disk" in values(docker.container(), "--volume")


def test_path_with_a_colon_is_mounted_in_the_long_form(docker: Machine, tmp_path: Path) -> None:
    working = tmp_path / "at 12:30"
    working.mkdir()
    docker.launch("run", "x.toml", cwd=working)
    assert values(docker.container(), "--mount") == [f"type=bind,source={working},target={working}"]


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
    # The root of a rootless container is the caller, and root is root.
    assert "--user" not in call


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


def test_podman_that_runs_nothing_is_reported(machine: Machine) -> None:
    machine.install("podman", ENGINE)
    done = machine.launch(
        "check", TRIBOX_ENGINE="podman", PULL_WORKS="yes", NEEDS="what nobody offers"
    )
    assert done.returncode == 2
    assert "podman cannot run a container here" in done.stderr


def bare_path(machine: Machine) -> str:
    """A search path with what every Unix has, and no way to run the program."""
    for name in ("cat", "cut", "date", "dirname", "grep", "id", "mkdir", "mktemp", "readlink"):
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


@pytest.mark.skipif(os.getuid() != 0, reason="only root installs packages")
def test_podman_is_installed_after_saying_so(machine: Machine) -> None:
    path = bare_path(machine)
    machine.install("env", '#!/bin/sh\nshift\nexec "$@"\n')
    machine.install("tail", '#!/bin/sh\nexec /usr/bin/tail "$@"\n')
    machine.install(
        "apt-get",
        '#!/bin/sh\n{ printf "%s\\n" apt-get "$@"; echo =====; } >>"$STATE/calls"\nexit 1\n',
    )
    done = machine.launch("run", "cases/sfa.toml", PATH=path)
    assert done.returncode == 2
    said, *_, last = done.stderr.splitlines()
    assert "installing podman runc mmdebstrap" in said
    assert "apt-get could not install podman" in last
    assert machine.calls_of("apt-get", "install", "podman", "runc", "mmdebstrap")


@pytest.mark.parametrize("engine", ["kubernetes", "docker", "podman", "python"])
def test_engine_that_is_not_there_is_named(machine: Machine, engine: str) -> None:
    done = machine.launch("check", PATH=bare_path(machine), TRIBOX_ENGINE=engine)
    assert done.returncode == 2
    assert done.stderr.startswith(f"tribox: TRIBOX_ENGINE={engine}")
    assert done.stderr.count("\n") == 1


# --- the image's entry ------------------------------------------------------------------------


def enter(
    directory: Path, name: str, *arguments: str, uid: int = 0, owner: int = 0, **environment: str
) -> list[str]:
    """What the entry called ``name`` starts, with /results owned by ``owner``."""
    directory.mkdir(exist_ok=True)
    entry = directory / name
    shutil.copy(ROOT / "docker/entry", entry)
    report = '#!/bin/sh\nprintf "%s\\n" "${0##*/}" "$TRIBOX_RESULTS" "$@"\n'
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
