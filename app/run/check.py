"""What ``tribox check`` does: every problem of a case file is a line, without running it."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from tribox.app.case.reading import check_case, load_case
from tribox.app.case.toml_files import without_effect
from tribox.app.case.trust import require_trust
from tribox.app.errors import InputError, SaidOnce, tell


def run_check(case_file: Path, overrides: Sequence[str], law: bool, trust: bool) -> int:
    """Check a case file and print what is found.

    Returns the exit code.
    """
    if problems := check_case(case_file, overrides):
        return _refused(problems)
    from tribox.app.run.building import notes_on_sweep

    case = load_case(case_file, overrides)
    if case.sweep is not None and (reason := without_effect(overrides, case.sweep.key)):
        raise InputError(reason)
    if law:
        require_trust(case, case_file, trust)
    notes, problems = notes_on_sweep(case, runs_code=law)
    if problems:
        return _refused([f"tribox: {line}" for line in problems])
    once = SaidOnce()
    for note in notes:
        tell(once(f"note: {note}"))
    if law:
        from tribox.app.run.building import check_laws

        check_laws([part for _, part in case.sweep_cases()] or [case])
    runs = len(case.sweep.values) if case.sweep is not None else 1
    stages = len(case.stage)
    counted = f"{runs} run{'s' * (runs > 1)}, {stages} stage{'s' * (stages > 1)}"
    print(f"{case_file}: correct ({counted})")
    return 0


def _refused(problems: Sequence[str]) -> int:
    """Print what is wrong; the exit code for it."""
    for line in problems:
        tell(line, sys.stderr)
    return 2
