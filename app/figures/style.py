"""The look all figures share, and what they need to read and write files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from geometry.surfaces.facets import Floats

COLOURS = ("#1b6ca8", "#d1495b", "#2e8b57", "#8d5fa8", "#e08e1b", "#555555")
MARKERS = ("o", "s", "^", "D", "v", "P")
STYLE = {
    "font.size": 10,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "figure.dpi": 150,
}


def save(figure: Figure, path: Path) -> None:
    """Write a PNG under a temporary name and rename it."""
    part = path.with_suffix(".part.png")
    figure.savefig(part, bbox_inches="tight")
    plt.close(figure)
    part.replace(path)


def columns(rows: list[dict[str, Any]], *names: str) -> list[Floats]:
    """Columns of a table's rows, each (n,)."""
    return [np.array([row[name] for row in rows]) for name in names]
