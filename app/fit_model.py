"""The coordinates of a fit under their documented name; see :mod:`tribox.app.fit.model`."""

from tribox.app.fit.model import coordinates

__all__ = ["coordinates"]
