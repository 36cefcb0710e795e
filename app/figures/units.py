"""What quantities are called in all figures, and units that fit their values.

One name, one symbol and one unit for each; the prefix of the unit is that with which the largest of
some values has one to three digits.
"""

from __future__ import annotations

import math
import textwrap
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from tribox.app.figures.style import Floats, plain_number

if TYPE_CHECKING:
    from tribox.app.results import Results

PREFIXES = {9: "G", 6: "M", 3: "k", 0: "", -3: "m", -6: "µ", -9: "n", -12: "p"}
_ALL, _SMALL, _LARGE = range(-12, 10), range(-12, 1), range(10)
# Units that take a prefix: its powers of ten in use, and the power of the unit under it. Nobody
# says km of a contact, or ks; and pressures below 1 Pa are noise.
_SCALED = {
    **dict.fromkeys(("m", "s", "m/s"), (_SMALL, 1)),
    **dict.fromkeys(("Pa", "Pa/m"), (_LARGE, 1)),
    **dict.fromkeys(("N", "J", "N m", "Pa s", "J/m²"), (_ALL, 1)),
    "m²": (_SMALL, 2),
}
MANY = 1e4  # largest over smallest velocity from which on no prefix fits all of a run


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit to show values in.

    Attributes:
        power: of ten, from it to SI; name: such as "µm".
    """

    power: int
    name: str

    @property
    def factor(self) -> float:
        """What SI values are multiplied by."""
        return 10.0**-self.power

    def of(self, values: ArrayLike) -> Floats:
        """Values given in SI, in this unit."""
        return np.asarray(values, dtype=np.float64) * self.factor

    def number(self, value: float, digits: int = 4) -> str:
        """A value given in SI, in this unit, without its name."""
        # With 0 added −0 is 0.
        return f"{value * self.factor + 0.0:.{digits}g}" if math.isfinite(value) else "–"

    def text(self, value: float) -> str:
        """A value given in SI, with the unit behind it."""
        return f"{self.number(value)} {self.name}".rstrip()


def fitting(values: ArrayLike, unit: str) -> Unit:
    """The unit in which the largest of the values has one to three digits before the point.

    Args:
        values: in SI; those that are not finite do not count.
        unit: the SI unit, such as "m"; others than those in use, and plain numbers, have no prefix.
    """
    found: Floats = np.abs(np.asarray(values, dtype=np.float64))
    largest = float(np.max(found, initial=0.0, where=np.isfinite(found)))
    if unit not in _SCALED or largest == 0.0:
        return Unit(0, unit)
    powers, exponent = _SCALED[unit]
    usual = [power for power in PREFIXES if power in powers]
    # A hair below, since 1 mm may come as 0.000999999….
    fits = [p for p in usual if largest >= 10.0 ** (p * exponent) * (1.0 - 1e-9)]
    power = fits[0] if fits else usual[-1]
    return Unit(power * exponent, PREFIXES[power] + unit)


def velocity_unit(speeds: ArrayLike) -> Unit:
    """The one unit of a run's velocities: with a prefix, unless they span too many decades.

    Zeros, and what is not finite, do not count.
    """
    found = np.abs(np.asarray(speeds, dtype=np.float64))
    found = found[np.isfinite(found) & (found > 0.0)]
    if len(found) and found.max() > MANY * found.min():
        return Unit(0, "m/s")
    return fitting(found, "m/s")


def velocity_text(speed: float, unit: Unit) -> str:
    """A velocity, m/s, in the unit of its run, such as "30 µm/s" or "3·10⁻⁸ m/s"."""
    return f"{plain_number(float(unit.of(speed)))} {unit.name}"


# -- Names ----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Quantity:
    """A quantity in figures.

    Attributes:
        name: in words; symbol: plain text, "" without; unit: SI, "" of a plain number.
    """

    name: str
    symbol: str
    unit: str

    def label(self, unit: str | None = None) -> str:
        """Text of an axis."""
        shown = self.unit if unit is None else unit
        words = f"{self.name} {self.symbol}".rstrip()
        return f"{words} ({shown or '-'})"


TIME = Quantity("time", "t", "s")
STEP = Quantity("step", "", "")
DRIVEN_PATH = Quantity("path of the driven surface", "", "m")
VELOCITY = Quantity("sliding velocity", "V", "m/s")
FILM = Quantity("film thickness", "D", "m")
NORMAL_FORCE = Quantity("normal force", "N", "N")
FRICTION_FORCE = Quantity("friction force", "F_T", "N")
RATIO = Quantity("friction coefficient", "F_T/N", "")
MEAN_TRACTION = Quantity("friction per area", "F_T/A", "Pa")
CONTACT_PRESSURE = Quantity("contact pressure", "t_N", "Pa")
TRACTION = Quantity("friction traction", "T", "Pa")
LOCAL_RATIO = Quantity("friction coefficient", "T/p", "")
VISCOSITY = Quantity("effective viscosity", "η_eff", "Pa s")
SHEAR_RATE = Quantity("shear rate", "V/D", "1/s")
HERSEY = Quantity("Hersey length", "η_b V/p", "m")
SLIP = Quantity("slip", "", "m")
DISPLACEMENT = Quantity("displacement", "u", "m")
REACTION = Quantity("force", "R", "N")
MOMENT = Quantity("moment", "M", "N m")
ENERGY = Quantity("energy", "", "J")

# Arrays of the field files, by name. Anything else is shown under its own name and without a unit.
FIELDS = {
    "von_mises_stress": Quantity("von Mises stress", "", "Pa"),
    "cauchy_stress": Quantity("Cauchy stress", "σ", "Pa"),
    "pressure": Quantity("pressure −tr σ/3", "", "Pa"),
    "displacement": Quantity("displacement", "u", "m"),
    "contact_pressure": CONTACT_PRESSURE,
    "J": Quantity("volume ratio", "J", ""),
    "max_stretch": Quantity("largest stretch", "", ""),
    "log_strain": Quantity("logarithmic strain", "ε", ""),
    "equivalent_plastic_strain": Quantity("equivalent plastic strain", "α", ""),
    "triaxiality": Quantity("triaxiality", "σ_m/σ_vM", ""),
    "thickness_strain": Quantity("thickness strain", "ε_t", ""),
}


# -- What bodies, axes, pairs and pictures of a run are called in its figures ----------------------

TITLE_WIDTH = 110  # characters


def body_names(results: Results) -> list[str]:
    """Names of the bodies in the order of their numbers in the field files."""
    return list(results.summary.get("bodies", results.case.bodies))


def axis_names(results: Results) -> tuple[str, str]:
    """Names of the two axes of a mesh in the plane."""
    section = results.case.geometry.built_section
    return ("r", "z") if section == "axisymmetric" else ("x", "y")


def pair_names(results: Results) -> list[str]:
    """Names of the contact pairs in the order of the case."""
    return [getattr(c, "name", None) or f"{c.slave}-{c.master}" for c in results.case.contact]


def unit_of_velocity(results: Results) -> Unit:
    """The unit in which all figures of a run, or of a sweep, give velocities."""
    table = results.table("history" if results.case.sweep is None else "sweep")
    return velocity_unit(table["velocity"] if len(table) and "velocity" in table else [])


def heading(results: Results, title: str) -> str:
    """Title of the case above what the picture shows."""
    return titled(results.case.title, title)


def titled(case: str, title: str) -> str:
    """Title of a case above what the picture shows, either of them "" without."""
    lines = [line for line in (case, title) if line]
    return "\n".join("\n".join(textwrap.wrap(line, TITLE_WIDTH)) for line in lines)
