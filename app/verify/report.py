"""``tribox verify``: runs verification cases, prints one table, writes a report.

Each case is a function that computes something and holds it against a closed form (or another
code's result); the tests call the same functions.
"""

from __future__ import annotations

import contextlib
import difflib
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from tribox.app.errors import InputError, SolutionError
from tribox.app.results.claim import claimed
from tribox.app.results.directory import write_text
from tribox.app.verify.bulk import block_compression
from tribox.app.verify.contact import (
    cattaneo_mindlin,
    hertz_line,
    hertz_two_cylinders,
    mindlin_reversal,
)
from tribox.app.verify.curved import film_over_curve, film_over_sphere, pressed_curve
from tribox.app.verify.flowing import considere, thick_tube
from tribox.app.verify.flowing_bending import cook, pure_bending
from tribox.app.verify.result import Check, Verification
from tribox.app.verify.sliding import block_slide, film_sliding, friction_law, penalty
from tribox.app.verify.space import isotropy, patch_space
from tribox.app.verify.sphere import curved_sliding, hertz_point, sphere_twist
from tribox.app.verify.upset import upset

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
    "film-over-curve": film_over_curve,
    "pressed-curve": pressed_curve,
    "cattaneo-mindlin": cattaneo_mindlin,
    "mindlin-reversal": mindlin_reversal,
    "isotropy": isotropy,
    "patch-space": patch_space,
    "film-over-sphere": film_over_sphere,
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

    Args:
        names: of the cases; none: all.
        out: directory of the report.
        force: whether to replace a report that is there.

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
            near = difflib.get_close_matches(name, CASES, n=1)
            hint = f'did you mean "{near[0]}"?' if near else f"there are {', '.join(CASES)}"
            raise InputError(f'verify: no case "{name}"; {hint}')
    return list(dict.fromkeys(names)) or list(CASES)


def verify(name: str) -> Verification:
    """Run one verification case; one that cannot be computed is a result too.

    Args:
        name: a key of ``CASES``.
    """
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
    """Write ``verification.md`` and a figure of each case with curves.

    Args:
        results: what was found.
        directory: free of other results; made if missing.
    """
    # Drawing starts a library that takes a while.
    from tribox.app.verify.figures import draw

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
