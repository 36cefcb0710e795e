"""Closed forms for verification; those of homogeneous sliding can be imported from here."""

from tribox.forms.closed_forms.homogeneous_sliding import (
    crossover_speed,
    effective_viscosity,
    film_fraction,
    presliding_length,
    steady_traction,
    threshold_speed,
)

__all__ = [
    "crossover_speed",
    "effective_viscosity",
    "film_fraction",
    "presliding_length",
    "steady_traction",
    "threshold_speed",
]
