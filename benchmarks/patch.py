"""The patch test of the contact: a uniform pressure through a flat interface of meshes that differ.

From the repository: ``python3 -m benchmarks.patch`` prints the tables of docs/quadrature.md;
``--figure FILE`` draws their figure as well.

Two blocks of one width lie on each other, supported at the sides and from below, and are pressed
from above. The exact stress is σ_yy = −p in every cell. The contact forces of the slave are
consistent with a uniform pressure at any quadrature; those of the master are integrals of its shape
functions, which have kinks inside slave facets, so that a fixed number of points per slave facet
gives an error.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from benchmarks.verify.result import solve
from benchmarks.verify.space import PatchErrors, stress_errors
from tribox.app.errors import SolutionError
from tribox.app.figures.style import STYLE, save

PRESSURE = 1e5  # Pa, a fiftieth of the elastomer's modulus
CASE = """
title = "patch test"
[geometry]
kind = "two-blocks"
cell = "{cell}"
upper = {{ width = "1 mm", height = "0.5 mm", elements = [{upper}, {upper_rows}] }}
lower = {{ width = "1 mm", height = "0.5 mm", elements = [{lower}, {lower_rows}] }}
[bodies.elastomer]
material = "neo-hookean"
E = "5 MPa"
nu = 0.45
[bodies.aluminium]
material = "neo-hookean"
E = "{stiffness} MPa"
nu = 0.33
[[contact]]
slave = "{slave}_contact"
master = "{master}_contact"
friction = {{ law = "frictionless" }}
[[boundary]]
surface = "bottom"
displacement = {{ y = 0 }}
[[boundary]]
surface = "top"
pressure = {pressure}
[[stage]]
name = "press"
duration = "1 s"
steps = 1
"""
CASE += "".join(
    f'[[boundary]]\nsurface = "{body}_{side}"\ndisplacement = {{{{ x = 0 }}}}\n'
    for body in ("elastomer", "aluminium")
    for side in ("left", "right")
)


@dataclass(frozen=True, slots=True)
class Patch:
    """One patch test.

    Attributes:
        upper, lower: facets of the elastomer above and of the block below along the interface.
        slave: body whose surface carries the points, "elastomer" or "aluminium".
        cell: "quadrilateral" or "triangle".
        stiffness: MPa, modulus of the lower block; the upper one has 5 MPa.
    """

    upper: int
    lower: int
    slave: str = "elastomer"
    cell: str = "quadrilateral"
    stiffness: float = 70e3

    def text(self) -> str:
        """The case file; elements are about square."""
        return CASE.format(
            cell=self.cell,
            upper=self.upper,
            upper_rows=max(self.upper // 2, 2),
            lower=self.lower,
            lower_rows=max(self.lower // 2, 2),
            stiffness=self.stiffness,
            slave=self.slave,
            master={"elastomer": "aluminium", "aluminium": "elastomer"}[self.slave],
            pressure=PRESSURE,
        )


def errors(patch: Patch, scratch: Path, *options: str) -> PatchErrors:
    """Solve a patch test, ``options`` being KEY=VALUE changes of the case, and compare."""
    path = scratch / "patch.toml"
    path.write_text(patch.text(), encoding="utf-8")
    return stress_errors(solve(path, options)[1], PRESSURE)


DEGREES = (1, 3, 5, 7, 9, 11, 15)
# Facets of the slave side: a prime number, so that the nodes of the two sides line up nowhere.
SLAVE = 31
# Facets of the master side: where the slave is at least as fine, and where it is coarser.
FINER = (8, 10, 12, 14, 16, 18, 20, 22, 23, 24, 25, 26, 27, 28, 29, 30)
COARSER = (32, 33, 35, 37, 40, 43, 46)
MUCH_COARSER = (53, 64, 77, 93)
RATIOS = {
    "slave finer, 1.03 to 3.9 times": FINER,
    "slave coarser, up to 1.5 times": COARSER,
    "slave coarser, 1.7 to 3 times": MUCH_COARSER,
}
PAIRS = {
    "elastomer on aluminium, elastomer slave": {},
    "elastomer on elastomer": {"stiffness": 5.0},
    "elastomer on aluminium, aluminium slave": {"slave": "aluminium"},
}
Worst = dict[tuple[str, str, str, int], list[PatchErrors]]


def survey(cells: Sequence[str], scratch: Path) -> Worst:
    """Errors of every mismatch, by (cell, pair, ratio, degree)."""
    found: Worst = {}
    for cell in cells:
        for pair, given in PAIRS.items():
            for ratio, counts in RATIOS.items():
                for degree in DEGREES:
                    option = f"contact.0.quadrature_degree={degree}"
                    found[cell, pair, ratio, degree] = [
                        _tried(_patch(count, cell, **given), scratch, option) for count in counts
                    ]
    return found


def _tried(patch: Patch, scratch: Path, option: str) -> PatchErrors:
    """The errors of a patch test; no numbers, and a line that says so, where it has no solution."""
    try:
        return errors(patch, scratch, option)
    except SolutionError:
        print(f"no solution: {patch} {option}", flush=True)
        return PatchErrors(np.nan, np.nan, np.nan)


def _patch(master: int, cell: str, stiffness: float = 70e3, slave: str = "elastomer") -> Patch:
    upper, lower = (SLAVE, master) if slave == "elastomer" else (master, SLAVE)
    return Patch(upper, lower, slave, cell, stiffness)


def table(found: Worst, cell: str) -> Iterator[str]:
    """Largest errors over all ratios of a group, in percent, near / far / at the points."""
    points = " | ".join(str((degree + 1) // 2) for degree in DEGREES)
    yield f"| points per slave facet | {points} |"
    yield "|---" * (len(DEGREES) + 1) + "|"
    for pair in PAIRS:
        for ratio in RATIOS:
            row = [_worst(found[cell, pair, ratio, degree]) for degree in DEGREES]
            yield f"| {pair}; {ratio} | " + " | ".join(row) + " |"


def _worst(some: Sequence[PatchErrors]) -> str:
    near, far, pressure = (
        100.0 * np.nanmax([getattr(e, name) for e in some]) for name in ("near", "far", "pressure")
    )
    return f"{near:.2g} / {far:.2g} / {pressure:.2g}"


def draw(found: Worst, cell: str, path: Path) -> None:
    """Largest stress error near the interface against the number of points."""
    points = [(degree + 1) // 2 for degree in DEGREES]
    with rc_context(STYLE):
        figure = Figure(figsize=(11.0, 3.8), layout="constrained")
        panels = figure.subplots(1, len(PAIRS), sharey=True)
        for axes, pair in zip(panels, PAIRS, strict=True):
            for ratio, marker in zip(RATIOS, "os^", strict=True):
                groups = [found[cell, pair, ratio, degree] for degree in DEGREES]
                worst = [100.0 * np.nanmax([e.near for e in group]) for group in groups]
                axes.semilogy(points, worst, marker=marker, label=ratio)
            axes.axhline(1.0, color="0.4", linestyle="--", linewidth=1.0)
            axes.set_title(pair, fontsize=9)
            axes.set_xlabel("points per slave facet")
        panels[0].set_ylabel("largest stress error (% of the pressure)")
        panels[0].legend(fontsize=8)
        save(figure, path)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--figure", type=Path, help="file (png) of the figure")
    chosen = parser.parse_args()
    cells = ("quadrilateral", "triangle")
    with tempfile.TemporaryDirectory() as scratch:
        found = survey(cells, Path(scratch))
    for cell in cells:
        print(f"\n{cell}:\n\n" + "\n".join(table(found, cell)))
    if chosen.figure:
        draw(found, "quadrilateral", chosen.figure)


if __name__ == "__main__":
    main()
