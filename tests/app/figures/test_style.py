"""Pages are cut to what is drawn, and are the pictures that matplotlib makes."""

import numpy as np
import pytest
from PIL import Image

from tribox.app.figures.style import write_png


def page(path) -> np.ndarray:
    with Image.open(path) as picture:
        assert picture.mode in ("RGB", "RGBA") and picture.info["dpi"] == pytest.approx(
            (150, 150), 1e-3
        )
        return np.asarray(picture.convert("RGB"))


def test_png_holds_the_pixels(tmp_path):
    pixels = np.random.default_rng(1).integers(0, 256, (7, 5, 3)).astype(np.uint8)
    write_png(tmp_path / "one.png", pixels, 150.0)
    np.testing.assert_array_equal(page(tmp_path / "one.png"), pixels)
