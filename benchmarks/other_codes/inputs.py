"""The problem as an input of CalculiX, and the forces out of its ``.dat``; as a case of tribox."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from benchmarks.other_codes.problem import Box, Problem, shear_and_lame

# Faces of C3D8 by the nodes of :meth:`Box.cells`: S3 has the smallest y, S5 the largest.
LOWER_SIDE, UPPER_SIDE = "S3", "S5"
# CalculiX takes residuals below 1e-6 for zero, whatever the unit. So forces are in micronewtons,
# stresses in µN/mm² where the tolerance is to count.
MICRO = 1e6


def deck(problem: Problem, *, tolerance: float | None = None) -> str:
    """CalculiX' input; a second is a step.

    Args:
        problem: what to solve.
        tolerance: largest residual at a node over the mean nodal force; None for CalculiX' own,
            0.5 %, which does not count here: forces in newtons are below what it takes for zero.
    """
    upper, lower = problem.upper, problem.lower
    first = sum(1 for _ in upper.nodes())
    lines = ["*NODE, NSET=ALL", *_nodes(list(upper.nodes()), 1)]
    lines += _nodes(list(lower.nodes()), first + 1)
    soft, stiff = list(upper.cells()), list(lower.cells())
    lines += ["*ELEMENT, TYPE=C3D8, ELSET=SOFT", *_cells(soft, 1, 1)]
    lines += ["*ELEMENT, TYPE=C3D8, ELSET=STIFF", *_cells(stiff, len(soft) + 1, first + 1)]
    lines += ["*NSET, NSET=TOP", *(f"{n + 1}," for n in upper.layer(upper.counts[1]))]
    lines += ["*NSET, NSET=BOTTOM", *(f"{first + n + 1}," for n in lower.layer(0))]
    lines += ["*SURFACE, NAME=SLAVE, TYPE=ELEMENT"]
    lines += [f"{n + 1},{LOWER_SIDE}" for n in _row(upper.counts, 0)]
    lines += ["*SURFACE, NAME=MASTER, TYPE=ELEMENT"]
    top = _row(lower.counts, lower.counts[1] - 1)
    lines += [f"{len(soft) + n + 1},{UPPER_SIDE}" for n in top]
    unit = MICRO if tolerance is not None else 1.0
    lines += [*_properties(problem, unit), *_motion(problem)]
    controls = list(_controls(tolerance)) if tolerance is not None else []
    for steps in (problem.press_steps, problem.slide_steps):
        lines += [*_step(problem, steps, controls)]
    return "\n".join(lines) + "\n"


def _nodes(places: Sequence[tuple[float, float, float]], first: int) -> Iterator[str]:
    for n, (x, y, z) in enumerate(places):
        yield f"{first + n},{x:.12g},{y:.12g},{z:.12g}"


def _cells(cells: Sequence[tuple[int, ...]], first: int, node: int) -> Iterator[str]:
    for n, cell in enumerate(cells):
        yield f"{first + n}," + ",".join(str(node + corner) for corner in cell)


def _row(counts: tuple[int, int, int], j: int) -> Iterator[int]:
    """Numbers, from 0, of the elements in a layer."""
    across, up, deep = counts
    yield from (i + across * (j + up * k) for k in range(deep) for i in range(across))


def _properties(problem: Problem, unit: float) -> Iterator[str]:
    shear, lame = shear_and_lame(problem.soft)
    bulk = lame + 2.0 / 3.0 * shear
    yield from ("*MATERIAL, NAME=RUBBER", "*HYPERELASTIC, NEO HOOKE")
    yield f"{0.5 * shear * unit:.12g},{2.0 / bulk / unit:.12g}"
    modulus, ratio = problem.stiff
    yield from ("*MATERIAL, NAME=METAL", "*ELASTIC", f"{modulus * unit},{ratio}")
    yield "*SOLID SECTION, ELSET=SOFT, MATERIAL=RUBBER"
    yield "*SOLID SECTION, ELSET=STIFF, MATERIAL=METAL"
    yield from ("*SURFACE INTERACTION, NAME=PAIR", "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR")
    yield f"{problem.penalty * unit}"
    yield from ("*FRICTION", f"{problem.friction},{problem.stick * unit}")
    yield from ("*CONTACT PAIR, INTERACTION=PAIR, TYPE=SURFACE TO SURFACE", "SLAVE,MASTER")
    yield from ("*BOUNDARY", "BOTTOM,1,3", "TOP,3,3")


def _motion(problem: Problem) -> Iterator[str]:
    press, end = problem.press_steps, problem.press_steps + problem.slide_steps
    yield from ("*AMPLITUDE, NAME=DOWN, TIME=TOTAL TIME", f"0.,0.,{press}.,1.,{end}.,1.")
    yield from ("*AMPLITUDE, NAME=ALONG, TIME=TOTAL TIME", f"0.,0.,{press}.,0.,{end}.,1.")


def _controls(tolerance: float) -> Iterator[str]:
    """Residual at which an increment is solved, also after many iterations; no other way out."""
    yield "*CONTROLS, PARAMETERS=FIELD"
    yield f"{tolerance:g},0.01,,,{tolerance:g},1e-15,1e-8,1e-15"


def _step(problem: Problem, steps: int, controls: Sequence[str]) -> Iterator[str]:
    yield from (f"*STEP, NLGEOM, INC={10 * steps}", "*STATIC, DIRECT", f"1.,{steps}.", *controls)
    yield from ("*BOUNDARY, AMPLITUDE=DOWN", f"TOP,2,2,{-problem.pressed}")
    yield from ("*BOUNDARY, AMPLITUDE=ALONG", f"TOP,1,1,{problem.slid}")
    yield from ("*NODE PRINT, NSET=TOP, TOTALS=ONLY", "RF", "*END STEP")


def forces_in(text: str) -> list[tuple[float, float, float, float]]:
    """Time, s, and force of what moves the top along x, y and z, N, by increment of a ``.dat``."""
    number = r"([-+\d.E]+)"
    pattern = rf"total force.*?time\s+{number}\s+{number}\s+{number}\s+{number}"
    found = re.findall(pattern, text)
    return [(float(t), float(x), float(y), float(z)) for t, x, y, z in found]


def iterations_in(text: str) -> list[int]:
    """Iterations of each increment that was solved, from a ``.sta``."""
    rows = [line.split() for line in text.splitlines()]
    return [int(row[3]) for row in rows if len(row) == 7 and row[0].isdecimal()]


# -- As a case file of tribox ----------------------------------------------------------------------

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
