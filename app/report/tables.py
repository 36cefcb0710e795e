"""Tables of the report: frames of results with titles, units and few digits."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from tribox.app.errors import SaidOnce
from tribox.app.figures.style import Unit, fitting
from tribox.app.simulation.history import DECLARED, UNBALANCED, Column

if TYPE_CHECKING:
    from pandas import DataFrame

ROUND_OFF = 1e-10  # beside the largest number of a table in the same unit
_STEADY = {1: "yes", 0: "no", -1: "–"}
_COUNTS = ("step", "newton_iterations", "linear_iterations")
_OF_A_LOAD_STEP = (
    *("label", "steady", "normal_force", "friction_force", "friction_coefficient"),
    *("tangential_force", "film_thickness", "effective_viscosity", "contact_area"),
    *("stick_fraction", "viscous_fraction", "max_penetration", "velocity", "time"),
)
_OF_A_SWEEP = (
    *("label", "stage", "velocity", "normal_force", "friction_force", "friction_coefficient"),
    *("tangential_force", "film_thickness", "effective_viscosity", "contact_area"),
    *("max_penetration", "steady", "time"),
)
_OF_A_PAIR = (
    *("pair", "label"),
    *(name for name in _OF_A_LOAD_STEP if name not in ("label", "steady", "time", "velocity")),
)
_MOTION = tuple(f"{kind}_{axis}" for kind in ("displacement", "velocity") for axis in "xyz")
_OF_A_SURFACE = (
    *("surface", "label", "force_x", "force_y", "force_z", "radial_force"),
    *("moment_x", "moment_y", "moment_z", *_MOTION),
)
_OF_A_BODY = (
    *("body", "label"),
    *(f"{kind}_force_{axis}" for kind in ("contact", "boundary") for axis in "xyz"),
    *_MOTION,
)
_OF_A_TOOL = (
    *("tool", "label", *(f"displacement_{axis}" for axis in "xyz"), "rotation"),
    *(f"{kind}_{axis}" for kind in ("force", "moment") for axis in "xyz"),
    *(f"driving_force_{axis}" for axis in "xyz"),
    "driving_moment",
)
_OF_A_SHAPE = (
    *("probe", "label", "angle", "bend_angle", "largest_turn", "radius", "off_circle", "length"),
    *("mean_thickness", "min_thickness", "max_thickness", "thinnest_at"),
)
_OF_NO_PAIR = ("label", "stage", "steady", "velocity", "time")
_OF_ONE_PAIR = ("film_thickness", "effective_viscosity")  # their means over several say little
_NONE_AT_0 = _OF_ONE_PAIR  # 0 stands for pairs without a film, and where nothing is driven
_FRICTION = ("friction_force", "tangential_force")  # in one unit, to be compared
_OVER_DECADES = ("velocity", "effective_viscosity", "slip_speed")  # with their SI unit then
MANY = 1e4  # largest over smallest
MANY_ROWS = 12  # from which a table of details is folded
_ALWAYS = (
    *("label", "pair", "surface", "body", "tool", "probe", "bend_angle", "time", "normal_force"),
    *("force_x", "force_y"),
)


@dataclass(frozen=True, slots=True)
class Table:
    """A table that is ready to be written."""

    caption: str  # what it holds
    # (title, unit) of each column; the first column names the row
    headings: Sequence[tuple[str, str]]
    rows: Sequence[Sequence[str]]  # text of the cells
    folded: bool = False  # whether it is shown only when asked for


def load_step_table(load_steps: DataFrame, pairs: int = 1) -> Table | None:
    """The last step of each load step; None without any."""
    caption = "At the end of each load step"
    return frame_table(load_steps, _of_pairs(_OF_A_LOAD_STEP, pairs), caption + _words(pairs))


def end_table(history: DataFrame, pairs: int = 1) -> Table | None:
    """The last step of a run that ended within a load step; None without a history."""
    names = _of_pairs(("stage", *_OF_A_LOAD_STEP[2:]), pairs)
    caption = "After the last step that was solved" + _words(pairs)
    return frame_table(history.tail(1), names, caption)


def sweep_table(sweep: DataFrame, pairs: int = 1) -> Table | None:
    """All values and load steps of a sweep in one table; None without any."""
    caption = "All values at the end of each load step" + _words(pairs)
    return frame_table(sweep, _of_pairs(_OF_A_SWEEP, pairs), caption, "value")


_BESIDE = {
    "run": ("normal_force", "friction_force", "friction_coefficient", "contact_area"),
    "pair": ("normal_force", "friction_force", "friction_coefficient"),
    "tool": (
        *(f"{kind}_{axis}" for kind in ("displacement", "force") for axis in "xyz"),
        *("rotation", "moment_x", "moment_y", "moment_z", "driving_moment"),
    ),
    "probe": (
        *("bend_angle", "springback", "radius", "mean_thickness", "min_thickness"),
        "max_thickness",
    ),
}


def comparison_tables(sweep: DataFrame, details: DataFrame, labels: Sequence[str]) -> list[Table]:
    """The runs of a sweep beside each other at the end of each stage: a column for each value."""
    if sweep.empty or len(labels) < 2:
        return []
    tables = []
    for stage in dict.fromkeys(sweep["stage"]):
        rows = _beside(sweep, str(stage), "", "run", labels)
        for kind in ("pair", "tool", "probe") if not details.empty else ():
            for name, part in details[details["kind"] == kind].groupby("name", sort=False):
                rows += _beside(part, str(stage), f"{name}: ", kind, labels)
        if rows:
            headings = [("quantity", ""), *((label, "") for label in labels)]
            tables.append(Table(f"Beside each other at the end of {stage}", headings, rows))
    return tables


def _beside(
    frame: DataFrame, stage: str, who: str, kind: str, labels: Sequence[str]
) -> list[list[str]]:
    """A row for each quantity: what it is, with its unit, and its value in each run.

    Those that are round-off beside what they are in other stages are left out.
    """
    last = frame[frame["stage"] == stage].groupby("label", sort=False).tail(1).set_index("label")
    rows = []
    for name in _BESIDE[kind]:
        noise = ROUND_OFF * frame[name].abs().max() if name in frame else math.inf
        if not (noise < math.inf and (last[name].abs() > noise).any()):
            continue
        known = column(name)
        values = [float(last[name].get(label, float("nan"))) for label in labels]
        scale = fitting(values, known.unit)
        if known.unit == "rad":
            values, scale = [math.degrees(value) for value in values], Unit(0, "°")
            noise = math.degrees(noise)
        title = f"{who}{known.title}" + (f" ({scale.name})" if scale.name else "")
        rows.append([title, *(_text(value, name, scale, noise) for value in values)])
    return rows


def _of_pairs(names: Sequence[str], pairs: int) -> list[str]:
    """Columns that tell something of so many pairs together; none of contact without pairs."""
    if pairs == 0:
        return [name for name in names if name in _OF_NO_PAIR]
    return [name for name in names if pairs == 1 or name not in _OF_ONE_PAIR]


def _words(pairs: int) -> str:
    return "" if pairs <= 1 else ", all pairs together"


def detail_tables(
    load_steps: DataFrame,
    contacts: DataFrame,
    surfaces: DataFrame,
    bodies: DataFrame,
    tools: DataFrame,
    shapes: DataFrame,
) -> list[Table]:
    """Pairs, shapes, tools, surfaces and bodies at the end of each load step, those that there are.

    Of one pair alone the table of load steps has told all. Of tools there is a table of the largest
    values of all steps too.
    """
    if not contacts.empty and contacts["pair"].nunique() == 1:
        contacts = contacts.head(0)
    made = [
        frame_table(_ends(frame, load_steps, first), names, caption)
        for frame, first, names, caption in (
            (contacts, "pair", _OF_A_PAIR, "Each pair at the end of each load step"),
            (shapes, "probe", _OF_A_SHAPE, "Shape of surfaces: angle, radius and thickness"),
            (tools, "tool", _OF_A_TOOL, "Tools: force and moment of the bodies on them"),
            (surfaces, "surface", _OF_A_SURFACE, "Surfaces with a boundary: force on the body"),
            (bodies, "body", _OF_A_BODY, "Bodies: forces on them, and their centres"),
        )
    ]
    peaks = [name for name in _OF_A_TOOL if name != "label"]
    most = frame_table(_largest(tools, "tool"), peaks, "Tools: largest value of each over the run")
    made.insert(3, most)
    tables = [table for table in made if table is not None]
    return [replace(t, folded=len(t.rows) > MANY_ROWS) for t in tables]


def _ends(frame: DataFrame, load_steps: DataFrame, first: str) -> DataFrame:
    """The rows of a table at the ends of load steps, with their labels, sorted by name."""
    if frame.empty or load_steps.empty or first not in frame:
        return frame.head(0)
    found = frame.merge(load_steps[["step", "label"]], on="step", how="inner")
    order = {name: place for place, name in enumerate(dict.fromkeys(frame[first]))}
    return found.sort_values(first, key=lambda names: names.map(order), kind="stable")


def _largest(frame: DataFrame, first: str) -> DataFrame:
    """Of each name in a column the values that are largest in size, with their signs, of its rows.

    They need not be of one step.
    """
    if frame.empty or first not in frame:
        return frame.head(0)
    parts = frame.groupby(first, sort=False)
    numbers = frame.select_dtypes("number").columns
    return parts[list(numbers)].agg(lambda one: one.loc[one.abs().idxmax()]).reset_index()


def frame_table(
    frame: DataFrame, names: Sequence[str], caption: str, first: str = ""
) -> Table | None:
    """Rows of a frame by some columns, but those that are 0 everywhere; None without rows.

    ``first``: title of the first column, where it is not the usual one.
    """
    if frame.empty:
        return None
    kept = [name for name in names if name in frame.columns and _tells(frame, name)]
    # What counts as round-off beside the largest value in the same unit; of ratios beside 1
    noise = {"": ROUND_OFF}
    for name in kept:
        unit = column(name).unit
        if unit:
            noise[unit] = max(noise.get(unit, 0.0), ROUND_OFF * float(frame[name].abs().max()))
    noise = noise if {"N", "N m"} & noise.keys() else {}
    columns, headings = [], []
    for name in kept:
        texts, unit = _cells(frame, name, noise.get(column(name).unit, 0.0))
        columns.append(texts)
        headings.append((column(name).title, unit))
    headings[0] = (first or headings[0][0], headings[0][1])
    return Table(caption, headings, list(zip(*columns, strict=True)))


def _tells(frame: DataFrame, name: str) -> bool:
    if name == "steady":
        return bool((frame[name] >= 0).any())
    return name in _ALWAYS or frame[name].dtype == object or bool((frame[name] != 0.0).any())


def _cells(frame: DataFrame, name: str, noise: float) -> tuple[list[str], str]:
    """Text of a column's cells, and their unit."""
    values = frame[name].tolist()
    if any(isinstance(value, str) for value in values):
        return [str(value) for value in values], ""
    if name == "steady":
        return [_STEADY.get(int(value), "–") for value in values], ""
    if name in _COUNTS:
        return [f"{value:.0f}" for value in values], ""
    wide = name in _OVER_DECADES and _spread(values) > MANY
    together = [other for other in _FRICTION if name in _FRICTION and other in frame.columns]
    sizes = frame[together].to_numpy().ravel().tolist() if together else values
    scale = Unit(0, column(name).unit) if wide else fitting(sizes, column(name).unit)
    if name == "time":
        # Numbers with as many digits as tell them apart
        for digits in range(6, 17):
            texts = [scale.number(value, digits) for value in values]
            if len(set(texts)) == len(set(values)):
                break
        return texts, scale.name
    return [_text(value, name, scale, noise) for value in values], scale.name


def _text(value: float, name: str, scale: Unit, noise: float) -> str:
    if value == 0.0 and name in _NONE_AT_0:
        return "–"
    return "≈ 0" if 0.0 < abs(value) < noise else scale.number(value)


def _spread(values: Sequence[float]) -> float:
    """Largest over smallest of the sizes of values, zeros left out; 1 without any."""
    sizes = [abs(value) for value in values if value != 0.0]
    return max(sizes) / min(sizes) if sizes else 1.0


# -- What the columns of the tables are called in the report, and their units ----------------------


_TITLES = {  # where the name with blanks says too little; of vectors with their axis
    "label": "load step",
    "off_circle": "off the circle",
    "min_thickness": "least thickness",
    "max_thickness": "largest thickness",
    "rotation": "rotation θ",
    "displacement": "displacement u_{}",
    "velocity": "velocity v_{}",
    "force": "force R_{}",
    "moment": "moment M_{}",
    "boundary_force": "force of boundaries, {}",
    "contact_force": "force of contacts, {}",
    "driving_force": "driving force, {}",
}
_UNITS = {
    **dict.fromkeys(("angle", "bend_angle", "largest_turn", "springback", "rotation"), "rad"),
    **dict.fromkeys(("radius", "off_circle", "length", "thinnest_at", "displacement"), "m"),
    **dict.fromkeys((f"{which}_thickness" for which in ("mean", "min", "max")), "m"),
    **dict.fromkeys(("force", "radial_force", "contact_force", "boundary_force"), "N"),
    **{"driving_force": "N", "moment": "N m", "driving_moment": "N m", "velocity": "m/s"},
}


def column(name: str) -> Column:
    """Title and unit of a column: of the history as declared there, of others by their words."""
    if (known := DECLARED.get(name)) is not None:
        return Column(known.title, known.unit.replace("text", ""))
    kind, _, axis = name.rpartition("_")
    if axis not in ("x", "y", "z"):
        kind, axis = name, ""
    title = _TITLES.get(kind, name.replace("_", " "))
    return Column(title.format(axis), _UNITS.get(kind, ""))


# -- How a run ended and whether its energies add up, in words with numbers ------------------------


_PARTS = (
    ("external_work", "work of supports and loads"),
    ("strain_energy", "stored in the bodies"),
    ("kinetic_energy", "kinetic"),
    ("interface_energy", "stored in the contact"),
    ("friction", "dissipated"),
    ("plastic_dissipation", "of that by plastic flow in the bodies"),
    ("viscous_dissipation", "of that by viscosity of the bodies"),
    ("damping_dissipation", "taken by damping"),
    ("energy_error", "unaccounted for"),
    ("numerical_dissipation", "more dissipated by the length of the steps"),
)


@dataclass(frozen=True, slots=True)
class Verdict:
    """A judgement."""

    kind: str  # "good", "fair" or "bad"
    word: str  # in short
    text: str  # in full


def status_verdict(summary: Mapping[str, Any], unfinished: str | None = None) -> Verdict:
    """How a run ended."""
    status = summary.get("status")
    if status == "done":
        unsteady = [one["label"] for one in summary["load_steps"] if one["steady"] is False]
        if unsteady:
            which = ", ".join(unsteady)
            return Verdict("fair", "done, not steady", f"Not steady at the end: {which}.")
        return Verdict("good", "done", "The run went to its end.")
    if status == "failed":
        return Verdict("bad", "failed", str(summary.get("failure") or "No step was solved."))
    if status == "interrupted":
        return Verdict("fair", "interrupted", "The run was stopped; this is what it had solved.")
    return Verdict("fair", "unfinished", f"The run {unfinished or 'does not say how it ended'}.")


def energy_verdict(history: DataFrame, summary: Mapping[str, Any]) -> Verdict | None:
    """Whether energies add up; None without a history."""
    if history.empty or "energy_error" not in history:
        return None
    if "force_balance_relative" in summary and summary["force_balance_relative"] is None:
        if not summary.get("explicit"):
            return Verdict("fair", "nothing acted", "No force beyond rounding acts on any body.")
    last = history.iloc[-1]
    work = _largest_work(history)
    gap = summary.get("energy_error_relative", last["energy_error"] / work if work else 0.0)
    scale = fitting([work], "J")
    what = f"{abs(100.0 * gap):.2g} % of the largest work or kinetic energy, "
    what += scale.text(work)
    if abs(gap) <= UNBALANCED:
        return Verdict("good", "energies add up", f"All but {what}, is accounted for.")
    return Verdict(
        "bad",
        "energies do not add up",
        f"Unaccounted for are {what}. Smaller steps or a finer master may help; the numbers of "
        "this run are not to be relied on.",
    )


def _largest_work(history: DataFrame) -> float:
    """Largest external work or kinetic energy, J."""
    return float(max(history["external_work"].abs().max(), history["kinetic_energy"].max()))


def energy_table(history: DataFrame) -> Table | None:
    """Energies after the last step, J, and their shares of the largest work."""
    if history.empty or "energy_error" not in history:
        return None
    last = dict(history.iloc[-1])
    last["friction"] = last["dissipation"] - last["numerical_dissipation"]
    for name in ("plastic_dissipation", "viscous_dissipation"):
        last.setdefault(name, 0.0)  # results of before there was any
        last["friction"] += last[name]
    work = _largest_work(history)
    scale = fitting([work], "J")
    rows = [
        (title, scale.number(last[name]), f"{100.0 * last[name] / work:.3g}" if work else "–")
        for name, title in _PARTS
        if last[name] != 0.0
    ]
    headings = [("part", ""), ("energy", scale.name), ("share", "%")]
    return Table("Energies since the start", headings, rows)


def cost_table(summary: Mapping[str, Any]) -> Table | None:
    """Wall time by part; None where the run did not say."""
    seconds = summary.get("seconds", {})
    whole = seconds.get("run", 0.0)
    if not whole:
        return None
    parts = sorted(seconds.items(), key=lambda one: -one[1])
    rows = [
        ("all" if name == "run" else name, f"{value:.3g}", f"{100.0 * value / whole:.0f}")
        for name, value in parts
    ]
    return Table("Wall time", [("part", ""), ("time", "s"), ("share", "%")], rows)


def facts(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """(name, value) of the size of a run and of what it was made with."""
    found = []
    explicit = "explicit" in summary
    for key, name in (
        ("steps", "rows" if explicit else "steps"),
        ("newton_iterations", "Newton iterations"),
        ("attempts", "time steps" if explicit else "attempts at steps"),
        ("dofs", "unknowns"),
        ("ranks", "ranks"),
    ):
        if key in summary:
            found.append((name, f"{summary[key]:,}".replace(",", "\u202f")))
    if memory := summary.get("memory_MiB_per_rank"):
        found.append(("peak memory of all ranks", f"{sum(memory):.0f} MiB"))
    for about in ("versions", "host"):
        found += [(name, str(value)) for name, value in summary.get(about, {}).items()]
    return found


def origin(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """(name, value) of when, and by what command, a run was made; what it has told."""
    found = []
    if started := summary.get("started"):
        seconds = summary.get("seconds", {}).get("run")
        took = "" if seconds is None else f", took {seconds:.3g} s"
        found.append(
            ("started", f"{str(started).replace('T', ' ').replace('+00:00', ' UTC')}{took}")
        )
    if command := summary.get("command"):
        found.append(("command", str(command)))
    if host := summary.get("host", {}).get("system"):
        found.append(("on", str(host)))
    return found


def notes_and_warnings(summary: Mapping[str, Any]) -> tuple[list[str], list[str]]:
    """Notes before the first step, and warnings of the run; of old results all are warnings."""
    once = SaidOnce()
    lines, notes = (
        [once(line) for line in summary.get("warnings", [])],
        int(summary.get("notes", 0)),
    )
    return lines[:notes], lines[notes:]
