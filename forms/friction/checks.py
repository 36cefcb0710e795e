r"""Checks of friction-map parameters against the film, the pressure and the numbers of a run.

Parameters that cannot be computed with raise a ``ValueError``; where they may give unexpected
results, a function returns one line with the numbers, for the caller to print.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tribox.forms.friction.film import at_rest, threshold_speed
from tribox.forms.friction.parameters import FrictionMapParameters, Table

Floats = NDArray[np.float64]
MOST_TOLD = 4  # film thicknesses that a message names
SAME = 1e-6  # relative difference of two film thicknesses that count as one


def uniqueness_warning(
    parameters: FrictionMapParameters, pressure: float, film: Floats | float
) -> str | None:
    r"""Whether slip weakening may give a step two solutions, as a line of text.

    .. math:: (1 - \alpha) K_T > \omega\, t_N (\mu_s - \mu_d) B

    (omega = 1 - alpha for the weighted flow rule, 1 for the literal one; alpha below the threshold
    speed) is sufficient for one solution, not necessary. Where it fails, stick and slip can coexist
    and the traction can jump.

    Args:
        parameters: Of the law.
        pressure: Pa, the highest contact pressure t_N to expect.
        film: (q,) or a number, m, film thickness D.

    Returns:
        A message with the numbers, or None where the solution is unique.
    """
    softening = pressure * (parameters.mu_s - parameters.mu_dynamic) * parameters.B
    stiffness, what = parameters.K_T, "K_T"
    if parameters.flow_rule == "literal":
        thickness = np.atleast_1d(np.asarray(film, dtype=np.float64))
        solid = at_rest(parameters, thickness).solid
        # Where the film carries all there is no friction that could weaken.
        solid = solid[solid > 0.0]
        if not solid.size:
            return None
        stiffness, what = float(solid.min()) * stiffness, "(1 - alpha) K_T"
    if softening == 0.0 or stiffness > softening:
        return None
    highest = pressure * stiffness / softening
    return (
        f"slip weakening: stick and slip can coexist and the friction traction can jump, as "
        f"{what} = {stiffness:.3g} Pa/m is not above t_N (mu_s - mu_d) B = {softening:.3g} Pa/m at "
        f"t_N = {pressure:.3g} Pa; it is unique up to t_N = {highest:.3g} Pa"
    )


def threshold_speed_warning(
    parameters: FrictionMapParameters,
    film: Floats | float,
    *,
    position_error: float,
    dt: float,
    slowest: float | None = None,
) -> str | None:
    """Whether the threshold speed V* has an effect in a run, as a line of text.

    Speeds below (error of a position)/(time step) cannot be distinguished from rest; and where
    V* is below every driven speed, the film carries all (alpha = 1) throughout the sliding.

    Args:
        parameters: Of the law.
        film: (q,) or a number, m, film thickness D.
        position_error: m, error of a position: round-off or the solver's tolerance.
        dt: s, the shortest time step.
        slowest: m/s, the lowest speed of sliding, > 0, if there is one.

    Returns:
        A message with the numbers, or None where V* can be resolved and lies between (or
        where there is no film between D_min and D_max, so that V* has no effect).
    """
    thickness = np.atleast_1d(np.asarray(film, dtype=np.float64))
    inside = (thickness > parameters.D_min) & (thickness < parameters.D_max)
    if not inside.any():
        return None
    v_star = threshold_speed(parameters, thickness[inside])
    lowest, at = float(v_star.min()), float(thickness[inside][v_star.argmin()])
    source = "gamma" if parameters.gamma is not None else "V_star"
    given = parameters.gamma if parameters.gamma is not None else parameters.V_star
    head = f"{source} = {given:g}: the threshold speed V* = {lowest:.2g} m/s (D = {at:.3g} m)"
    resolved = position_error / dt
    if lowest <= resolved:
        return (
            f"{head} lies within round-off: speeds below {resolved:.2g} m/s (position error "
            f"{position_error:.2g} m over a time step of {dt:.2g} s) cannot be distinguished"
        )
    if slowest is not None and float(v_star.max()) < slowest:
        return (
            f"{head} lies below every speed of sliding (from {slowest:.2g} m/s): the film carries "
            f"all (alpha = 1) throughout"
        )
    return None


def tabulation_note(parameters: FrictionMapParameters, film: Floats | float) -> str | None:
    """Film thicknesses that a table of alpha, or beta, has no row for, as a line of text.

    Args:
        parameters: Of the law.
        film: (q,) or a number, m, film thicknesses D.

    Returns:
        A message with alpha there; None where every thickness has a row, or none is asked for.
    """
    name, table = _tabulated(parameters)
    if table is None:
        return None
    rows = np.array([thickness for thickness, _ in table])
    asked = np.unique(np.atleast_1d(np.asarray(film, dtype=np.float64)))
    asked = asked[(asked > parameters.D_min) & (asked < parameters.D_max)]
    has_row = np.isclose(asked[:, None], rows, rtol=SAME, atol=0.0).any(axis=1)
    missing = asked[~has_row]
    if not missing.size:
        return None
    inside = (missing > rows[0]) & (missing < rows[-1])
    alpha = 1.0 - at_rest(parameters, missing).solid
    told = [
        f"{value:.4g} at D = {thickness:g} m ({'interpolated' if within else 'end of the table'})"
        for thickness, value, within in zip(missing, alpha, inside, strict=True)
    ]
    more = [f"and {len(told) - MOST_TOLD} more"] if len(told) > MOST_TOLD else []
    values = ", ".join([*told[:MOST_TOLD], *more])
    return (
        f"the table of {name} has no row for some film thicknesses: alpha = {values}; such values "
        f"are no data; give {name} a row there, or one number, if you know it"
    )


def _tabulated(parameters: FrictionMapParameters) -> tuple[str, Table | None]:
    """The name of what gives alpha, and its table; None where it is a number."""
    name = "beta" if parameters.alpha is None else "alpha"
    value = parameters.beta if parameters.alpha is None else parameters.alpha
    return name, value if isinstance(value, tuple) else None


def fixed_threshold_note(parameters: FrictionMapParameters, usual: float) -> str | None:
    r"""A threshold speed that stays where the viscosity is not the usual one, as a line of text.

    .. math:: \gamma = {V^*}^2 D \eta_b/D_{max}

    Args:
        parameters: Of the law.
        usual: Pa s, viscosity that V_star is taken to belong to, such as that of a preset.

    Returns:
        A message with the gamma that lets V* move; None where V* is not given, or the viscosity is.
    """
    if parameters.V_star is None or np.isclose(parameters.eta_b, usual, rtol=SAME, atol=0.0):
        return None
    if not np.isfinite(parameters.V_star):
        return None
    gamma = parameters.threshold_constant * usual / parameters.D_max
    return (
        f"V_star is given directly and does not move with eta_b, which is not the preset's "
        f"{usual:g} Pa*s; to have V* fall as 1/sqrt(eta_b), give gamma = {gamma:.4g} N/s instead "
        "of V_star and V_star_at"
    )
