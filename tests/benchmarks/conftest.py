"""Cases and the command line, as tests of the application have them."""

from __future__ import annotations

from tests.app.conftest import block, case_file, tribox

__all__ = ["block", "case_file", "tribox"]
