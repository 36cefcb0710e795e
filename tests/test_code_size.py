"""No function is longer than 50 lines, no class has more than 20 attributes, or a reason is given.

Lines count from ``def`` to the last one, docstring included. Attributes are those that methods of
the class assign to ``self`` and the annotated ones of its body.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
TOP = ("app", "forms", "geometry")
LINES = 50
ATTRIBUTES = 20

# "module:Class" or "module:Class.function" and why it is allowed to be longer. Tables of a
# case file are left out, see `_is_table`.
REASONS: dict[str, str] = {
    "tribox.app.simulation.contact_resultants:ContactResultants": (
        "numbers of a pair, each a column"
    ),
    "tribox.app.simulation.history:Row": "the columns of history.csv, one attribute each",
}


def sources(root: Path = ROOT) -> dict[str, str]:
    """Text of each module by its name."""
    files = [p for top in TOP for p in sorted((root / top).rglob("*.py"))]
    names = [".".join(("tribox", *p.relative_to(root).with_suffix("").parts)) for p in files]
    return {n: p.read_text(encoding="utf-8") for n, p in zip(names, files, strict=True)}


def too_large(text: str, module: str = "module") -> dict[str, str]:
    """What is beyond the limits, with its size, by "module:Class.function"."""
    return {f"{module}:{name}": size for name, size in _large(ast.parse(text), "")}


def _large(node: ast.AST, inside: str) -> Iterator[tuple[str, str]]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.ClassDef):
            count = len(attributes(child))
            if count > ATTRIBUTES and not _is_table(child):
                yield f"{inside}{child.name}", f"{count} attributes"
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef):
            assert child.end_lineno is not None
            lines = child.end_lineno - child.lineno + 1
            if lines > LINES:
                yield f"{inside}{child.name}", f"{lines} lines"
        named = isinstance(child, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        yield from _large(child, f"{inside}{child.name}." if named else inside)


def attributes(node: ast.ClassDef) -> set[str]:
    """Names of the attributes of a class's objects, inherited ones not counted."""
    found = {
        item.target.id
        for item in node.body
        if isinstance(item, ast.AnnAssign)
        and isinstance(item.target, ast.Name)
        and "ClassVar" not in ast.unparse(item.annotation)
    }
    for item in ast.walk(node):
        if isinstance(item, ast.Attribute) and isinstance(item.ctx, ast.Store):
            if isinstance(item.value, ast.Name) and item.value.id == "self":
                found.add(item.attr)
    return found


def _is_table(node: ast.ClassDef) -> bool:
    """Whether a class is a table of a case file; its keys are those that a user may write."""
    return any(ast.unparse(base) == "Model" for base in node.bases)


def test_functions_and_classes_are_small_or_say_why_not():
    found: dict[str, str] = {}
    for module, text in sources().items():
        found |= too_large(text, module)
    assert {name: size for name, size in found.items() if name not in REASONS} == {}
    assert set(REASONS) <= set(found), "a reason that is not needed any more"
