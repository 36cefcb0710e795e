"""Notes on the tables of a contact: the stiffnesses of contact and stick, its film, its tie."""

from __future__ import annotations

from collections.abc import Iterator

from tribox.app.case.contact import Contact
from tribox.app.case.friction import MAP, Friction
from tribox.forms.bodies.materials import Material, contact_shear_modulus
from tribox.forms.contact.pressure import PressureKind

STIFFER = 10.0  # G (or hardness) of the slave's body over that of the master's that is pointed out
CHATTER = 10.0  # K h/M above which an explicit run pays for the penalty K
# Penalties in units of the stiffness of the elements beside them (`penalty_factor`). Up to a
# thousand times the default Newton's method converges as ever; from ten thousand times on it needs
# many more iterations, and rounding the coordinates begins to keep the residual above the
# tolerance.
STIFF_PENALTY = 3e4
SOFT_PENALTY = 0.1
STIFF_STICK = 5e3  # K_T h/G from which steps take several times the iterations
SOFT_STICK = 0.1  # K_T h/G below which the elastic slip is longer than the shear of the elements

WHOLE = 0.999  # tied share of a slave's area that counts as all of it


def stiffer_slave(
    index: int, contact: Contact, body: str, slave: Material, master: Material | None = None
) -> Iterator[str]:
    """A line on a slave that is on the stiffer body.

    Args:
        body: name of the slave's body.
        master: material of the other body; None: a tool.
    """
    if master is None:
        return
    if contact_shear_modulus(slave) > STIFFER * contact_shear_modulus(master):
        yield (
            f"contact.{index}: the slave {contact.slave} is on the stiffer body {body}; the "
            "softer body's surface should be the slave"
        )


def note_on_idle_film(place: str, contact: Contact) -> Iterator[str]:
    """A line on a film that the friction law has no use for."""
    if contact.given_film is not None and contact.acting_film is None:
        yield f'{place}: film has no effect with law = "{contact.friction.law}"'


def note_on_tie(place: str, contact: Contact, share: float) -> Iterator[str]:
    """A line on a slave that is tied in part only; ``share``: of the slave's area that is tied."""
    if share < WHOLE:
        yield (
            f"{place}: {contact.slave} is tied to {contact.master} over {100.0 * share:.3g} % of "
            "its area: the rest has nothing beside it"
        )


def notes_on_penalty(
    index: int, factor: float, pressure: PressureKind = "averaged", ratio: float | None = None
) -> Iterator[str]:
    """Lines on a penalty that is far from what works, or that shortens explicit steps.

    Args:
        pressure: "averaged" or "pointwise", which compare with other moduli.
        ratio: of that modulus to the oedometric one, where the run is explicit.
    """
    # Rounding may lift a penalty of just this size above it.
    if ratio is not None and factor * ratio > (1.0 + 1e-9) * CHATTER:
        yield (
            f"contact.{index}: a penalty of penalty_factor = {factor:.4g}, {factor * ratio:.3g} "
            "times the oedometric modulus over the length of a facet, shortens explicit steps, and "
            "its dashpots take what the nodes at the surface bring to an impact; "
            f"{1.0 / ratio:.2g} to {3.0 / ratio:.2g} is stiff enough for most"
        )
    if not SOFT_PENALTY <= factor <= STIFF_PENALTY:
        what = (
            "the bodies overlap rather than press on each other"
            if factor < SOFT_PENALTY
            else "Newton's method may fail or need many iterations"
        )
        modulus = "M" if pressure == "pointwise" else "max(10 G, M/10)"
        yield (
            f"contact.{index}: the penalty is {factor:.2g} times the stiffness {modulus}/h of the "
            f"softer body's elements beside it: {what}"
        )


def note_on_stick(index: int, friction: Friction, stiffness: float) -> Iterator[str]:
    """A line on dry friction that sticks far more softly, or stiffly, than the bodies shear.

    The default is found from the mesh and the bodies; a resolved case that is run with a finer mesh
    or a stiffer body keeps the value it had.

    Args:
        stiffness: Pa/m, G/h of the softer body beside the contact.
    """
    # The friction map's K_T is that of its asperities, not a penalty.
    if friction.law != MAP and (K_T := getattr(friction, "K_T", None)) is not None:
        factor = K_T / stiffness
        if factor < SOFT_STICK:
            yield (
                f"contact.{index}: K_T is {factor:.2g} times the stiffness G/h of the elements "
                "beside it: points move a good way before they slip (leave K_T out for 10 G/h)"
            )
        elif factor > STIFF_STICK:
            yield (
                f"contact.{index}: K_T is {factor:.2g} times the stiffness G/h of the elements "
                "beside it, which takes many iterations for nothing: 100 G/h leaves next to no "
                "elastic slip (leave K_T out for 10 G/h)"
            )
