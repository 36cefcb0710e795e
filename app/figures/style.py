"""The look all figures share, and what they need to read and write files."""

from __future__ import annotations

import math
import textwrap
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, FigureBase
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageChops, ImageOps

from tribox.app.results.directory import written_whole

if TYPE_CHECKING:
    from tribox.app.results import Results


Floats = NDArray[np.float64]
Longs = NDArray[np.int64]
Pixels = NDArray[np.uint8]

RED = "#b3202f"  # of lines that are second, and of what is wrong: the only one in figures
# Any two differ for readers without one kind of cones too; markers and dashes say the same.
COLOURS = ("#1b6ca8", RED, "#009e73", "#cc79a7", "#e69f00", "#2b2b2b")
FILLS = (*COLOURS[:1], *COLOURS[2:])  # of areas, with lines in red above them
DECADES, MANY_DECADES = 2.5, 5.0  # from which on an axis has ticks at 1, 2, 5; at 1 only
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
PLAIN = (1e-3, 1e5)  # numbers between these have no power of ten
MARGIN = 0.1  # inches of white round what is drawn
LEVEL = 1  # of zlib; 6, the default, takes much longer for a few per cent less
MARKERS = ("o", "s", "^", "D", "v", "P")
DASHES: tuple[Any, ...] = (
    *("-", (0, (6, 2)), (0, (6, 1.5, 1, 1.5)), (0, (3, 1.2)), (0, (9, 2))),
    (0, (6, 1.5, 1, 1.5, 1, 1.5)),
)
STYLE = {
    "font.size": 10,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "figure.dpi": 150,
}
# Of figures that hold names and titles of a case: a $ in them begins no formula. Logarithmic axes
# then need :func:`thin_log_ticks`, matplotlib's own powers of ten being formulae.
CASE_STYLE = STYLE | {"text.parse_math": False}


def save(figure: Figure, path: Path, *, tight: bool = True) -> None:
    """Write a PNG, complete or not at all; ``tight``: cut to what is drawn and a margin."""
    with written_whole(path, ".part.png") as part:
        _write(figure, part, tight)


def _write(figure: Figure, part: Path, tight: bool) -> None:
    canvas = FigureCanvasAgg(figure)
    # Constrained layout puts everything on the page; otherwise matplotlib finds where it ends.
    within = isinstance(figure.get_layout_engine(), ConstrainedLayoutEngine)
    if within or not tight:
        canvas.draw()
        # Without the channel of transparency, which is the same everywhere.
        picture = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())
        # Matplotlib would find what is not white by drawing everything twice more.
        left, top, right, bottom = box = ImageChops.invert(picture).getbbox() or (0, 0, 0, 0)
        inside = left > 0 and top > 0 and right < picture.width and bottom < picture.height
        if tight and inside:
            margin = round(MARGIN * figure.dpi)
            picture = ImageOps.expand(picture.crop(box), margin, "white")
        if inside or not tight or not any(box):
            picture.save(part, "png", dpi=(figure.dpi, figure.dpi), compress_level=LEVEL)
            return
    figure.savefig(part, bbox_inches="tight", pil_kwargs={"compress_level": LEVEL})


def panels_in(room: FigureBase, rows: int, columns: int, count: int) -> list[Axes]:
    """All panels of a grid, row by row; those from ``count`` on are not shown."""
    panels: list[Axes] = list(room.subplots(rows, columns, squeeze=False).flat)
    for idle in panels[count:]:
        idle.set_visible(False)
    return panels


def thin_log_ticks(axes: Axes) -> None:
    """On logarithmic axes few ticks, plain numbers or, over several decades, powers as plain text.

    Matplotlib's own eight ticks between two decades and its powers set as formulae take most of
    the time of a figure. To be called when the limits of the axes are what they will be.
    """
    for axis in (axes.xaxis, axes.yaxis):
        low, high = axis.get_view_interval()
        if axis.get_scale() != "log":
            continue
        if high < 10.0**DECADES * low:
            between = (1.0, 2.0, 5.0) if PLAIN[0] <= low and high < PLAIN[1] else (1.0, 3.0)
            axis.set_major_locator(MaxNLocator(5) if high < 4.0 * low else LogLocator(subs=between))
            axis.set_minor_locator(NullLocator())
            axis.set_major_formatter(FuncFormatter(lambda value, _: plain_number(value)))
            continue
        many = high > 10.0**MANY_DECADES * low
        axis.set_minor_locator(NullLocator() if many else LogLocator(subs=(2.0, 5.0)))
        axis.set_minor_formatter(NullFormatter())
        axis.set_major_formatter(FuncFormatter(lambda value, _: power_of_ten(value)))


def colour_of(number: int) -> str:
    """The colour of a line, an own one for each of the first."""
    return COLOURS[number % len(COLOURS)]


def marker_of(number: int) -> str:
    """The marker of a line's points."""
    return MARKERS[number % len(MARKERS)]


def dashes_of(number: int) -> Any:
    """The dashes of a line, as matplotlib's ``linestyle``."""
    return DASHES[number % len(DASHES)]


def look_of(number: int) -> dict[str, Any]:
    """Colour, marker and dashes of a line, as keywords of matplotlib's ``plot``."""
    return {"color": colour_of(number), "marker": marker_of(number), "ls": dashes_of(number)}


CROSSES = "grey crosses: NOT steady"


def cross_out(axes: Axes, x: Floats, y: Floats, wrong: NDArray[np.bool_]) -> None:
    """Grey crosses over points that were not steady when they were taken."""
    axes.plot(x[wrong], y[wrong], "x", color="0.45", ms=10, mew=2, zorder=5)


def plain_number(value: float) -> str:
    """A number such as 0.2 or 3·10⁵ in plain text."""
    if PLAIN[0] <= abs(value) < PLAIN[1] or value == 0.0:
        return f"{value:.4g}"
    digits, _, power = f"{value:.3e}".partition("e")
    mantissa = "" if float(digits) == 1.0 else f"{float(digits):g}·"
    return f"{mantissa}10" + f"{int(power)}".translate(RAISED)


def power_of_ten(value: float) -> str:
    """A decade such as 10⁻³ in plain text."""
    return "10" + f"{round(math.log10(value))}".translate(RAISED)


def columns(rows: list[dict[str, Any]], *names: str) -> list[Floats]:
    """Columns of a table's rows, each (n,)."""
    return [np.array([row[name] for row in rows]) for name in names]


# -- What quantities are called in all figures, and units that fit their values --------------------
#
# One name, one symbol and one unit for each; the prefix of the unit is that with which the largest
# of some values has one to three digits.


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
    """A unit to show values in."""

    power: int  # of ten, from it to SI
    name: str  # such as "µm"

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
    """The unit in which the largest of values has one to three digits before the point.

    Values in SI, those not finite do not count; other units than those in use have no prefix.
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
    """A quantity in figures."""

    name: str  # in words
    symbol: str  # plain text, "" without
    unit: str  # SI, "" of a plain number

    @property
    def words(self) -> str:
        """Name and symbol."""
        return f"{self.name} {self.symbol}".rstrip()

    def label(self, unit: str | None = None) -> str:
        """Text of an axis."""
        return f"{self.words} ({(self.unit if unit is None else unit) or '-'})"


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
    return [contact.label for contact in results.case.contact]


def unit_of_velocity(results: Results) -> Unit:
    """The unit in which all figures of a run, or of a sweep, give velocities."""
    table = results.table("history" if results.case.sweep is None else "sweep")
    return velocity_unit(table["velocity"] if len(table) and "velocity" in table else [])


def stage_ends(results: Results) -> list[tuple[str, int]]:
    """Each stage of a run with its last step, in order."""
    history = results.table("history")
    if not len(history):
        return []
    return [(str(stage), int(rows["step"][-1])) for stage, rows in history.parts("stage")]


def heading(results: Results, title: str) -> str:
    """Title of the case above what the picture shows."""
    return titled(results.case.title, title)


def titled(case: str, title: str) -> str:
    """Title of a case above what the picture shows, either of them "" without."""
    lines = [line for line in (case, title) if line]
    return "\n".join("\n".join(textwrap.wrap(line, TITLE_WIDTH)) for line in lines)
