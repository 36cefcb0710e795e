"""The pictures of the forming cases in ``docs/gallery.md``, drawn from runs of their tests."""

from dataclasses import dataclass
from pathlib import Path

from tribox import read
from tribox.app.figures.body_shapes import DEFAULT_FIELD
from tribox.app.figures.run_figures import draw_figures


@dataclass(frozen=True)
class Picture:
    """The file of a figure, and the field that bodies are coloured by, if not the usual one."""

    figure: str
    field: str = ""


_FLOWN = "equivalent_plastic_strain"
PICTURES = {
    "cup": Picture(f"deformed-{_FLOWN}.png", _FLOWN),
    "ironing": Picture(f"deformed-{_FLOWN}-3-draw.png", _FLOWN),
    "own-mesh": Picture(f"deformed-{_FLOWN}-1-bend.png", _FLOWN),
    "pad": Picture("deformed-1-press.png"),
    "recess": Picture("deformed-1-press.png"),
    "roller": Picture("deformed.png"),
    "strip-draw": Picture("stribeck.png"),
    "strip-rolling": Picture(f"deformed-{_FLOWN}.png", _FLOWN),
    "tube-bulge": Picture("deformed-2-press.png"),
    "u-bend": Picture(f"deformed-{_FLOWN}-1-press.png", _FLOWN),
}


def draw_picture(name: str, directory: Path) -> None:
    """Draw the picture of a case, if it has one, from the results of its run."""
    if name in PICTURES:
        picture = PICTURES[name]
        drawn = draw_figures(read(directory), picture.field or DEFAULT_FIELD)
        assert picture.figure in {path.name for path in drawn}
