"""How a process ends for what no case is to blame for."""

from __future__ import annotations

import pytest

from tribox.app.run.ending import end_with
from tribox.geometry.native.compiler import KernelError


def test_a_source_that_does_not_compile_is_one_line(capsys):
    with pytest.raises(SystemExit) as ended:
        end_with(KernelError("plane_kernel.c cannot be compiled: cc says: 'm' undeclared\nhere"))
    assert ended.value.code == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("tribox: plane_kernel.c cannot be compiled") and "undeclared" in line


def test_other_errors_keep_their_traceback():
    with pytest.raises(RuntimeError, match="of another kind"):
        end_with(RuntimeError("of another kind"))
