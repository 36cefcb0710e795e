"""What ``tribox run`` and ``check`` do with their options."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from tribox.app.case.case import Case
from tribox.app.case.reading import check_case, load_case
from tribox.app.case.toml_files import without_effect
from tribox.app.case.trust import require_trust
from tribox.app.checkpoint.same_case import is_whole
from tribox.app.errors import InputError, SaidOnce, tell
from tribox.app.results.claim import check_not_in_use, is_done, sweep_labels
from tribox.app.results.directory import (
    check_free,
    checkpoint_numbers,
    default_directory,
    keep_inputs_apart,
)
from tribox.app.run.process import lasting_imports, nothing_begun, ranks_around
from tribox.app.run.ranks import RunOptions, run_on_ranks


def run_command(case_file: Path, options: RunOptions) -> int:
    """Run a case, or its sweep, and write results and figures; the exit code; TriboxError."""
    if options.force and options.goes_on:
        raise InputError("--force begins anew, --resume and --extend go on: give one of them")
    directory = options.out or default_directory(case_file)
    with nothing_begun():
        case = load_case(case_file, options.overrides)
        runs_code = require_trust(case, case_file, options.trust)
    changes = [word for item in options.overrides for word in ("--set", item)]
    changes += ["--trust"] * runs_code
    _keep_results_apart(directory, case, case_file, options)
    if case.sweep is not None and options.part is None:
        if reason := without_effect(options.overrides, case.sweep.key):
            raise InputError(reason)
        from tribox.app.run.sweep_runs import run_sweep

        run_sweep(case, case_file, directory, options, changes)
        return 0
    if options.part is not None:
        parts = case.sweep_cases()
        if options.part >= len(parts):
            raise InputError(
                f"--part {options.part}: the sweep has {len(parts)} values, counted from 0"
            )
        case = parts[options.part][1]
    if options.resume and not options.extend and is_done(directory):
        is_whole(directory, case)
        print(f"{directory}: the run is done; --extend goes on past its end")
        return 0
    if options.ranks > 1 and ranks_around() == 1:
        return _run_on_ranks(case_file, directory, options, changes)
    with lasting_imports():
        from tribox.app.run.run import run_case
    run_case(
        case,
        directory,
        force=options.force,
        inputs_of=options.inputs_of,
        resume=options.resume,
        extend=options.extend,
    )
    return 0


def _keep_results_apart(directory: Path, case: Case, case_file: Path, options: RunOptions) -> None:
    """Refuse results where they would be cleared with what the run is made from."""
    swept = case.sweep is not None
    begun = (directory / "case.toml").exists() if swept else checkpoint_numbers(directory)
    if options.goes_on and begun:
        return  # nothing is cleared
    with lasting_imports():
        from tribox.app.results.inputs import input_files
    keep_inputs_apart(directory, (case_file, *input_files(case)))


def _run_on_ranks(case_file: Path, directory: Path, options: RunOptions, changes: list[str]) -> int:
    """Have several ranks run a case; their exit code."""
    check_not_in_use(directory)
    if not options.goes_on:
        check_free(directory, options.force, sweep_labels(directory))
    words = ["run", str(case_file), "--out", str(directory), *changes, *options.for_ranks()]
    return run_on_ranks(options.ranks, words)


# -- What ``tribox check`` does --------------------------------------------------------------------


def run_check(case_file: Path, overrides: Sequence[str], law: bool, trust: bool) -> int:
    """Check a case file and print what is found; the exit code."""
    if problems := check_case(case_file, overrides):
        return _refused(problems)
    from tribox.app.run.building import notes_on_sweep

    case = load_case(case_file, overrides)
    if case.sweep is not None and (reason := without_effect(overrides, case.sweep.key)):
        raise InputError(reason)
    require_trust(case, case_file, trust, python=law)
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
