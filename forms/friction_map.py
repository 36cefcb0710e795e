"""The friction-map law under its documented name; see :mod:`tribox.forms.friction.friction_map`."""

from tribox.forms.friction.friction_map import FrictionMap

__all__ = ["FrictionMap"]
