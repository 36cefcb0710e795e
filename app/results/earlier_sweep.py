"""The sub-directories of a sweep whose results a directory holds."""

from __future__ import annotations

from pathlib import Path

from tribox.app.errors import InputError


def sweep_labels(directory: Path) -> tuple[str, ...]:
    """Their names, from the case file beside them; none without a sweep.

    Args:
        directory: results directory, which need not exist.
    """
    if not (directory / "case.toml").is_file():
        return ()
    # Not before: most directories are new, and the tables of a case take a while to import.
    from tribox.app.case.reading import load_past_case

    try:
        case = load_past_case(directory / "case.toml")
    except InputError:
        return ()
    return case.sweep.labels if case.sweep is not None else ()
