"""Builds the site into ``build/site``: ``./tribox python docs/build.py``."""

import sys
from pathlib import Path

from sphinx.cmd.build import main

SITE = ["-W", "--keep-going", "-b", "html", str(Path(__file__).parent), "build/site"]

if __name__ == "__main__":
    sys.exit(main([*sys.argv[1:], *SITE]))
