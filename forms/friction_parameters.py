"""The law's parameters under their documented name; see :mod:`forms.friction.parameters`."""

from forms.friction.parameters import PRESETS, FrictionMapParameters, with_preset

__all__ = ["PRESETS", "FrictionMapParameters", "with_preset"]
