"""The problem as an input of CalculiX, and the forces out of its ``.dat``."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from benchmarks.other_codes.problem import Problem, shear_and_lame

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
