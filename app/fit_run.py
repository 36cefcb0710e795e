"""The set-up of a fit under its documented name; see :mod:`tribox.app.fit.setup`."""

from tribox.app.fit.setup import fit_setup

__all__ = ["fit_setup"]
