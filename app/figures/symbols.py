"""What quantities are called in all figures: one name, one symbol and one unit for each."""

from __future__ import annotations

from dataclasses import dataclass


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
        """Text of an axis.

        Args:
            unit: that the axis is in; by default the SI unit.
        """
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
MEAN_PRESSURE = Quantity("mean pressure", "p = N/A", "Pa")
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
