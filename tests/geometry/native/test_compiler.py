"""How C sources are compiled."""

import os
import subprocess
import sys

import pytest

from tribox.forms.native import library
from tribox.geometry.native import compiler
from tribox.geometry.native.compiler import LEVELS, KernelError, level_of

SOURCE = "int twice(int n) { return 2 * n; }\nint far(int n) { return n + 2147483647; }\n"
SCRIPT = (
    "import sys; from pathlib import Path; from tribox.geometry.native.compiler import compiled\n"
    "library = compiled(Path(sys.argv[1])); print(library.twice(4)); library.far(1)"
)


def test_a_variable_adds_options_of_the_compiler(tmp_path):
    """A sanitizer's, say. Libraries of other options are others, in the same cache."""
    (tmp_path / "source.c").write_text(SOURCE)
    sanitized = "-O0 -fsanitize=undefined"
    for count, flags in ((1, ""), (2, sanitized), (2, "")):
        done = subprocess.run(
            [sys.executable, "-c", SCRIPT, str(tmp_path / "source.c")],
            env=os.environ | {"TRIBOX_CFLAGS": flags, "XDG_CACHE_HOME": str(tmp_path)},
            capture_output=True,
            text=True,
            check=False,
        )
        assert (done.returncode, done.stdout) == (0, "8\n")
        assert ("signed integer overflow" in done.stderr) is (flags == sanitized)
        assert len(list((tmp_path / "fenics").glob("libtribox_source_*.so"))) == count


def test_what_the_compiler_says_ends_the_program(tmp_path):
    (tmp_path / "source.c").write_text("int twice(int n) { return 2 * m; }\n")
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(tmp_path / "source.c")],
        env=os.environ | {"XDG_CACHE_HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1 and "source.c cannot be compiled: " in done.stderr
    assert "undeclared" in done.stderr


@pytest.mark.parametrize("level", LEVELS)
def test_the_processor_must_have_all_instructions_of_its_level(level):
    """One that lacks any would end the program, so that it gets the level below."""
    assert level_of("flags : fpu " + " ".join(LEVELS[level])) == (f"-march={level}",)
    for missing in LEVELS[level]:
        has = " ".join(LEVELS[level] - {missing})
        assert level_of("flags : fpu " + has) != (f"-march={level}",)
    assert level_of("") == ()


def test_processes_that_start_together_compile_once(tmp_path):
    """The others wait for the first, and find its library; nothing else stays behind."""
    (tmp_path / "source.c").write_text(SOURCE)
    compiler = tmp_path / "cc"
    compiler.write_text('#!/bin/sh\necho called >> "$0.log"\nsleep 0.5\nexec gcc "$@"\n')
    compiler.chmod(0o755)
    environment = {"XDG_CACHE_HOME": str(tmp_path), "CC": str(compiler)}
    started = [
        subprocess.Popen(
            [sys.executable, "-c", SCRIPT, str(tmp_path / "source.c")],
            env=os.environ | environment,
            stdout=subprocess.PIPE,
            text=True,
        )
        for _ in range(3)
    ]
    assert [process.communicate()[0] for process in started] == ["8\n"] * 3
    assert (tmp_path / "cc.log").read_text() == "called\n"
    assert [file.suffix for file in (tmp_path / "fenics").iterdir()] == [".so"]


# -- Where compiled libraries are kept -------------------------------------------------------------


@pytest.fixture
def cached(monkeypatch):
    """Has libraries looked for in one directory alone, and forgets those that are loaded."""

    def at(directory):
        monkeypatch.setattr(compiler, "_caches", lambda: (directory,))
        library.cache_clear()
        return directory

    yield at
    library.cache_clear()


def test_without_a_compiler_there_is_an_error(cached, monkeypatch, tmp_path):
    """And no run that is silently slower. The cache is empty, and nothing is on the path."""
    cached(tmp_path / "none")
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    with pytest.raises(KernelError, match=r"plane_kernel.c .*no C compiler on the PATH"):
        library("plane_kernel.c")


def test_a_library_is_compiled_once_and_a_broken_one_again(cached, tmp_path):
    directory = cached(tmp_path / "cache")
    assert library("plane_contact.c") is not None
    (built,) = directory.iterdir()
    stamp = built.stat().st_mtime_ns
    cached(directory)
    assert library("plane_contact.c") is not None
    assert built.stat().st_mtime_ns == stamp
    broken = tmp_path / "other" / built.name
    broken.parent.mkdir()
    broken.write_bytes(b"half a library")
    cached(broken.parent)
    assert library("plane_contact.c") is not None
    assert broken.stat().st_size > 1000


def test_libraries_of_strangers_are_not_loaded(cached, tmp_path):
    directory = cached(tmp_path)
    os.chown(directory, 4242, -1) if os.getuid() == 0 else pytest.skip("needs root")
    with pytest.raises(KernelError, match="belongs to somebody else"):
        library("plane_contact.c")
    os.chown(directory, 0, -1)
    assert library("plane_contact.c") is not None
