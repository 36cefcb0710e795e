"""The set-up of a fit under its documented name; see :mod:`tribox.app.fit.run`."""

from tribox.app.fit.run import fit_setup

__all__ = ["fit_setup"]
