"""Friction laws of numbers near one, which tests of contacts share."""

from tribox.forms.friction.coulomb import CoulombLaw, CoulombParameters
from tribox.forms.friction.friction_map import FrictionMap
from tribox.forms.friction.parameters import FrictionMapParameters

FILM = 0.5  # thickness for which the laws below have their numbers


def coulomb(mu: float, K_T: float = 60.0) -> CoulombLaw:
    return CoulombLaw(CoulombParameters(mu=mu, K_T=K_T))


def film_map(**changes: float) -> FrictionMap:
    """Friction that weakens with slip, and a film that carries 0.4 of it up to V* = 100."""
    values = {
        "mu_s": 0.3, "mu_d": 0.2, "A_d": 0.01, "B": 20.0, "K_T": 60.0, "eta_b": 5.0, "D_max": 1.0,
        "alpha": 0.4, "V_star": 100.0, "V_star_at": FILM, "film_onset_pressure": 1.0,
    }  # fmt: skip
    return FrictionMap(FrictionMapParameters(**(values | changes)))


def viscous_map(viscosity: float, alpha: float = 1.0, **changes: float) -> FrictionMap:
    """A film of ``viscosity`` per speed where it carries all; it carries ``alpha`` at any speed."""
    values = {
        "mu_s": 0.3, "K_T": 60.0, "eta_b": FILM * viscosity, "D_max": 1.0, "alpha": alpha,
        "V_star": 1e9, "V_star_at": FILM, "transition_width": 0.0,
    }  # fmt: skip
    return FrictionMap(FrictionMapParameters(**(values | changes)))
