"""Checks a command of tribox without running it: ``python3 -m tests.docs.parse test -k map``."""

import sys

from tests.docs.commands import problems

if __name__ == "__main__":
    import shlex

    sys.exit("\n".join(problems(shlex.join(["tribox", *sys.argv[1:]]))) or 0)
