"""``tribox fit``: calibration of the friction law to tribometer data."""

from tribox.app.fit.calibration import Calibration
from tribox.app.fit.model import coordinates
from tribox.app.fit.setup import fit_setup

__all__ = ["Calibration", "coordinates", "fit_setup"]
