"""A temporary directory that looks like a checkout to the commands of a page."""

import contextlib
import os
import re
import shlex
import shutil
import subprocess
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.ranks import called, mpi_environment

ROOT = Path(__file__).resolve().parents[2]
LIMIT = 500.0  # s for one block
# A page may write beside these; all else of the tree is a link.
_COPIED = ("cases", "examples")
_LEFT_OUT = ("results", "tribox")
# What of a shell script may be done in a shell of its own, command by command.
_SIMPLE = re.compile(r"(cat|cp|head|mkdir|tail|wc) [\w./* -]+(> *[\w./-]+)?$")
_LOOP = re.compile(r"^for (\w+) in ([\w. -]+); do\n(.*?)^done$", re.MULTILINE | re.DOTALL)
# Commands of the program that keys can be set for.
_SETTABLE = "run | check | mesh | map | bench"
# Commands that can be called in the process of the test: no others take its place.
_CALLED = ("check", "fit", "init", "map", "materials", "mesh", "plot", "report", "run", "schema")
_PROGRAM = """\
#!/bin/sh
# Stands for the launcher: the program of this tree, in the Python that the tests run in.
case ${{1:-}} in
test) exec {python} -m tests.docs.parse "$@" ;;
{settable}) exec {python} -m tribox "$@" {words} ;;
*) exec {python} -m tribox "$@" ;;
esac
"""


@dataclass(frozen=True)
class Done:
    """What a block has printed, errors too as on a terminal, and its exit code."""

    code: int
    printed: str


class Checkout:
    """An empty directory that becomes one, and how commands are run in it."""

    def __init__(self, directory: Path) -> None:
        self.path = directory / "tribox"
        self.path.mkdir()
        self._bin, home = directory / "bin", directory / "home"
        self._bin.mkdir()
        home.mkdir()
        for entry in ROOT.iterdir():
            if entry.name in _COPIED:
                shutil.copytree(entry, self.path / entry.name, symlinks=True)
            elif not entry.name.startswith(".") and entry.name not in _LEFT_OUT:
                (self.path / entry.name).symlink_to(entry)
        (self._bin / "tribox").symlink_to(self.path / "tribox")
        _write_program(self._bin / "python3", f'exec {sys.executable} "$@"\n')
        self.environment = _environment(self._bin, home)

    def run(self, script: str, words: str = "") -> Done:
        """Run commands up to the first that fails; ``words`` go behind those of tribox."""
        if not (calls := _plain(script)):
            return self._shell(script, words)
        code, printed = 0, ""
        for call in calls:
            shell = isinstance(call, str)
            done = self._shell(call, "") if shell else self._call(call, shlex.split(words))
            code, printed = done.code, printed + done.printed
            if code:
                break
        return Done(code, printed)

    def _shell(self, script: str, words: str) -> Done:
        """Run commands in a shell, those of tribox in processes of their own."""
        quoted = shlex.join(shlex.split(words))
        program = _PROGRAM.format(python=sys.executable, settable=_SETTABLE, words=quoted)
        (self.path / "tribox").unlink(missing_ok=True)
        _write_program(self.path / "tribox", program)
        done = subprocess.run(
            ["bash", "-e", "-o", "pipefail", "-c", script],
            cwd=self.path,
            env=self.environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=LIMIT,
        )
        return Done(done.returncode, done.stdout)

    def _call(self, call: list[str], words: list[str]) -> Done:
        """The same for one call of the command line, in this process."""
        with (
            pytest.MonkeyPatch.context() as patch,
            contextlib.chdir(self.path),
            warnings.catch_warnings(),
        ):
            warnings.simplefilter("ignore")
            for name in os.environ.keys() - self.environment.keys():
                patch.delenv(name)
            for name, value in self.environment.items():
                patch.setenv(name, value)
            return Done(*called(*call, *(words if call[0] in _SETTABLE.split(" | ") else [])))


def _plain(script: str) -> list[list[str] | str]:
    """The words of each call of tribox, and simple commands; empty if there is more to do."""
    calls: list[list[str] | str] = []
    for line in _unrolled(script.replace("\\\n", " ")).splitlines():
        if _SIMPLE.match(line):
            calls.append(line)
            continue
        bare = re.sub(r"'[^']*'|\"[^\"$`\\]*\"", "", line)
        words = shlex.split(line, comments=True)
        if not words:
            continue
        if re.search(r"[|&;<>()$`\\*?\[~\"']|--np|--watch", bare.partition("#")[0]):
            return []
        if words[0] not in ("tribox", "./tribox") or words[1:2] == [] or words[1] not in _CALLED:
            return []
        calls.append(words[1:])
    return calls


def _unrolled(script: str) -> str:
    """A script with its loops over words written out."""

    def passes(loop: re.Match[str]) -> str:
        variable = re.compile(rf"\${loop[1]}\b")
        return "".join(variable.sub(value, loop[3]) for value in loop[2].split())

    return _LOOP.sub(passes, script)


def _write_program(path: Path, text: str) -> None:
    path.write_text(text if text.startswith("#!") else f"#!/bin/sh\n{text}", encoding="utf-8")
    path.chmod(0o755)


def _environment(binaries: Path, home: Path) -> dict[str, str]:
    """That of the tests, with a home of its own; compiled forms come from the usual cache."""
    found = mpi_environment()
    cache = found.get("XDG_CACHE_HOME") or str(Path(found.get("HOME", "/root")) / ".cache")
    for name in ("TRIBOX_RESULTS", "TRIBOX_TRUST", "PYTHONSAFEPATH"):
        found.pop(name, None)
    return found | {
        "HOME": str(home),
        "PATH": f"{binaries}:{found['PATH']}",
        "PYTHONPATH": f"{ROOT / 'src'}:{ROOT}",
        "XDG_CACHE_HOME": cache,
    }
