"""``tribox verify``: runs verification cases, prints one table, writes a report.

Each case is a function that computes something and holds it against a closed form (or another
code's result); the tests call the same functions.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import dolfinx
import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmarks.verify.contact import (
    block_slide,
    cattaneo_mindlin,
    film_sliding,
    friction_law,
    hertz_line,
    hertz_two_cylinders,
    mindlin_reversal,
    penalty,
)
from benchmarks.verify.flowing import considere, thick_tube, upset
from benchmarks.verify.flowing_bending import cook, pure_bending
from benchmarks.verify.result import Check, Floats, Line, Panel, Verification, compare, solve
from benchmarks.verify.space import curved_sliding, hertz_point, isotropy, patch_space, sphere_twist
from tribox.app.case.generators import BlocksGeometry
from tribox.app.case.table import nearest
from tribox.app.errors import InputError, SolutionError
from tribox.app.figures.style import STYLE, colour_of, marker_of, save
from tribox.app.results.claim import claimed
from tribox.app.results.directory import write_text
from tribox.app.results.fields import StressField
from tribox.app.simulation.simulation import Simulation

# -- Verification of the solids: a nearly incompressible block in plane-strain compression ---------

BODY = "elastomer"


def block_compression(overrides: Sequence[str] = ()) -> Verification:
    """Nominal stress against the incompressible closed form, and pressures of the elements."""
    case, simulation = solve("block-compression", overrides)
    geometry, modulus = case.geometry, case.bodies[BODY].shear_modulus
    assert isinstance(geometry, BlocksGeometry)
    block = geometry.upper
    (down,) = (b.displacement.y for b in case.boundary if b.surface == "top" and b.displacement)
    assert down is not None and not isinstance(down, str)
    stretch = np.array([1.0 + down(row.time) / block.height for row in simulation.rows])
    area = block.width * geometry.slab
    nominal = np.array([-row.normal_force for row in simulation.rows]) / area
    exact = np.array([plane_strain_stress(s, modulus) for s in stretch])
    pressure = cell_pressures(simulation)
    jump = float(np.abs(np.diff(pressure[neighbours(simulation)], axis=1)).max())
    uniform = plane_strain_pressure(float(stretch[-1]), modulus)
    checks = (
        *(
            compare(f"nominal stress at λ = {s:.2f}", n, e, 5e-3, "MPa")
            for s, n, e in zip(stretch, nominal, exact, strict=True)
        ),
        compare("mean pressure of the elements", pressure.mean(), uniform, 5e-3, "MPa"),
        Check("neighbouring elements' pressures, max difference / mean", jump / uniform, 0.05),
    )
    fine = np.linspace(stretch.min(), 1.0, 101)
    curve = np.array([plane_strain_stress(s, modulus) for s in fine])
    lines = (
        Line("G (λ − λ⁻³)", fine, curve * 1e-6, exact=True),
        Line("computed", stretch, nominal * 1e-6),
    )
    K, formulation = case.bodies[BODY].bulk_modulus, simulation.model.case.bodies[BODY].formulation
    return Verification(
        "block-compression",
        "nearly incompressible block, plane-strain compression",
        f"{len(pressure)} elements ({formulation}) with K/G = {K / modulus:.4g}, "
        "pressed by a platen from above on a stiff block, both without friction; the nodes of the "
        "two blocks do not match. The closed form is that of an incompressible body.",
        checks,
        (Panel("stretch λ (-)", "nominal stress (MPa)", lines),),
    )


def plane_strain_stress(stretch: float, shear_modulus: float) -> float:
    r"""Nominal stress of a neo-Hookean block, Pa: :math:`G (\lambda - \lambda^{-3})`.

    Incompressible, :math:`W = G/2 (I_1 - 3)`, in plane strain with lateral faces free of stress;
    positive in tension.

    Args:
        stretch: λ > 0, deformed over undeformed height.
        shear_modulus: Pa, G.
    """
    return shear_modulus * (stretch - stretch**-3)


def plane_strain_pressure(stretch: float, shear_modulus: float) -> float:
    r"""Mean pressure -tr σ/3 of the same block, Pa.

    The Cauchy stresses are :math:`G(\lambda^2 - \lambda^{-2})` along the load, 0 across it in the
    plane, and :math:`G(1 - \lambda^{-2})` normal to the plane.
    """
    across = stretch**-2
    return -shear_modulus * (stretch**2 - across + 1.0 - across) / 3.0


def cell_pressures(simulation: Simulation) -> Floats:
    """Pressure −tr σ/3 of the elastomer's elements in their order of number, (c,), Pa."""
    model = simulation.model
    field = StressField(model.problem.u, model.problem.solids)
    return field.evaluate().pressure[np.sort(model.named.cells(BODY))]


def neighbours(simulation: Simulation) -> NDArray[np.int64]:
    """Pairs of elements of the elastomer that share a facet, (n, 2), as rows of its pressures."""
    named = simulation.model.named
    topology = named.mesh.topology
    topology.create_connectivity(topology.dim - 1, topology.dim)
    table: dolfinx.graph.AdjacencyList = topology.connectivity(topology.dim - 1, topology.dim)
    inner = np.flatnonzero(np.diff(table.offsets) == 2)
    pairs = np.stack([table.array[table.offsets[inner] + side] for side in (0, 1)], axis=1)
    cells = np.sort(named.cells(BODY))
    # Bodies share no facet: one cell of the body suffices to tell.
    return np.searchsorted(cells, pairs[np.isin(pairs[:, 0], cells)])


CASES: dict[str, Callable[[], Verification]] = {
    "friction-law": friction_law,
    "film-sliding": film_sliding,
    "block-slide": block_slide,
    "penalty": penalty,
    "block-compression": block_compression,
    "hertz-line": hertz_line,
    "hertz-two-cylinders": hertz_two_cylinders,
    "considere": considere,
    "thick-tube": thick_tube,
    "upset": upset,
    "springback": pure_bending,
    "cook-membrane": cook,
    "cattaneo-mindlin": cattaneo_mindlin,
    "mindlin-reversal": mindlin_reversal,
    "isotropy": isotropy,
    "patch-space": patch_space,
    "hertz-point": hertz_point,
    "sphere-twist": sphere_twist,
    "curved-sliding": curved_sliding,
}
"""The verification cases by name, quick ones first."""

WIDTHS = (20, 53, 13, 13, 9, 9, 4)
HEAD = ("case", "quantity", "computed", "closed form", "error", "bar", "")
REPORT = "verification.md"


def run_verify(names: Sequence[str], out: Path | None, force: bool) -> None:
    """Run verification cases and print their table; write a report where one is asked for.

    ``names``: none: all; ``out``: directory of the report.

    Raises:
        InputError: there is no such case, or the directory is not usable; nothing was run.
        SolutionError: a check failed, or a case could not be computed.
    """
    chosen = chosen_names(names)
    with contextlib.nullcontext() if out is None else claimed(out, force) as claim:
        print(_columns(HEAD), flush=True)
        results = []
        for result in map(verify, chosen):
            results.append(result)
            for line in table(result):
                print(line, flush=True)
        if claim is not None:
            claim.clear()
            write_report(results, claim.directory)
            print(f"report in {claim.directory / REPORT}")
    checks = [check for result in results for check in result.checks]
    failed = sum(not check.passed for check in checks)
    broken = [result.name for result in results if result.failure]
    if failed or broken:
        lost = f"; not computed: {', '.join(broken)}" if broken else ""
        raise SolutionError(f"{failed} of {len(checks)} checks failed{lost}")
    print(f"all {len(checks)} checks of {len(results)} cases passed")


def chosen_names(names: Sequence[str]) -> list[str]:
    """The names asked for, each once; all of them where none is given.

    Raises:
        InputError: a name is not that of a case.
    """
    for name in names:
        if name not in CASES:
            raise InputError(f'verify: no case "{name}"; {nearest(name, list(CASES))}')
    return list(dict.fromkeys(names)) or list(CASES)


def verify(name: str) -> Verification:
    """Run one verification case; one that cannot be computed is a result too."""
    try:
        return CASES[name]()
    except (SolutionError, ValueError) as error:
        return Verification(name, "", "", (), failure=str(error))


def table(result: Verification) -> Iterator[str]:
    """The rows of one case, as columns of text."""
    for check in result.checks:
        cells = _cells(check)
        yield _columns((result.name, *cells, "pass" if check.passed else "FAIL"))
    if result.failure:
        yield f"{result.name}: FAIL: not computed: {result.failure}"


def _cells(check: Check) -> tuple[str, str, str, str, str]:
    """Quantity, computed, closed form, error and bar as text."""
    unit = f" ({check.unit})" if check.unit else ""
    return (
        check.quantity + unit,
        "" if check.computed is None else f"{check.computed:.6g}",
        "" if check.exact is None else f"{check.exact:.6g}",
        percent(check.error),
        percent(check.bar),
    )


def percent(value: float) -> str:
    """A share as text, in % or, where that would be all zeros, as it is."""
    if not math.isfinite(value):
        return str(value)
    return f"{100.0 * value:.3g} %" if value == 0.0 or value >= 1e-5 else f"{value:.1e}"


def _columns(cells: Sequence[str]) -> str:
    left = [cells[i].ljust(WIDTHS[i]) for i in (0, 1)]
    right = [cells[i].rjust(WIDTHS[i]) for i in range(2, len(cells))]
    return " ".join((*left, *right)).rstrip()


def write_report(results: Sequence[Verification], directory: Path) -> None:
    """Write ``verification.md`` and a figure of each case with curves."""
    figures = directory / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    lines = ["# Verification report", ""]
    for result in results:
        lines += report_lines(result)
        if result.panels:
            file = f"verify_{result.name.replace('-', '_')}.png"
            draw(result, figures / file)
            lines += [f"![{result.title}](figures/{file})", ""]
    write_text(directory / REPORT, "\n".join(lines))


def report_lines(result: Verification) -> Iterator[str]:
    """One case as Markdown: set-up and table."""
    title = f"{result.title[:1].upper()}{result.title[1:]}. " if result.title else ""
    yield from (f"## {result.name}", "", f"{title}{result.setup}", "")
    if result.failure:
        yield from (f"**Not computed:** {result.failure}", "")
        return
    yield "| quantity | computed | closed form | error | bar | |"
    yield "|---|---|---|---|---|---|"
    for check in result.checks:
        yield f"| {' | '.join(_cells(check))} | {'pass' if check.passed else '**FAIL**'} |"
    yield ""


# -- Figures of the verification report: computed points over closed forms -------------------------


def draw(result: Verification, path: Path) -> None:
    """Write the figure of one verification case as PNG."""
    with rc_context(STYLE):
        figure = Figure(figsize=(6.5 * len(result.panels), 4.0))
        axes = figure.subplots(1, len(result.panels), squeeze=False)
        for panel, ax in zip(result.panels, axes[0], strict=True):
            _draw_panel(panel, ax)
        figure.suptitle(result.title, fontsize=10)
        save(figure, path)


def _draw_panel(panel: Panel, axes: Axes) -> None:
    """Closed forms as lines, computed values as points, in order of their colours."""
    seen = {True: 0, False: 0}
    for line in panel.lines:
        number = seen[line.exact]
        seen[line.exact] += 1
        points = {"marker": marker_of(number), "ms": 3, "mfc": "none", "mew": 0.8, "ls": "none"}
        look = {"lw": 1.2} if line.exact else points
        axes.plot(line.x, line.y, color=colour_of(number), label=line.label, **look)
    if panel.log:
        axes.set_xscale("log")
        axes.set_yscale("log")
    axes.set_xlabel(panel.x_label)
    axes.set_ylabel(panel.y_label)
    axes.legend(fontsize=7)
