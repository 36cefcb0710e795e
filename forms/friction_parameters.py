"""The law's parameters under their documented name; see :mod:`tribox.forms.friction.parameters`."""

from tribox.forms.friction.parameters import PRESETS, FrictionMapParameters, with_preset

__all__ = ["PRESETS", "FrictionMapParameters", "with_preset"]
