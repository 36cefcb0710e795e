"""What bodies, axes, pairs and pictures of a run are called in its figures."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

from tribox.app.figures.units import Unit, velocity_unit

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


def unit_of_velocity(results: Results) -> Unit:
    """The unit in which all figures of a run, or of a sweep, give velocities."""
    table = results.table("history" if results.case.sweep is None else "sweep")
    return velocity_unit(table["velocity"] if len(table) and "velocity" in table else [])


def heading(results: Results, title: str) -> str:
    """Title of the case above what the picture shows."""
    return titled(results.case.title, title)


def titled(case: str, title: str) -> str:
    """Title of a case above what the picture shows, either of them "" without."""
    lines = [line for line in (case, title) if line]
    return "\n".join("\n".join(textwrap.wrap(line, TITLE_WIDTH)) for line in lines)
