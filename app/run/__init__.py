"""Runs cases and sweeps into results directories."""

from __future__ import annotations

TYPE_CHECKING = False  # without typing: see tribox.app.run.process
if TYPE_CHECKING:
    from typing import Any

    from tribox.app.run.run import run_case

__all__ = ["run_case"]


def __getattr__(name: str) -> Any:
    """Load :func:`run_case`, and DOLFINx with it, when it is asked for."""
    if name == "run_case":
        from tribox.app.run.run import run_case

        return run_case
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
