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
film of the face.

**Cavitation** has one unknown w at each place: with :math:`r = \sqrt{w^2 + 4 \varepsilon^2}`

.. math:: p = p_s \frac{w + r}{2}, \qquad 1 - \theta = \frac{r - w}{2}, \qquad
   \frac{p}{p_s} (1 - \theta) = \varepsilon^2

which is the complementarity of pressure and missing oil, rounded off (A. Fischer, Optimization 24,
1992; H. Elrod, J. Lubr. Technol. 103, 1981). :math:`\varepsilon p_s` is an ambient pressure: it
must be small.

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
import scipy.sparse.linalg

from tribox.forms.film.roughness import RoughGap
from tribox.forms.friction.film_rheology import FilmRheology
from tribox.geometry.surfaces.facets import Bools, Floats, Longs

SMOOTHING = 1e-7  # ε
TOLERANCE = 1e-11  # of the mass balance, over what flows and what is stored at a place
_ROUNDOFF = 1e-13  # the same, over the flow under the pressure scale: rounding of open gaps
MOST_ITERATIONS = 80


class FilmError(RuntimeError):
    """The film's own equations were not solved."""


@dataclass(frozen=True, slots=True)
class FilmCells:
    """Where the film's places are, and which are neighbours.

    Attributes:
        ends: (f, 2) places that a face lies between; length: (f,), m, between them; width: (f,),
            m of rings, or 1 per unit thickness.
        area: (n,), m² per unit thickness, or of rings.
    """

    ends: Longs
    length: Floats
    width: Floats
    area: Floats

    @classmethod
    def on_line(cls, position: Floats, rings: bool = False) -> FilmCells:
        """Of places (n,), m, along a line, in order; ``rings``: these are radii."""
        number = np.arange(len(position) - 1)
        middle = 0.5 * (position[1:] + position[:-1])
        edges = np.concatenate([position[:1], middle, position[-1:]])
        area = np.pi * np.diff(edges**2) if rings else np.diff(edges)
        width = 2.0 * np.pi * middle if rings else np.ones(len(number))
        ends = np.stack([number, number + 1], axis=1)
        return cls(ends, np.diff(position), width, area)

    def only(self, members: Bools) -> FilmCells:
        """The part (m,) of some places (n,); nothing flows out of it."""
        number = np.cumsum(members) - 1
        inside = members[self.ends].all(axis=1)
        ends = number[self.ends[inside]]
        return FilmCells(ends, self.length[inside], self.width[inside], self.area[members])

    def last(self) -> Bools:
        """Places (n,) with fewer than two neighbours: the ends of the film."""
        count = np.bincount(self.ends.reshape(-1), minlength=len(self.area))
        out: Bools = count < 2
        return out


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
        pressure: ∂p/∂h (n, n), Pa/m, and filled: ∂θ/∂h (n, n), 1/m.
        pressure_by_speed: ∂p/∂u (n, f), Pa s/m, and filled_by_speed: ∂θ/∂u (n, f), s/m.
    """

    pressure: Floats
    filled: Floats
    pressure_by_speed: Floats
    filled_by_speed: Floats


@dataclass(frozen=True, slots=True)
class _Linear:
    """The balance at one w: its residual (n,), flux (f,) and derivatives."""

    residual: Floats
    flux: Floats
    by_unknown: scipy.sparse.csc_matrix
    by_film: scipy.sparse.csr_matrix
    by_speed: scipy.sparse.csr_matrix


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
        w = self._held(step, start.copy())
        for iteration in range(1, MOST_ITERATIONS + 1):
            linear = self._linear(step, w)
            with np.errstate(all="ignore"):
                change = _scaled_solve(linear.by_unknown, -linear.residual)
            if not np.isfinite(change).all():
                break
            balanced = bool(np.all(np.abs(linear.residual) <= self._limit(step)))
            w = w + self._bounded(change)
            if balanced:
                return self._solution(step, w, iteration)
        raise FilmError(f"the film's mass balance was not met in {iteration} iterations")

    def slopes(self, step: FilmStep, solution: FilmSolution) -> FilmSlopes:
        """Derivatives of pressure and filling of a solution."""
        _, _, d_p, d_theta = self.parts(solution.unknown)
        linear = self._linear(step, solution.unknown)
        right = scipy.sparse.hstack([linear.by_film, linear.by_speed]).toarray()
        d_w = -_scaled_solve(linear.by_unknown, right)
        count = len(step.film)
        by_film, by_speed = d_w[:, :count], d_w[:, count:]
        return FilmSlopes(
            d_p[:, None] * by_film,
            d_theta[:, None] * by_film,
            d_p[:, None] * by_speed,
            d_theta[:, None] * by_speed,
        )

    def _bounded(self, change: Floats) -> Floats:
        """A change of w (n,) by which no viscosity grows more than e-fold."""
        growth = self.rheology.barus * self.scale * float(np.max(change, initial=0.0))
        return change * (1.0 / max(1.0, growth))

    def _solution(self, step: FilmStep, w: Floats, iterations: int) -> FilmSolution:
        p, theta, _, _ = self.parts(w)
        flux = self._flow(step, p, theta).value
        balance = self._balance(step, theta, flux)
        volume = theta * step.film * self.cells.area
        supply = np.where(step.fixed, balance, 0.0)
        return FilmSolution(w, p, theta, volume, flux, supply, iterations)

    def _held(self, step: FilmStep, w: Floats) -> Floats:
        """The unknowns with those of the reservoirs as they are."""
        given, _ = _reservoir(step)
        return np.where(step.fixed, given, w)

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

    def _flow(self, step: FilmStep, p: Floats, theta: Floats) -> _Flow:
        """Flow through the faces."""
        cells, (a, b) = self.cells, self.cells.ends.T
        ends, h = cells.ends, step.film
        cube, d_cube = self._mobility(step)
        mean_film = 0.5 * (h[a] + h[b])
        rate = 2.0 * np.abs(step.speed) / mean_film
        flow = self.rheology.viscosity(rate, 0.5 * (p[a] + p[b]))
        over = 0.5 * (cube[a] + cube[b]) / (12.0 * flow.value)
        slope = (p[b] - p[a]) / cells.length
        pressed, thinning = -over * slope, over * slope / flow.value
        up = np.where(step.speed >= 0.0, a, b)
        carried = step.speed * theta[up]
        at_up = ends == up[:, None]
        by_pressure = 0.5 * (thinning * flow.d_pressure)[:, None] + np.stack(
            [over / cells.length, -over / cells.length], axis=1
        )
        by_filled = at_up * (step.speed * mean_film)[:, None]
        by_film = -(slope / (24.0 * flow.value))[:, None] * d_cube[ends]
        by_film += 0.5 * (carried - thinning * flow.d_rate * rate / mean_film)[:, None]
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

    def _linear(self, step: FilmStep, w: Floats) -> _Linear:
        """The balance and its derivatives."""
        cells, count = self.cells, len(w)
        p, theta, d_p, d_theta = self.parts(w)
        flow = self._flow(step, p, theta)
        residual = self._balance(step, theta, flow.value)
        by_w = flow.by_pressure * d_p[cells.ends] + flow.by_filled * d_theta[cells.ends]
        stored_w: Floats = np.zeros(count)
        stored_h: Floats = np.zeros(count)
        if step.volume is not None and np.isfinite(step.dt):
            per_time = cells.area * (1.0 / step.dt)
            stored_w = d_theta * step.film * per_time
            stored_h = theta * per_time
        given, d_given = _reservoir(step)
        residual = np.where(step.fixed, w - given, residual)
        free = np.where(step.fixed, 0.0, 1.0)
        by_unknown = self._table(by_w, stored_w, free, step.fixed.astype(np.float64))
        by_film = self._table(flow.by_film, stored_h, free, np.where(step.fixed, -d_given, 0.0))
        face = np.arange(len(cells.ends))
        row, column = cells.ends.T.reshape(-1), np.tile(face, 2)
        data = np.concatenate([flow.by_speed, -flow.by_speed]) * free[row]
        by_speed = scipy.sparse.csr_matrix((data, (row, column)), (count, len(face)))
        return _Linear(residual, flow.value, by_unknown.tocsc(), by_film, by_speed)

    def _table(
        self, of_faces: Floats, stored: Floats, free: Floats, diagonal: Floats
    ) -> scipy.sparse.csr_matrix:
        """Table (n, n) of derivatives (f, 2) of the flow for both ends and (n,) of storage."""
        ends, count = self.cells.ends, len(stored)
        row = np.concatenate([np.repeat(ends[:, 0], 2), np.repeat(ends[:, 1], 2), np.arange(count)])
        column = np.concatenate([ends.reshape(-1), ends.reshape(-1), np.arange(count)])
        plain = of_faces.reshape(-1)
        data = np.concatenate([plain, -plain, stored]) * free[row]
        data[-count:] += diagonal
        return scipy.sparse.csr_matrix((data, (row, column)), (count, count))

    def _limit(self, step: FilmStep) -> Floats:
        """Error (n,) of the balance that is accepted, m²/s or m³/s; of w, where it is given."""
        cells, h = self.cells, step.film
        a, b = cells.ends.T
        cube, _ = self._mobility(step)
        eta = max(self.rheology.eta_b, np.finfo(float).tiny)
        pressed = cells.width * 0.5 * (cube[a] + cube[b]) * self.scale / (12.0 * eta * cells.length)
        sheared = cells.width * np.abs(step.speed) * 0.5 * (h[a] + h[b])
        moved = TOLERANCE * sheared + _ROUNDOFF * pressed
        count = len(h)
        out = np.zeros(count)
        out += np.bincount(a, moved, count) + np.bincount(b, moved, count)
        if np.isfinite(step.dt):
            out += TOLERANCE * h * cells.area / step.dt
        return np.where(step.fixed, _ROUNDOFF, out)


def _reservoir(step: FilmStep) -> tuple[Floats, Floats]:
    """Values w (n,) that the reservoirs keep, and dw/dh (n,), 1/m: 0 where they flood the film."""
    short: Bools = step.content < step.film
    content = np.where(short, step.content, step.film)
    given = np.where(short, content / step.film - 1.0, 0.0)
    return given, np.where(short, -content / step.film**2, 0.0)


def _scaled_solve(matrix: scipy.sparse.csc_matrix, right: Floats) -> Floats:
    """Solution with rows and columns scaled by their largest entries; not finite if singular."""
    rows = abs(matrix).max(axis=1).toarray().ravel()
    rows = 1.0 / np.where(rows > 0.0, rows, 1.0)
    scaled = scipy.sparse.diags(rows) @ matrix
    columns = abs(scaled).max(axis=0).toarray().ravel()
    columns = 1.0 / np.where(columns > 0.0, columns, 1.0)
    try:
        factor = scipy.sparse.linalg.splu((scaled @ scipy.sparse.diags(columns)).tocsc())
    except RuntimeError:  # exactly singular
        return np.full_like(right, np.nan)
    by_row = right * (rows if right.ndim == 1 else rows[:, None])
    out: Floats = factor.solve(by_row) * (columns if right.ndim == 1 else columns[:, None])
    return out
