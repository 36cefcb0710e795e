"""``tribox fit``: calibration of the friction law to tribometer data."""

from app.fit.calibration import Calibration
from app.fit.model import coordinates
from app.fit.run import fit_setup

__all__ = ["Calibration", "coordinates", "fit_setup"]
