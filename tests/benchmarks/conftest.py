"""Cases and the command line, as tests of the application have them."""

from tests.app.conftest import block, case_file, tribox

__all__ = ["block", "case_file", "tribox"]
