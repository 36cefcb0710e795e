"""How an animation is written as a GIF: few colours, the same ones in all frames."""

from __future__ import annotations

import numpy as np
from matplotlib.animation import PillowWriter
from PIL import Image

COLOURS = 128
LOOKED_AT = 8  # frames that the colours are chosen from


class GifWriter(PillowWriter):
    """Writes all frames in one palette.

    Pillow would choose the colours of each frame by what fills most of it: thin lines change their
    colours from frame to frame, and little equals the frame before, which a GIF need not repeat.
    """

    _frames: list[Image.Image]

    def finish(self) -> None:
        """Write the file."""
        palette = common_palette(self._frames)
        frames = [f.quantize(palette=palette, dither=Image.Dither.NONE) for f in self._frames]
        frames[0].save(
            self.outfile,
            save_all=True,
            append_images=frames[1:],
            duration=int(1000 / self.fps),
            loop=0,
        )


def common_palette(frames: list[Image.Image]) -> Image.Image:
    """An image with a palette that serves all frames: colours far apart, and white.

    Args:
        frames: RGB, of one size.
    """
    chosen = np.unique(np.linspace(0, len(frames) - 1, LOOKED_AT).round().astype(int))
    width, height = frames[0].size
    sheet = Image.new("RGB", (width, height * len(chosen)))
    for place, number in enumerate(chosen):
        sheet.paste(frames[number], (0, height * place))
    found = sheet.quantize(COLOURS - 1, Image.Quantize.MAXCOVERAGE).getpalette() or []
    palette = Image.new("P", (1, 1))
    palette.putpalette([*found[: 3 * (COLOURS - 1)], 255, 255, 255])
    return palette
