"""How C sources are compiled."""

from __future__ import annotations

import os
import subprocess
import sys

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
