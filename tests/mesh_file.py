"""Meshes of gmsh's format 2.2, written without gmsh."""

from collections.abc import Iterable, Sequence
from pathlib import Path


def write_mesh(
    path: Path, names: Sequence[str], nodes: Sequence[Iterable[float]], rows: Sequence[str]
) -> Path:
    """Write groups ('1 1 "top"'), nodes (2 or 3 of x, y, z), elements ("1 2 tag tag a b")."""
    parts = {
        "MeshFormat": ["2.2 0 8"],
        "PhysicalNames": [str(len(names)), *names],
        "Nodes": [str(len(nodes))],
        "Elements": [str(len(rows)), *(f"{k} {row}" for k, row in enumerate(rows, 1))],
    }
    for k, node in enumerate(nodes, 1):
        parts["Nodes"].append(" ".join([str(k), *(f"{x:.17g}" for x in [*node, 0.0][:3])]))
    text = "\n".join("\n".join([f"${k}", *v, f"$End{k}"]) for k, v in parts.items())
    path.write_text(f"{text}\n", encoding="utf-8")
    return path
