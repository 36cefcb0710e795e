"""What ``tribox verify``, or ``python3 -m benchmarks.verify``, reads from its command line."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.verify.report import run_verify
from tribox.app.errors import InputError
from tribox.app.run.process import ranks_around
from tribox.app.run.ranks import end_interrupted, end_with


def main(words: Sequence[str]) -> None:
    """Run the cases asked for; errors of ours become one line and an exit code."""
    parser = argparse.ArgumentParser(
        "tribox verify",
        description="Compute verification cases and compare them with closed forms; exit code 3 if "
        "one fails.",
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="cases (default: all)")
    parser.add_argument("--out", type=Path, help="directory for a report with figures")
    parser.add_argument("--force", action="store_true", help="replace a report that is there")
    given = parser.parse_args(words)
    try:
        if ranks_around() > 1:
            raise InputError("verify runs on one rank")
        run_verify(given.names, given.out, given.force)
    except KeyboardInterrupt:
        end_interrupted(False)
    except Exception as error:
        end_with(error)


if __name__ == "__main__":
    main(sys.argv[1:])
