"""How a run ended and whether its energies add up, in words with numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from tribox.app.errors import SaidOnce
from tribox.app.figures.units import fitting
from tribox.app.report.tables import Table

if TYPE_CHECKING:
    from pandas import DataFrame

UNBALANCED = 0.01  # energy error over the work from which on a run is warned of
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
    """A judgement.

    Attributes:
        kind: "good", "fair" or "bad"; word: in short; text: in full.
    """

    kind: str
    word: str
    text: str


def status_verdict(summary: Mapping[str, Any], unfinished: str | None = None) -> Verdict:
    """How a run ended.

    Args:
        summary: of the run; empty where it did not write any.
        unfinished: why it does not say how it ended, as ``Results.unfinished``.
    """
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
    work = _largest(history)
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


def _largest(history: DataFrame) -> float:
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
    work = _largest(history)
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
    """What was noted before the first step, and what was warned of in the run.

    Results of before there was a number of notes have warnings only.
    """
    once = SaidOnce()
    lines, notes = (
        [once(line) for line in summary.get("warnings", [])],
        int(summary.get("notes", 0)),
    )
    return lines[:notes], lines[notes:]
