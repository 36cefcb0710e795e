"""The problem as a case file of tribox."""

from __future__ import annotations

from benchmarks.other_codes.problem import Box, Problem

CASE = """
title = "press and slide of two boxes, side by side with other codes"

[geometry]
kind = "two-boxes"
upper = {upper}
lower = {lower}
offset = ["{x:.9g} mm", "{z:.9g} mm"]

[bodies.elastomer]
material = "{law}"
{soft}
formulation = "{element}"

[bodies.aluminium]
material = "neo-hookean"
E = "{E2:.9g} MPa"
nu = {nu2!r}
formulation = "{element}"

[[contact]]
slave = "elastomer_contact"
master = "aluminium_contact"
penalty = "{penalty:.9g} MPa/mm"
friction = {{ law = "coulomb", mu = {mu!r}, K_T = "{stick:.9g} MPa/mm" }}

[[boundary]]
surface = "bottom"
displacement = {{ x = 0, y = 0, z = 0 }}

[[boundary]]
surface = "top"

[boundary.displacement]
x = [["{press} s", "0 mm"], ["{end} s", "{slid:.9g} mm"]]
y = [["0 s", "0 mm"], ["{press} s", "-{pressed:.9g} mm"]]
z = 0

[[stage]]
name = "press"
duration = "{press} s"
steps = {press}

[[stage]]
name = "slide"
duration = "{slide} s"
steps = {slide}

[solver]
tolerance = {tolerance!r}

[output]
figures = false
fields_every = 0
"""


def case_text(problem: Problem, *, calculix: bool = False, element: str = "q1") -> str:
    """The case; a second is a step.

    ``calculix``: the soft body has CalculiX' neo-Hookean energy, isochoric and volumetric parts
    apart; else that of Simo and Pister, with which GetFEM runs.
    """
    E, nu = problem.soft
    shear, bulk = E / (2.0 * (1.0 + nu)), E / (3.0 * (1.0 - 2.0 * nu))
    split = f'C10 = "{0.5 * shear!r} MPa"\nC01 = "0 MPa"\nK = "{bulk!r} MPa"'
    return CASE.format(
        upper=_box(problem.upper),
        lower=_box(problem.lower),
        x=problem.upper.corner[0] - problem.lower.corner[0],
        z=problem.upper.corner[2] - problem.lower.corner[2],
        law="mooney-rivlin" if calculix else "neo-hookean",
        soft=split if calculix else f'E = "{E!r} MPa"\nnu = {nu!r}',
        element=element,
        E2=problem.stiff[0],
        nu2=problem.stiff[1],
        penalty=problem.penalty,
        mu=problem.friction,
        stick=problem.stick,
        press=problem.press_steps,
        slide=problem.slide_steps,
        end=problem.press_steps + problem.slide_steps,
        slid=problem.slid,
        pressed=problem.pressed,
        tolerance=problem.tolerance,
    )


def _box(box: Box) -> str:
    """Table of one box."""
    width, height, depth = box.size
    return (
        f'{{ width = "{width:.9g} mm", height = "{height:.9g} mm", depth = "{depth:.9g} mm", '
        f"elements = {list(box.counts)} }}"
    )
