r"""The mass balance of a film with cavitation on a line of places, and its pressure.

Axis letters: n places of the film, f faces between neighbours. Finite volumes in the material frame
of the surface that the places belong to:

.. math::
   \frac{\theta_A h_A M_A - v_A}{\Delta t} + \sum_f b_f q_f = 0, \qquad
   q_f = -\frac{k_f}{12 \eta_f} \frac{p_B - p_A}{L_f} + u_f\, \theta_{up}\, \bar h_f

with the areas M, the volumes v of the step before, faces of width b between places a length L
apart, :math:`k = \phi h^3` their mean over both places, and u half the velocity of the other
surface relative to this one. What rolls in with the places themselves is the storage term, which
makes the balance objective. The flow by shear takes the content of the place upstream and the mean
film of the face over the step, as the volumes before and after do: taken at its end alone, a gap
that closes ahead of a contact draws in too much, a load 7 % too high in steps of a cell.

**Cavitation** has one unknown w at each place: with :math:`r = \sqrt{w^2 + 4 \varepsilon^2}`

.. math:: p = p_s \frac{w + r}{2}, \qquad 1 - \theta = \frac{r - w}{2}, \qquad
   \frac{p}{p_s} (1 - \theta) = \varepsilon^2

which is the complementarity of pressure and missing oil, rounded off (A. Fischer, Optimization 24,
1992; H. Elrod, J. Lubr. Technol. 103, 1981). A reservoir that floods the film fills it but for
δ = 10⁻⁴, so that its pressure is not :math:`\varepsilon p_s` but :math:`\varepsilon^2 p_s/\delta`:
p_s goes with the modulus of the bodies, and a film on metal may bear kilopascals.

**Time mean of the mobility.** Within a step a film squeezed by a constant load obeys
:math:`\dot h \propto h^3`; its flow is that of

.. math:: \overline{h^3} = \frac{2 h_0^2 h_1^2}{h_0 + h_1}

which is exact for it, while the :math:`h_1^3` of backward Euler lets go 20 to 40 % too slowly at
five steps a halving, and is h³ where nothing changes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse
from scipy.linalg import lapack

from tribox.forms.film.roughness import RoughGap
from tribox.forms.friction.film_rheology import FilmRheology
from tribox.geometry.surfaces.facets import Bools, Floats, Longs

SMOOTHING = 1e-7  # ε
UNFILLED = 1e-4  # δ, 1 − θ of a reservoir that floods the film
TOLERANCE = 1e-11  # of the mass balance, over what flows and what is stored at a place
_ROUNDOFF = 1e-13  # the same, over the flow under the pressure scale: rounding of open gaps
MOST_ITERATIONS = 80


class FilmError(RuntimeError):
    """The film's own equations were not solved."""


class Band:
    """Matrices (n, n) with entries of neighbours only, as bands, and their solution.

    Places along a line have one neighbour on either side, those of a ring too once both its halves
    are numbered side by side.

    Attributes:
        row, column: (e,) of the entries: of each face those of both ends (4 f), and the diagonal.
        number: (n,) of the places, along the line.
    """

    def __init__(self, ends: Longs, count: int) -> None:
        """Number ``count`` places so that neighbours ``ends`` (f, 2) are near each other."""
        from scipy.sparse.csgraph import reverse_cuthill_mckee  # only films need it

        every = np.arange(count)
        self.row = np.concatenate([np.repeat(ends[:, 0], 2), np.repeat(ends[:, 1], 2), every])
        self.column = np.concatenate([ends.reshape(-1), ends.reshape(-1), every])
        entries = np.ones(len(self.row)), (self.row, self.column)
        pattern = scipy.sparse.csr_matrix(entries, (count, count))
        self._order = reverse_cuthill_mckee(pattern, symmetric_mode=True) if count else every
        self.number = np.empty(count, dtype=np.int64)
        self.number[self._order] = every
        apart = self.number[self.column] - self.number[self.row]
        self._reach = int(np.max(np.abs(apart), initial=0))
        self._place = (apart + self._reach) * count + self.number[self.row]
        self._count = count

    def solved(self, entries: Floats, right: Floats) -> Floats:
        """Solution for ``right`` (n,) or (n, r) with the ``entries`` (e,); NaN if singular.

        Rows and columns are scaled by their largest entries.
        """
        reach, count = self._reach, self._count
        size = (2 * reach + 1, count)
        summed = np.bincount(self._place, entries, size[0] * count)
        by_row: Floats = summed.astype(np.float64).reshape(size)
        rows = _reciprocal(np.abs(by_row).max(axis=0, initial=0.0))
        by_row = by_row * rows
        # LAPACK's bands go by columns, with room for what pivoting fills.
        bands = np.zeros((3 * reach + 1, count), order="F")
        for off in range(-reach, reach + 1):
            here = slice(max(0, -off), count - max(0, off))
            bands[2 * reach - off, max(0, off) : count + min(0, off)] = by_row[reach + off, here]
        columns = _reciprocal(np.abs(bands).max(axis=0, initial=0.0))
        bands *= columns
        factor, pivots, info = lapack.dgbtrf(bands, reach, reach, overwrite_ab=True)
        out: Floats = np.full_like(right, np.nan)
        if info == 0 and count:
            shape = (count,) + (1,) * (right.ndim - 1)
            scaled = np.asfortranarray(right[self._order] * rows.reshape(shape))
            found, _ = lapack.dgbtrs(factor, reach, reach, scaled, pivots, overwrite_b=True)
            out[self._order] = found.reshape(right.shape) * columns.reshape(shape)
        return out


def _reciprocal(size: Floats) -> Floats:
    return np.divide(1.0, size, out=np.ones_like(size), where=size > 0.0)


@dataclass(frozen=True, slots=True)
class FilmCells:
    """Where the film's places are, and which are neighbours.

    Attributes:
        ends: (f, 2) places that a face lies between; length: (f,), m, between them; width: (f,),
            m of rings, or 1 per unit thickness.
        area: (n,), m² per unit thickness, or of rings.
        band: of matrices between neighbours.
    """

    ends: Longs
    length: Floats
    width: Floats
    area: Floats
    band: Band

    @classmethod
    def on_line(cls, position: Floats, rings: bool = False) -> FilmCells:
        """Of places (n,), m, along a line, in order; ``rings``: these are radii."""
        number = np.arange(len(position) - 1)
        middle = 0.5 * (position[1:] + position[:-1])
        edges = np.concatenate([position[:1], middle, position[-1:]])
        area = np.pi * np.diff(edges**2) if rings else np.diff(edges)
        width = 2.0 * np.pi * middle if rings else np.ones(len(number))
        ends = np.stack([number, number + 1], axis=1)
        return cls(ends, np.diff(position), width, area, Band(ends, len(area)))

    def last(self) -> Bools:
        """Places (n,) with fewer than two neighbours: the ends of the film."""
        count = np.bincount(self.ends.reshape(-1), minlength=len(self.area))
        out: Bools = count < 2
        return out


@dataclass(frozen=True, slots=True)
class FilmPart:
    """Places that a film has, of those that facets are divided into.

    Attributes:
        members: (v,) vertices; inside: (f,) facets between them; here: (n,) places.
        between: (m, v), from values at vertices to those of the m places, and its transpose.
        ends: (e, 2) of these, that each face lies between; faces: (e,) numbers among all faces.
        band: of matrices between neighbours; per_facet: k, cells on each facet.
    """

    members: Bools
    inside: Bools
    here: Bools
    between: scipy.sparse.csr_matrix
    shared: scipy.sparse.csr_matrix
    ends: Longs
    faces: Longs
    band: Band
    per_facet: int

    def of(self, cells: FilmCells) -> FilmCells:
        """The cells of these places, of those of all; nothing flows out of them."""
        length, width = cells.length[self.faces], cells.width[self.faces]
        return FilmCells(self.ends, length, width, cells.area[self.here], self.band)

    def sums(self, area: Floats, values: Floats) -> Floats:
        """What vertices get (v, …) of values (m, …) per area (m,)."""
        weighted = values * (area if values.ndim == 1 else area[:, None])
        out: Floats = self.shared @ weighted
        return out

    def pulls(self, film: Floats, pressure: Floats, length: Floats) -> Floats:
        """Mean of h ∂p/∂s (f′,), Pa, of the facets inside, which are ``length`` (f′,) m long."""
        a, b = self.ends.T
        steps = 0.5 * (film[a] + film[b]) * (pressure[b] - pressure[a])
        out: Floats = steps.reshape(-1, self.per_facet).sum(axis=1) / length
        return out

    def pull_slopes(
        self, film: Floats, pressure: Floats, length: Floats
    ) -> tuple[scipy.sparse.csr_matrix, scipy.sparse.csr_matrix]:
        """Derivatives (f′, m) of :meth:`pulls` for film, Pa/m, and pressure."""
        (a, b), size = self.ends.T, (len(length), len(film))
        over = np.repeat(1.0 / length, self.per_facet)
        mean, rise = 0.5 * (film[a] + film[b]) * over, 0.5 * (pressure[b] - pressure[a]) * over
        start = 2 * self.per_facet * np.arange(len(length) + 1)
        by_film = np.stack([rise, rise], axis=1).reshape(-1)
        by_pressure = np.stack([-mean, mean], axis=1).reshape(-1)
        index = self.ends.reshape(-1)
        return (
            scipy.sparse.csr_matrix((by_film, index, start), size),
            scipy.sparse.csr_matrix((by_pressure, index, start), size),
        )


class FilmPlaces:
    """Places of a film on facets: their vertices, and places between these.

    Axis letters: v vertices, f facets, n places. What facets give is linear between their vertices,
    and what they take is shared out by the same functions: both do the same work.

    Attributes:
        facets: (f, 2) vertices; per_facet: k, cells of the film on each.
        count: of places, v + (k − 1) f: the vertices, and those inside the facets, in order.
        between: (n, v), from values at vertices to those at places.
    """

    def __init__(self, facets: Longs, vertices: int, per_facet: int) -> None:
        """Divide ``facets`` (f, 2) of so many vertices."""
        self.facets, self.per_facet = facets, per_facet
        inner = vertices + np.arange(len(facets) * (per_facet - 1)).reshape(len(facets), -1)
        self.count = vertices + inner.size
        line = np.concatenate([facets[:, :1], inner, facets[:, 1:]], axis=1)
        self._ends = np.stack([line[:, :-1], line[:, 1:]], axis=2).reshape(-1, 2)
        self._band = Band(self._ends, self.count)
        share = np.tile(np.arange(1, per_facet) / per_facet, len(facets))
        every = np.arange(vertices)
        row = np.concatenate([every, inner.reshape(-1), inner.reshape(-1)])
        ends = [np.repeat(end, per_facet - 1) for end in facets.T]
        data = np.concatenate([np.ones(vertices), 1.0 - share, share])
        place = row, np.concatenate([every, *ends])
        self.between = scipy.sparse.csr_matrix((data, place), (self.count, vertices))
        self._part: FilmPart | None = None

    def part(self, members: Bools) -> FilmPart:
        """Places between vertices (v,) that are members; kept while these stay the same."""
        known = self._part
        if known is not None and np.array_equal(known.members, members):
            return known
        inside = np.all(members[self.facets], axis=1)
        here = np.concatenate([members, np.repeat(inside, self.per_facet - 1)])
        faces = np.nonzero(np.repeat(inside, self.per_facet))[0]
        ends = (np.cumsum(here) - 1)[self._ends[faces]]
        between = self.between[here]
        band = Band(ends, int(np.count_nonzero(here)))
        part = FilmPart(
            *(members.copy(), inside, here, between, between.T.tocsr(), ends, faces, band),
            self.per_facet,
        )
        self._part = part
        return part

    def cells(self, length: Floats, parts: Floats) -> FilmCells:
        """Cells of facets (f,), m long, of which the vertices have the areas ``parts`` (f, 2).

        The width of rings is linear along a facet.
        """
        k, (a, b) = self.per_facet, parts.T / length
        ends = np.stack([4.0 * a - 2.0 * b, 4.0 * b - 2.0 * a], axis=1)
        at = np.arange(k + 1) / k
        width = ends[:, :1] * (1.0 - at) + ends[:, 1:] * at
        low, high, size = width[:, :-1], width[:, 1:], length[:, None] / k
        shares = np.stack([size * (low / 3 + high / 6), size * (low / 6 + high / 3)], axis=2)
        summed = np.bincount(self._ends.reshape(-1), shares.reshape(-1), self.count)
        middle, area = 0.5 * (low + high).reshape(-1), summed.astype(np.float64)
        return FilmCells(self._ends, np.repeat(length / k, k), middle, area, self._band)


@dataclass(frozen=True, slots=True)
class FilmStep:
    """What a step asks of the film.

    Attributes:
        film: h (n,), m, at the end of the step.
        speed: u (f,), m/s, half the velocity of the other surface relative to this one, from the
            first end of a face to the second.
        fixed: (n,) places that a reservoir feeds, and content: (n,), m, what it keeps there, θh;
            infinite where they are flooded.
        dt: s; infinite: the steady state.
        before: (n,), m, film at the start of the step; volume: (n,), m² or m³, oil then.
    """

    film: Floats
    speed: Floats
    fixed: Bools
    content: Floats
    dt: float = np.inf
    before: Floats | None = None
    volume: Floats | None = None


@dataclass(frozen=True, slots=True)
class FilmSolution:
    """A film that balances.

    Attributes:
        unknown: w (n,); pressure: p (n,), Pa; filled: θ (n,); volume: θ h M (n,).
        flux: b q (f,), m²/s or m³/s; supply: (n,) the same, from the reservoirs.
        iterations: of Newton's method.
    """

    unknown: Floats
    pressure: Floats
    filled: Floats
    volume: Floats
    flux: Floats
    supply: Floats
    iterations: int


@dataclass(frozen=True, slots=True)
class FilmSlopes:
    """How a film that balances changes with thickness and speed.

    Attributes:
        by_pressure, by_filled: ∂p/∂w (n,), Pa, and ∂θ/∂w (n,).
        by_film: (n, n) and by_speed: (n, f), of the balance at the same w.
    """

    by_pressure: Floats
    by_filled: Floats
    by_film: scipy.sparse.csr_matrix
    by_speed: scipy.sparse.csr_matrix
    _entries: Floats
    _band: Band

    def unknown(self, balance: Floats) -> Floats:
        """Change of w (n,) or (n, r) as the balance rises by (n,) or (n, r)."""
        return -self._band.solved(self._entries, balance)


@dataclass(frozen=True, slots=True)
class _Given:
    """What does not change while a step's film is sought.

    Attributes:
        cube, d_cube: (n,) mobility, m³, and its derivative for h; film: (f,), m, mean of both ends
            and over the step, and d_film its derivative for the h of either end;
            rate: (f,), 1/s; held: (n,) w of the reservoirs and d_held: (n,), 1/m, dw/dh
            for either end of a place's face.
        limit: (n,) error of the balance that is accepted, m²/s or m³/s; of w, where it is given.
    """

    cube: Floats
    d_cube: Floats
    film: Floats
    d_film: float
    rate: Floats
    held: Floats
    d_held: Floats
    limit: Floats


@dataclass(frozen=True, slots=True)
class _Flow:
    """Flow through the faces (f,) and its derivatives for both ends (f, 2)."""

    value: Floats
    by_pressure: Floats
    by_filled: Floats
    by_film: Floats
    by_speed: Floats


@dataclass(frozen=True, slots=True)
class ReynoldsFilm:
    """The film on some places.

    Attributes:
        cells: its places; rheology: of the oil; rough: the surfaces' roughness.
        scale: p_s, Pa, of the order of the pressures; smoothing: ε.
    """

    cells: FilmCells
    rheology: FilmRheology
    rough: RoughGap
    scale: float
    smoothing: float = SMOOTHING

    def parts(self, unknown: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Pressure p (n,), Pa, filling θ (n,), and their derivatives for w."""
        eps = self.smoothing
        root = np.sqrt(unknown**2 + 4.0 * eps**2)
        # The smaller of (r + w)/2 and (r − w)/2 from their product: nothing cancels.
        larger = 0.5 * (root + np.abs(unknown))
        smaller = eps**2 / larger
        up, down = unknown > 0.0, eps > 0.0
        pressed = np.where(up, larger, smaller if down else 0.0)
        missing = np.where(up, smaller if down else 0.0, larger)
        p, theta = self.scale * pressed, 1.0 - missing
        return p, theta, self.scale * pressed / root, missing / root

    def solve(self, step: FilmStep, start: Floats) -> FilmSolution:
        """The film at the end of a step, from ``start`` (n,), a guess of w.

        Raises:
            FilmError: Newton's method does not converge.
        """
        given = self._given(step)
        w = np.where(step.fixed, given.held, start)
        for iteration in range(1, MOST_ITERATIONS + 1):
            p, theta, d_p, d_theta = self.parts(w)
            flow = self._flow(step, given, p, theta)
            residual = self._balance(step, theta, flow.value)
            residual = np.where(step.fixed, w - given.held, residual)
            with np.errstate(all="ignore"):
                entries = self._by_unknown(step, flow, d_p, d_theta)
                change = self.cells.band.solved(entries, -residual)
            if not np.isfinite(change).all():
                break
            balanced = bool(np.all(np.abs(residual) <= given.limit))
            w = w + self._bounded(change)
            if balanced:
                return self._solution(step, given, w, iteration)
        raise FilmError(f"the film's mass balance was not met in {iteration} iterations")

    def slopes(self, step: FilmStep, solution: FilmSolution) -> FilmSlopes:
        """Derivatives of a solution."""
        given, cells = self._given(step), self.cells
        p, theta, d_p, d_theta = self.parts(solution.unknown)
        flow = self._flow(step, given, p, theta)
        free = np.where(step.fixed, 0.0, 1.0)
        stored = theta * self._per_time(step)
        data = self._entries(flow.by_film, stored, free, np.zeros_like(free))
        held = np.where(step.fixed, -given.d_held, 0.0)[cells.band.row]
        held[4 * len(cells.ends) :] = 0.0  # it is the films at both ends of a face that count
        data += held
        count, face = len(theta), np.arange(len(cells.ends))
        by_film = scipy.sparse.csr_matrix(
            (data, (cells.band.row, cells.band.column)), (count, count)
        )
        row, column = cells.ends.T.reshape(-1), np.tile(face, 2)
        data = np.concatenate([flow.by_speed, -flow.by_speed]) * free[row]
        by_speed = scipy.sparse.csr_matrix((data, (row, column)), (count, len(face)))
        entries = self._by_unknown(step, flow, d_p, d_theta)
        return FilmSlopes(d_p, d_theta, by_film, by_speed, entries, cells.band)

    def _bounded(self, change: Floats) -> Floats:
        """A change of w (n,) by which no viscosity grows more than e-fold."""
        growth = self.rheology.barus * self.scale * float(np.max(change, initial=0.0))
        return change * (1.0 / max(1.0, growth))

    def _solution(self, step: FilmStep, given: _Given, w: Floats, iterations: int) -> FilmSolution:
        p, theta, _, _ = self.parts(w)
        flux = self._flow(step, given, p, theta).value
        balance = self._balance(step, theta, flux)
        volume = theta * step.film * self.cells.area
        supply = np.where(step.fixed, balance, 0.0)
        return FilmSolution(w, p, theta, volume, flux, supply, iterations)

    def _given(self, step: FilmStep) -> _Given:
        """What a step's film is sought with."""
        cells, (a, b), h = self.cells, self.cells.ends.T, step.film
        cube, d_cube = self._mobility(step)
        in_time = step.before is not None and np.isfinite(step.dt)
        mean = 0.5 * (h + step.before) if in_time and step.before is not None else h
        film = 0.5 * (mean[a] + mean[b])
        held, d_held = _reservoir(step, cells)
        eta = max(self.rheology.eta_b, np.finfo(float).tiny)
        pressed = cells.width * 0.5 * (cube[a] + cube[b]) * self.scale / (12.0 * eta * cells.length)
        moved = TOLERANCE * cells.width * np.abs(step.speed) * film + _ROUNDOFF * pressed
        limit: Floats = np.zeros(len(h))
        limit += np.bincount(a, moved, len(h)) + np.bincount(b, moved, len(h))
        limit += TOLERANCE * h * self._per_time(step)
        limit = np.where(step.fixed, _ROUNDOFF, limit)
        rate = 2.0 * np.abs(step.speed) / film
        return _Given(cube, d_cube, film, 0.25 if in_time else 0.5, rate, held, d_held, limit)

    def _per_time(self, step: FilmStep) -> Floats:
        """What is stored (n,) in a step per thickness of film, over its duration; 0 if steady."""
        if step.volume is None or not np.isfinite(step.dt):
            return np.zeros_like(self.cells.area)
        return self.cells.area * (1.0 / step.dt)

    def _balance(self, step: FilmStep, theta: Floats, flux: Floats) -> Floats:
        """What leaves a place and is stored there (n,), m²/s or m³/s; 0 where nothing feeds it."""
        a, b = self.cells.ends.T
        count = len(step.film)
        out = np.zeros(count)
        out += np.bincount(a, flux, count) - np.bincount(b, flux, count)
        if step.volume is not None and np.isfinite(step.dt):
            out += (theta * step.film * self.cells.area - step.volume) / step.dt
        return out

    def _mobility(self, step: FilmStep) -> tuple[Floats, Floats]:
        """φ times the time mean of h³ (n,), m³, and its derivative for h."""
        h, phi_slope = step.film, self.rough.flow(step.film)
        if step.before is None or not np.isfinite(step.dt):
            cube, d_cube = h**3, 3.0 * h**2
        else:
            first = step.before
            cube = 2.0 * first**2 * h**2 / (first + h)
            d_cube = 2.0 * first**2 * h * (h + 2.0 * first) / (first + h) ** 2
        phi, d_phi = phi_slope
        return phi * cube, d_phi * cube + phi * d_cube

    def _flow(self, step: FilmStep, given: _Given, p: Floats, theta: Floats) -> _Flow:
        """Flow through the faces."""
        cells, (a, b) = self.cells, self.cells.ends.T
        ends, mean_film, rate = cells.ends, given.film, given.rate
        flow = self.rheology.viscosity(rate, 0.5 * (p[a] + p[b]))
        over = 0.5 * (given.cube[a] + given.cube[b]) / (12.0 * flow.value)
        slope = (p[b] - p[a]) / cells.length
        pressed, thinning = -over * slope, over * slope / flow.value
        up = np.where(step.speed >= 0.0, a, b)
        carried = step.speed * theta[up]
        at_up = ends == up[:, None]
        by_pressure = 0.5 * (thinning * flow.d_pressure)[:, None] + np.stack(
            [over / cells.length, -over / cells.length], axis=1
        )
        by_filled = at_up * (step.speed * mean_film)[:, None]
        by_film = -(slope / (24.0 * flow.value))[:, None] * given.d_cube[ends]
        by_film += given.d_film * (carried - thinning * flow.d_rate * rate / mean_film)[:, None]
        by_speed = theta[up] * mean_film
        by_speed += thinning * flow.d_rate * 2.0 * np.sign(step.speed) / mean_film
        width = cells.width
        return _Flow(
            width * (pressed + carried * mean_film),
            width[:, None] * by_pressure,
            width[:, None] * by_filled,
            width[:, None] * by_film,
            width * by_speed,
        )

    def _by_unknown(self, step: FilmStep, flow: _Flow, d_p: Floats, d_theta: Floats) -> Floats:
        """Entries (e,) of the balance's derivatives for w."""
        ends, fixed = self.cells.ends, step.fixed.astype(np.float64)
        of_faces = flow.by_pressure * d_p[ends] + flow.by_filled * d_theta[ends]
        stored = d_theta * step.film * self._per_time(step)
        return self._entries(of_faces, stored, 1.0 - fixed, fixed)

    def _entries(self, of_faces: Floats, stored: Floats, free: Floats, diagonal: Floats) -> Floats:
        """Entries (e,) from derivatives (f, 2) of the flow for both ends and (n,) of storage."""
        plain = of_faces.reshape(-1)
        out = np.concatenate([plain, -plain, stored]) * free[self.cells.band.row]
        out[len(out) - len(stored) :] += diagonal
        return out


def _reservoir(step: FilmStep, cells: FilmCells) -> tuple[Floats, Floats]:
    """Values w (n,) that the reservoirs keep; dw/dh (n,), 1/m, for either end of a place's face.

    What lies between the surfaces is carried in with the mean film of a face: θ is that of this
    film. The slope is 0 where the film is flooded.
    """
    ends, count = cells.ends, len(step.film)
    faces = np.bincount(ends.reshape(-1), minlength=count)
    mean = np.repeat(0.5 * step.film[ends].sum(axis=1), 2)
    film = np.bincount(ends.reshape(-1), mean, count) / np.maximum(faces, 1)
    film = np.where(faces > 0, film, step.film)
    short: Bools = step.content < (1.0 - UNFILLED) * film
    content = np.where(short, step.content, film)
    given = np.where(short, content / film - 1.0, -UNFILLED)
    return given, np.where(short, -0.5 * content / (film**2 * np.maximum(faces, 1)), 0.0)
