"""The layout: every import goes down to a lower room, and there is no circle.

The rooms stand in docs/layout.md. The imports are read from the sources, those inside functions
and under ``TYPE_CHECKING`` too: a circle that only waits is one all the same.
"""

import ast
import graphlib
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
TOP = ("app", "forms", "geometry")

# Lowest first. Rooms on one line do not know each other.
LAYERS: tuple[tuple[str, ...], ...] = (
    ("tribox.geometry.compat",),
    ("tribox.geometry.native",),
    ("tribox.geometry.generators", "tribox.geometry.surfaces"),
    ("tribox.geometry.meshes",),
    ("tribox.forms", "tribox.forms.parameters"),
    ("tribox.forms.native", "tribox.forms.friction"),
    (
        "tribox.forms.closed_forms",
        "tribox.forms.bodies",
        "tribox.forms.film",
        "tribox.forms.friction_map",
        "tribox.forms.friction_parameters",
    ),
    ("tribox.forms.contact",),
    ("tribox.app", "tribox.app.errors"),
    ("tribox.app.case", "tribox.app.equilibrium"),
    ("tribox.app.implicit", "tribox.app.explicit"),
    ("tribox.app.build",),
    ("tribox.app.simulation",),
    ("tribox.app.results",),
    ("tribox.app.checkpoint",),
    ("tribox.app.precompile",),
    ("tribox.app.figures",),
    ("tribox.app.friction_map",),
    ("tribox.app.fit", "tribox.app.init", "tribox.app.report", "tribox.app.run"),
    ("tribox.app.fit_model", "tribox.app.fit_run"),
    ("tribox.app.cli",),
)
LEVEL = {room: level for level, rooms in enumerate(LAYERS) for room in rooms}
# What a room may import from outside the project; every other room what it likes.
OUTSIDE = {"tribox.forms.friction": {"numpy"}, "tribox.app.results.directory": set()}
# What a room may import from the project beside its own modules, where that is not all below it.
INSIDE = {
    "tribox.forms.friction": {"tribox.forms.parameters"},
    "tribox.app.equilibrium": {"tribox.geometry", "tribox.forms"},
    "tribox.app.implicit": {"tribox.geometry", "tribox.forms", "tribox.app.equilibrium"},
    "tribox.app.explicit": {"tribox.geometry", "tribox.forms", "tribox.app.equilibrium"},
    "tribox.app.results.directory": {"tribox.app.errors"},
}


def module_of(path: Path, root: Path = ROOT) -> str:
    parts = ("tribox", *path.relative_to(root).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def sources(root: Path = ROOT) -> dict[str, Path]:
    return {module_of(p, root): p for top in TOP for p in sorted((root / top).rglob("*.py"))}


def imported(module: str, path: Path, known: set[str]) -> Iterator[str]:
    """Modules that a module imports, whole names; of packages that give names, the package."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}: relative import"
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                yield inner if inner in known else str(node.module)


@cache
def imports(root: Path = ROOT) -> dict[str, set[str]]:
    found = sources(root)
    return {module: set(imported(module, path, set(found))) for module, path in found.items()}


def room(module: str) -> str:
    return ".".join(module.split(".")[:3])


def within(module: str, places: set[str]) -> bool:
    return any(module == place or module.startswith(place + ".") for place in places)


def violations(graph: dict[str, set[str]]) -> list[str]:
    """One line for each import that the layout does not allow."""
    out = []
    for module, targets in graph.items():
        for target in sorted(targets):
            if target == "tribox":  # the version, and where the package is
                continue
            if target.split(".")[0] == "tribox":
                out += _inside(module, target)
            else:
                out += _outside(module, target.split(".")[0])
    return out


def _inside(module: str, target: str) -> Iterator[str]:
    here, there = room(module), room(target)
    if here not in LEVEL or there not in LEVEL:
        yield f"{module} -> {target}: a room that is not in LAYERS"
    elif here != there and LEVEL[there] >= LEVEL[here]:
        yield f"{module} -> {target}: not a lower room"
    for name in (here, module):
        if name in INSIDE and not within(target, INSIDE[name] | {name}):
            yield f"{module} -> {target}: {name} may not"


def _outside(module: str, package: str) -> Iterator[str]:
    for name in (room(module), module):
        allowed = OUTSIDE.get(name)
        if allowed is not None and package not in {*allowed, *sys.stdlib_module_names}:
            yield f"{module} -> {package}: {name} may not"


def test_every_import_goes_down():
    assert violations(imports()) == []


def test_there_is_no_circle():
    graph = imports()
    graphlib.TopologicalSorter({m: graph[m] - {m} for m in graph}).prepare()
