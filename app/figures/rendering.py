"""Bodies in space rendered by pyvista, off-screen, in a process of its own.

VTK without a display may end its process rather than raise. So pictures are made by a child: where
it fails, there are none, and the caller draws with matplotlib.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import tribox
from tribox.app.figures.scenes import EDGES_SHOWN, EYE, RIGHT, UP, Scene

MODULE = "tribox.app.figures.rendering"
START, EACH = 60.0, 20.0  # s that the child may take to start, and for each picture


def render(scenes: Sequence[Scene]) -> list[NDArray[np.uint8]] | None:
    """Pictures (h, w, 3) of all scenes; None where rendering does not work here."""
    if find_spec("pyvista") is None:
        return None
    from matplotlib.image import imread

    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        for number, scene in enumerate(scenes):
            np.savez(
                directory / f"{number}.npz", position=scene.position, polygons=scene.polygons,
                colours=scene.colours, body=scene.body, low=scene.low, high=scene.high,
            )  # fmt: skip
        if not _child(directory, len(scenes)):
            return None
        pictures = [imread(directory / f"{number}.png") for number in range(len(scenes))]
    return [np.rint(picture[..., :3] * 255.0).astype(np.uint8) for picture in pictures]


def _child(directory: Path, count: int) -> bool:
    """Whether a process of its own has rendered all scenes of a directory."""
    path = os.pathsep.join(
        filter(None, [str(Path(tribox.__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    )
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-m", MODULE, str(directory), str(count)],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, stdin=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": path}, timeout=START + EACH * count, check=False,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired):
        return False
    return done.returncode == 0 and all((directory / f"{k}.png").is_file() for k in range(count))


def _lacks_display() -> bool:
    """Whether VTK would render to a display, and there is none: it would end the process then."""
    if os.environ.get("DISPLAY"):
        return False
    import_module("vtkmodules.vtkRenderingOpenGL2")  # the windows that there are
    window = import_module("vtkmodules.vtkRenderingCore").vtkRenderWindow()
    return "XOpenGL" in type(window).__name__


def _render_files(directory: Path, count: int) -> None:
    """What the child does."""
    if _lacks_display():
        sys.exit(1)
    import pyvista

    for number in range(count):
        scene = Scene(**np.load(directory / f"{number}.npz"))
        polygons = scene.polygons
        padded = np.insert(polygons, 0, polygons.shape[1], axis=1)
        # In a unit in which the bodies are of the size of one: VTK has tolerances of its own.
        unit = 1.0 / float(np.max(scene.high - scene.low))
        surface = pyvista.PolyData(scene.position * unit, padded.reshape(-1))
        surface.cell_data["colours"] = np.rint(scene.colours * 255.0).astype(np.uint8)
        plotter = pyvista.Plotter(off_screen=True, window_size=list(scene.size))
        plotter.set_background("white")
        plotter.add_mesh(
            surface, scalars="colours", rgb=True, show_edges=len(polygons) <= EDGES_SHOWN,
            edge_color="gray", line_width=0.5, ambient=0.5, diffuse=0.55, specular=0.0,
        )  # fmt: skip
        low, high = (corner * unit for corner in scene.window)
        middle = 0.5 * (low + high) @ np.stack([RIGHT, UP])
        plotter.enable_parallel_projection()
        plotter.camera_position = [tuple(middle + 5.0 * EYE), tuple(middle), tuple(UP)]
        plotter.camera.parallel_scale = 0.5 * float((high - low)[1])
        plotter.camera.clipping_range = (0.01, 20.0)
        plotter.enable_anti_aliasing("ssaa")
        plotter.screenshot(str(directory / f"{number}.png"))
        plotter.close()


if __name__ == "__main__":
    _render_files(Path(sys.argv[1]), int(sys.argv[2]))
