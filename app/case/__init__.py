"""The case file: its tables, read, checked and completed with defaults, in SI.

What is named here is imported when it is asked for: a command that needs the tables of the friction
law alone does not wait for all the others.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tribox.app.case.case import Case, resolved_toml
    from tribox.app.case.reading import check_case, load_case
    from tribox.app.case.schema import json_schema

__all__ = ["Case", "check_case", "json_schema", "load_case", "resolved_toml"]

_MODULES = {
    "Case": "case",
    "check_case": "reading",
    "json_schema": "schema",
    "load_case": "reading",
    "resolved_toml": "case",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
