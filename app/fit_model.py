"""The coordinates of a fit under their documented name; see :mod:`app.fit.model`."""

from app.fit.model import coordinates

__all__ = ["coordinates"]
