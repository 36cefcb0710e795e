"""Watches films that are found: what makes them wrong without a word, and where laws are stretched.

The gap before the edge of a contact grows with the distance x as x^3/2. The inlet is as long as it
takes the film to double there, (h²R²/a)^1/3 for a cylinder of radius R and a contact of half-width
a: its length is seen from how much the film grows along the facet at the edge.

Axis letters: v vertices of the slave, n those that the film has, f faces of the film, q contact
points.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import dolfinx
import numpy as np
import scipy.sparse

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.snapshot import Kept, Remembers
from tribox.app.simulation.history import Row
from tribox.forms.contact.asperities import AsperityPressure
from tribox.forms.contact.lubricated import LubricatedTerm
from tribox.forms.contact.state import ContactTrial, Lubrication
from tribox.forms.film.reynolds import UNFILLED, FilmSolution, FilmStep, ReynoldsFilm
from tribox.geometry.surfaces.facets import Bools, Floats, Longs
from tribox.geometry.surfaces.surface import facet_turns

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
BOUNDED = 10.0  # film at the slave's end over the least, up to which a contact ends by itself
SAGITTA = 0.05  # of the film, that a facet of the master may miss its arc by
EDGE = np.radians(20.0)  # between facets of the master: from there on it is an edge, and no arc
LAGS = 1.5  # by which the load is off, over the mean change of the film: wedges of 1.2 to 3
LAG = 0.01  # of the load, by which a film may lag behind a master that ends within it
SWING = 0.01  # of what flows in a step, by which the film may swing under a corner of the master
PILED = 0.1  # share of the oil given to the slave that lies at an end that it flows to
PASSED = 0.98  # share of the oil given that passes: below it the rest would pile up
FILLED = 1e-3  # of the largest pressure, at the end of a film that nothing leaves
MOVED = 0.1  # of the way slid, by which the contact may move along the slave in a steady state
OWN = 0.02  # of what a film carries, that a flooded reservoir's own pressure may make of it
CONDUCTS = 0.14  # W/(m K), of oils; they lose some 3 % of their viscosity a kelvin
WARMS = 5.0  # K, by which a film's middle may be warmer than its walls
THICKENS, THICKER = 15e-9, 1.5  # 1/Pa, of mineral oils; by how much, where barus is not given
UNEVEN = 1e-3  # of the flow, by which it may change along the film in a steady state
NEGLECTED = 0.2  # of the flow, that a film stores in a step, of which a steady state takes none
AGAIN = 0.05  # share of the contact's area that may have been in it before


@dataclass(frozen=True, slots=True)
class Look:
    """A pair's film at a converged step."""

    place: str  # of the pair, in words
    when: str  # of the step, in words
    term: LubricatedTerm
    trial: ContactTrial
    film: Lubrication
    faces: Longs  # (f, 2) vertices of its faces
    length: Floats  # (f,), m, of each
    depth: Floats  # (f,), m, of the cells below
    carried: Floats  # (v,), Pa, by film and asperities together
    step: FilmStep  # what the film was found from
    solver: ReynoldsFilm  # by what
    solution: FilmSolution  # what was found

    @property
    def loaded(self) -> Bools:
        """Vertices (v,) that bear a load."""
        return self.carried > LOADED * self.carried.max(initial=0.0)

    @property
    def pressed(self) -> Bools:
        """Faces (f,) between vertices that count to the width of the contact."""
        return (self.carried > PRESSED * self.carried.max(initial=0.0))[self.faces].all(axis=1)

    @property
    def width(self) -> float:
        """Half-width, m, of the contact: all of what is pressed up to a plane of symmetry."""
        pressed = self.pressed
        whole = self.term.places.closed[self.faces[pressed]].any()
        return float(self.length[pressed].sum()) * (1.0 if whole else 0.5)


Found = Iterator[tuple[str, float, str]]
"""What is wrong with a film: a word for it, how bad it is, and what is said of it."""


class FilmWatch(Remembers):
    """The worst of each pair whose film is found."""

    _found: Kept[dict[str, tuple[float, str]]]  # how bad, and what is said of it
    # Of each pair, its film and speed in the step before, where its load was at first and how far
    # it has slid since, which vertices were loaded in the step before, and which have come out.
    _last: Kept[dict[int, tuple[Floats, float]]]
    _first: Kept[dict[int, Floats]]
    _slid: Kept[dict[int, float]]
    _was: Kept[dict[int, Bools]]
    _left: Kept[dict[int, Bools]]

    def __init__(self, problem: Equilibrium) -> None:
        self._problem = problem
        pairs = enumerate(problem.contacts)
        self._terms = [(i, term) for i, term in pairs if isinstance(term, LubricatedTerm)]
        self._depths = {i: cell_depths(term, problem.space) for i, term in self._terms}
        self._found, self._first, self._slid, self._was, self._left = {}, {}, {}, {}, {}
        self._last = {}

    def step(self, row: Row) -> None:
        """Look at a converged step."""
        when = f"worst at {row.when}"
        for index, term in self._terms:
            trial, history = self._problem.committed[index], term.state.film
            film = trial.normal_contact.lubrication
            if film is None or history is None:
                continue
            if film.solution is None or film.step is None or film.solver is None:
                continue
            area, inside = term.surface.vertices.area, film.part.inside
            carried = np.where(film.members, film.asperity + film.pressure, 0.0)
            look = Look(
                place=f"contact.{index}",
                when=when,
                term=term,
                trial=trial,
                film=film,
                faces=term.faces[inside],
                length=history.length[inside],
                depth=self._depths[index][inside],
                carried=carried,
                step=film.step,
                solver=film.solver,
                solution=film.solution,
            )
            found = [*self._motion(index, look, row.dt)]
            stored = [*self._neglected(index, look, row.dt)]
            if area @ np.where(film.members, film.pressure, 0.0) >= FELT * (area @ carried):
                found += stored + [one for check in CHECKS for one in check(look)]
            # What masters are like is seen by the ranks above them.
            everywhere = self._problem.comm.allgather(found)
            for word, bad, said in [one for part in everywhere for one in part]:
                name = f"{word} {look.place}"
                if name not in self._found or self._found[name][0] < bad:
                    self._found[name] = (bad, f"{look.place}: {said}")

    def _motion(self, index: int, look: Look, dt: float) -> Found:
        """See where the contact goes on the slave, and whether it was there before."""
        term, loaded, vertices = look.term, look.loaded, look.term.surface.vertices
        weight = vertices.area * look.carried
        middle = weight @ vertices.position / max(weight.sum(), np.finfo(float).tiny)
        moved = float(np.linalg.norm(middle - self._first.setdefault(index, middle)))
        slid = 2.0 * dt * float(np.abs(look.step.speed).max(initial=0.0))
        slid = self._slid[index] = self._slid.get(index, 0.0) + slid
        if term.model.steady:
            # Friction that changes shifts the load a little.
            width = term.surface.facet_length * np.count_nonzero(loaded)
            if moved > max(MOVED * slid, 0.25 * width):
                yield (
                    "steady",
                    moved,
                    f"the contact has moved {moved:.2g} m along the slave while it slid "
                    f"{slid:.2g} m ({look.when}): film.steady is for a contact that stays where it "
                    "is on the slave; make the other surface the slave, or leave film.steady out",
                )
            return
        none: Bools = np.zeros(len(loaded), dtype=bool)
        left: Bools = self._left.get(index, none) | (self._was.get(index, none) & ~loaded)
        self._left[index], self._was[index] = left, loaded
        again, area = vertices.area @ (left & loaded), vertices.area @ loaded
        share = float(again / max(float(area), 1e-300))
        if np.isfinite(term.model.oil) and share > AGAIN:
            yield (
                "again",
                share,
                f"{100.0 * share:.0f} % of the contact's surface has left it before "
                f"({look.when}), with all of the oil: what the master carries away at the exit is "
                "not known, and up to half is its; give the second pass its own film.oil",
            )

    def _neglected(self, index: int, look: Look, dt: float) -> Found:
        """See whether a film that should be steady is the same as in the last step of its speed."""
        film, speed = look.film, float(np.abs(look.step.speed).max(initial=0.0))
        before, last = self._last.get(index, (film.film, np.inf))
        self._last[index] = film.film, speed
        if not look.term.model.steady or abs(speed - last) > 0.02 * speed:
            return
        near = film.members & (film.film < BOUNDED * film.film[film.members].min())
        stored = np.abs(film.film - before) * film.filled * look.term.surface.vertices.area
        flow = float(np.abs(look.solution.flux).max(initial=0.0))
        share = float(stored[near].sum() / max(dt * flow, np.finfo(float).tiny))
        if share > NEGLECTED:
            yield (
                "stored",
                share,
                f"at one speed the film changes by what takes {100.0 * share:.2g} % of its flow "
                f"({look.when}), which film.steady leaves out: it is for a film that stays as it "
                "is where the slave is, under a master that slides along itself or turns; make the "
                "other surface the slave, or leave film.steady out",
            )

    def warnings(self) -> Iterator[str]:
        """One line for each pair and reason."""
        yield from (said for _, said in self._found.values())


# -- What is looked at, film by film ---------------------------------------------------------------


def inlet(look: Look) -> Found:
    """Hold the facet at the inlet, and the film before it, against what they should be."""
    film, faces, length, cells = look.film, look.faces, look.length, look.term.places.per_facet
    loaded, speed = look.loaded, look.step.speed[: cells * len(faces) : cells]
    upstream = np.where(speed >= 0.0, faces[:, 0], faces[:, 1])
    downstream = faces.sum(axis=1) - upstream
    at = np.nonzero(loaded[downstream] & ~loaded[upstream])[0]
    if not len(at):
        return
    first = int(at[np.argmax(length[at])])
    growth = film.film[upstream[first]] / film.film[downstream[first]] - 1.0
    most = min(COARSE, COARSE_CELL * cells)
    if growth > 0.0 and growth ** (2.0 / 3.0) > most:
        size = length[first] / growth ** (2.0 / 3.0)
        yield (
            "inlet",
            length[first] / size,
            f"the inlet of the film is about {size:.2g} m long and the slave's facets there "
            f"{length[first]:.2g} m ({look.when}): film and asperities do not share the load as "
            "they should, and friction may be off by a tenth and more; refine the slave at the "
            f"edges of the contact to {most * size:.2g} m"
            + (", or give film.cells = 4" if most < COARSE else ""),
        )
    width = look.width
    ahead, begin = _ahead(upstream, downstream, length, first)
    ring = not look.solver.cells.last().any()
    if width > 0.0 and ahead < AHEAD * width and not (ring or _bounded(look, begin)):
        yield (
            "ahead",
            width / max(ahead, 1e-9 * width),
            f"the film begins {ahead:.2g} m upstream of the contact, whose half-width is "
            f"{width:.2g} m ({look.when}): it comes out too thin; let slave and film reach "
            f"{AHEAD:g} half-widths, or raise film.h_max",
        )


def _bounded(look: Look, first: int) -> bool:
    """Whether there is nothing further out than the vertex that a film begins at.

    A slider or a plate, slave or master, has a narrow gap up to its edge; and what is not full
    at its beginning begins further in.
    """
    film, faces = look.film, look.term.faces
    at_first, bare = (faces == first).any(axis=1), _bare(look)
    ends = np.count_nonzero(at_first) < 2 or bool(bare[faces[at_first]].any())
    narrow = bool(film.film[first] < BOUNDED * film.film[look.loaded].min())
    return (ends and narrow) or bool(film.filled[first] < PASSED)


def _bare(look: Look) -> Bools:
    """Vertices (v,) with no master below all of their area; collective."""
    vertices = look.term.surface.vertices
    bare: Floats = np.zeros(vertices.count)
    bare[vertices.of_point[~look.trial.projection.on_surface]] = 1.0
    return vertices.total(bare) > 0.0


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


def cells_below(look: Look) -> Found:
    """Hold the slave's cells below the contact against its half-width, where they give way."""
    pressed, modulus = look.pressed, look.term.modulus
    if modulus is None or not pressed.any():
        return
    width, deepest = look.width, float(look.depth[pressed].max())
    gives = look.carried.max() * deepest / modulus
    if deepest > DEEP * width and gives > GIVES * float(look.film.film[look.faces[pressed]].min()):
        yield (
            "depth",
            deepest / width,
            f"the slave's cells below the contact are {deepest:.2g} m deep, and its half-width is "
            f"{width:.2g} m ({look.when}): friction where film and asperities share the load comes "
            f"out too high; cells of {DEEP * width:.2g} m there, by grading or a finer mesh",
        )


def roughness(look: Look) -> Found:
    """See whether surfaces are closer than their laws of roughness were made for."""
    area = look.term.surface.vertices.area * look.loaded
    below = look.film.film < THIN * look.term.model.rough.sigma
    thin = float(area @ below / max(area.sum(), np.finfo(float).tiny))
    if thin > 0.5:
        yield (
            "thin",
            thin,
            f"the film is thinner than {THIN:g} sigma on {100.0 * thin:.0f} % of the contact "
            f"({look.when}), where the laws of film and asperities are extrapolated",
        )


def master_facets(look: Look) -> Found:
    """Hold arcs over the chords of a faceted master, and its corners, against the film."""
    vertices, at, nodes = look.term.surface.vertices, look.trial.projection, look.trial.nodes
    carried = vertices.at_points(look.carried)
    loaded = look.trial.kinematics.closed & (carried > LOADED * look.carried.max(initial=0.0))
    if nodes is None or not loaded.any():
        return
    length, turn, beside = facet_turns(look.term.surface.target, nodes)
    least = np.full(len(length), np.inf)
    np.minimum.at(least, at.facet[loaded], vertices.at_points(look.film.film)[loaded])
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
        yield (
            "facets",
            float(sagitta[worst] / least[worst]),
            f"the master's facets are {length[worst]:.2g} m long and lie up to "
            f"{sagitta[worst]:.2g} m from its arc, "
            f"{100.0 * sagitta[worst] / least[worst]:.0f} % of the film ({look.when}): film and "
            "friction ripple with them; a circle, a plane or fillets as tool, a smoothing_angle, "
            f"or facets of {fine:.2g} m",
        )
    turn = np.where(arc[:, None] | ~np.isfinite(least[beside]), 0.0, turn)
    # The film's volume is that of the gaps at the vertices: it swings as a corner of the angle α
    # passes between two of them, by α l²/8, against what flows in the step.
    slid = 2.0 * look.step.dt * float(np.abs(look.step.speed).max(initial=0.0))
    if not np.isfinite(slid) or slid == 0.0:
        return
    size = look.term.surface.facet_length
    over = size * min(size, slid) / (4.0 * slid)  # what it passes in the step
    swing = np.abs(turn).max(axis=1) * over / np.maximum(least, 1e-300)
    worst = int(np.argmax(swing))
    if swing[worst] > SWING:
        yield (
            "corners",
            float(swing[worst]),
            f"a corner of {np.abs(turn[worst]).max():.2g} rad of the master passes over facets of "
            f"{size:.2g} m, under which the film swings by up to {100.0 * swing[worst]:.2g} % of "
            f"what flows in a step ({look.when}): load and friction may be off by several times as "
            "much, up and down from step to step; the body with the corner as slave, or facets of "
            f"{size * np.sqrt(SWING / swing[worst]):.2g} m",
        )


def oil(look: Look) -> Found:
    """See whether more oil is given than passes, or flows to an end where nothing lets it out."""
    step, solution, cells = look.step, look.solution, look.solver.cells
    if not np.isfinite(look.term.model.oil):
        return
    a, b = cells.ends.T
    if np.isfinite(step.dt):
        members, count = look.film.members, len(step.film)
        outwards = np.bincount(b, step.speed > 0.0, count) + np.bincount(a, step.speed < 0.0, count)
        edge = np.bincount(look.term.faces.reshape(-1), minlength=len(members)) < 2
        edge &= ~look.term.places.closed
        at_edge: Bools = np.zeros(count, dtype=bool)
        at_edge[: np.count_nonzero(members)] = edge[members]  # vertices come first
        piled = float(solution.volume[at_edge & (outwards > 0.0)].sum())
        piled /= look.term.model.oil * float(look.term.surface.vertices.area.sum())
        if piled > PILED:
            yield (
                "end",
                piled,
                "oil flows to the end of the slave and stays there, "
                f"{100.0 * piled:.2g} % of what was given ({look.when}): in truth it leaves; "
                "what it fills and carries there is not to be believed; a longer slave, or a "
                "smaller film.h_max, so that the film ends before it",
            )
        end = cells.last() & (solution.pressure > FILLED * solution.pressure.max())
        end[: np.count_nonzero(members)] &= ~look.term.places.closed[members]
        if end.any() and solution.pressure.max() > 0.0:
            yield (
                "oil",
                1.0,
                f"the oil before the contact fills the film up to its end ({look.when}): "
                "more is given than passes, and what no longer fits presses on a wall that is "
                'not there; less film.oil, a larger film.h_max, or film.oil = "flooded"',
            )
        return
    entering = np.where(step.speed >= 0.0, a, b)
    first = step.fixed[entering]
    mean = 0.5 * (step.film[a] + step.film[b])
    given = np.minimum(step.content[entering], mean)
    offered = float(np.sum((np.abs(step.speed) * cells.width * given)[first]))
    passed = float(solution.supply[entering[first]].sum())
    if offered > 0.0 and passed < PASSED * offered:
        yield (
            "oil",
            offered / max(passed, 1e-3 * offered),
            f"{100.0 * passed / offered:.2g} % of the oil that is brought passes the contact "
            f"({look.when}): there is no steady state, the rest piles up before it; the film is "
            'the flooded one: film.oil = "flooded", or leave film.steady out',
        )


def steady_flow(look: Look) -> Found:
    """See whether a steady film lets as much out as it takes in."""
    cells, part = look.term.places.per_facet, look.film.part
    ring = part.ring[part.ends[: cells * len(look.faces), 0]]
    flow = look.solution.flux[: len(ring)] * np.repeat(part.sense, cells)
    passing = np.abs(flow[np.repeat(look.loaded[look.faces].all(axis=1), cells)])
    if np.isfinite(look.step.dt) or not len(passing) or passing.max() == 0.0:
        return
    most, least = np.full((2, ring.max() + 1), -np.inf)
    np.maximum.at(most, ring, flow)
    np.maximum.at(least, ring, -flow)
    uneven = float(np.max(most + least) / passing.max())
    if uneven > UNEVEN:
        yield (
            "flow",
            uneven,
            f"the flow changes by {100.0 * uneven:.2g} % of itself along the film ({look.when}), "
            "which is no steady state: rounding of open gaps, most likely; a smaller film.h_max",
        )


def reservoirs(look: Look) -> Found:
    """Hold what reservoirs press by themselves, as they flood a film, against the film's load."""
    step, area, p = look.step, look.solver.cells.area, look.solution.pressure
    own = look.solver.scale * look.solver.smoothing**2 / UNFILLED
    bearing = area[p > 1.01 * own].sum()  # less is a cavity, or the reservoir
    off = float(own * bearing / (area @ p))
    if off > OWN and not np.isfinite(step.content[step.fixed]).all():
        yield (
            "reservoirs",
            off,
            f"the reservoirs press by {own:.2g} Pa of their own, which goes with the bodies' "
            f"modulus: {100.0 * off:.2g} % of what the film carries ({look.when}); a hundredth of "
            "the modulus, if that is still as good as rigid",
        )


def heat(look: Look) -> Found:
    """Hold against what oils bear how much warmer than its walls the middle of the film is.

    By τ V/8k, where both walls stay as cold as the oil that comes in (R. Bird, W. Stewart, E.
    Lightfoot, Transport Phenomena, 2002, 10.4). It is the least, as bodies warm too.
    """
    step, (a, b), p = look.step, look.solver.cells.ends.T, look.solution.pressure
    slid, film = 2.0 * np.abs(step.speed), 0.5 * (step.film[a] + step.film[b])
    bears = np.minimum(p[a], p[b]) > LOADED * p.max(initial=0.0)
    flow = look.solver.rheology.viscosity(slid / film, 0.5 * (p[a] + p[b]))
    warmer = float(np.max(flow.value * slid**2 * bears, initial=0.0)) / (8.0 * CONDUCTS)
    if warmer > WARMS:
        yield (
            "heat",
            warmer,
            f"shear warms the middle of the film by {warmer:.2g} K over its walls, if it conducts "
            f"{CONDUCTS:g} W/(m K) ({look.when}): an oil loses some 3 % of its viscosity a kelvin, "
            "so that film and friction come out too large; eta_b of the warm oil, or tau_0 and "
            "critical_rate, which limit the shear",
        )


def thickening(look: Look) -> Found:
    """Hold the pressure against what makes oils more viscous, where none is to."""
    most = float(look.solution.pressure.max(initial=0.0))
    thicker = float(np.exp(THICKENS * most))
    if look.solver.rheology.barus == 0.0 and thicker > THICKER:
        said = (
            f"the film presses by up to {most:.2g} Pa ({look.when}), where a mineral oil of "
            f"{THICKENS:.2g}/Pa is {thicker:.2g} times as viscous as eta_b: film.barus"
        )
        yield "thickening", thicker, said


def lag(look: Look) -> Found:
    """Hold by how much a film changes in a step as its master slides on against the film.

    Its pressure is that of the middle of the step, over the places of the end. Where the film
    ends by itself, as behind a roll, it lies half a step behind; where it ends with the master
    it is that of a film thicker or thinner by half the change, and p goes with h^-2.
    """
    step, cells, film = look.step, look.solver.cells, look.film
    bearing = film.pressure > LOADED * film.pressure.max()
    least = film.film[bearing & film.members].min(initial=np.inf)
    narrow = bool((film.film[_bare(look) & film.members] < BOUNDED * least).any())
    if step.before is None or not narrow:  # the master ends elsewhere than over a narrow film
        return
    a, b = cells.ends.T
    slid = 2.0 * step.dt * step.speed * (step.film[b] - step.film[a]) / cells.length
    change = 0.5 * (step.before - step.film)[cells.ends].sum(axis=1)
    # What the master brings along; squeezing is taken exactly.
    behind = np.where(slid * change < 0.0, 0.0, np.sign(change))
    behind *= np.minimum(np.abs(slid), np.abs(change)) / step.film[cells.ends].mean(axis=1)
    weight = look.solution.pressure[cells.ends].mean(axis=1) * cells.length
    off = LAGS * float(np.abs(weight @ behind) / max(weight.sum(), np.finfo(float).tiny))
    if off > LAG:
        yield (
            "lag",
            off,
            "the master ends within the film, which lags behind it by half a step: the load may be "
            f"off by {100.0 * off:.2g} % ({look.when}); steps of {step.dt * LAG / off:.2g} s, or "
            "the body that ends as slave, and film.steady",
        )


CHECKS = (
    *(inlet, cells_below, roughness, master_facets, oil),
    *(steady_flow, reservoirs, heat, thickening, lag),
)
"""All that a film which carries a part of the load is held against."""


def cell_depths(term: LubricatedTerm, space: dolfinx.fem.FunctionSpace) -> Floats:
    """How far the cells reach in (f,), m, below the slave's facets, over the elements' degree.

    Of the facets of all ranks; collective.
    """
    dim, surface = term.surface.dim, term.surface
    assert isinstance(term.rule, AsperityPressure)
    mine, first = np.unique(term.rule.facet_of, return_index=True)
    index = space.dofmap.index_map
    nodes = surface.nodes[surface.slave_rows[first, :2]]
    ends = index.global_to_local(nodes.reshape(-1)).reshape(nodes.shape)
    cells = np.asarray(space.dofmap.list, dtype=np.int64)
    place = np.repeat(np.arange(len(cells)), cells.shape[1])
    table = scipy.sparse.csr_matrix(
        (np.ones(cells.size, dtype=np.int8), (cells.reshape(-1), place)),
        (index.size_local + index.num_ghosts, len(cells)),
    )
    cell = table[ends[:, 0]].multiply(table[ends[:, 1]]).tocsr().indices  # one has both
    position = space.tabulate_dof_coordinates()[:, :dim]
    along = position[ends[:, 1]] - position[ends[:, 0]]
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    inward = position[cells[cell]] - position[ends[:, 0]][:, None]
    depth = np.abs(np.einsum("fai,fi->fa", inward, normal)).max(axis=1)
    out: Floats = np.zeros(len(term.faces))
    out[mine] = depth / space.element.basix_element.degree
    return surface.vertices.total(out)
