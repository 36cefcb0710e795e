"""Private and version-dependent parts of DOLFINx are used in one module only."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ALONE = ROOT / "geometry" / "compat.py"
# Names that DOLFINx renamed, or whose arguments or results it changed, between 0.9 and 0.11.
VERSIONED = {
    *("EntityMap", "cmap", "cmaps", "compute_integration_domains", "create_mesh", "create_submesh"),
    *("create_vector", "dofmaps", "entities_to_geometry", "entity_maps", "get_options", "gmshio"),
    *("interpolation_points", "pack_coefficients", "pack_constants", "sub_topology_to_topology"),
}
# Attributes that begin with an underscore and are not this project's own.
FOREIGN = {"_cpp_object", "_cpp", "_ufl_domain", "_geometry", "_topology", "_mesh", "_V"}


def violations(text: str) -> list[str]:
    """One line for each use of a private or version-dependent name in a source."""
    return [f"line {line}: {name}" for line, name in sorted(_found(ast.parse(text)))]


def _found(tree: ast.AST) -> Iterator[tuple[int, str]]:
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            yield from _imported(node)
        elif isinstance(node, ast.Import):
            yield from (
                (node.lineno, alias.name)
                for alias in node.names
                if alias.name.startswith("dolfinx.cpp")
            )
        elif isinstance(node, ast.Call):
            yield from ((node.lineno, k.arg) for k in node.keywords if k.arg == "entity_maps")
        elif isinstance(node, ast.Attribute):
            yield from _attribute(node)


def _imported(node: ast.ImportFrom) -> Iterator[tuple[int, str]]:
    module = node.module or ""
    if module.split(".")[0] != "dolfinx":
        return
    for alias in node.names:
        private = "cpp" in module.split(".") or alias.name == "cpp" or alias.name in VERSIONED
        if private or module.endswith("gmshio") or (module, alias.name) == ("dolfinx.io", "gmsh"):
            yield node.lineno, f"{module}.{alias.name}"


def _attribute(node: ast.Attribute) -> Iterator[tuple[int, str]]:
    own = isinstance(node.value, ast.Name) and node.value.id in ("self", "cls")
    if not own and (node.attr in VERSIONED or node.attr in FOREIGN):
        yield node.lineno, node.attr
    if node.attr == "cpp" and ast.unparse(node) == "dolfinx.cpp":
        yield node.lineno, "dolfinx.cpp"
    if node.attr == "dofmap" and ast.unparse(node.value).endswith("geometry"):
        yield node.lineno, ast.unparse(node)  # a list of them from 0.11 on


def sources() -> list[Path]:
    rooms = ("app", "forms", "geometry", "benchmarks")
    return sorted(p for room in rooms for p in (ROOT / room).rglob("*.py") if p != ALONE)


def test_only_one_module_uses_what_is_private_or_differs_between_versions():
    found = {p.relative_to(ROOT): violations(p.read_text(encoding="utf-8")) for p in sources()}
    assert {path: lines for path, lines in found.items() if lines} == {}


@pytest.mark.parametrize(
    "line",
    [
        "from dolfinx import cpp as _cpp", "import dolfinx.cpp.fem",
        "from dolfinx.cpp.mesh import to_string", "from dolfinx.io import gmshio",
        "from dolfinx.io import gmsh", "dolfinx.cpp.mesh.to_string(cell)", "form._cpp_object",
        "dolfinx.fem.form(a, entity_maps=maps)",
        "dolfinx.fem.compute_integration_domains(kind, topology, facets)",
        "mesh.geometry.dofmap[cells]", "element.interpolation_points()",
        "dolfinx.jit.get_options()",
    ],
)  # fmt: skip
def test_such_a_use_is_seen(line):
    assert violations(line)


def test_what_is_allowed_is_not():
    assert not violations("import dolfinx.fem.petsc\nspace.dofmap.list\nself._cpp\nimport gmsh")
