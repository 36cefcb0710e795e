"""The set-up of a fit under its documented name; see :mod:`app.fit.run`."""

from app.fit.run import fit_setup

__all__ = ["fit_setup"]
