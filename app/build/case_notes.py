"""What may surprise in a case that is correct: lines for the person who runs it."""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Iterable, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from tribox.app.case.boundary import Boundary
from tribox.app.case.case import Case
from tribox.app.case.contact import Contact
from tribox.app.case.friction import LawTable
from tribox.app.case.generators import BlocksGeometry
from tribox.app.case.geometry import GeneratedGeometry
from tribox.app.case.stage import Stage
from tribox.app.case.table import Model
from tribox.app.case.time_tables import TimeTable
from tribox.forms.closed_forms import steady_traction
from tribox.forms.friction.film import at_rest, threshold_speed
from tribox.forms.friction.law import SETTLED
from tribox.forms.friction.parameters import PRESETS, FrictionMapParameters, Table

Floats = NDArray[np.float64]

LOOSE = 1e-3  # of the residual over the contact force, from which on results show it
THICK = 1e-5  # m, film thickness that is surely a slip of units
SOFT = 100.0  # Pa, shear modulus, below that of gels, that is surely a slip of units


def notes_on(case: Case) -> list[str]:
    """Notes on a case before it runs, one line each."""
    notes = [
        f"boundary.{index}.{key}: falls to {min(table.values):g} Pa: below zero it pulls"
        for index, boundary in enumerate(case.boundary)
        for key, table in _pressures(boundary)
        if min(table.values) < 0.0
    ]
    if case.solver.tolerance > LOOSE:
        notes.append(
            f"solver.tolerance = {case.solver.tolerance:g}: forces may be wrong by about as much; "
            f"the default is 1e-8, and above {LOOSE:g} results are not to be trusted"
        )
    notes += [
        f"bodies.{name}: a shear modulus of {body.shear_modulus:.3g} Pa is below that of gels; "
        'a number without a unit is in SI: write "3 MPa"'
        for name, body in case.bodies.items()
        if body.shear_modulus < SOFT
    ]
    touching = {name for contact in case.contact for name in (contact.slave, contact.master)}
    notes += [
        f"boundary.{index}.pressure: acts on {boundary.surface} where it touches too: pressures "
        "and forces of the contact are without it, and where the contact recedes beyond the named "
        "surface none acts"
        for index, boundary in enumerate(case.boundary)
        if boundary.pressure is not None and boundary.surface in touching
    ]
    notes += _notes_on_programs(case)
    return notes + [
        f"contact.{index}: {note}"
        for index, contact in enumerate(case.contact)
        for note in _notes_on_contact(case, contact)
    ]


def _notes_on_programs(case: Case) -> Iterator[str]:
    """Programs that the run leaves before their end, where the stages have their times."""
    if any(stage.duration is None for stage in case.stage):
        return
    end = sum(stage.duration or 0.0 for stage in case.stage)
    for key, table in _programs(case, ""):
        reached, last = table(end), table.values[-1]
        if table.times[-1] > end * (1.0 + 1e-9) and reached != last:
            yield (
                f"{key}: goes on to {last:g} at {table.times[-1]:g} s, but the stages end at "
                f"{end:g} s, where it is {reached:g}"
            )


def _programs(value: object, key: str) -> Iterator[tuple[str, TimeTable]]:
    """All programs of time below a key of the case."""
    parts: Iterable[tuple[object, object]] = ()
    if isinstance(value, TimeTable):
        yield key, value
    elif isinstance(value, Model):
        parts = ((name, getattr(value, name)) for name in type(value).model_fields)
    elif isinstance(value, Mapping):
        parts = value.items()
    elif isinstance(value, tuple):
        parts = enumerate(value)
    for name, part in parts:
        yield from _programs(part, f"{key}.{name}" if key else str(name))


def _pressures(boundary: Boundary) -> Iterator[tuple[str, TimeTable]]:
    if boundary.pressure is not None:
        yield "pressure", boundary.pressure
    if boundary.platen is not None and boundary.platen.pressure is not None:
        yield "platen.pressure", boundary.platen.pressure


def _notes_on_contact(case: Case, contact: Contact) -> Iterator[str]:
    parameters = contact.map
    if parameters is None or contact.given_film is None:
        return
    yield from _notes_on_weakening(case, parameters)
    thickest = max(contact.given_film.thicknesses)
    if thickest > THICK:
        yield (
            f"film thickness D = {thickest:.3g} m: the law is one of thin "
            "films (nanometres to about a micrometre)"
        )
    film = np.array(contact.given_film.thicknesses)
    # Between the rows of a table over the pressure the film takes every thickness.
    middle: Floats = 0.5 * (film[1:] + film[:-1])
    taken = np.concatenate([film, middle])
    assert isinstance(contact.friction, LawTable)
    yield from notes_on_choices(contact.friction, taken)
    pressure = highest_pressure(case)
    if pressure > 0.0:
        yield from notes_on_uniqueness(parameters, pressure, film)
    yield from notes_on_settling(case, contact, pressure)
    steps = list(_driven_steps(case))
    if steps:
        yield from notes_on_threshold(
            parameters,
            film,
            position_error=sys.float_info.epsilon * _size(case),
            dt=min(dt for _, dt in steps),
            slowest=None if _comes_to_rest(case) else min(speed for speed, _ in steps),
        )
    if parameters.switch == "lagged" and _comes_to_rest(case):
        longest = parameters.eta_b / (float(film.max()) * parameters.K_T)
        yield (
            'friction.switch = "lagged": a stage without motion follows a driven one, and with the '
            "film fraction of the step before a body that comes to rest keeps the right traction "
            f"only in steps shorter than eta_b/(D K_T) = {longest:.2g} s; "
            'switch = "implicit" takes any'
        )


def notes_on_choices(friction: LawTable, film: Floats) -> Iterator[str]:
    """Lines on what the law takes by itself for films (q,), m, where the case does not say it."""
    parameters = friction.parameters()
    yield from notes_on_tabulation(parameters, film)
    if friction.preset is not None:
        yield from notes_on_fixed_threshold(parameters, PRESETS[friction.preset]["eta_b"])


def _notes_on_weakening(case: Case, friction: FrictionMapParameters) -> Iterator[str]:
    """Weakening that does nothing, and weakening that lets patches of the contact snap."""
    fall = friction.mu_s - friction.mu_dynamic
    if fall > 0.0 and friction.B == 0.0:
        yield f"mu_d = {friction.mu_dynamic:g} has no effect while B = 0: friction stays at mu_s"
    if not isinstance(case.geometry, BlocksGeometry):
        return
    upper = case.bodies[case.geometry.bodies[0]].shear_modulus / case.geometry.upper.height
    slope = highest_pressure(case) * fall * friction.B
    if slope > upper:
        yield (
            f"slip weakening p (mu_s - mu_d) B = {slope:.3g} Pa/m is steeper than the upper "
            f"block's shear stiffness G/height = {upper:.3g} Pa/m: the onset of slip can snap, "
            "and a quasi-static step through it may have no solution (lower B)"
        )


def highest_pressure(case: Case) -> float:
    """The highest pressure that a boundary prescribes, Pa; 0 if none does."""
    tables = [table for boundary in case.boundary for _, table in _pressures(boundary)]
    return max((max(table.values) for table in tables), default=0.0)


def _driven_steps(case: Case) -> Iterator[tuple[float, float]]:
    """(speed in m/s, step in s) of every driven load step that feels its rate."""
    for stage in case.stage:
        if not stage.rate_dependent:
            continue
        for velocity in stage.velocities_within(case.film_conductance):
            assert stage.slip_step is not None
            yield abs(velocity), stage.slip_step / abs(velocity)
        if stage.velocity and stage.duration is not None:
            yield abs(stage.velocity), stage.duration / stage.steps


def _comes_to_rest(case: Case) -> bool:
    """Whether a stage without motion follows a driven one, which slows through V* then."""
    felt = [stage for stage in case.stage if stage.rate_dependent]
    moves = [bool(stage.velocities or stage.velocity) for stage in felt]
    return any(before and not now for before, now in itertools.pairwise(moves))


def _size(case: Case) -> float:
    """A length of the model, m, that coordinates are rounded to."""
    geometry = case.geometry
    return geometry.extent if isinstance(geometry, GeneratedGeometry) else 1.0


# -- Programmes of velocities that are too short for friction to become steady: lines for the user
#
# Estimated from the case alone, before anything runs. The judgement itself is made during the run,
# see `steady`.


def notes_on_settling(case: Case, contact: Contact, pressure: float) -> Iterator[str]:
    """A line on stages with too little slip for a velocity; ``pressure``: Pa, 0 if unknown."""
    law, slid = contact.map, 0.0
    if law is None or contact.given_film is None:
        return
    film, compliance = max(contact.given_film.thicknesses), shear_compliance(case)
    if pressure > 0.0:
        film = contact.given_film.at(pressure)
    for stage in case.stage:
        if not stage.velocities:
            slid += abs(stage.velocity or 0.0) * (stage.duration or 0.0)
            continue
        assert stage.slip_step is not None
        most = stage.max_steps * stage.slip_step
        speeds = [abs(velocity) for velocity in stage.velocities_within(case.film_conductance)]
        short: list[tuple[float, float]] = []
        for speed in speeds:
            at = speed if stage.rate_dependent else 0.0
            weakening = weakening_slip(law, at, film, pressure)
            needed = max(weakening - slid, 0.0)
            needed += drive_to_load(law, stage, at, film, pressure, compliance)
            if needed > most:
                short.append((speed, needed))
            slid = slid + most if needed > most else max(slid, weakening)
        if short:
            yield _note(stage, most, short, len(speeds))


def _note(stage: Stage, most: float, short: list[tuple[float, float]], of: int) -> str:
    speed, needed = short[0]
    after = f"after {needed:.3g} m" if math.isfinite(needed) else "never, as mu_d = 0"
    return (
        f"stage {stage.name} gives each velocity at most max_steps x slip_step = {most:.3g} m, but "
        f"at {speed:.3g} m/s friction comes to within 0.1 % of where it tends {after}: "
        f"{len(short)} of {of} velocities will not be steady (raise max_steps or slip_step, or "
        "slide in a stage before)"
    )


def weakening_slip(law: FrictionMapParameters, speed: float, film: float, pressure: float) -> float:
    """Slip after which the weakening has come to within ``SETTLED`` of the traction, m.

    ``speed``: m/s, 0 where rates do not count; ``film``: m; ``pressure``: Pa, 0 (unknown): dry.
    """
    p = pressure if pressure > 0.0 else 1.0
    # The traction is linear in mu: its slope, and the film's drag beside it.
    per_mu = float(
        steady_traction(speed, film, p, 1.0, law) - steady_traction(speed, film, p, 0.0, law)
    )
    if per_mu == 0.0:
        return 0.0
    drag = float(steady_traction(speed, film, p, 0.0, law)) if pressure > 0.0 else 0.0
    # At that slip the traction is per_mu (mu_d + excess) + drag, of which excess may be a share.
    excess = SETTLED / (1.0 - SETTLED) * (law.mu_dynamic + drag / per_mu)
    return law.friction.settling_slip(excess)


def drive_to_load(
    law: FrictionMapParameters,
    stage: Stage,
    speed: float,
    film: float,
    pressure: float,
    compliance: float,
) -> float:
    """Way in which asperities and bodies take up the traction of a velocity, m.

    Dry friction is reached after its elastic length, and must then be seen to stay for as long. The
    film's drag grows with 1 - exp(-s/l) over the way s, l being the elastic length under it.
    ``speed``: m/s, 0 where rates do not count; ``film``: m; ``pressure``: Pa, 0 if unknown;
    ``compliance``: m/Pa, of the bodies in shear.
    """
    drag = float(steady_traction(speed, film, pressure, 0.0, law))
    dry = float(steady_traction(speed, film, pressure, law.mu_s, law)) - drag
    presliding = law.mu_s * pressure / law.K_T if dry > 0.0 else 0.0
    rest = math.log(1.0 / min(stage.steady_tolerance, 0.5))
    return 2.0 * (presliding + dry * compliance) + rest * drag * compliance


def shear_compliance(case: Case) -> float:
    """Displacement of the upper block's top per shear traction below, m/Pa; 0 if not known."""
    if not isinstance(case.geometry, BlocksGeometry):
        return 0.0
    return case.geometry.upper.height / case.bodies[case.geometry.bodies[0]].shear_modulus


# -- Checks of friction-map parameters against the film, the pressure and the numbers of a run -----

MOST_TOLD = 4  # film thicknesses that a message names
SAME = 1e-6  # relative difference of two film thicknesses that count as one


def notes_on_uniqueness(
    parameters: FrictionMapParameters, pressure: float, film: Floats
) -> Iterator[str]:
    r"""A line where slip weakening may give a step two solutions.

    .. math:: (1 - \alpha) K_T > \omega\, t_N (\mu_s - \mu_d) B

    (omega = 1 - alpha for the weighted flow rule, 1 for the literal one; alpha below the threshold
    speed) is sufficient for one solution, not necessary. Where it fails, stick and slip can coexist
    and the traction can jump.

    Args:
        pressure: Pa, the highest contact pressure t_N to expect.
        film: (q,), m, film thickness D.
    """
    softening = pressure * (parameters.mu_s - parameters.mu_dynamic) * parameters.B
    stiffness, what = parameters.K_T, "K_T"
    if parameters.flow_rule == "literal":
        solid = at_rest(parameters, film).solid
        # Where the film carries all there is no friction that could weaken.
        solid = solid[solid > 0.0]
        if not solid.size:
            return
        stiffness, what = float(solid.min()) * stiffness, "(1 - alpha) K_T"
    if softening == 0.0 or stiffness > softening:
        return
    highest = pressure * stiffness / softening
    yield (
        f"slip weakening: stick and slip can coexist and the friction traction can jump, as "
        f"{what} = {stiffness:.3g} Pa/m is not above t_N (mu_s - mu_d) B = {softening:.3g} Pa/m at "
        f"t_N = {pressure:.3g} Pa; it is unique up to t_N = {highest:.3g} Pa"
    )


def notes_on_threshold(
    parameters: FrictionMapParameters,
    film: Floats,
    *,
    position_error: float,
    dt: float,
    slowest: float | None = None,
) -> Iterator[str]:
    """A line where the threshold speed V* has no effect in a run with a film (q,), m, below D_max.

    Speeds below ``position_error``, m, over ``dt``, the shortest time step, s, cannot be told from
    rest; and where V* is below ``slowest``, m/s, the lowest speed of sliding, the film carries all.
    """
    inside = film[(film > parameters.D_min) & (film < parameters.D_max)]
    if not inside.size:
        return
    v_star = threshold_speed(parameters, inside)
    lowest, at = float(v_star.min()), float(inside[v_star.argmin()])
    source = "gamma" if parameters.gamma is not None else "V_star"
    given = parameters.gamma if parameters.gamma is not None else parameters.V_star
    head = f"{source} = {given:g}: the threshold speed V* = {lowest:.2g} m/s (D = {at:.3g} m)"
    resolved = position_error / dt
    if lowest <= resolved:
        yield (
            f"{head} lies within round-off: speeds below {resolved:.2g} m/s (position error "
            f"{position_error:.2g} m over a time step of {dt:.2g} s) cannot be distinguished"
        )
    elif slowest is not None and float(v_star.max()) < slowest:
        yield (
            f"{head} lies below every speed of sliding (from {slowest:.2g} m/s): the film carries "
            f"all (alpha = 1) throughout"
        )


def notes_on_tabulation(parameters: FrictionMapParameters, film: Floats) -> Iterator[str]:
    """A line with alpha at thicknesses (q,), m, that a table of alpha, or beta, has no row for."""
    name = "beta" if parameters.alpha is None else "alpha"
    table: float | Table | None = getattr(parameters, name)
    if not isinstance(table, tuple):
        return
    rows = np.array([thickness for thickness, _ in table])
    asked = np.unique(film)
    asked = asked[(asked > parameters.D_min) & (asked < parameters.D_max)]
    missing = asked[~np.isclose(asked[:, None], rows, rtol=SAME, atol=0.0).any(axis=1)]
    if not missing.size:
        return
    inside = (missing > rows[0]) & (missing < rows[-1]) | (name == "alpha")
    alpha = 1.0 - at_rest(parameters, missing).solid
    told = [
        f"{value:.4g} at D = {thickness:g} m ({'interpolated' if within else 'end of the table'})"
        for thickness, value, within in zip(missing, alpha, inside, strict=True)
    ]
    more = [f"and {len(told) - MOST_TOLD} more"] if len(told) > MOST_TOLD else []
    values = ", ".join([*told[:MOST_TOLD], *more])
    yield (
        f"the table of {name} has no row for some film thicknesses: alpha = {values}; such values "
        f"are no data; give {name} a row there, or one number, if you know it"
    )


def notes_on_fixed_threshold(parameters: FrictionMapParameters, usual: float) -> Iterator[str]:
    r"""A line on a threshold speed that stays where the viscosity is not the ``usual`` one, Pa s.

    With the gamma that lets it move, :math:`\gamma = {V^*}^2 D \eta_b/D_{max}`.
    """
    if parameters.V_star is None or np.isclose(parameters.eta_b, usual, rtol=SAME, atol=0.0):
        return
    if not np.isfinite(parameters.V_star):
        return
    gamma = parameters.threshold_constant * usual / parameters.D_max
    yield (
        f"V_star is given directly and does not move with eta_b, which is not the preset's "
        f"{usual:g} Pa*s; to have V* fall as 1/sqrt(eta_b), give gamma = {gamma:.4g} N/s instead "
        "of V_star and V_star_at"
    )
