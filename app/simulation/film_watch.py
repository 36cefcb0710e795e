"""Watches films that are found: whether facets resolve their inlet, and where laws are stretched.

The gap before the edge of a contact grows with the distance x as x^3/2. The inlet is as long as it
takes the film to double there, (h²R²/a)^1/3 for a cylinder of radius R and a contact of half-width
a: its length is seen from how much the film grows along the facet at the edge.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.snapshot import Snapshot
from tribox.app.simulation.history import Row
from tribox.app.simulation.time_text import time_text
from tribox.forms.contact.lubricated import LubricatedTerm
from tribox.forms.contact.state import Lubrication
from tribox.geometry.surfaces.facets import Floats, Longs

LOADED = 0.01  # of the largest pressure, from which on a vertex counts as loaded
FELT = 0.02  # share of the load from which on the film's accuracy matters
COARSE = 0.5  # facet over the length of the inlet
AHEAD = 4.0  # half-widths of film upstream of the contact's edge
THIN = 0.5  # h/σ below which the laws of film and asperities are extrapolated


class FilmWatch:
    """The worst of each pair whose film is found."""

    def __init__(self, problem: Equilibrium) -> None:
        """Find these pairs."""
        self._problem = problem
        pairs = enumerate(problem.contacts)
        self._terms = [(i, term) for i, term in pairs if isinstance(term, LubricatedTerm)]
        self._found: dict[str, list[float | str]] = {}  # how bad, and what is said of it

    def step(self, row: Row) -> None:
        """Look at a converged step."""
        for index, term in self._terms:
            film = self._problem.committed[index].normal_contact.lubrication
            history = term.state.film
            if film is None or film.solution is None or film.step is None or history is None:
                continue
            load = term.surface.vertices.area @ np.where(
                film.members, film.asperity + film.pressure, 0.0
            )
            carried = term.surface.vertices.area @ np.where(film.members, film.pressure, 0.0)
            if carried < FELT * load:
                continue
            when = f"worst at time {time_text(row.time, row.dt)}, stage {row.stage}"
            faces = term.faces[film.members[term.faces].all(axis=1)]
            length = history.length[film.members[term.faces].all(axis=1)]
            cells = term.places.per_facet
            self._look_at_inlet(f"contact.{index}", film, faces, length, when, cells)
            self._look_at_roughness(f"contact.{index}", term, film, when)

    def _look_at_inlet(
        self, place: str, film: Lubrication, faces: Longs, length: Floats, when: str, cells: int = 1
    ) -> None:
        """Hold the facet at the inlet, and the film before it, against what they should be."""
        assert film.step is not None
        carried = np.where(film.members, film.asperity + film.pressure, 0.0)
        loaded = carried > LOADED * carried.max()
        upstream = np.where(film.step.speed[::cells] >= 0.0, faces[:, 0], faces[:, 1])
        downstream = faces.sum(axis=1) - upstream
        at = np.nonzero(loaded[downstream] & ~loaded[upstream])[0]
        if not len(at):
            return
        inlet = int(at[np.argmax(length[at])])
        inside, outside = film.film[downstream[inlet]], film.film[upstream[inlet]]
        growth = outside / inside - 1.0
        if growth > 0.0 and growth ** (2.0 / 3.0) > COARSE * cells:
            size = length[inlet] / growth ** (2.0 / 3.0)
            self._keep(
                f"inlet {place}",
                length[inlet] / (cells * size),
                f"{place}: the inlet of the film is about {size:.2g} m long and its cells "
                f"there {length[inlet] / cells:.2g} m ({when}): too much load is left to the "
                f"asperities, and friction is too high; refine the slave at the edges of the "
                f"contact, or raise film.cells, until they are {COARSE * size:.2g} m",
            )
        width = 0.5 * float(length[loaded[faces].all(axis=1)].sum())
        ahead = self._ahead(upstream, downstream, length, inlet)
        if width > 0.0 and ahead < AHEAD * width:
            self._keep(
                f"ahead {place}",
                width / max(ahead, 1e-9 * width),
                f"{place}: the film begins {ahead:.2g} m upstream of the contact, whose half-width "
                f"is {width:.2g} m ({when}): it comes out too thin; let slave and film reach "
                f"{AHEAD:g} half-widths, or raise film.h_max",
            )

    @staticmethod
    def _ahead(upstream: Longs, downstream: Longs, length: Floats, inlet: int) -> float:
        """Length of film upstream of a face, m, this included."""
        before = {int(vertex): face for face, vertex in enumerate(downstream)}
        total, face = 0.0, inlet
        for _ in range(len(length)):
            total += float(length[face])
            following = before.get(int(upstream[face]))
            if following is None:
                break
            face = following
        return total

    def _look_at_roughness(
        self, place: str, term: LubricatedTerm, film: Lubrication, when: str
    ) -> None:
        """See whether surfaces are closer than their laws of roughness were made for."""
        sigma = term.model.rough.sigma
        carried = np.where(film.members, film.asperity + film.pressure, 0.0)
        area = term.surface.vertices.area * (carried > LOADED * carried.max())
        thin = float(area @ (film.film < THIN * sigma) / max(area.sum(), np.finfo(float).tiny))
        if thin > 0.5:
            self._keep(
                f"thin {place}",
                thin,
                f"{place}: the film is thinner than {THIN:g} sigma on {100.0 * thin:.0f} % of the "
                f"contact ({when}), where the laws of film and asperities are extrapolated",
            )

    def _keep(self, word: str, bad: float, said: str) -> None:
        if word not in self._found or float(self._found[word][0]) < bad:
            self._found[word] = [bad, said]

    def warnings(self) -> Iterator[str]:
        """One line for each pair and reason."""
        yield from (str(said) for _, said in self._found.values())

    def snapshot(self) -> Snapshot:
        """What has been seen so far."""
        return {"found": [[word, *found] for word, found in self._found.items()]}

    def restore(self, kept: Snapshot) -> None:
        """Go on from what :meth:`snapshot` has seen."""
        self._found = {word: [bad, said] for word, bad, said in kept["found"]}
