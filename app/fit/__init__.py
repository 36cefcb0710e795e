"""``tribox fit``: calibration of friction to tribometer data, of materials to their tests."""

from tribox.app.fit.calibration import Calibration
from tribox.app.fit.material import MaterialOptions, MaterialResult, fit_material
from tribox.app.fit.model import coordinates
from tribox.app.fit.setup import fit_setup

__all__ = [
    "Calibration",
    "MaterialOptions",
    "MaterialResult",
    "coordinates",
    "fit_material",
    "fit_setup",
]
