"""``tribox map``: a friction law at material points without bodies, or a film in a line contact."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tribox.app.errors import tell
from tribox.app.friction_map.material_tests import compute_map, summary, write_map
from tribox.app.friction_map.setup import law_notes, map_setup, mapped
from tribox.app.results.claim import claimed
from tribox.app.results.directory import keep_inputs_apart, suffixed_directory

if TYPE_CHECKING:
    from tribox.app.case.case import Case

BUILT_IN = Path("built-in.toml")  # names the results of a map without a case


def run_map(
    case_file: Path | None, overrides: Sequence[str], out: Path | None, force: bool
) -> Path:
    """Map a law and write tables and figures to ``out`` or results/CASE-map.

    InputError, with nothing changed, if case (None: built-in) or directory is not usable.
    """
    directory = out or suffixed_directory(case_file or BUILT_IN, "map")
    keep_inputs_apart(directory, [case_file] if case_file else [])
    found = _with_film(case_file, overrides)
    if found is not None:
        from tribox.app.friction_map.line_contact import film_map, map_film

        films = film_map(found)
        with claimed(directory, force) as claim:
            claim.clear()
            map_film(films, directory)
        return directory
    setup = map_setup(case_file, overrides)
    with claimed(directory, force) as claim:
        started = time.perf_counter()
        result = compute_map(setup)
        seconds = time.perf_counter() - started
        claim.clear()
        write_map(setup, result, directory, seconds)
        # Drawing starts a library that takes longer than the map.
        from tribox.app.friction_map.figures import draw_map

        (directory / "figures").mkdir(exist_ok=True)
        draw_map(setup, result, directory / "figures")
    notes = law_notes(setup)
    numbers = summary(setup, result, seconds)
    for note in notes:
        tell(f"note: {note}")
    print(
        f"{numbers['points']} steady states in {numbers['seconds']} s, within "
        f"{numbers['largest_deviation_from_closed_form']:.1e} of the closed form"
    )
    if numbers["points_not_steady"]:
        print(f"warning: {numbers['points_not_steady']} of them are not steady yet")
    print(f"results in {directory}")
    return directory


def _with_film(case_file: Path | None, overrides: Sequence[str]) -> Case | None:
    """The case, where what is mapped of it is a film that is found; None: a law, or none."""
    if case_file is None:
        return None
    from tribox.app.case.reading import load_case

    case = load_case(case_file, overrides)
    index = mapped(case)
    film = None if index is None else case.contact[index].film
    return case if film is not None and film.is_unknown else None
