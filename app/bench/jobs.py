"""What ``tribox bench`` runs: cases at mesh levels, every value of a sweep by itself."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tribox.app.case.case import Case
from tribox.app.case.generators import BlocksGeometry, BoxesGeometry
from tribox.app.case.reading import load_case
from tribox.app.case.stage import solver_of
from tribox.app.errors import InputError

LEVELS = (1, 2, 4)
HIGHEST = 64


@dataclass(frozen=True, slots=True)
class Job:
    """One run to be measured.

    Attributes:
        name: for the tables; level: how finely it is meshed, 1 being the case as it is.
        words: what ``tribox run`` is called with, but for the results directory.
    """

    name: str
    level: int
    words: tuple[str, ...]

    def __str__(self) -> str:
        """For messages."""
        return f"{self.name}, level {self.level}"


def levels_of(words: Sequence[str], names: Sequence[str]) -> tuple[int, ...]:
    """The mesh levels that words ask for, none for none.

    Args:
        words: of the command line.
        names: of what may be measured in the place of levels.

    Raises:
        InputError: a word is no level.
    """
    for word in words:
        if not (word.isdecimal() and 1 <= int(word) <= HIGHEST):
            raise InputError(
                f'bench: "{word}" is neither a mesh level (1 to {HIGHEST}) nor one of: '
                + ", ".join(names)
            )
    return tuple(sorted({int(word) for word in words}))


def jobs_of(case_file: Path, levels: Sequence[int], changes: Sequence[str] = ()) -> Iterator[Job]:
    """The runs of a case at some mesh levels, every value of its sweep by itself.

    Args:
        case_file: the case.
        levels: of its mesh.
        changes: KEY=VALUE, keys to change.

    Raises:
        InputError: the case is wrong, or has a mesh that cannot be refined.
    """
    case = load_case(case_file, changes)
    refined = {level: level_options(case, level) for level in levels}
    labels = [label for label, _ in case.sweep_cases()]
    path = str(case_file.resolve())
    for level, options in refined.items():
        words = (path, *set_options(changes), *options)
        if not labels:
            yield Job(case_file.stem, level, words)
        for part, label in enumerate(labels):
            yield Job(label, level, (*words, "--part", str(part)))


def check_has_iterations(case_file: Path, changes: Sequence[str]) -> None:
    """Refuse a case without implicit stages: the tables of one run are about Newton iterations.

    Raises:
        InputError: all stages are explicit.
    """
    case = load_case(case_file, changes)
    if all(solver_of(stage, case.solver.kind) == "explicit" for stage in case.stage):
        raise InputError(
            f"bench: {case_file}: all stages are explicit, and the tables are of Newton "
            'iterations; compare with --against, --with or --np, or time "tribox bench explicit"'
        )


def set_options(changes: Sequence[str]) -> tuple[str, ...]:
    """Options of ``tribox run`` that change keys of the case, given as KEY=VALUE."""
    return tuple(word for change in changes for word in ("--set", change))


def level_options(case: Case, level: int) -> list[str]:
    """Options of ``tribox run`` that mesh the two blocks of ``case`` ``level`` times as finely.

    Raises:
        InputError: the mesh is not that of two blocks or boxes and the level is not 1.
    """
    if level == 1:
        return []
    if not isinstance(case.geometry, BlocksGeometry | BoxesGeometry):
        raise InputError(
            f'bench: level {level} needs geometry.kind = "two-blocks" or "two-boxes", found '
            f'"{case.geometry.kind}", which only level 1 takes'
        )
    options = []
    for name, block in (("upper", case.geometry.upper), ("lower", case.geometry.lower)):
        if block.elements is not None:
            change = f"elements={[count * level for count in block.elements]}"
        else:
            assert block.size is not None
            change = f"size={block.size / level!r}"
        options += ["--set", f"geometry.{name}.{change}"]
    return options
