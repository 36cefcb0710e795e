r"""Friction of a line contact over load, speed and oil: ``tribox map`` where the film is found.

A round tool on a half plane of the bodies' E\*, in a steady state, with the roughness, oil and
asperities of the case. With the gap g between the mean planes, p = p_a(g) + p_f and the approach d

.. math:: g(x) = \frac{x^2}{2 R} - d - \frac{2}{\pi E^*} \int p(s) \ln|x - s|\, ds, \qquad
   \int p\, dx = W

by Newton's method, the film's own equations solved inside (:mod:`tribox.forms.film.reynolds`).

Axis letters: n places along the contact.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tribox.app.case.bodies import Body, Elastomer, ElastoPlasticBody
from tribox.app.case.film import Film
from tribox.app.case.tools import CircleTool
from tribox.app.errors import InputError, tell
from tribox.app.figures.style import STYLE, Floats, look_of, save, thin_log_ticks, titled
from tribox.app.friction_map.setup import mapped
from tribox.app.results.directory import write_json, write_table
from tribox.forms.bodies.materials import young_and_poisson
from tribox.forms.film.places import FilmCells
from tribox.forms.film.reynolds import FilmError, FilmStep, ReynoldsFilm, wedge_film
from tribox.forms.film.roughness import Asperities, RoughGap
from tribox.forms.friction.film_rheology import FilmRheology

if TYPE_CHECKING:
    from tribox.app.case.case import Case


COLUMNS = (
    *("load [N/m]", "pressure [Pa]", "velocity [m/s]", "oil [kg/m^2]", "friction_coefficient [-]"),
    *("asperity_share [-]", "film_middle [m]", "film_least [m]", "film_over_sigma [-]"),
    *("oil_passed [-]", "iterations"),
)
LOADS = (0.3, 1.0, 3.0)  # of that of the case
OILS = (1.5, 3.0, 6.0)  # σ, where the case has more oil than enough; else shares of its own
OF_OWN = (0.25, 0.5, 1.0, 2.0)
DENSITY = 900.0  # kg/m³, where the case gives none
FILMS = (0.03, 30.0)  # σ, films of a smooth contact between which the speeds lie
SPEEDS_PER_DECADE = 4
ENDS = (-12.0, 4.0)  # a, of the film
STEP_AT_EDGE = 0.5  # of the inlet's length
GROWTH, WIDEST = 1.2, 0.1  # of one step over the last, and a
MOST_HALVINGS = 10  # of the logarithm of a speed step
TOLERANCE, MOST_ITERATIONS = 1e-8, 60


@dataclass(frozen=True, slots=True)
class Point:
    """A steady contact."""

    gap: Floats  # g (n,), m
    unknown: Floats  # w (n,) of the film
    approach: float  # d, m
    friction: float  # F/W
    dry: float  # share of the asperities
    film: Floats  # h (n,), m
    pressure: Floats  # p (n,), Pa
    passed: float  # share of the oil brought that passes
    iterations: int  # of Newton's method


@dataclass(frozen=True, slots=True)
class LineContact:
    """What is pressed and slid: radius R, m, modulus E*, Pa, mu of the asperities, rough and oil.

    ``place``: x (n,), m, oil coming from below; ``compliance``: (n, n), m/Pa.
    """

    radius: float
    modulus: float
    mu: float
    place: Floats
    compliance: Floats
    rough: RoughGap
    asperities: Asperities
    rheology: FilmRheology

    def half_width(self, load: float) -> float:
        """H. Hertz's a, m, under a load, N/m."""
        return float(np.sqrt(4.0 * load * self.radius / (np.pi * self.modulus)))

    def on(self, load: float) -> LineContact:
        """The same with places for a load, N/m: fine at both edges, where the film begins."""
        a, sigma = self.half_width(load), self.rough.sigma
        inlet = (sigma**2 * self.radius**2 / a) ** (1.0 / 3.0)
        place = graded(ENDS[0] * a, ENDS[1] * a, a, min(STEP_AT_EDGE * inlet, WIDEST * a))
        return replace(self, place=place, compliance=half_plane(place, self.modulus))

    def dry(self, load: float) -> Point:
        """At rest, on the asperities alone."""
        # From ten σ apart, where nothing touches, under loads that each begin where the last ended;
        # w below 0 is a film that is not full, without pressure.
        ten = 10.0 * max(self.rough.sigma, 1e-12)
        shape: Floats = np.asarray(self.place**2 / (2.0 * self.radius), dtype=np.float64)
        none = np.zeros(len(shape))
        start = Point(shape + ten, none - 1e-3, -ten, 0.0, 1.0, shape, none, 1.0, 0)
        for share in (1e-3, 1e-2, 0.1, 0.3, 1.0):
            start = self.at(share * load, 0.0, np.inf, start)
        return start

    def at(self, load: float, speed: float, oil: float, start: Point) -> Point:
        """Steady state of a load (N/m), speed (m/s) and oil (θh, m); FilmError if there is none."""
        area, count = self._cells().area, len(self.place)
        shape = self.place**2 / (2.0 * self.radius)
        gap, w, d = start.gap, start.unknown, start.approach
        for iteration in range(1, MOST_ITERATIONS + 1):
            film, d_film = self.rough.film(gap)
            dry, d_dry = self.asperities.pressure(gap)
            wet, w, d_wet, passed, filled = self._film(film, speed, oil, w, load)
            # ∂p_i/∂g_j = ∂p_i/∂h_j dh_j/dg_j: a factor for each column.
            carried, by_gap = dry + wet, np.diag(d_dry) + d_wet * d_film
            error = gap - shape + d - self.compliance @ carried
            missing = area @ carried / load - 1.0
            # The approach d is an unknown like the gaps; its row is the balance with the load.
            matrix = np.empty((count + 1, count + 1))
            matrix[:-1, :-1] = np.eye(count) - self.compliance @ by_gap
            matrix[:-1, -1], matrix[-1, -1] = 1.0, 0.0
            matrix[-1, :-1] = area @ by_gap / load
            change = np.linalg.solve(matrix, -np.append(error, missing))
            # Gaps beside the contact may still move while all that presses has settled.
            loaded = carried > 0.01 * carried.max()
            size = max(float(np.max(np.abs(change[:-1] / film)[loaded])), abs(float(missing)))
            if size < TOLERANCE:
                drag = self._drag(film, dry, wet, filled, speed)
                share = float(area @ dry) / load
                return Point(gap, w, d, drag / load, share, film, carried, passed, iteration)
            step = self._bounded(change[:-1], film, loaded)
            gap, d = gap + step * change[:-1], d + step * change[-1]
        raise FilmError(f"no steady contact in {MOST_ITERATIONS} iterations")

    def _bounded(self, change: Floats, film: Floats, loaded: NDArray[np.bool_]) -> float:
        """Share of a change of the gap (n,), m, that Newton's method takes."""
        least = 4.0 * self.rough.sigma
        closing = -change / np.maximum(0.7 * film, least)
        opening = np.where(loaded, change, 0.0) / np.maximum(2.0 * film, least)
        return 1.0 / max(1.0, float(closing.max()), float(opening.max()))

    def _cells(self) -> FilmCells:
        return FilmCells.on_line(self.place)

    def _film(
        self, film: Floats, speed: float, oil: float, w: Floats, load: float
    ) -> tuple[Floats, Floats, Floats, float, Floats]:
        """Pressure (n,), w, ∂p/∂h (n, n), share of the oil that passes and θ (n,) of a film."""
        count = len(film)
        if speed == 0.0:
            none = np.zeros(count)
            return none, w, np.zeros((count, count)), 1.0, none + 1.0
        a = self.half_width(load)
        # p_s is the peak of H. Hertz's pressure, 2 W/(π a).
        solver = ReynoldsFilm(self._cells(), self.rheology, self.rough, 2.0 * load / (np.pi * a))
        u = np.full(count - 1, 0.5 * speed)
        step = FilmStep(film, u, solver.cells.last(), np.full(count, oil))
        found = solver.solve(step, w)
        # Brought is what the mean speed carries: the oil, or all of the gap where there is more.
        passed = float(found.supply[0]) / (0.5 * speed * min(oil, float(film[0])))
        slopes = solver.slopes(step, found)
        by_film = slopes.by_pressure[:, None] * slopes.unknown(slopes.by_film.toarray())
        return found.pressure, found.unknown, by_film, passed, found.filled

    def _drag(self, film: Floats, dry: Floats, wet: Floats, filled: Floats, speed: float) -> float:
        """Friction force, N/m: asperities, and the film's shear on the half plane."""
        area = self._cells().area
        rate: Floats = np.asarray(speed / film, dtype=np.float64)
        eta = self.rheology.viscosity(rate, wet).value
        # The flow by pressure shears this wall by −(h/2) ∂p/∂x.
        faces = wedge_film(np.stack([film[1:], film[:-1]], axis=1))[0]
        gradient = 0.5 * faces @ np.diff(wet)
        sheared: Floats = self.mu * dry + filled * eta * rate
        return float(area @ sheared - gradient)


def graded(low: float, high: float, edge: float, least: float) -> Floats:
    """Places (n,), m, from low to high: ``least`` apart at ± ``edge``, wider away from both."""

    def side(way: float) -> Floats:
        """Distances from an edge up to ``way``, growing, the last at ``way``."""
        steps = [least]
        while sum(steps) < way:
            steps.append(min(steps[-1] * GROWTH, WIDEST * edge))
        found = np.concatenate([[0.0], np.cumsum(steps)])
        return np.asarray(found * (way / found[-1]), dtype=np.float64)

    # Slices leave out what the part beside has already: both edges, and the middle.
    inner = side(edge)
    parts = [-edge - side(-edge - low)[:0:-1], -edge + inner, edge - inner[-2::-1]]
    return np.concatenate([*parts, edge + side(high - edge)[1:]])


def half_plane(place: Floats, modulus: float) -> Floats:
    """Displacement (n, n) into a half plane, m/Pa, of pressures linear between places (n,), m.

    K. L. Johnson, Contact Mechanics, 1985, section 2.3: −2/(π E*) ∫ p ln|x − s| ds.
    """

    def first(t: Floats) -> Floats:
        """∫ ln|t| dt."""
        return np.asarray(t * np.log(np.where(t == 0.0, 1.0, np.abs(t))) - t, dtype=np.float64)

    def second(t: Floats) -> Floats:
        """∫ t ln|t| dt."""
        log = np.log(np.where(t == 0.0, 1.0, np.abs(t)))
        return np.asarray(0.5 * t**2 * log - 0.25 * t**2, dtype=np.float64)

    low = place[None, :-1] - place[:, None]
    high = place[None, 1:] - place[:, None]
    length = np.diff(place)
    # With t = s − x the halves of a hat are (high − t)/l and (t − low)/l.
    plain, turned = first(high) - first(low), second(high) - second(low)
    out = np.zeros((len(place), len(place)))
    out[:, :-1] += (high * plain - turned) / length
    out[:, 1:] += (turned - low * plain) / length
    return np.asarray(-2.0 / (np.pi * modulus) * out, dtype=np.float64)


# -- What is mapped, tables and figures ------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class FilmMap:
    """What is mapped."""

    title: str  # of the case
    contact: LineContact  # without places
    sigma: float  # m
    loads: tuple[float, ...]  # N/m
    speeds: tuple[float, ...]  # m/s, rising
    oils: tuple[float, ...]  # kg/m², the last infinite
    density: float  # kg/m³, of them
    notes: tuple[str, ...]  # what was assumed, a line each


@dataclass(frozen=True, slots=True)
class Curve:
    """Rows (v,) of :data:`COLUMNS` at rising speeds, of one load and oil; failed: speeds, m/s."""

    load: float
    oil: float
    rows: tuple[tuple[float, ...], ...]
    failed: tuple[float, ...]


def film_map(case: Case) -> FilmMap:
    """The line contact of a case's first pair with a film that is found; InputError: it is none."""
    index = mapped(case) or 0
    pair = case.contact[index]
    film, tool = pair.film, case.tools.get(pair.master)
    assert film is not None and film.sigma is not None
    place, where = f"contact.{index}", "tribox map of a film that is found"
    if not isinstance(tool, CircleTool) or tool.inside:
        raise InputError(f'{place}.master = "{pair.master}": {where} takes a circle as tool')
    if film.share != "contact" or film.sigma == 0.0:
        raise InputError(f'{place}.film: {where} takes share = "contact" and sigma > 0')
    if pair.friction.law not in ("coulomb", "frictionless"):
        raise InputError(
            f'{place}.friction.law = "{pair.friction.law}": {where} takes "coulomb", of the '
            'asperities, or "frictionless"'
        )
    load = _load(case, tool) / case.geometry.slab
    name = _body_of(case, pair.slave)
    body = case.bodies[name]
    modulus = _modulus(name, body)
    none: Floats = np.zeros(0)
    contact = LineContact(
        radius=tool.radius,
        modulus=modulus,
        mu=_coefficient(pair.friction),
        place=none,
        compliance=none,
        rough=RoughGap(film.sigma, film.gamma or None),
        asperities=film.asperity_law(modulus),
        rheology=film.rheology(),
    )
    own = film.oil if isinstance(film.oil, float) else None
    density = film.density or DENSITY
    oils = [n * film.sigma * density for n in OILS] if own is None else [n * own for n in OF_OWN]
    return FilmMap(
        title=case.title,
        contact=contact,
        sigma=film.sigma,
        loads=tuple(factor * load for factor in LOADS),
        speeds=_speeds(contact, film.sigma, load),
        oils=(*oils, np.inf),
        density=density,
        notes=tuple(_notes(film, name, body)),
    )


def _notes(film: Film, name: str, body: Body) -> Iterator[str]:
    """What is assumed, a line each."""
    yield "the body is taken for an elastic half plane; a layer is stiffer"
    if getattr(body, "prony", ()):
        yield f"bodies.{name}: its branches are relaxed; E* is that of its long-term G"
    if getattr(body, "mullins", None) is not None:
        yield f"bodies.{name}: its softening is left out"
    if not film.density:
        yield f"the case gives no density: {DENSITY:g} kg/m^3 assumed"


def _load(case: Case, tool: CircleTool) -> float:
    """The largest force that presses a tool, N."""
    force = tool.force.y if tool.force is not None else None
    largest = max((abs(value) for value in force.values), default=0.0) if force is not None else 0.0
    if largest == 0.0:
        raise InputError(
            "tribox map of a film that is found takes the load from force.y of the tool: give one"
        )
    return largest


def _coefficient(friction: Any) -> float:
    """μ of the asperities; of a program its largest."""
    if friction.law == "frictionless":
        return 0.0
    return friction.mu if isinstance(friction.mu, float) else max(friction.mu.values)


def _body_of(case: Case, slave: str) -> str:
    """The body that a surface is named after, or the only one."""
    names = [name for name in case.bodies if slave.startswith(name)] or list(case.bodies)
    if len(names) > 1 and len(case.bodies) == len(names):
        known = ", ".join(names)
        raise InputError(f"slave = {slave}: tribox map cannot tell its body; of {known}")
    return max(names, key=len)


def _modulus(name: str, body: Body) -> float:
    """E*, Pa, of a body; in the steady state of a contact that stays where it is, it is relaxed."""
    solid = body.relaxed_material(False) if isinstance(body, Elastomer) else body
    shear, bulk = (getattr(solid, f"{of}_modulus", None) for of in ("shear", "bulk"))
    if isinstance(body, ElastoPlasticBody) or shear is None or bulk is None:
        raise InputError(
            f'bodies.{name}.material = "{body.material}": tribox map of a film that is found takes '
            "an elastic body with moduli of its own: metal that yields bears other pressures"
        )
    young, poisson = young_and_poisson(shear, bulk)
    return float(young / (1.0 - poisson**2))


def _speeds(contact: LineContact, sigma: float, load: float) -> tuple[float, ...]:
    """From where the film is far thinner than the roughness to where it is far thicker.

    A smooth, soft contact has about h = 2.5 R (u η/2 E* R)^0.6 (W/2 E* R)^-0.2 (K. Herrebrugh,
    J. Lubr. Technol. 90, 1968, with the constant rounded), u = V/2.
    """
    scale = 2.0 * contact.modulus * contact.radius
    eta = contact.rheology.eta_b
    ends = []
    for ratio in FILMS:
        film = ratio * sigma / (2.5 * contact.radius)
        ends.append(2.0 * scale / eta * (film * (load / scale) ** 0.2) ** (1.0 / 0.6))
    low, high = (10.0 ** np.round(np.log10(end)) for end in ends)
    count = round(np.log10(high / low)) * SPEEDS_PER_DECADE + 1
    return tuple(float(f"{v:.6g}") for v in np.geomspace(low, high, count))


def compute(setup: FilmMap) -> list[Curve]:
    """All curves: every load with every oil, more than enough first."""
    curves = []
    for load in setup.loads:
        contact = setup.contact.on(load)
        dry = contact.dry(load)
        for oil in sorted(setup.oils, reverse=True):
            points, failed, last, before = [], [], dry, 0.1 * setup.speeds[0]
            for speed in setup.speeds:
                try:
                    last = reached(contact, load, oil / setup.density, (before, speed), last)
                except FilmError:
                    failed.append(speed)
                    continue
                before = speed
                a = contact.half_width(load)
                middle = float(np.interp(0.0, contact.place, last.film))
                least = float(last.film[last.pressure > 0.01 * last.pressure.max()].min())
                points.append((
                    *(load, load / (2.0 * a), speed, oil, last.friction, last.dry),
                    *(middle, least, middle / setup.sigma, last.passed, float(last.iterations)),
                ))  # fmt: skip
            curves.append(Curve(load, oil, tuple(points), tuple(failed)))
    return curves


def reached(
    contact: LineContact,
    load: float,
    oil: float,
    speeds: tuple[float, float],
    start: Point,
    halvings: int = MOST_HALVINGS,
) -> Point:
    """The steady contact at the second of two speeds, from that at the first, by smaller steps.

    Where oil lacks, pressure turns to none with the last per cent of the gap; FilmError.
    """
    try:
        return contact.at(load, speeds[1], oil, start)
    except FilmError:
        if halvings == 0:
            raise
    middle = float(np.sqrt(speeds[0] * speeds[1]))
    start = reached(contact, load, oil, (speeds[0], middle), start, halvings - 1)
    return reached(contact, load, oil, (middle, speeds[1]), start, halvings - 1)


def write(setup: FilmMap, curves: list[Curve], directory: Path, seconds: float) -> None:
    """Write ``film_map.csv`` and ``summary.json``."""
    rows = [list(row) for curve in curves for row in curve.rows]
    write_table(directory / "film_map.csv", COLUMNS, rows)
    write_json(
        directory / "summary.json",
        {
            "title": setup.title,
            "notes": list(setup.notes),
            "radius_m": setup.contact.radius,
            "modulus_Pa": setup.contact.modulus,
            "mu": setup.contact.mu,
            "sigma_m": setup.sigma,
            "density_kg_per_m3": setup.density,
            "loads_N_per_m": list(setup.loads),
            "points": len(rows),
            "points_not_found": sum(len(curve.failed) for curve in curves),
            "seconds": round(seconds, 2),
        },
    )


def draw(setup: FilmMap, curves: list[Curve], path: Path) -> None:
    """Draw friction and the asperities' share: over loads when flooded, over oils at one load."""
    middle = setup.loads[len(setup.loads) // 2]
    choices = [
        [c for c in curves if np.isinf(c.oil)],
        sorted((c for c in curves if c.load == middle), key=lambda c: c.oil),
    ]
    with rc_context(STYLE):
        figure = Figure(figsize=(10.0, 6.6), layout="constrained")
        panels = figure.subplots(2, 2, sharex=True, sharey="row", height_ratios=[2.0, 1.0])
        for column, chosen in zip(panels.T, choices, strict=True):
            by_load = chosen is choices[0]
            for number, curve in enumerate(chosen):
                if not curve.rows:
                    continue
                rows = np.array(curve.rows)
                # What a curve is called
                if by_load:
                    label = f"p = {curve.rows[0][1] / 1e6:.3g} MPa"
                else:
                    label = "flooded" if np.isinf(curve.oil) else f"{1e3 * curve.oil:.3g} g/m²"
                for axes, name in zip(column, (4, 5), strict=True):
                    axes.plot(
                        rows[:, 2], rows[:, name], **look_of(number), lw=0.9, ms=4, label=label
                    )
            column[0].set_xscale("log")
            column[1].set_xlabel("sliding velocity V (m/s)")
            column[0].legend(fontsize=8)
        panels[0, 0].set_ylim(bottom=0.0)
        panels[1, 0].set_ylim(-0.03, 1.03)
        panels[0, 0].set_ylabel("friction coefficient (-)")
        panels[1, 0].set_ylabel("load on asperities (-)")
        panels[0, 0].set_title("more oil than passes", fontsize=9)
        mean = middle / (2.0 * setup.contact.half_width(middle))
        panels[0, 1].set_title(f"p = {mean / 1e6:.3g} MPa", fontsize=9)
        for axes in panels.flat:
            thin_log_ticks(axes)
        words = "a round tool on a half plane, steady, with the film that is found"
        figure.suptitle(titled(setup.title, words), fontsize=9)
        save(figure, path)


def map_film(setup: FilmMap, directory: Path) -> None:
    """Map a film into a directory that is ready."""
    started = time.perf_counter()
    curves = compute(setup)
    seconds = time.perf_counter() - started
    write(setup, curves, directory, seconds)
    (directory / "figures").mkdir(exist_ok=True)
    draw(setup, curves, directory / "figures" / "film_map.png")
    for note in setup.notes:
        tell(f"note: {note}")
    print(f"{sum(len(curve.rows) for curve in curves)} steady states in {seconds:.3g} s")
    lost = sum(len(curve.failed) for curve in curves)
    if lost:
        tell(f"warning: {lost} states were not found; film_map.csv is without them")
    print(f"results in {directory}")
