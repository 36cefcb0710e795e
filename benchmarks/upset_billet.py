"""An upset billet with friction on a rigid die, against CalculiX.

From the repository: ``python3 -m benchmarks.upset_billet``; it needs ``ccx`` on the path (Debian's
``calculix-ccx``). ``--deck FILE`` writes CalculiX' input and stops; ``--calculix FILE`` reads its
``.dat`` from a run made elsewhere.

A cylinder of aluminium, 20 mm wide and 15 mm high, is upset by 40 % between flat rigid dies with
Coulomb friction. Half of it is modelled, as a body of revolution. Both codes have the same elastic
constants, the same linear hardening and the same stroke; CalculiX has quadratic elements of reduced
integration, a penalty of its own and its own finite plasticity.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

RADIUS, HEIGHT, STROKE = 10.0, 7.5, 3.0  # mm, of the half
MODULUS, RATIO = 70e3, 0.33  # MPa
YIELD, HARDENING = 100.0, 200.0  # MPa
FRICTION = 0.1
WEDGE = 2.0  # degrees of a body of revolution that CalculiX' forces are for
LEVELS = (0.2, 0.4, 0.6, 0.8, 1.0)  # shares of the stroke that forces are compared at


@dataclass(frozen=True, slots=True)
class Grid:
    """A rectangle of eight-node elements.

    Attributes:
        origin, size: mm, of the rectangle; counts: of elements each way.
        first: number of its first node.
    """

    origin: tuple[float, float]
    size: tuple[float, float]
    counts: tuple[int, int]
    first: int

    def nodes(self) -> dict[tuple[int, int], int]:
        """Numbers of the nodes by place on the grid of half elements; middles have none."""
        across, up = self.counts
        places = [
            (i, j) for j in range(2 * up + 1) for i in range(2 * across + 1) if not i % 2 * (j % 2)
        ]
        return {place: self.first + n for n, place in enumerate(places)}

    def node_lines(self) -> Iterator[str]:
        """The nodes as CalculiX reads them."""
        for (i, j), number in self.nodes().items():
            x = self.origin[0] + self.size[0] * i / (2 * self.counts[0])
            y = self.origin[1] + self.size[1] * j / (2 * self.counts[1])
            yield f"{number},{x:.9g},{y:.9g},0."

    def elements(self) -> list[tuple[int, ...]]:
        """Nodes of the elements, row by row from below."""
        at, corners = self.nodes(), ((0, 0), (2, 0), (2, 2), (0, 2))
        order = (*corners, (1, 0), (2, 1), (1, 2), (0, 1))
        across, up = self.counts
        return [
            tuple(at[2 * i + a, 2 * j + b] for a, b in order)
            for j in range(up)
            for i in range(across)
        ]


def deck(across: int = 16, up: int = 12, penalty: float = 1e6) -> str:
    """CalculiX' input.

    ``across``, ``up``: elements of the billet; ``penalty``: MPa/mm; a tenth of it against slip.
    """
    billet = Grid((0.0, 0.0), (RADIUS, HEIGHT), (across, up), 1)
    die = Grid((0.0, HEIGHT), (1.6 * RADIUS, 1.0), (4, 1), len(billet.nodes()) + 1)
    cells, tool = billet.elements(), die.elements()
    last = len(cells)
    lines = ["*NODE, NSET=ALL", *billet.node_lines(), *die.node_lines()]
    for name, rows, start in (("BILLET", cells, 1), ("DIE", tool, last + 1)):
        lines.append(f"*ELEMENT, TYPE=CAX8R, ELSET={name}")
        lines += [f"{start + n}," + ",".join(map(str, row)) for n, row in enumerate(rows)]
    sets = {
        "BOTTOM": [n for (_, j), n in billet.nodes().items() if j == 0],
        "AXIS": [n for (i, _), n in billet.nodes().items() if i == 0],
        "TOOL": list(die.nodes().values()),
    }
    for name, nodes in sets.items():
        lines += [f"*NSET, NSET={name}", *(f"{node}," for node in nodes)]
    lines += ["*SURFACE, NAME=TOP, TYPE=ELEMENT"]
    lines += [f"{last - across + n + 1},S3" for n in range(across)]
    lines += ["*SURFACE, NAME=FACE, TYPE=ELEMENT", *(f"{last + n + 1},S1" for n in range(4))]
    return "\n".join([*lines, *_properties(penalty), *_step()]) + "\n"


def _properties(penalty: float) -> Iterator[str]:
    yield from ("*MATERIAL, NAME=ALUMINIUM", "*ELASTIC", f"{MODULUS},{RATIO}", "*PLASTIC")
    yield from (f"{YIELD},0.", f"{YIELD + 4.0 * HARDENING},4.")
    yield from ("*MATERIAL, NAME=STEEL", "*ELASTIC", "210000.,.3")
    yield "*SOLID SECTION, ELSET=BILLET, MATERIAL=ALUMINIUM"
    yield "*SOLID SECTION, ELSET=DIE, MATERIAL=STEEL"
    yield from ("*SURFACE INTERACTION, NAME=PAIR", "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR")
    yield f"{penalty}"
    yield from ("*FRICTION", f"{FRICTION},{0.1 * penalty}")
    yield from ("*CONTACT PAIR, INTERACTION=PAIR, TYPE=SURFACE TO SURFACE", "TOP,FACE")
    yield from ("*BOUNDARY", "BOTTOM,2", "AXIS,1", "TOOL,1")


def _step() -> Iterator[str]:
    yield from ("*STEP, NLGEOM, INC=2000", "*STATIC", "0.02,1.,1e-6,0.02")
    yield from ("*BOUNDARY", f"TOOL,2,2,{-STROKE}")
    yield from ("*NODE PRINT, NSET=TOOL, TOTALS=ONLY", "RF", "*END STEP")


def forces_in(text: str) -> dict[float, float]:
    """Force of the die, N, by share of the stroke, from CalculiX' ``.dat``."""
    number = r"([-\d.E+]+)"
    pattern = rf"total force.*?time\s+{number}\s+{number}\s+{number}"
    found = re.findall(pattern, text)
    return {round(float(t), 6): -float(fy) * 360.0 / WEDGE for t, _, fy in found}


def calculix(scratch: Path) -> dict[float, float]:
    """Run CalculiX; see :func:`forces_in`."""
    (scratch / "billet.inp").write_text(deck())
    subprocess.run(["ccx", "billet"], cwd=scratch, check=True, capture_output=True)
    return forces_in((scratch / "billet.dat").read_text())


def tribox(overrides: Sequence[str] = ()) -> dict[float, float]:
    """Run the same by tribox: force of the die, N, by share of the stroke."""
    from mpi4py import MPI

    from tribox.app.build.model import build_model
    from tribox.app.case.reading import load_case
    from tribox.app.simulation.run_state import Observer
    from tribox.app.simulation.simulation import Simulation

    path = Path(__file__).parents[1] / "cases" / "forming" / "upsetting.toml"
    simulation = Simulation(build_model(load_case(path, overrides), MPI.COMM_SELF))
    simulation.run(Observer())
    end = simulation.rows[-1].time
    return {round(row.time / end, 6): row.normal_force for row in simulation.rows}


def compare(mine: Mapping[float, float], other: Mapping[float, float]) -> list[str]:
    """A table of forces at the same shares of the stroke."""
    lines = ["| reduction | tribox, kN | CalculiX, kN | difference |", "|---|---|---|---|"]
    for level in LEVELS:
        a, b = (float(np.interp(level, list(f), list(f.values()))) for f in (mine, other))
        reduction = 100.0 * level * STROKE / HEIGHT
        lines.append(
            f"| {reduction:.0f} % | {a / 1e3:.2f} | {b / 1e3:.2f} | {100 * (a / b - 1):+.2f} % |"
        )
    return lines


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--deck", type=Path, help="write CalculiX' input here and stop")
    parser.add_argument("--calculix", type=Path, help=".dat of a run of that input")
    parser.add_argument("--set", action="append", default=[], help="key=value of the case")
    asked = parser.parse_args()
    if asked.deck is not None:
        asked.deck.write_text(deck())
        return
    if asked.calculix is not None:
        other = forces_in(asked.calculix.read_text())
    elif shutil.which("ccx"):
        with tempfile.TemporaryDirectory() as scratch:
            other = calculix(Path(scratch))
    else:
        sys.exit("upset_billet: no ccx on the path; install calculix-ccx, or see --deck")
    print("\n".join(compare(tribox(asked.set), other)))


if __name__ == "__main__":
    main()
