"""Verification of metal pressed by a rigid tool: a billet upset without friction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tribox.app.case.generators import PlacedBlocksGeometry
from tribox.app.verify.result import Check, Floats, Line, Panel, Verification
from tribox.app.verify.shipped_case import solve
from tribox.forms.bodies.elastoplastic import ElastoPlastic
from tribox.forms.bodies.hardening import Hardening
from tribox.forms.closed_forms.metal_bar import stress_at

FRICTIONLESS = 'contact.0.friction={law="frictionless"}'
COARSE = ("geometry.blocks.billet.elements=[4, 3]", "stage.0.steps=10")
WAYS: dict[str, tuple[str, ...]] = {
    "4 × 3 elements, 10 steps": COARSE,
    "4 × 3 elements, 40 steps": COARSE[:1],
    "a tenth of the penalty": (*COARSE, "contact.0.penalty_factor=3"),
    "ten times the penalty": (*COARSE, "contact.0.penalty_factor=300"),
}


@dataclass(frozen=True, slots=True)
class Billet:
    """A billet that was upset: a value for each step.

    Attributes:
        travelled: of the die, over the height before, subtracted from 1.
        stretch: height over that before; less travelled, where the die penetrates.
        force: N, of the die.
        young, hardening, area: E, Pa; yield stress; m², before.
    """

    travelled: Floats
    stretch: Floats
    force: Floats
    young: float
    hardening: Hardening
    area: float

    def exact(self, stretch: Floats) -> Floats:
        """Force of the closed form, N."""
        return -self.area * stress_at(stretch, self.young, self.hardening, pressed=True)


def billet(overrides: Sequence[str] = ()) -> Billet:
    """Upset the billet of ``cases/forming/upsetting.toml`` without friction.

    Args:
        overrides: of that case.
    """
    case, simulation = solve("forming/upsetting", (FRICTIONLESS, *overrides))
    geometry = case.geometry
    assert isinstance(geometry, PlacedBlocksGeometry)
    (block,) = geometry.blocks.values()
    height = block.y[1] - block.y[0]
    tool = next(iter(case.tools.values()))
    assert tool.displacement is not None
    down = tool.displacement.y
    assert down is not None and not isinstance(down, str)
    rows = simulation.rows
    travelled = np.array([1.0 + down(row.time) / height for row in rows])
    (solid,) = simulation.model.problem.solids
    material = solid.material
    assert isinstance(material, ElastoPlastic)
    G, K = material.shear_modulus, material.bulk_modulus
    return Billet(
        travelled=travelled,
        stretch=travelled + np.array([row.max_penetration for row in rows]) / height,
        force=np.array([row.normal_force for row in rows]),
        young=9.0 * K * G / (3.0 * K + G),
        hardening=material.hardening,
        area=np.pi * block.x[1] ** 2,
    )


def upset() -> Verification:
    """Force of the die over the height, by step sizes and penalties."""
    shipped = billet(("stage.0.steps=10",))
    at_travel = shipped.exact(shipped.travelled)
    checks = [
        Check("force over the die's travel, as shipped", apart(shipped.force, at_travel), 1e-3)
    ]
    fine = np.linspace(0.9999, shipped.stretch[-1], 100)
    lines = [_line("closed form", fine, shipped.exact(fine), exact=True)]
    lines.append(_line("as shipped", shipped.travelled, shipped.force))
    for name, overrides in WAYS.items():
        found = billet(overrides)
        error = apart(found.force, found.exact(found.stretch))
        checks.append(Check(f"force over the height, {name}", error, 1e-3))
        lines.append(_line(name, found.stretch, found.force))
    return Verification(
        "upset",
        "billet upset between rigid planes without friction",
        "`cases/forming/upsetting.toml` without friction: every point of the billet is in uniaxial "
        "compression. The force is compared at the travel of the die with the mesh of the case, "
        "and at the height of the billet, the travel less the penetration, with a coarser one. "
        "Errors are the largest of all steps.",
        tuple(checks),
        (Panel("reduction of height (%)", "force (kN)", tuple(lines)),),
    )


def apart(force: Floats, exact: Floats) -> float:
    """Largest difference of a force, over the closed form's."""
    return float(np.abs(force / exact - 1.0).max())


def _line(name: str, stretch: Floats, force: Floats, exact: bool = False) -> Line:
    return Line(name, 100.0 * (1.0 - stretch), 1e-3 * force, exact)
