"""Results directories: what is in them, how it gets there without loss, and how to read it.

``read`` and ``Results`` are imported when they are asked for, and without the solver's libraries.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tribox.app.results.reading import Results, read

__all__ = ["Results", "read"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from tribox.app.results import reading

    return getattr(reading, name)
