"""The figures of a results directory, to stand in the page itself."""

from __future__ import annotations

import base64
import re
from dataclasses import dataclass
from pathlib import Path

from tribox.app.errors import InputError

_KNOWN = {
    "history": ("Forces and friction", "Normal force, friction force and their ratio over the run"),
    "mesh": ("Mesh", "The bodies with their cells before anything moved"),
    "deformed": ("Deformed bodies", "The deformed bodies, and the tractions between them"),
    "animation": ("Animation", "The deformed bodies in the course of the run"),
    "energy": ("Energies", "Work and energies over the run"),
    "effective_viscosity": (
        "Effective viscosity",
        "Effective viscosity over the velocity, on logarithmic axes",
    ),
    "friction_map": ("Friction map", "Friction over the velocity at steady points"),
    "stribeck": ("Stribeck view", "Friction coefficient over the velocity"),
    "force_displacement": (
        "Force and displacement",
        "Force of platens and tools over their displacement",
    ),
    "phase": ("Phase plot", "Velocity over displacement"),
    "sweep_comparison": (
        "Comparison",
        "Forces of pairs and tools, springback and thickness at the end of each run",
    ),
    "sweep": ("Sweep", "Forces at the end of each run over the swept value"),
}
_ORDER = ("sweep", "mesh", "deformed", "history", "force_displacement", "energy")
_KINDS = {".png": "image/png", ".gif": "image/gif"}


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure.

    Attributes:
        title: above it; alt: what it shows, for those who cannot see it.
        source: the image itself, as a data address; width, height: in points of the image.
    """

    title: str
    alt: str
    source: str
    width: int
    height: int


def pictures_of(directory: Path, subject: str) -> list[Picture]:
    """All figures of a results directory, those that tell most first.

    Args:
        directory: of the results.
        subject: title of the run, for the alternative texts.

    Raises:
        InputError: one is no picture.
    """
    from PIL import Image

    found = (p for p in (directory / "figures").glob("*.*") if p.suffix in _KINDS)
    paths = [p for p in found if p.is_file() and not p.is_symlink()]
    pictures = []
    for path in sorted(paths, key=_rank):
        if ".part" in path.name:
            continue
        title, shows = _title(path.stem)
        try:
            data = base64.b64encode(path.read_bytes()).decode("ascii")
            with Image.open(path, formats=[path.suffix[1:]]) as image:
                width, height = image.size
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
            raise InputError(
                f"{path}: is no picture that can be read ({error}); tribox plot draws it again"
            ) from None
        source = f"data:{_KINDS[path.suffix]};base64,{data}"
        pictures.append(Picture(title, f"{shows}. {subject}", source, width, height))
    return pictures


def _rank(path: Path) -> tuple[int, str]:
    places = [place for place, name in enumerate(_ORDER) if path.stem.startswith(name)]
    return (min(places, default=len(_ORDER)), path.name)


def _title(stem: str) -> tuple[str, str]:
    """Title and description of a figure, by the longest known beginning of its name."""
    known = [name for name in _KNOWN if stem.startswith(name)]
    if not known:
        words = stem.replace("_", " ").replace("-", " ")
        return words.capitalize(), f"Figure {words}"
    name = max(known, key=len)
    title, shows = _KNOWN[name]
    rest = stem.removeprefix(name).replace("_", " ").replace("-", " ").strip()
    # Names of fields hold no dash, and begin with a letter.
    if found := re.fullmatch(r"deformed-(?:([A-Za-z]\w*)-)?(\d+)-(.+)", stem):
        field = f"{found[1].replace('_', ' ')}, " if found[1] else ""
        rest = f"{field}end of stage {found[2]}, {found[3]}"
    return (f"{title}: {rest}", f"{shows}: {rest}") if rest else (title, shows)
