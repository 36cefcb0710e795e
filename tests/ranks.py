"""Tests on several ranks: one start of MPI for each number of ranks, whoever asks.

Starting ranks takes longer than most of what they are tested with. So a test names the functions it
needs on ranks, and on how many::

    @pytest.mark.mpi(facts, 2, 3)
    def test_ranks_agree(on_ranks):
        assert on_ranks(facts, 2) == on_ranks(facts, 3) == on_ranks(facts, 1)

The functions of all tests that are to run are then called one after the other by the same ranks, as
``facts(comm, directory)``: collectively, with a directory for that function and number of ranks.
The test is given what the first rank returns, as JSON. On one rank this process calls them.
"""

import contextlib
import importlib
import json
import os
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any

import pytest
from mpi4py import MPI

ROOT = Path(__file__).resolve().parents[1]
# s that a process may take at most, or all functions of one start of ranks: what only a hang takes,
# however busy the machine is, and less than the limit that pytest sets a test.
LIMIT = 500.0
Scene = Callable[[MPI.Comm, Path], Any]


def mpi_environment() -> dict[str, str]:
    """Environment for another process: without what MPI, once started here, has put into ours."""
    kept = {
        key: value
        for key, value in os.environ.items()
        if not key.startswith(("PMIX_", "OMPI_COMM_WORLD", "OMPI_UNIVERSE", "PMI_"))
    }
    path = os.pathsep.join((str(ROOT / "src"), str(ROOT)))
    kept |= {"PYTHONPATH": path, "MPLBACKEND": "Agg", "OMP_NUM_THREADS": "1"}
    # Ranks that wait give way to those that work, where there are fewer cores than ranks.
    return kept | {"OMPI_MCA_mpi_yield_when_idle": "1"}


@pytest.fixture(scope="session")
def environment() -> dict[str, str]:
    """Environment for another process: without what MPI, once started here, has put into ours."""
    return mpi_environment()


class OnRanks:
    """Calls functions on ranks; each number of ranks is started once in a run of the tests.

    What only long tests ask for has a start of its own: no test may wait for all of it.
    """

    def __init__(self, session: pytest.Session, directory: Path) -> None:
        self.directory = directory
        self._alone: dict[str, Any] = {}
        self._tiers: dict[tuple[str, int], str] = {}
        for item in session.items:
            tier = "long" if item.get_closest_marker("long") else "guard"
            for key in _asked(item):
                self._tiers[key] = min(tier, self._tiers.get(key, tier))

    def __call__(self, scene: Scene, count: int) -> Any:
        """What a function returns on the first of a number of ranks."""
        name = name_of(scene)
        if count == 1:
            if name not in self._alone:
                self._alone[name] = call(scene, MPI.COMM_SELF, self.directory / "1")
            return self._alone[name]
        assert (name, count) in self._tiers, f"@pytest.mark.mpi({scene.__name__}, {count})"
        directory = self.directory / f"{count}-{self._tiers[name, count]}"
        if not directory.exists():
            self._start(self._tiers[name, count], count, directory)
        found = directory / f"{name}.json"
        said = (directory / "said.txt").read_text(encoding="utf-8")
        assert found.exists(), f"{name} did not end within {LIMIT:g} s, or failed:\n{said}"
        return json.loads(found.read_text(encoding="utf-8"))

    def _start(self, tier: str, count: int, directory: Path) -> None:
        directory.mkdir(parents=True)
        names = [name for (name, ranks), of in self._tiers.items() if (of, ranks) == (tier, count)]
        with (directory / "said.txt").open("w", encoding="utf-8") as output:
            while names:  # after one that fails, and ends all ranks, the others have a new start
                _run(count, directory, names, output)
                ended = [(directory / f"{name}.json").exists() for name in names]
                names = names[ended.index(False) + 1 :] if False in ended else []


def _run(count: int, directory: Path, names: list[str], output: IO[str]) -> None:
    """Call functions on ranks until all have returned, one has failed or the time is over."""
    command = ["mpirun", "--oversubscribe", "-n", f"{count}", sys.executable, "-m"]
    command += ["tests.ranks", f"{directory}", *names]
    with contextlib.suppress(subprocess.TimeoutExpired):  # what has been returned counts
        subprocess.run(
            command,
            cwd=ROOT,
            env=mpi_environment(),
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            timeout=LIMIT,
        )


def _asked(item: pytest.Item) -> list[tuple[str, int]]:
    """The functions that a test names in its markers, each with the numbers of ranks."""
    return [
        (name_of(scene), count)
        for mark in item.iter_markers("mpi")
        for scene in mark.args
        for count in mark.args
        if not isinstance(scene, int) and isinstance(count, int)
    ]


@pytest.fixture(scope="session")
def on_ranks(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> OnRanks:
    """Calls a function that is named in the test's marker on a number of ranks."""
    return OnRanks(request.session, tmp_path_factory.mktemp("ranks"))


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Where several processes test, one of them has all tests that share starts of ranks."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        for item in items:
            if "on_ranks" in getattr(item, "fixturenames", ()):
                item.add_marker(pytest.mark.xdist_group("ranks"))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> object:
    """Hands out those as one, and the others file by file."""
    from xdist.scheduler import LoadGroupScheduling

    class Scheduling(LoadGroupScheduling):
        def _split_scope(self, nodeid: str) -> str:
            found = str(super()._split_scope(nodeid))
            return nodeid.split("::")[0] if found == nodeid else found

    return Scheduling(config, log)


def pytest_configure(config: pytest.Config) -> None:
    """Keep processes that share the tests out on cores of their own, with all that they start."""
    if worker := os.environ.get("PYTEST_XDIST_WORKER"):
        config.option.loadgroup = True  # the marks above count, however tests are shared out
        cores, count = sorted(os.sched_getaffinity(0)), int(os.environ["PYTEST_XDIST_WORKER_COUNT"])
        os.sched_setaffinity(0, cores[int(worker[2:]) % len(cores) :: count])


def name_of(scene: Scene) -> str:
    return f"{scene.__module__}:{scene.__qualname__}"


def call(scene: Scene, comm: MPI.Comm, directory: Path) -> Any:
    """Call a function, collectively, with a directory of its own; returns what JSON makes of it."""
    own = directory / name_of(scene).replace(":", ".")
    own.mkdir(parents=True, exist_ok=True)
    return json.loads(json.dumps(scene(comm, own)))


# -- what ranks do --------------------------------------------------------------------------------


def main(directory: Path, names: list[str]) -> None:
    """Call functions on all ranks there are; write what the first rank returns."""
    import tests.loaded_once  # noqa: F401

    # All on one core, where they give way to each other and take no longer than they compute. They
    # wait for each other at every step, and come to nothing beside another process.
    cores = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(0, {cores[os.getppid() % len(cores)]})
    comm = MPI.COMM_WORLD
    for name in names:
        module, function = name.split(":")
        try:
            found = call(getattr(importlib.import_module(module), function), comm, directory)
        except BaseException:
            print(f"{name} on rank {comm.rank} of {comm.size}:\n{traceback.format_exc()}")
            sys.stdout.flush()
            comm.Abort(1)
        if comm.rank == 0:
            (directory / f"{name}.json").write_text(json.dumps(found), encoding="utf-8")
        comm.barrier()


def command(comm: MPI.Comm, *words: object) -> tuple[list[Any], str]:
    """Call tribox on all ranks: what each would end with, and all that they print."""
    code, said = called(*words)
    return comm.allgather(code), "".join(comm.allgather(said))


def called(*words: object) -> tuple[int, str]:
    """Call tribox in this process, which saves its imports: its end, and all that it prints."""
    from tribox.app.cli import main as tribox

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["tribox", *map(str, words)])
        with tempfile.TemporaryFile("w+", encoding="utf-8") as file:
            with _output_to(file.fileno()), pytest.raises(SystemExit) as ended:
                tribox()
            file.seek(0)
            return ended.value.code or 0, file.read()


@contextlib.contextmanager
def _output_to(descriptor: int) -> Iterator[None]:
    """Standard output and error of this process, and of libraries in it, to a file."""
    streams = (sys.stdout, sys.stderr)
    kept = [os.dup(number) for number in (1, 2)]
    for stream in streams:
        stream.flush()
    try:
        for number in (1, 2):
            os.dup2(descriptor, number)
        with open(1, "w", encoding="utf-8", buffering=1, closefd=False) as both:
            with contextlib.redirect_stdout(both), contextlib.redirect_stderr(both):
                yield
    finally:
        for number, before in zip((1, 2), kept, strict=True):
            os.dup2(before, number)
            os.close(before)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
