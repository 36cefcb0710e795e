"""Watches films that are found: what makes them wrong without a word, and where laws are stretched.

The gap before the edge of a contact grows with the distance x as x^3/2. The inlet is as long as it
takes the film to double there, (h²R²/a)^1/3 for a cylinder of radius R and a contact of half-width
a: its length is seen from how much the film grows along the facet at the edge.

Axis letters: v vertices of the slave, n those that the film has, f faces of the film, q contact
points.
"""

from __future__ import annotations

from collections.abc import Iterator

import dolfinx
import numpy as np
import scipy.sparse

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.snapshot import Snapshot
from tribox.app.simulation.history import Row, time_text
from tribox.forms.contact.asperities import AsperityPressure
from tribox.forms.contact.lubricated import LubricatedTerm
from tribox.forms.contact.state import ContactTrial, Lubrication
from tribox.geometry.surfaces.facets import Bools, Floats, Longs
from tribox.geometry.surfaces.projection import FacetSurface
from tribox.geometry.surfaces.rigid import RigidSurface

LOADED = 0.01  # of the largest pressure, from which on a vertex counts as loaded
PRESSED = 0.1  # the same, from which on it counts to the width of the contact
FELT = 0.02  # share of the load from which on the film's accuracy matters
# Facet over the length of the inlet, up to which friction in the mixed regime is within 5 % of that
# of the finest mesh, and cell of the film over the same.
COARSE, COARSE_CELL = 2.5, 2.0
DEEP = 0.25  # cell over the half-width of the contact; .35 of it left friction 10 % too high
GIVES = 1.0  # of the film, that a column of a cell's depth gives way by: less moves no film
AHEAD = 4.0  # half-widths of film upstream of the contact's edge
THIN = 0.5  # h/σ below which the laws of film and asperities are extrapolated
BOUNDED = (
    10.0  # film at the end of the slave over the least: up to it a contact ends there by itself
)
SAGITTA = 0.05  # of the film, that a facet of the master may miss its arc by
EDGE = np.radians(20.0)  # between facets of the master: from there on it is an edge, and no arc
LAGS = 1.5  # by which the load is off, over the mean change of the film: wedges of 1.2 to 3
LAG = 0.01  # of the load, by which a film may lag behind a master that ends within it
SWING = 0.01  # of what flows in a step, by which the film may swing under a corner of the master
PILED = 0.1  # share of the oil given to the slave that lies at an end that it flows to
PASSED = 0.98  # share of the oil given that passes: below it the rest would pile up
FILLED = 1e-3  # of the largest pressure, at the end of a film that nothing leaves
MOVED = 0.1  # of the way slid, by which the contact may move along the slave in a steady state
UNEVEN = 1e-3  # of the flow, by which it may change along the film in a steady state
AGAIN = 0.05  # share of the contact's area that may have been in it before


class FilmWatch:
    """The worst of each pair whose film is found."""

    def __init__(self, problem: Equilibrium) -> None:
        self._problem = problem
        pairs = enumerate(problem.contacts)
        self._terms = [(i, term) for i, term in pairs if isinstance(term, LubricatedTerm)]
        self._depths = {i: cell_depths(term, problem.space) for i, term in self._terms}
        self._found: dict[str, list[float | str]] = {}  # how bad, and what is said of it
        # Of each pair, where its load was at first and how far it has slid since, which vertices
        # were loaded in the step before, and which have come out.
        self._first: dict[int, Floats] = {}
        self._slid: dict[int, float] = {}
        self._was: dict[int, Bools] = {}
        self._left: dict[int, Bools] = {}

    def step(self, row: Row) -> None:
        """Look at a converged step."""
        when = f"worst at time {time_text(row.time, row.dt)}, stage {row.stage}"
        for index, term in self._terms:
            trial, history = self._problem.committed[index], term.state.film
            film = trial.normal_contact.lubrication
            if film is None or film.solution is None or film.step is None or history is None:
                continue
            area, place = term.surface.vertices.area, f"contact.{index}"
            carried = np.where(film.members, film.asperity + film.pressure, 0.0)
            self._look_at_motion(index, term, film, carried, row.dt, when)
            if area @ np.where(film.members, film.pressure, 0.0) < FELT * (area @ carried):
                continue
            inside = film.part.inside
            faces, length = term.faces[inside], history.length[inside]
            self._look_at_inlet(place, term, trial, film, faces, length, when)
            self._look_at_depth(place, term, film, faces, self._depths[index][inside], length, when)
            self._look_at_roughness(place, term, film, when)
            self._look_at_facets(place, term, trial, film, when)
            self._look_at_oil(place, term, film, when)
            self._look_at_flow(place, film, faces, term.places.per_facet, when)
            self._look_at_lag(place, term, trial, film, when)

    def _look_at_inlet(
        self,
        place: str,
        term: LubricatedTerm,
        trial: ContactTrial,
        film: Lubrication,
        faces: Longs,
        length: Floats,
        when: str,
    ) -> None:
        """Hold the facet at the inlet, and the film before it, against what they should be."""
        assert film.step is not None and film.solver is not None
        cells = term.places.per_facet
        carried = np.where(film.members, film.asperity + film.pressure, 0.0)
        loaded = carried > LOADED * carried.max()
        upstream = np.where(
            film.step.speed[: cells * len(faces) : cells] >= 0.0, faces[:, 0], faces[:, 1]
        )
        downstream = faces.sum(axis=1) - upstream
        at = np.nonzero(loaded[downstream] & ~loaded[upstream])[0]
        if not len(at):
            return
        inlet = int(at[np.argmax(length[at])])
        inside, outside = film.film[downstream[inlet]], film.film[upstream[inlet]]
        growth = outside / inside - 1.0
        most = min(COARSE, COARSE_CELL * cells)
        if growth > 0.0 and growth ** (2.0 / 3.0) > most:
            size = length[inlet] / growth ** (2.0 / 3.0)
            self._keep(
                f"inlet {place}",
                length[inlet] / size,
                f"{place}: the inlet of the film is about {size:.2g} m long and the slave's facets "
                f"there {length[inlet]:.2g} m ({when}): film and asperities do not share the load "
                "as they should, and friction may be off by a tenth and more; refine the slave at "
                f"the edges of the contact to {most * size:.2g} m"
                + (", or give film.cells = 4" if most < COARSE else ""),
            )
        pressed = carried > PRESSED * carried.max()
        width = 0.5 * float(length[pressed[faces].all(axis=1)].sum())
        ahead, first = self._ahead(upstream, downstream, length, inlet)
        ring = not film.solver.cells.last().any()
        bounded = ring or self._bounded(term, trial, film, first, loaded)
        if width > 0.0 and ahead < AHEAD * width and not bounded:
            self._keep(
                f"ahead {place}",
                width / max(ahead, 1e-9 * width),
                f"{place}: the film begins {ahead:.2g} m upstream of the contact, whose half-width "
                f"is {width:.2g} m ({when}): it comes out too thin; let slave and film reach "
                f"{AHEAD:g} half-widths, or raise film.h_max",
            )

    @staticmethod
    def _bounded(
        term: LubricatedTerm, trial: ContactTrial, film: Lubrication, first: int, loaded: Bools
    ) -> bool:
        """Whether there is nothing further out than the vertex that a film begins at.

        A slider or a plate, slave or master, has a narrow gap up to its edge; and what is not full
        at its beginning begins further in.
        """
        at_first = (term.faces == first).any(axis=1)
        bare: Bools = np.zeros(len(film.members), dtype=bool)  # no master below all of their area
        bare[term.surface.vertices.of_point[~trial.projection.on_surface]] = True
        ends = np.count_nonzero(at_first) < 2 or bool(bare[term.faces[at_first]].any())
        narrow = bool(film.film[first] < BOUNDED * film.film[loaded].min())
        return (ends and narrow) or bool(film.filled[first] < PASSED)

    @staticmethod
    def _ahead(upstream: Longs, downstream: Longs, length: Floats, inlet: int) -> tuple[float, int]:
        """Length of film upstream of a face, m, this included, and the vertex it begins at."""
        before = {int(vertex): face for face, vertex in enumerate(downstream)}
        total, face = 0.0, inlet
        for _ in range(len(length)):
            total += float(length[face])
            following = before.get(int(upstream[face]))
            if following is None:
                break
            face = following
        return total, int(upstream[face])

    def _look_at_depth(
        self,
        place: str,
        term: LubricatedTerm,
        film: Lubrication,
        faces: Longs,
        depth: Floats,
        length: Floats,
        when: str,
    ) -> None:
        """Hold the slave's cells below the contact against its half-width, where they give way."""
        carried = np.where(film.members, film.asperity + film.pressure, 0.0)
        pressed = (carried > PRESSED * carried.max())[faces].all(axis=1)
        if term.modulus is None or not pressed.any():
            return
        width, deepest = 0.5 * float(length[pressed].sum()), float(depth[pressed].max())
        gives = carried.max() * deepest / term.modulus
        if deepest > DEEP * width and gives > GIVES * float(film.film[faces[pressed]].min()):
            self._keep(
                f"depth {place}",
                deepest / width,
                f"{place}: the slave's cells below the contact are {deepest:.2g} m deep, and its "
                f"half-width is {width:.2g} m ({when}): friction where film and asperities "
                f"share the load comes out too high; cells of {DEEP * width:.2g} m there, by "
                "grading or a finer mesh",
            )

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

    def _look_at_facets(
        self, place: str, term: LubricatedTerm, trial: ContactTrial, film: Lubrication, when: str
    ) -> None:
        """Hold arcs over the chords of a faceted master, and its corners, against the film."""
        vertices, at = term.surface.vertices, trial.projection
        carried = vertices.at_points(np.where(film.members, film.asperity + film.pressure, 0.0))
        loaded = trial.kinematics.closed & (carried > LOADED * carried.max())
        if trial.nodes is None or not loaded.any():
            return
        length, turn, beside = corners(term.surface.target, trial.nodes)
        least = np.full(len(length), np.inf)
        np.minimum.at(least, at.facet[loaded], vertices.at_points(film.film)[loaded])
        flat = np.ones(len(length), dtype=bool)
        if at.curvature is not None:  # what is round, or was made smooth, has no arc to miss
            flat[at.facet[loaded]] = np.abs(at.curvature[loaded]).max(axis=(1, 2, 3)) == 0.0
        # Three corners in a row that turn the same way are those of an arc.
        arc = (np.prod(turn, axis=1) > 0.0) & (np.abs(turn).max(axis=1) < EDGE) & flat
        arc &= (arc[beside] & (turn != 0.0)).any(axis=1)
        sagitta = 0.125 * length * np.where(arc, np.abs(turn).min(axis=1), 0.0)
        worst = int(np.argmax(sagitta / least))
        if sagitta[worst] > SAGITTA * least[worst]:
            fine = length[worst] * np.sqrt(SAGITTA * least[worst] / sagitta[worst])
            self._keep(
                f"facets {place}",
                float(sagitta[worst] / least[worst]),
                f"{place}: the master's facets are {length[worst]:.2g} m long and lie up to "
                f"{sagitta[worst]:.2g} m from its arc, "
                f"{100.0 * sagitta[worst] / least[worst]:.0f} % of the film "
                f"({when}): film and friction ripple with them; a circle, a plane or fillets as "
                f"tool, a smoothing_angle, or facets of {fine:.2g} m",
            )
        turn = np.where(arc[:, None] | ~np.isfinite(least[beside]), 0.0, turn)
        self._look_at_corners(place, term, film, turn, least, when)

    def _look_at_corners(
        self,
        place: str,
        term: LubricatedTerm,
        film: Lubrication,
        turn: Floats,
        least: Floats,
        when: str,
    ) -> None:
        """Hold the film under corners that pass over the slave against what flows in a step.

        The film's volume is that of the gaps at the vertices: it swings as a corner of the angle α
        passes between two of them, by α l²/8.
        """
        assert film.step is not None
        slid = 2.0 * film.step.dt * float(np.abs(film.step.speed).max(initial=0.0))
        if not np.isfinite(slid) or slid == 0.0:
            return
        size = term.surface.facet_length
        over = size * min(size, slid) / (4.0 * slid)  # what it passes in the step
        swing = np.abs(turn).max(axis=1) * over / np.maximum(least, 1e-300)
        worst = int(np.argmax(swing))
        if swing[worst] > SWING:
            self._keep(
                f"corners {place}",
                float(swing[worst]),
                f"{place}: a corner of {np.abs(turn[worst]).max():.2g} rad of the master passes "
                f"over facets of {size:.2g} m, under which the film swings by up to "
                f"{100.0 * swing[worst]:.2g} % of what flows in a step ({when}): load and friction "
                "may be off by several times as much, up and down from step to step; the body with "
                f"the corner as slave, or facets of {size * np.sqrt(SWING / swing[worst]):.2g} m",
            )

    def _look_at_oil(self, place: str, term: LubricatedTerm, film: Lubrication, when: str) -> None:
        """See whether more oil is given than passes."""
        assert film.step is not None and film.solution is not None and film.solver is not None
        step, solution, cells = film.step, film.solution, film.solver.cells
        if not np.isfinite(term.model.oil):
            return
        if np.isfinite(step.dt):
            self._look_at_ends(place, term, film, when)
            end = cells.last() & (solution.pressure > FILLED * solution.pressure.max())
            if end.any() and solution.pressure.max() > 0.0:
                self._keep(
                    f"oil {place}",
                    1.0,
                    f"{place}: the oil before the contact fills the film up to its end ({when}): "
                    f"more is given than passes, and what no longer fits presses on a wall that is "
                    f'not there; less film.oil, a larger film.h_max, or film.oil = "flooded"',
                )
            return
        a, b = cells.ends.T
        entering = np.where(step.speed >= 0.0, a, b)
        first = step.fixed[entering]
        mean = 0.5 * (step.film[a] + step.film[b])
        given = np.minimum(step.content[entering], mean)
        offered = float(np.sum((np.abs(step.speed) * cells.width * given)[first]))
        passed = float(solution.supply[entering[first]].sum())
        if offered > 0.0 and passed < PASSED * offered:
            self._keep(
                f"oil {place}",
                offered / max(passed, 1e-3 * offered),
                f"{place}: {100.0 * passed / offered:.2g} % of the oil that is brought passes the "
                f"contact ({when}): there is no steady state, the rest piles up before it; the "
                f'film is the flooded one: film.oil = "flooded", or leave film.steady out',
            )

    def _look_at_ends(self, place: str, term: LubricatedTerm, film: Lubrication, when: str) -> None:
        """See whether oil flows to an end of the slave, where nothing lets it out."""
        assert film.step is not None and film.solution is not None and film.solver is not None
        step, (a, b) = film.step, film.solver.cells.ends.T
        count = len(step.film)
        outwards = np.bincount(b, step.speed > 0.0, count) + np.bincount(a, step.speed < 0.0, count)
        edge = np.bincount(term.faces.reshape(-1), minlength=len(film.members)) < 2
        at_edge: Bools = np.zeros(count, dtype=bool)
        at_edge[: np.count_nonzero(film.members)] = edge[film.members]  # vertices come first
        piled = float(film.solution.volume[at_edge & (outwards > 0.0)].sum())
        piled /= term.model.oil * float(term.surface.vertices.area.sum())
        if piled > PILED:
            self._keep(
                f"end {place}",
                piled,
                f"{place}: oil flows to the end of the slave and stays there, "
                f"{100.0 * piled:.2g} % of what was given ({when}): in truth it leaves; "
                "what it fills and carries there is not to be believed; a longer slave, or a "
                "smaller film.h_max, so that the film ends before it",
            )

    def _look_at_flow(
        self, place: str, film: Lubrication, faces: Longs, cells: int, when: str
    ) -> None:
        """See whether a steady film lets as much out as it takes in."""
        assert film.step is not None and film.solution is not None
        carried = np.where(film.members, film.asperity + film.pressure, 0.0)
        loaded = (carried > LOADED * carried.max())[faces].all(axis=1)
        flow = film.solution.flux[: cells * len(faces)]
        passing = np.abs(flow[np.repeat(loaded, cells)])
        if np.isfinite(film.step.dt) or not len(passing) or passing.max() == 0.0:
            return
        uneven = float(np.ptp(flow) / passing.max())
        if uneven > UNEVEN:
            self._keep(
                f"flow {place}",
                uneven,
                f"{place}: the flow changes by {100.0 * uneven:.2g} % of itself along the film "
                f"({when}), which is no steady state: rounding of open gaps, most likely; a "
                "smaller film.h_max",
            )

    def _look_at_lag(
        self, place: str, term: LubricatedTerm, trial: ContactTrial, film: Lubrication, when: str
    ) -> None:
        """Hold by how much a film changes in a step as its master slides on against the film.

        Its pressure is that of the middle of the step, over the places of the end. Where the film
        ends by itself, as behind a roll, it lies half a step behind; where it ends with the master
        it is that of a film thicker or thinner by half the change, and p goes with h^-2.
        """
        step, solver, found = film.step, film.solver, film.solution
        assert step is not None and solver is not None and found is not None
        if step.before is None or not self._ends_narrow(term, trial, film):
            return
        a, b = solver.cells.ends.T
        slid = 2.0 * step.dt * step.speed * (step.film[b] - step.film[a]) / solver.cells.length
        change = 0.5 * (step.before - step.film)[solver.cells.ends].sum(axis=1)
        # What the master brings along; squeezing is taken exactly.
        lag = np.where(slid * change < 0.0, 0.0, np.sign(change))
        lag *= np.minimum(np.abs(slid), np.abs(change)) / step.film[solver.cells.ends].mean(axis=1)
        weight = found.pressure[solver.cells.ends].mean(axis=1) * solver.cells.length
        off = LAGS * float(np.abs(weight @ lag) / max(weight.sum(), np.finfo(float).tiny))
        if off > LAG:
            self._keep(
                f"lag {place}",
                off,
                f"{place}: the master ends within the film, which lags behind it by half a step: "
                f"the load may be off by {100.0 * off:.2g} % ({when}); steps of "
                f"{step.dt * LAG / off:.2g} s, or the body that ends as slave, and film.steady",
            )

    @staticmethod
    def _ends_narrow(term: LubricatedTerm, trial: ContactTrial, film: Lubrication) -> bool:
        """Whether the master ends over the slave where the film is narrow."""
        ends: Bools = np.zeros(len(film.members), dtype=bool)
        ends[term.surface.vertices.of_point[~trial.projection.on_surface]] = True
        loaded = film.pressure > LOADED * film.pressure.max()
        least = film.film[loaded & film.members].min(initial=np.inf)
        return bool((film.film[ends & film.members] < BOUNDED * least).any())

    def _look_at_motion(
        self,
        index: int,
        term: LubricatedTerm,
        film: Lubrication,
        carried: Floats,
        dt: float,
        when: str,
    ) -> None:
        """See where the contact goes on the slave, and whether it was there before."""
        assert film.step is not None
        vertices, place = term.surface.vertices, f"contact.{index}"
        loaded = carried > LOADED * carried.max(initial=0.0)
        weight = vertices.area * carried
        middle = weight @ vertices.position / max(weight.sum(), np.finfo(float).tiny)
        moved = float(np.linalg.norm(middle - self._first.setdefault(index, middle)))
        slid = 2.0 * dt * float(np.abs(film.step.speed).max(initial=0.0))
        slid = self._slid[index] = self._slid.get(index, 0.0) + slid
        if term.model.steady:
            # Friction that changes shifts the load a little.
            width = term.surface.facet_length * np.count_nonzero(loaded)
            if moved > max(MOVED * slid, 0.25 * width):
                self._keep(
                    f"steady {place}",
                    moved,
                    f"{place}: the contact has moved {moved:.2g} m along the slave while it slid "
                    f"{slid:.2g} m ({when}): film.steady is for a contact that stays where it is "
                    "on the slave; make the other surface the slave, or leave film.steady out",
                )
            return
        none: Bools = np.zeros(len(loaded), dtype=bool)
        left: Bools = self._left.get(index, none) | (self._was.get(index, none) & ~loaded)
        self._left[index], self._was[index] = left, loaded
        share = float(vertices.area @ (left & loaded) / max(vertices.area @ loaded, 1e-300))
        if np.isfinite(term.model.oil) and share > AGAIN:
            self._keep(
                f"again {place}",
                share,
                f"{place}: {100.0 * share:.0f} % of the contact's surface has left it before "
                f"({when}), with all of the oil: what the master carries away at the exit is not "
                "known, and up to half is its; give the second pass its own film.oil",
            )

    def _keep(self, word: str, bad: float, said: str) -> None:
        if word not in self._found or float(self._found[word][0]) < bad:
            self._found[word] = [bad, said]

    def warnings(self) -> Iterator[str]:
        """One line for each pair and reason."""
        yield from (str(said) for _, said in self._found.values())

    def snapshot(self) -> Snapshot:
        """What has been seen so far."""
        return {
            "found": [[word, *found] for word, found in self._found.items()],
            "first": [[pair, at.tolist()] for pair, at in self._first.items()],
            "slid": [[pair, way] for pair, way in self._slid.items()],
            "was": [[pair, on.tolist()] for pair, on in self._was.items()],
            "left": [[pair, on.tolist()] for pair, on in self._left.items()],
        }

    def restore(self, kept: Snapshot) -> None:
        """Go on from what :meth:`snapshot` has seen."""
        self._found = {word: [bad, said] for word, bad, said in kept["found"]}
        self._first = {int(pair): np.array(at) for pair, at in kept["first"]}
        self._slid = {int(pair): float(way) for pair, way in kept["slid"]}
        self._was = {int(pair): np.array(on, dtype=bool) for pair, on in kept["was"]}
        self._left = {int(pair): np.array(on, dtype=bool) for pair, on in kept["left"]}


def corners(target: FacetSurface | RigidSurface, nodes: Floats) -> tuple[Floats, Floats, Longs]:
    """Lengths (f,), m, of a master's facets in the plane, and how they turn at their ends.

    Args:
        target: the master.
        nodes: (n, i), m, current.

    Returns:
        Also the angles (f, 2), rad, by which the way along a facet turns to the left from what is
        before it, and to what is behind it, 0 at ends; and the facets (f, 2) that are there.
    """
    near = target.neighbours.tocoo()
    facet, other = (index[near.row != near.col] for index in (near.row, near.col))
    count = near.shape[0]
    every = np.arange(count, dtype=np.int32)
    # Places and directions (e, f, i) of both ends.
    ends = [target.places(every, np.full((count, 1), xi), nodes) for xi in (0.0, 1.0)]
    place = np.stack([at for at, _ in ends])
    way = np.stack([tangent[:, 0] for _, tangent in ends])
    length = np.linalg.norm(way, axis=2).mean(axis=0)
    turn, beside = np.zeros((count, 2)), np.repeat(every[:, None], 2, axis=1).astype(np.int64)
    for end in (0, 1):
        for begin in (0, 1):
            apart = np.linalg.norm(place[end, facet] - place[begin, other], axis=1)
            meet = apart <= 1e-6 * length[facet]
            one, two = facet[meet], other[meet]
            a, b = way[end, one], way[begin, two] * (1.0 if end != begin else -1.0)
            if end == 0:
                a, b = b, a
            cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
            turn[one, end] = np.arctan2(cross, np.einsum("pi,pi->p", a, b))
            beside[one, end] = two
    return length, turn, beside


def cell_depths(term: LubricatedTerm, space: dolfinx.fem.FunctionSpace) -> Floats:
    """How far the cells reach in (f,), m, below the slave's facets, over the elements' degree.

    On one rank, as films that are found are.
    """
    dim, surface = term.surface.dim, term.surface
    assert isinstance(term.rule, AsperityPressure)
    _, first = np.unique(term.rule.facet_of, return_index=True)
    ends = surface.nodes[surface.slave_rows[first, :2]]
    cells = np.asarray(space.dofmap.list, dtype=np.int64)
    place = np.repeat(np.arange(len(cells)), cells.shape[1])
    table = scipy.sparse.csr_matrix(
        (np.ones(cells.size, dtype=np.int8), (cells.reshape(-1), place))
    )
    cell = table[ends[:, 0]].multiply(table[ends[:, 1]]).tocsr().indices  # one has both
    position = space.tabulate_dof_coordinates()[:, :dim]
    along = position[ends[:, 1]] - position[ends[:, 0]]
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    inward = position[cells[cell]] - position[ends[:, 0]][:, None]
    depth = np.abs(np.einsum("fai,fi->fa", inward, normal)).max(axis=1)
    return np.asarray(depth / space.element.basix_element.degree)
