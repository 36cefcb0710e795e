"""The film's mass balance against closed forms, and its derivatives."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from tribox.forms.film.places import FilmCells, FilmPlaces
from tribox.forms.film.reynolds import FilmError, FilmStep, ReynoldsFilm, wedge_film
from tribox.forms.film.roughness import RoughGap
from tribox.forms.friction.film_rheology import FilmRheology

SMOOTH = RoughGap(0.0)


def smooth_film(x, eta, scale, rings=False):
    return ReynoldsFilm(FilmCells.on_line(x, rings), FilmRheology(eta_b=eta), SMOOTH, scale)


def at_ends(count):
    fixed = np.zeros(count, dtype=bool)
    fixed[[0, -1]] = True
    return fixed


def flooded(h, speed, fixed=None, **more):
    """A step with ends that are flooded and a speed the same everywhere."""
    count = len(h)
    fixed = at_ends(count) if fixed is None else fixed
    return FilmStep(h, np.full(count - 1, speed), fixed, np.full(count, np.inf), **more)


# -- slider -----------------------------------------------------------------------------------

LENGTH, LEAST, ETA, SPEED = 1e-2, 1e-6, 0.8, 0.1


def test_a_cylinder_that_passes_carries_what_one_at_rest_does():
    """In steps of a cell: what shear carries is its mean over the step, as storage is."""
    radius, least, speed = 0.01, 1e-6, 1.0
    b = np.sqrt(2.0 * radius * least)
    x = np.linspace(0.0, 28.0 * b, 561)
    dx, at = x[1], 20.0 * b
    film = smooth_film(x, 0.1, 12 * 0.1 * b / 1e-12 / 10)
    h = np.minimum(least + (x - at) ** 2 / (2.0 * radius), 2e-4)
    w, volume, loads = np.full(561, -0.1), h * film.cells.area, []
    dt = dx / speed
    for _ in range(int(10.0 * b / (speed * dt))):
        before, at = h, at - speed * dt
        h = np.minimum(least + (x - at) ** 2 / (2.0 * radius), 2e-4)
        found = film.solve(flooded(h, -speed / 2, dt=dt, before=before, volume=volume), w)
        w, volume = found.unknown, found.volume
        loads.append(film.cells.area @ found.pressure)
    load = np.mean(loads[-len(loads) // 4 :]) * least / (0.1 * speed * radius)
    assert load == pytest.approx(2.4211, rel=0.016)  # of the steady film with 3001 places


# -- squeeze ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rings", "load", "time"),
    [
        (False, 3000.0, ETA * 1e-3**3 / (2 * 3000.0)),
        (True, 9.42478, 3 * np.pi * ETA * 1e-3**4 / (4 * 9.42478)),
    ],
    ids=["strip", "disc"],
)
def test_a_film_is_squeezed_out_in_the_time_of_the_closed_form(rings, load, time):
    x = np.linspace(0.0, 1e-3, 41)
    film = smooth_film(x, ETA, load / (np.pi * 1e-6 if rings else 1e-3), rings)
    fixed = at_ends(41)
    fixed[0] = not rings
    taken, thick = 0.0, [1e-6, 5e-7, 2.5e-7, 1.25e-7]
    for h0, h1 in itertools.pairwise(thick):
        dt, h = time / h1**2, np.full(41, h1)
        before = np.full(41, h0)
        for _ in range(3):
            volume = before * film.cells.area
            step = flooded(h, 0.0, fixed, dt=dt, before=before, volume=volume)
            found = film.solve(step, np.ones(41))
            dt *= film.cells.area @ found.pressure / load
        taken += dt
        exact = time * (1.0 / h1**2 - 1.0 / h0**2)
        assert dt == pytest.approx(exact, rel=2e-3)
    # The volume that left went through the rim.
    change = np.sum(volume) - np.sum(found.volume)
    assert change == pytest.approx(-np.sum(found.supply) * step.dt, rel=1e-10)


# -- cavitation -------------------------------------------------------------------------------


def parabola(count, left=-15.0, right=8.0):
    """Places, film and the group b of a cylinder on a plane."""
    radius, least = 0.01, 1e-6
    b = np.sqrt(2.0 * radius * least)
    x = np.linspace(left * b, right * b, count)
    return x, least + x**2 / (2.0 * radius), b


def test_a_film_behind_a_cylinder_cavitates_where_reynolds_condition_says():
    x, h, b = parabola(369)
    film = smooth_film(x, 0.1, 12 * 0.1 * b / 1e-12 / 10)
    found = film.solve(flooded(h, 0.5), np.where(x < 0.0, 0.1, -0.1))
    assert found.flux.mean() / (0.5 * 1e-6) == pytest.approx(1.2260, rel=1e-3)
    assert np.ptp(found.flux) < 1e-8 * found.flux.mean()
    assert found.filled.min() >= 0.0
    assert found.filled.max() <= 1.0
    assert found.pressure.min() >= 0.0


def test_the_mirrored_film_is_the_same():
    x, h, b = parabola(120)
    h = h * (1.0 + 0.2 * np.tanh(x / b))
    film = smooth_film(x, 0.1, 12 * 0.1 * b / 1e-12 / 10)
    found = film.solve(flooded(h, 0.5), np.where(x < 0.0, 0.1, -0.1))
    back = smooth_film(-x[::-1], 0.1, film.scale)
    other = back.solve(flooded(h[::-1].copy(), -0.5), np.where(x > 0.0, 0.1, -0.1))
    assert other.pressure[::-1] == pytest.approx(found.pressure, rel=1e-9, abs=1e-6)
    assert other.filled[::-1] == pytest.approx(found.filled, rel=1e-9)
    assert -other.flux[::-1] == pytest.approx(found.flux, rel=1e-9)
    assert other.supply[::-1] == pytest.approx(found.supply, rel=1e-9, abs=1e-16)


def test_a_reservoir_floods_the_film_without_a_pressure_of_its_own():
    x, h, _ = parabola(60)
    film = smooth_film(x, 0.1, 1e9)
    step = flooded(h, 0.5)
    for content in (np.inf, 1.0 - 1e-6):  # what is all but full is no fuller
        given = np.where(step.fixed, content * h, np.inf)
        found = film.solve(replace(step, content=given), np.where(x < 0.0, 1e-3, -0.1))
        assert found.filled[[0, -1]] == pytest.approx(1.0 - 1e-4, abs=1e-9)
        assert found.pressure[[0, -1]] == pytest.approx(0.1, rel=1e-3)  # ε² p_s/δ, not ε p_s


@pytest.mark.parametrize(("oil", "count"), [(1.05e-6, 801), (1.15e-6, 201), (1.2e-6, 801)])
def test_a_starved_film_is_as_thick_as_the_oil_under_its_greatest_pressure(oil, count):
    x, h, b = parabola(count, -10.0, 6.0)
    film = smooth_film(x, 0.1, 12 * 0.1 * b / 1e-12 / 10)
    content = np.full(count, np.inf)
    content[0] = oil
    step = replace(flooded(h, 0.5), content=content)
    found = film.solve(step, np.where(x < 0.0, 0.05, -0.1))
    top = int(np.argmax(found.pressure))
    near = slice(top - 1, top + 2)
    curve = np.polyfit(x[near] / b, found.pressure[near] / film.scale, 2)
    at = -curve[1] / (2.0 * curve[0]) * b
    assert np.interp(at, x, h) == pytest.approx(oil, rel=5e-3)
    # However steeply the gap grows where the oil comes in.
    assert found.flux == pytest.approx(0.5 * oil, rel=1e-9)


@pytest.mark.parametrize("oil", [0.02, 0.5, np.inf], ids=["little", "some", "flooded"])
@pytest.mark.parametrize("seed", range(4))
def test_no_film_pulls_or_holds_more_or_less_than_fits(seed, oil):
    """0 ≤ θ ≤ 1 and p ≥ 0 whatever the gap does, in steps of several cells; oil is kept."""
    rng, count = np.random.default_rng(seed), 60
    x = np.cumsum(rng.uniform(0.5, 2.0, count))
    film = smooth_film(x, 1.0, 1e4)
    area, fixed = film.cells.area, at_ends(count) & ~np.isfinite(oil)
    h = np.exp(rng.normal(size=count))
    volume, w = area * np.minimum(h, oil), np.full(count, -0.5)
    for _ in range(6):
        before, h = h, h * np.exp(0.3 * rng.normal(size=count))
        step = flooded(h, 4.0 * rng.normal(), fixed, dt=0.5, before=before, volume=volume)
        found = film.solve(step, w)
        assert found.pressure.min() >= 0.0
        assert 0.0 <= found.filled.min() <= found.filled.max() <= 1.0
        gained = found.volume.sum() - volume.sum() - step.dt * found.supply.sum()
        assert abs(gained) < 1e-10 * volume.sum()
        w, volume = found.unknown, found.volume
    steady = film.solve(flooded(h, 1.0), np.where(x < x[np.argmin(h)], 0.05, -0.1))
    assert steady.pressure.min() >= 0.0
    assert 0.0 <= steady.filled.min() <= steady.filled.max() <= 1.0


@pytest.mark.parametrize("ratio", [2.0, 20.0])
def test_a_wedge_is_exact_with_any_number_of_places(ratio):
    """Pressure at the places, h^-2 and h^-1 and a constant: Reynolds' of a plane slider."""
    x = np.array([0.0, 0.35, 0.6, 1.0])
    h = ratio - (ratio - 1.0) * x
    found = smooth_film(x, 1.0, 10.0).solve(flooded(h, 0.5), np.full(4, 0.01))
    flow = ratio / (ratio + 1.0)
    exact = 12.0 / (ratio - 1.0) * (0.5 / h - 0.5 * flow / h**2)
    exact = exact - exact[0]
    # What floods the film leaves a ten-thousandth of it unfilled.
    assert found.flux == pytest.approx(flow, rel=1e-4)
    assert found.pressure[1:3] == pytest.approx(exact[1:3], rel=5e-4)


# -- derivatives ------------------------------------------------------------------------------

THIN = FilmRheology(
    eta_b=0.1, barus=2e-7, critical_rate=1e5, thinning_exponent=0.6, eta_inf=0.01, tau_0=1e6
)


@pytest.mark.parametrize("rheology", [FilmRheology(eta_b=0.1), THIN], ids=["newtonian", "thinning"])
@pytest.mark.parametrize("moving", [False, True], ids=["steady", "in-time"])
def test_the_tangent_is_that_of_differences(rheology, moving):
    x, h, b = parabola(60, -8.0, 4.0)
    film = ReynoldsFilm(FilmCells.on_line(x), rheology, RoughGap(3e-7), 12 * 0.1 * b / 1e-12 / 10)
    content = np.full(60, np.inf)
    content[0] = 1.4e-6
    before = 1.02 * h
    more = {"dt": 1e-4, "before": before, "volume": before * film.cells.area} if moving else {}
    step = replace(flooded(h, 0.5, **more), content=content)
    step = replace(step, speed=step.speed * (1.0 + 0.1 * np.sin(x[1:] / b)))
    newtonian = replace(film, rheology=FilmRheology(eta_b=0.1))
    found = film.solve(step, newtonian.solve(step, np.where(x < 0.0, 0.05, -0.1)).unknown)
    slopes = film.slopes(step, found)
    rng = np.random.default_rng(3)
    by_film, by_speed = h * rng.normal(size=60), rng.normal(size=59)
    for dh, du in ((by_film, 0.0 * by_speed), (0.0 * by_film, by_speed)):
        e = 1e-6

        def at(t, dh=dh, du=du):
            moved = replace(step, film=h + t * dh, speed=step.speed + t * du)
            return film.solve(moved, found.unknown)

        plus, minus = at(e), at(-e)
        d_w = slopes.unknown(
            slopes.by_film @ dh + slopes.by_speed(np.arange(59), np.ones(59), 59) @ du
        )
        d_p, d_filled = slopes.by_pressure * d_w, slopes.by_filled * d_w
        for exact, low, high in (
            (d_p, minus.pressure, plus.pressure),
            (d_filled, minus.filled, plus.filled),
        ):
            difference = (high - low) / (2 * e)
            assert np.abs(exact - difference).max() < 1e-6 * np.abs(difference).max()


def test_a_film_that_cannot_balance_says_so():
    film = smooth_film(np.linspace(0.0, 1.0, 5), 1.0, 1.0)
    step = flooded(np.full(5, np.nan), 0.5)
    with pytest.raises(FilmError, match="mass balance"):
        film.solve(step, np.zeros(5))


def test_a_part_of_the_places_keeps_its_own_faces():
    places = FilmPlaces(np.array([[0, 1], [1, 2], [2, 3], [3, 4]]), 5, 2)
    part = places.part(np.array([False, True, True, False, True]))
    assert part.inside.tolist() == [False, True, False, False]
    cells = part.of(places.cells(np.array([1.0, 2.0, 1.0, 2.0]), np.full((4, 2), 0.5)))
    # Vertices first, then the places inside facets.
    assert cells.ends.tolist() == [[0, 3], [3, 1]]
    assert cells.length.tolist() == [1.0, 1.0]
    assert cells.last().tolist() == [True, True, True, False]


def test_another_part_of_the_same_places_is_its_own():
    places = FilmPlaces(np.array([[0, 1], [1, 2], [2, 3]]), 4, 2)
    first = places.part(np.array([True, True, False, False]))
    assert places.part(first.members.copy()) is first
    other = places.part(np.array([False, True, True, True]))
    assert other.inside.tolist() == [False, True, True]
    assert first.inside.tolist() == [True, False, False]


def divided(count=6, per_facet=3):
    """Facets of a ring that are not equal, their places, and a film on all but the first vertex."""
    rng = np.random.default_rng(5)
    facets = np.stack([np.arange(count - 1), np.arange(1, count)], axis=1)
    places = FilmPlaces(facets, count, per_facet)
    members = np.arange(count) > 0
    length = rng.uniform(1.0, 2.0, count - 1)
    parts = length[:, None] * rng.uniform(0.9, 1.1, (count - 1, 2))
    part = places.part(members)
    return part, part.of(places.cells(length, parts)), length[part.inside], parts, rng


def test_vertices_get_the_work_that_places_do():
    part, cells, length, parts, rng = divided()
    pressure = rng.normal(size=len(cells.area))
    # Forces and moments: the work on a slave that moves and turns.
    for moved in (np.ones(6), np.concatenate([[0.0, 0.0], np.cumsum(length)])):
        there = part.gaps(moved, length)
        assert part.sums(cells.area, pressure) @ moved == pytest.approx(
            (cells.area * pressure) @ there, rel=1e-12
        )
    # Vertices whose facets both have a film keep the areas that the facets give them.
    own = parts[1:-1, 1] + parts[2:, 0]
    assert part.sums(cells.area, np.ones(len(cells.area)))[2:5] == pytest.approx(own, rel=1e-12)


@pytest.mark.parametrize("closed", [False, True], ids=["line", "ring"])
def test_gaps_between_vertices_stay_between_theirs_and_have_their_slopes(closed):
    count, rng = 9, np.random.default_rng(3)
    facets = np.array([[i, (i + 1) % count] for i in range(count if closed else count - 1)])
    facets[2] = facets[2, ::-1]  # one runs the other way
    part = FilmPlaces(facets, count, 4).part(np.ones(count, dtype=bool))
    length, gap = rng.uniform(1.0, 3.0, len(facets)), rng.uniform(0.1, 1.0, count)
    here, slopes = part.gaps(gap, length), part.gap_slopes(gap, length)
    inner = here[count:].reshape(len(facets), 3)
    ends = gap[facets]
    least, most = ends.min(axis=1)[:, None], ends.max(axis=1)[:, None]
    beside = 0.005 * np.ptp(gap) * 3.0  # facets of up to three times the length
    assert np.all(inner >= least - beside) and np.all(inner <= most + beside)
    way, e = rng.normal(size=count), 1e-6
    change = (part.gaps(gap + e * way, length) - part.gaps(gap - e * way, length)) / (2 * e)
    assert slopes @ way == pytest.approx(change, abs=1e-8)


def test_gaps_before_an_edge_are_found_between_its_vertices():
    """g = x^3/2 beside a contact: off by a twentieth where a line is off by two fifths."""
    places = FilmPlaces(np.stack([np.arange(9), np.arange(1, 10)], axis=1), 10, 2)
    gap = np.maximum(np.arange(10.0) - 2.0, 0.0) ** 1.5
    inner = places.part(np.ones(10, dtype=bool)).gaps(gap, np.ones(9))[10:]
    exact = (np.arange(6) + 0.5) ** 1.5
    assert inner[2:8] == pytest.approx(exact, rel=5e-2)
    assert inner[3:8] == pytest.approx(exact[1:], rel=2e-2)
    assert 0.5 * (gap[2] + gap[3]) > 1.4 * exact[0]  # a line


def test_the_pull_is_the_integral_of_film_and_gradient_and_has_its_slopes():
    part, cells, length, _, rng = divided()
    count = len(cells.area)
    # h and p linear along the line: the mean of h ∂p/∂s is the mean film times the slope.
    at = np.concatenate([[0.0, *np.cumsum(length)]])
    line = part.gaps(np.concatenate([[np.inf], at]), length)
    mean = 2.0 + 0.3 * 0.5 * (at[1:] + at[:-1])
    faces = 2.0 + 0.3 * line[cells.ends].mean(axis=1)
    assert part.pulls(faces, 7.0 * line, length) == pytest.approx(7.0 * mean, rel=1e-12)
    film, pressure = rng.uniform(1.0, 2.0, count), rng.normal(size=count)

    def pulls(film, pressure):
        return part.pulls(film[cells.ends].mean(axis=1), pressure, length)

    halves = np.full(cells.ends.shape, 0.5)
    faces = film[cells.ends].mean(axis=1)
    by_film, by_pressure = part.pull_slopes(faces, halves, pressure, length)
    for slopes, one, other in ((by_film, 1.0, 0.0), (by_pressure, 0.0, 1.0)):
        way, e = rng.normal(size=count), 1e-3  # bilinear: central differences are exact
        high = pulls(film + one * e * way, pressure + other * e * way)
        low = pulls(film - one * e * way, pressure - other * e * way)
        assert slopes @ way == pytest.approx((high - low) / (2 * e), rel=1e-9, abs=1e-10)


@pytest.mark.parametrize("closed", [False, True], ids=["line", "ring"])
@pytest.mark.parametrize("cells", [1, 3])
def test_facets_in_any_order_give_the_film_of_a_line(closed, cells):
    count, rng = 12, np.random.default_rng(1)
    facets = np.array([[i, (i + 1) % count] for i in range(count if closed else count - 1)])
    h = 1.0 + 0.5 * np.sin(2 * np.pi * np.arange(count) / count)

    def pressures(name, order, way):
        ends = np.where(way[:, None] > 0.0, facets, facets[:, ::-1])
        places = FilmPlaces(name[ends][order], count, cells)
        part = places.part(np.ones(count, dtype=bool))
        # Of both senses of the whole the one in which the first facet runs.
        sense = part.sense * (part.sense * way[order])[np.argsort(order)[0]]
        size = np.ones(len(facets))
        line = part.of(places.cells(size, np.full((len(facets), 2), 0.5)))
        assert line.area.sum() == pytest.approx(len(facets), rel=1e-13)
        film = ReynoldsFilm(line, FilmRheology(eta_b=1.0), SMOOTH, 1.0)
        place = np.empty(count)
        place[name] = h
        speed = 0.1 * sense[part.feels]
        fixed = np.zeros(len(line.area), dtype=bool)
        fixed[name[[0, count // 2]]] = True
        step = FilmStep(part.gaps(place, size), speed, fixed, np.full(len(fixed), np.inf))
        found = film.solve(step, np.full(len(fixed), 0.01))
        pulled = part.pulls(wedge_film(step.film[line.ends])[0], found.pressure, size)
        return found.pressure[name], (way[order] * pulled)[np.argsort(order)]

    plain = pressures(np.arange(count), np.arange(len(facets)), np.ones(len(facets)))
    way = np.where(rng.random(len(facets)) < 0.5, -1.0, 1.0)
    mixed = pressures(rng.permutation(count), rng.permutation(len(facets)), way)
    for one, other in zip(plain, mixed, strict=True):
        assert other == pytest.approx(one, rel=1e-10, abs=1e-13)
    assert plain[0].max() > 0.1


def test_rings_divided_between_their_vertices_keep_their_area():
    radius = np.array([0.0, 1.0, 2.5])
    length = np.diff(radius)
    # 2 pi times the integrals of r and either hat function.
    a, b = radius[:-1], radius[1:]
    parts = 2 * np.pi * np.stack([length * (2 * a + b) / 6, length * (a + 2 * b) / 6], axis=1)
    cells = FilmPlaces(np.array([[0, 1], [1, 2]]), 3, 4).cells(length, parts)
    assert cells.area.sum() == pytest.approx(np.pi * 2.5**2, rel=1e-13)
    middle = np.concatenate([(np.arange(4) + 0.5) / 4, 1.0 + 1.5 * (np.arange(4) + 0.5) / 4])
    assert cells.width == pytest.approx(2 * np.pi * middle, rel=1e-12)
