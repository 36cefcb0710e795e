"""The tables on contact in space of docs/verification.md, from runs made here.

From the repository: ``python3 -m benchmarks.space patch`` (patch test by points per facet),
``... hertz`` (point contact as the mesh is refined) and ``... sliding`` (jumps of the forces while
facets of a curved master run through the contact).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np

from benchmarks.verify.report import percent
from benchmarks.verify.space import (
    MISMATCHES,
    SECTION,
    SLAVE_FACETS,
    SMOOTH,
    PatchErrors,
    jumps,
    patch_errors,
    press_sphere,
    roll,
)
from tribox.app.errors import SolutionError

DEGREES = (1, 3, 5, 7, 9, 11)
COARSER = 7  # slave facets along x and z under which the master has up to 1.5 times as many
FINER_MASTERS = ((8, 8), (9, 9), (10, 10), (10, 7))
SWAP = ("contact.0.slave=aluminium_contact", "contact.0.master=elastomer_contact")
LIKE = "bodies.aluminium.E=5 MPa"


def _worst(cell: str, finer: bool, swap: bool, like: bool, degree: int) -> str:
    """Largest errors over all mismatches of a group, in %; of those that have a solution."""
    count, others = (SLAVE_FACETS, MISMATCHES) if finer else (COARSER, FINER_MASTERS)
    options = [f"contact.0.quadrature_degree={degree}", f"geometry.cell={cell}"]
    options += [*SWAP] if swap else []
    options += [LIKE] if like else []
    found: list[PatchErrors] = []
    for along, across in others:
        slave, master = (count, 4, count), (along, 3, across)
        pair = (master, slave) if swap else (slave, master)
        try:
            found.append(patch_errors(*pair, options))
        except SolutionError:
            print(f"no solution: {pair} {' '.join(options)}", flush=True)
    values = [max(getattr(e, k) for e in found) for k in ("near", "far", "pressure")]
    return " / ".join(f"{100.0 * v:.2g}" for v in values)


def patch_tables() -> Iterator[str]:
    """Errors by the degree of the quadrature, for hexahedra and tetrahedra."""
    pairs = (
        ("elastomer on aluminium, elastomer slave", False, False),
        ("elastomer on elastomer", False, True),
        ("elastomer on aluminium, aluminium slave", True, False),
    )
    for cell in ("hexahedron", "tetrahedron"):
        yield f"{cell}: | " + " | ".join(map(str, DEGREES)) + " |"
        for name, swap, like in pairs:
            for finer in (True, False):
                cells = [_worst(cell, finer, swap, like, degree) for degree in DEGREES]
                which = "slave finer" if finer else "slave coarser, up to 1.5 times"
                yield f"| {name}; {which} | " + " | ".join(cells) + " |"


def hertz_table() -> Iterator[str]:
    """Errors of radius and peak, and the load, by mesh."""
    yield "| part | contact_size (µm) | growth | nodes | elements over a | a | p0 | P (mN) |"
    yield "|---|---|---|---|---|---|---|---|"
    meshes = [("section", size, growth) for growth in (1.5, 1.2) for size in (32.5, 20.0, 10.0)]
    meshes += [("quarter", size, 1.5) for size in (65.0, 41.0, 32.5)]
    for part, size, growth in meshes:
        options = [f"geometry.contact_size={size} um", f"geometry.growth={growth}"]
        options.append(f"geometry.contact_width={max(650.0, 18.0 * size)} um")
        found = press_sphere([*options, *(SECTION if part == "section" else ["stage.0.steps=1"])])
        exact, (radius, peak) = found.exact, found.fitted
        cells = (
            f"{exact.contact_radius / found.size:.0f}",
            percent(abs(radius / exact.contact_radius - 1.0)),
            percent(abs(peak / exact.peak - 1.0)),
            f"{1e3 * exact.load:.4g}",
        )
        yield f"| {part} | {size:g} | {growth:g} | {found.nodes} | {' | '.join(cells)} |"


def sliding_table() -> Iterator[str]:
    """Largest jump and range of the forces, by mesh, smooth and faceted."""
    yield "| facets (µm) | master | jump N | range N | jump drag | range drag |"
    yield "|---|---|---|---|---|---|"
    for size in (115, 80):
        for name, options in (("faceted", []), ("smooth", [SMOOTH])):
            forces = roll([f"geometry.contact_size={size} um", *options])
            cells = [percent(v) for f in forces for v in (jumps(f), np.ptp(f) / f.mean())]
            yield f"| {size} | {name} | {' | '.join(cells)} |"


def main() -> None:
    """Print the tables asked for."""
    tables = {"patch": patch_tables, "hertz": hertz_table, "sliding": sliding_table}
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=tables)
    for line in tables[parser.parse_args().what]():
        print(line, flush=True)


if __name__ == "__main__":
    main()
