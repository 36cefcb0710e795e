"""The tables of ``tribox bench``, as Markdown."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

# The parts an attempt at a step consists of, by what they belong to.
SOLIDS = ("solid residual", "solid tangent", "constrained rows")
CONTACT_FORCES = (
    "search",
    "projection",
    "kinematics",
    "law",
    "nodal forces",
    "merge into the residual",
    "rest of contact",
)
CONTACT_TANGENT = ("tangent blocks", "merge into the matrix")
CONTACT = (*CONTACT_FORCES, *CONTACT_TANGENT)
FACTORISATION = ("symbolic factorisation", "numeric factorisation")
SOLVE = ("solve",)
SOLVER = (*SOLIDS, *CONTACT, "pattern", *FACTORISATION, *SOLVE, "rest of solver")
SET_UP = ("imports", "set-up")
PARTS = (*SET_UP, *SOLVER, "between steps", "output", "figures")


@dataclass(frozen=True, slots=True)
class Measured:
    """One run.

    Attributes:
        name: of the run; level: of its mesh; dofs: unknowns; steps: converged; attempts: tried.
        iterations: of Newton, those of rejected attempts and the predictor's solves included.
        gross: most iterations in a step of gross sliding; 0 without such a step.
        command: CPU seconds of the whole process; seconds: by part; calls: of each part.
        factorisation: CPU seconds of one analysis and factorisation of the last tangent.
        memory: MiB, largest resident memory of the process.
    """

    name: str
    level: int
    dofs: int
    steps: int
    attempts: int
    iterations: int
    gross: int
    command: float
    seconds: dict[str, float]
    calls: dict[str, int]
    factorisation: float
    memory: float

    def sum(self, parts: Sequence[str]) -> float:
        """CPU seconds of some parts."""
        return sum(self.seconds.get(part, 0.0) for part in parts)

    @property
    def without_set_up(self) -> float:
        """CPU seconds of the command but for imports and the making of mesh, forms and contact."""
        return self.command - self.sum(SET_UP)

    @property
    def bare(self) -> float:
        """CPU seconds of solid assembly, factorisation and solve."""
        return self.sum((*SOLIDS, *FACTORISATION, *SOLVE))

    @property
    def tangents(self) -> int:
        """Tangents assembled and factorised."""
        return self.calls["solid tangent"]

    @property
    def solid_tangent(self) -> float:
        """CPU seconds of one assembly of the solids' tangent."""
        return self.seconds["solid tangent"] / self.tangents

    @property
    def evaluations(self) -> int:
        """Residuals evaluated."""
        return self.calls["merge into the residual"]

    @property
    def solves(self) -> int:
        """Linear solves: those of the iterations, and the predictor's with an old factor."""
        return self.calls["solve"]

    @property
    def full_bare(self) -> float:
        """CPU seconds of a full iteration without contact: a residual, a new tangent, a solve."""
        return (
            self.sum(("solid residual",)) / self.evaluations
            + self.sum(("solid tangent", "constrained rows", *FACTORISATION)) / self.tangents
            + self.sum(SOLVE) / self.solves
        )

    @property
    def full_contact(self) -> float:
        """CPU seconds that contact and all else add to a full iteration."""
        return (
            self.sum(CONTACT_FORCES) / self.evaluations
            + self.sum((*CONTACT_TANGENT, "pattern")) / self.tangents
            + self.sum(("rest of solver",)) / self.iterations
        )


Figure = Callable[[Measured], str]


def _milliseconds(parts: Sequence[str]) -> Figure:
    return lambda run: f"{1e3 * run.sum(parts) / run.iterations:.2f}"


RUNS: dict[str, Figure] = {
    "dofs": lambda run: f"{run.dofs}",
    "steps": lambda run: f"{run.steps}",
    "attempts": lambda run: f"{run.attempts}",
    "Newton": lambda run: f"{run.iterations}",
    "tangents factorised": lambda run: f"{run.tangents}",
    "linear solves": lambda run: f"{run.solves}",
    "residuals evaluated": lambda run: f"{run.evaluations}",
    "most in gross sliding": lambda run: f"{run.gross}" if run.gross else "–",
    "command (s)": lambda run: f"{run.command:.2f}",
    "without set-up (s)": lambda run: f"{run.without_set_up:.2f}",
    "peak memory (MiB)": lambda run: f"{run.memory:.0f}",
}
ITERATION: dict[str, Figure] = {
    "whole iteration (ms)": _milliseconds(SOLVER),
    "solid assembly (ms)": _milliseconds(SOLIDS),
    "factorisation (ms)": _milliseconds(FACTORISATION),
    "solve (ms)": _milliseconds(SOLVE),
    "contact (ms)": _milliseconds(CONTACT),
    **{f"– {part} (ms)": _milliseconds((part,)) for part in CONTACT},
    "pattern (ms)": _milliseconds(("pattern",)),
    "rest (ms)": _milliseconds(("rest of solver",)),
    "full iteration without contact (ms)": lambda run: f"{1e3 * run.full_bare:.2f}",
    "one solid tangent assembly (ms)": lambda run: f"{1e3 * run.solid_tangent:.2f}",
    "one MUMPS factorisation (ms)": lambda run: f"{1e3 * run.factorisation:.2f}",
    "**whole / (solid assembly + factorisation + solve)**": (
        lambda run: f"**{run.sum(SOLVER) / run.bare:.3f}**"
    ),
    "**the same of a full iteration**": (
        lambda run: f"**{1.0 + run.full_contact / run.full_bare:.3f}**"
    ),
    "**contact / one solid tangent assembly**": (
        lambda run: f"**{run.sum(CONTACT) / run.iterations / run.solid_tangent:.2f}**"
    ),
    "whole / one MUMPS factorisation": (
        lambda run: f"{run.sum(SOLVER) / run.iterations / run.factorisation:.2f}"
    ),
    "command without set-up / one MUMPS factorisation": (
        lambda run: f"{run.without_set_up / run.factorisation:.0f}"
    ),
}
GROWTH: dict[str, Callable[[Measured], float]] = {
    "dofs": lambda run: run.dofs,
    "Newton iterations": lambda run: run.iterations,
    "CPU without set-up": lambda run: run.without_set_up,
    "one iteration": lambda run: run.sum(SOLVER) / run.iterations,
    "solid assembly": lambda run: run.sum(SOLIDS) / run.iterations,
    "contact": lambda run: run.sum(CONTACT) / run.iterations,
    "one MUMPS factorisation": lambda run: run.factorisation,
    "peak memory": lambda run: run.memory,
}


def tables(runs: Sequence[Measured]) -> Iterator[str]:
    """Lines of the report: runs, CPU by part, one iteration, growth from level to level."""
    yield from _table("run", runs, RUNS)
    yield from ("", "CPU seconds of the command by part (share of the command):", "")
    parts = {part: _share(part) for part in PARTS}
    yield from _table("part", runs, parts)
    yield from ("", "One Newton iteration, mean of the run, CPU time:", "")
    yield from _table("", runs, ITERATION)
    steps = [
        (before, after)
        for before, after in pairwise(sorted(runs, key=lambda run: (run.name, run.level)))
        if before.name == after.name
    ]
    if steps:
        yield from ("", "Growth from level to level:", "")
        yield "| |" + "|".join(f" {_name(a, runs)} → {b.level} " for a, b in steps) + "|"
        yield "|---" * (len(steps) + 1) + "|"
        for row, value in GROWTH.items():
            cells = " | ".join(f"× {value(b) / value(a):.2f}" for a, b in steps)
            yield f"| {row} | {cells} |"


def _share(part: str) -> Figure:
    def cell(run: Measured) -> str:
        seconds = run.sum((part,))
        return f"{seconds:.3f} ({100.0 * seconds / run.command:.0f} %)"

    return cell


def _name(run: Measured, runs: Sequence[Measured]) -> str:
    """Heading of a run: its level, and its name where there are several."""
    several = len({other.name for other in runs}) > 1
    levels = len({other.level for other in runs}) > 1
    level = f"level {run.level}"
    return f"{run.name}, {level}" if several and levels else run.name if several else level


def _table(corner: str, runs: Sequence[Measured], rows: dict[str, Figure]) -> Iterator[str]:
    """One column for each run."""
    yield f"| {corner} | " + " | ".join(_name(run, runs) for run in runs) + " |"
    yield "|---" * (len(runs) + 1) + "|"
    for row, figure in rows.items():
        yield f"| {row} | " + " | ".join(figure(run) for run in runs) + " |"
