"""Refuses to package a checkout without symbolic links; all else stands in pyproject.toml."""

import sys
from pathlib import Path

from setuptools import setup

if not Path("src", "tribox", "app").is_dir():
    sys.exit(
        "src/tribox/app is no directory: packages are made through the links in src/tribox, and "
        "this checkout has no symbolic links (git config core.symlinks true && git checkout -- src)"
    )
setup()
