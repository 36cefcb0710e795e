"""``tribox init``: writes a starter case with comments, its mesh, and the schema for editors."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from tribox.app.case.schema import FILE_NAME, json_schema
from tribox.app.errors import InputError
from tribox.app.results.directory import write_text
from tribox.geometry.meshes.drawing import mesh_drawing

HERE = Path(__file__).parent
KINDS = {
    "two-blocks": "a block pressed on another and slid on a film, by a built-in generator",
    "own-mesh": "a pad on a plate, with a drawing for gmsh and its mesh",
    "forming": "an aluminium strip bent over an edge by rigid tools, and its springback",
}


def write_starter(kind: str, target: Path | None = None) -> list[Path]:
    """Write a starter case of `KINDS` and what it needs; the files, the case first.

    ``target``: the case file, ending in .toml, or a directory for ``KIND.toml``. InputError if
    there is no such kind, a file is there already, or cannot be written; nothing is changed.
    """
    if kind not in KINDS:
        cure = f" (as in: tribox init two-blocks {kind})" if kind.endswith(".toml") else ""
        raise InputError(f'no starter "{kind}"; there are {", ".join(KINDS)}{cure}')
    case = _case_file(kind, target)
    made = _makers(kind, case)
    for path in made:
        if path.exists() and not (path.name == FILE_NAME and _is_schema(path)):
            raise InputError(f"{path}: exists already; name another file or directory")
    try:
        case.parent.mkdir(parents=True, exist_ok=True)
        return [path for path, make in made.items() if make(path)]
    except OSError as error:
        where = error.filename or case
        raise InputError(f"{where}: cannot be written ({error.strerror or error})") from None


def _case_file(kind: str, target: Path | None) -> Path:
    """Where the case file goes."""
    if target is None:
        return Path(f"{kind}.toml")
    if target.suffix == ".toml" and not target.is_dir():
        return target
    if target.is_file():
        raise InputError(f"{target}: name a case file (.toml) or a directory")
    return target / f"{kind}.toml"


def _makers(kind: str, case: Path) -> dict[Path, Callable[[Path], bool]]:
    """The files of a starter, each with what writes it and says whether it did."""

    def copy(path: Path) -> bool:
        text = (HERE / f"{kind}{path.suffix}").read_text(encoding="utf-8")
        write_text(path, text.replace("NAME", case.stem))
        return True

    made: dict[Path, Callable[[Path], bool]] = {case: copy}
    if (HERE / f"{kind}.geo").is_file():
        made |= {case.with_suffix(".geo"): copy, case.with_suffix(".msh"): _write_mesh}
    return made | {case.with_name(FILE_NAME): _write_schema}


def _write_mesh(path: Path) -> bool:
    """Make the mesh of the drawing beside it."""
    mesh_drawing(path.with_suffix(".geo"), path)
    return True


def _write_schema(path: Path) -> bool:
    """Write the schema, unless it is there; that of another version is replaced."""
    text = json.dumps(json_schema(), indent=1, ensure_ascii=False) + "\n"
    if path.exists() and path.read_text(encoding="utf-8") == text:
        return False
    write_text(path, text)
    return True


def _is_schema(path: Path) -> bool:
    return path.is_file() and '"$schema"' in path.read_text(encoding="utf-8", errors="replace")
