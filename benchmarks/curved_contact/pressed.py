"""Round bodies pressed together without friction, against Hertz.

An elastomer (E = 10 MPa) under a round tool of aluminium, or two like round elastomers whose nodes
do not match; cylinders, or spheres as sections of revolution; pressed by displacement or by a
platen's force from a first touch. The bodies are forty half-widths in size, strains are about 1 %.
Half-width and peak are held against those of the computed load; the half-width twice, by the
ellipse that fits the pressure best and by the free surface beside the contact. ``worst`` is the
largest deviation of any nodal pressure (of a point's, where the contact has none of nodes) inside
0.9 a, over p0.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.curved_contact import runs
from benchmarks.curved_contact.runs import MM, Frame, Outcome
from benchmarks.curved_contact.shapes import Moved, TwoHemispheres, graded
from benchmarks.curved_contact.surfaces import beyond_line, beyond_point, half_width
from benchmarks.verify.contact import case_modulus, fit_ellipse
from benchmarks.verify.hertz import LineContact, PointContact, relative_radius
from tribox.geometry.generators.cylinders import FlatBlock, HalfCylinder
from tribox.geometry.generators.cylinders import LineContact as Lines
from tribox.geometry.generators.sphere_on_block import SphereOnBlock
from tribox.geometry.meshes.gmsh_model import Shape, write_msh

RADIUS = 10 * MM
ZONE = 1.2 * MM
FINEST = 30.0  # largest over smallest facet of a graded slave


@dataclass(frozen=True, slots=True)
class Setup:
    """One row of the table.

    Attributes:
        kind: "cylinder" or "sphere" of aluminium on an elastomer, "cylinders" or "spheres": two
            elastomers, "graded": the cylinder on facets that grow 1 : 30.
        by: "displacement" or "force"; size: µm, facets of the slave; nu: of the elastomer.
        slave: "rubber" (below) or "tool" (above).
        smooth: whether the master is smoothed.
    """

    kind: str = "cylinder"
    by: str = "displacement"
    size: float = 20.0
    nu: float = 0.4999
    slave: str = "rubber"
    smooth: bool = False

    @property
    def point(self) -> bool:
        """Whether it is a point contact."""
        return self.kind.startswith("sphere")

    @property
    def twice(self) -> bool:
        """Whether both bodies are round and soft."""
        return self.kind.endswith("s")


BASE = Setup()
QUICK = replace(BASE, nu=0.495)
ROWS = (
    *(Setup(k) for k in ("cylinder", "sphere", "cylinders", "spheres", "graded")),
    *(Setup(k, "force") for k in ("cylinder", "sphere")),
    Setup("cylinder", smooth=True),
    Setup("cylinder", slave="tool"),
    Setup("cylinder", size=10.0),
)


def shape_of(setup: Setup) -> Shape:
    """What is meshed."""
    size, other = setup.size * 1e-6, 1.3 * setup.size * 1e-6
    upper, lower = (size, other) if setup.slave == "tool" else (other, size)
    if setup.point:
        sphere = SphereOnBlock(
            RADIUS, 8 * MM, 8 * MM, ZONE, lower, 1.25, upper_name="tool", lower_name="rubber"
        )
        if setup.kind == "sphere":
            return sphere
        return TwoHemispheres(replace(sphere, contact_size=upper), sphere)
    tool = HalfCylinder(RADIUS, ZONE, upper)
    if setup.kind == "cylinders":
        return Lines(
            tool, HalfCylinder(RADIUS, ZONE, lower), 1.25, "quadrilateral", "tool", "rubber"
        )
    wide = setup.kind == "graded"
    zone = 4 * MM if wide else ZONE
    block = FlatBlock(20 * MM, 10 * MM, zone, lower)
    lines = Lines(tool, block, 1.25, "quadrilateral", "tool", "rubber")
    return Moved(lines, graded(0.5 * zone, FINEST)) if wide else lines


def case_of(setup: Setup) -> str:
    """The case file: pressed to a half-width of about 0.25 mm."""
    deep, force = (-6.5e-6, 0.03) if setup.point else (-13e-6, 65.0)
    if setup.by == "force":
        program = f'[["0 s", 0], ["1 s", {force}]]'
        top = f'displacement = {{ x = 0 }}\nplaten = {{ direction = "y", force = {program} }}'
    else:
        top = runs.moved("0", f"{deep * (2 if setup.twice else 1)} m")
    return runs.case_text(
        (runs.SMOOTH if setup.smooth else "") + runs.FRICTIONLESS,
        runs.moved("0"),
        top,
        runs.stages(4),
        rubber=runs.soft(setup.nu),
        tool=runs.soft(setup.nu) if setup.twice else runs.STIFF,
        slave=setup.slave,
        section=f'section = "{"axisymmetric" if setup.point else "plane-strain"}"',
    )


def row(setup: Setup, scratch: Path, overrides: tuple[str, ...] = ()) -> dict[str, Any]:
    """Solve one problem; its row of the table."""
    write_msh(shape_of(setup), scratch / "mesh.msh")
    outcome = runs.run(case_of(setup), scratch, overrides)
    out = asdict(setup) | outcome.cost()
    if outcome.failure:
        return out | {"failure": outcome.failure}
    return out | measured(setup, outcome, outcome.frames[-1])


def measured(setup: Setup, outcome: Outcome, last: Frame) -> dict[str, Any]:
    """The pressure against Hertz's under the computed load."""
    radius = relative_radius(RADIUS, RADIUS) if setup.twice else RADIUS
    modulus = case_modulus(outcome.model.case)
    exact: LineContact | PointContact
    if setup.point:
        exact = PointContact(last.row.normal_resultant, radius, modulus)
        a = exact.contact_radius
    else:
        exact = LineContact(last.row.normal_resultant, radius, modulus)
        a = exact.half_width
    closed = last.pressure > 0.0
    width, peak = fit_ellipse(last.position[closed, 0], last.pressure[closed])
    at, p = last.position[:, 0], last.pressure
    if last.nodal is not None and last.at is not None:
        at, p = last.at[:, 0], last.nodal
    inside = np.abs(at) < 0.9 * a
    apart = np.abs(p[inside] - exact.pressure(at[inside])) / exact.peak
    free = half_width(
        last.nodes["rubber_contact"],
        last.nodes["tool_contact"],
        radius,
        beyond_point if setup.point else beyond_line,
    )
    return {
        "a Hertz µm": a * 1e6,
        "a fit %": 100 * (width / a - 1.0),
        "a surface %": 100 * (free / a - 1.0),
        "p0 fit %": 100 * (peak / exact.peak - 1.0),
        "p max %": 100 * (float(np.max(p)) / exact.peak - 1.0),
        "worst %": 100 * float(apart.max()),
        "worst of": "points" if last.nodal is None else "nodes",
        "load N": last.row.normal_resultant,
    }
