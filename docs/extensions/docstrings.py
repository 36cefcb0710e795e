"""Docstrings in Google's style as Sphinx reads them, and references to what is not on a page.

A colon in the text after "Returns:" or in the docstring of a property is a colon, not the end of a
type as Sphinx's own ``napoleon`` has it: types stand in the annotations.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from importlib import import_module
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

_SECTION = re.compile(r"(Args|Attributes|Raises|Returns):$")
_ENTRY = re.compile(r"    (\*{0,2}\w[\w., ]*?): (.*)")
_BAR = re.compile(r"\|(?=(?:[^`]*``[^`]*``)*[^`]*$)")  # of formulae, but not in code
_FIELDS = {"Args": "param", "Attributes": "ivar", "Raises": "raises"}


def setup(app: Sphinx) -> dict[str, bool]:
    """Read docstrings, and tell a reference to nothing from one to what no page shows."""
    app.connect("autodoc-process-docstring", _convert)
    app.connect("missing-reference", _without_page)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _convert(
    app: Sphinx, what: str, name: str, thing: object, options: object, lines: list[str]
) -> None:
    """Turn the sections of a docstring into lists of fields."""
    lines[:] = list(_converted(list(lines)))


def _converted(lines: list[str]) -> Iterator[str]:
    section = ""
    for text in lines:
        line = _BAR.sub(r"\|", text)
        if found := _SECTION.match(line):
            section = found[1]
            yield ""
            if section == "Returns":
                yield ":returns:"
        elif line and not line.startswith(" "):
            section = ""
            yield line
        elif section in _FIELDS and (entry := _ENTRY.match(line)):
            for each in entry[1].split(", "):
                yield f":{_FIELDS[section]} {each}: {entry[2]}"
        else:
            yield line


def _without_page(
    app: Sphinx, env: BuildEnvironment, node: nodes.Element, content: nodes.Node
) -> nodes.Node | None:
    """Leave the name of something that exists as it is; what does not exist is a warning."""
    if node.get("refdomain") != "py":
        return None
    name, module, inside = node["reftarget"], node.get("py:module"), node.get("py:class")
    places = (name, f"{module}.{name}", f"{module}.{inside}.{name}")
    return content if any(map(_exists, places)) else None


def _exists(name: str) -> bool:
    """Whether a module, or something in one, has this name."""
    module, attributes = name, list[str]()
    while module:
        try:
            found: Any = import_module(module)
        except ImportError:
            module, _, last = module.rpartition(".")
            attributes.insert(0, last)
            continue
        for attribute in attributes:
            if not hasattr(found, attribute):
                return False
            found = getattr(found, attribute)
        return True
    return False
