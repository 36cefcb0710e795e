"""The friction-map law under its documented name; see :mod:`forms.friction.friction_map`."""

from forms.friction.friction_map import FrictionMap

__all__ = ["FrictionMap"]
