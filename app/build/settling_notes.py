"""Programmes of velocities that are too short for friction to become steady: lines for the user.

Estimated from the case alone, before anything runs. The judgement itself is made during the run,
see :mod:`tribox.app.simulation.steady`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from tribox.app.case.case import Case
from tribox.app.case.contact import Contact
from tribox.app.case.friction import FrictionMap
from tribox.app.case.generators import BlocksGeometry
from tribox.app.case.stage import Stage
from tribox.forms.closed_forms.homogeneous_sliding import steady_traction
from tribox.forms.friction.parameters import FrictionMapParameters
from tribox.forms.friction.settling import SETTLED


def notes_on_settling(case: Case, contact: Contact, pressure: float) -> Iterator[str]:
    """One line for each stage that has too little slip for some of its velocities.

    Args:
        case: the case.
        contact: one of its contacts; only the friction map says enough of itself.
        pressure: Pa, on the contact; 0 if unknown.
    """
    if not isinstance(contact.friction, FrictionMap) or contact.given_film is None:
        return
    law, slid = contact.friction.parameters(), 0.0
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

    Args:
        law: the friction map.
        speed: m/s; 0 where rates do not count.
        film: m, its thickness.
        pressure: Pa; 0 if unknown: then the film is taken to carry nothing beside the asperities.
    """
    p = pressure if pressure > 0.0 else 1.0
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

    Args:
        law: the friction map.
        stage: for its tolerance.
        speed: m/s; 0 where rates do not count.
        film: m, its thickness.
        pressure: Pa, 0 if unknown.
        compliance: m/Pa, of the bodies in shear.
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
    modulus = case.bodies[case.geometry.bodies[0]].shear_modulus
    return case.geometry.upper.height / modulus
