"""What bodies, axes, pairs and pictures of a run are called in its figures."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tribox.app.results import Results

TITLE_WIDTH = 110  # characters


def body_names(results: Results) -> list[str]:
    """Names of the bodies in the order of their numbers in the field files."""
    return list(results.summary.get("bodies", results.case.bodies))


def axis_names(results: Results) -> tuple[str, str]:
    """Names of the two axes of a mesh in the plane."""
    section = results.case.geometry.built_section
    return ("r", "z") if section == "axisymmetric" else ("x", "y")


def pair_names(results: Results) -> list[str]:
    """Names of the contact pairs in the order of the case."""
    return [getattr(c, "name", None) or f"{c.slave}-{c.master}" for c in results.case.contact]


def heading(results: Results, title: str) -> str:
    """Title of the case above what the picture shows."""
    lines = [results.case.title, title] if results.case.title else [title]
    return "\n".join("\n".join(textwrap.wrap(line, TITLE_WIDTH)) for line in lines)
