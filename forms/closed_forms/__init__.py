"""Closed forms of homogeneous sliding."""

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
