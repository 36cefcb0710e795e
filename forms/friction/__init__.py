"""Friction laws and the film, on numpy alone."""

from tribox.forms.friction.law import (
    Dissipation,
    FrictionLaw,
    FrictionResponse,
    FrictionState,
    Regime,
)

__all__ = ["Dissipation", "FrictionLaw", "FrictionResponse", "FrictionState", "Regime"]
