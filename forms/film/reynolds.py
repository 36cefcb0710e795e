r"""The mass balance of a film with cavitation on a line of places, and its pressure.

Axis letters: n places of the film, f faces between neighbours. Finite volumes in the material frame
of the surface that the places belong to:

.. math::
   \frac{\theta_A h_A M_A - v_A}{\Delta t} + \sum_f b_f q_f = 0, \qquad
   q_f = -\frac{k_f}{12 \eta_f} \frac{p_B - p_A}{L_f} + u_f\, \theta_{up}\, \bar h_f

with the areas M, the volumes v of the step before, faces of width b between places a length L
apart, and u half the velocity of the other surface relative to this one. What rolls in with the
places themselves is the storage term, which makes the balance objective.

**Fitted to a wedge.** Where the film is linear between both places and full, the same flow passes
everywhere between them if p rises by
:math:`12 \eta \int (u h - q)/h^3\, ds`, which gives

.. math:: k_f = \phi\, \frac{2 h_A^2 h_B^2}{h_A + h_B}, \qquad
   \bar h_f = \frac{2 h_A h_B}{h_A + h_B}

and not the means of h³ and h: before a contact, where the film falls to a quarter from one place to
the next, these would be four and more times as large (D. Scharfetter and H. Gummel fitted flows to
exponentials in the same way, IEEE Trans. Electron Devices 16, 1969).

The flow by shear takes the filling of the place upstream and the film in the middle of the step, as
the volumes before and after do: taken at its end alone, a gap that closes ahead of a contact draws
in too much, a load 7 % too high in steps of a cell.

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

import ctypes
import functools
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from tribox.forms.film.places import Band, FilmCells
from tribox.forms.film.roughness import RoughGap
from tribox.forms.friction.film_rheology import FilmRheology
from tribox.forms.native import library
from tribox.geometry.native.compiler import require_size, start_of
from tribox.geometry.surfaces.facets import Bools, Floats, Longs

SMOOTHING = 1e-7  # ε
UNFILLED = 1e-4  # δ, 1 − θ of a reservoir that floods the film
TOLERANCE = 1e-11  # of the mass balance, over what flows and what is stored at a place
_ROUNDOFF = 1e-13  # the same, over the flow under the pressure scale: rounding of open gaps
MOST_ITERATIONS = 80

# The arrays of film_balance.c, in its order.
_INPUTS = (
    *("ends", "order", "number", "leads", "moves", "stores", "had", "held", "limit", "fixed"),
    *("viscosity", "thickens", "unknown", "at"),
)
_RESULTS = (
    *("pressure", "filled", "d_pressure", "d_filled", "balance", "residual"),
    *("middle", "flux", "matrix"),  # of faces, and of more
)


class FilmError(RuntimeError):
    """The film's own equations were not solved."""


@dataclass(frozen=True, slots=True)
class FilmStep:
    """What a step asks of the film."""

    film: Floats  # h (n,), m, at the end of the step
    # u (f,), m/s, half the velocity of the other surface relative to this one, from the first end
    # of a face to the second
    speed: Floats
    fixed: Bools  # (n,) places that a reservoir feeds
    content: Floats  # (n,), m, what it keeps there, θh; infinite where they are flooded
    dt: float = np.inf  # s; infinite: the steady state
    before: Floats | None = None  # (n,), m, film at the start of the step
    volume: Floats | None = None  # (n,), m² or m³, oil then
    by_gap: Floats | None = None  # dh/dg (n,), which only those who gave the film may ask for


@dataclass(frozen=True, slots=True)
class FilmSolution:
    """A film that balances."""

    unknown: Floats  # w (n,)
    pressure: Floats  # p (n,), Pa
    filled: Floats  # θ (n,)
    volume: Floats  # θ h M (n,)
    flux: Floats  # b q (f,), m²/s or m³/s
    supply: Floats  # (n,) the same, from the reservoirs
    iterations: int  # of Newton's method
    _given: _Given
    _loops: _Loops


@dataclass(frozen=True, slots=True)
class FilmSlopes:
    """How a film that balances changes with thickness and speed."""

    by_pressure: Floats  # ∂p/∂w (n,), Pa
    by_filled: Floats  # ∂θ/∂w (n,)
    by_film: scipy.sparse.csr_matrix  # (n, n), of the balance at the same w
    _ends: Longs
    _by_speed: Floats
    _loops: _Loops

    def unknown(self, balance: Floats) -> Floats:
        """Change of w (n,) or (n, r) as the balance rises by (n,) or (n, r)."""
        self._loops.assemble()
        return self._loops.solved(-balance)

    def by_speed(self, felt: Longs, sense: Floats, count: int) -> Floats:
        """Derivatives (n, s) of the balance for ``count`` speeds.

        Of these, faces feel ``felt`` (f,), those of ``sense`` (f,) -1 the other way round.
        """
        place = (self._ends * count + felt[:, None]).reshape(-1)
        size = len(self.by_pressure), count
        by_speed = (self._by_speed * sense[:, None]).reshape(-1)
        summed = np.bincount(place, by_speed, size[0] * count)
        return summed.astype(np.float64).reshape(size)


@dataclass(frozen=True, slots=True)
class _Given:
    """What does not change while a step's film is sought."""

    cube: Floats  # k (f,), m³
    d_cube: Floats  # (f, 2) its derivatives for the h of both ends
    film: Floats  # h̄ (f,), m
    d_film: Floats  # (f, 2) likewise
    rate: Floats  # (f,), 1/s
    held: Floats  # (n,) w of the reservoirs
    d_held: Floats  # (n,), 1/m, dw/dh̄ of a place's face
    limit: Floats  # (n,) error of the balance that is accepted, m²/s or m³/s; of w, where given


class _Film(ctypes.Structure):
    """As ``struct film`` in film_balance.c."""

    _fields_ = [
        *((name, ctypes.c_int64) for name in ("places", "faces", "reach")),
        *((name, ctypes.c_double) for name in ("scale", "smoothing")),
        *((name, ctypes.c_void_p) for name in (*_INPUTS, *_RESULTS)),
    ]


class _Loops:
    """The balance and its matrix in compiled loops, and the arrays that they read and write."""

    arrays: dict[str, NDArray[Any]]  # by the names in film_balance.c

    def __init__(self, band: Band, scale: float, smoothing: float, **given: NDArray[Any]) -> None:
        self._code = _code()
        places, faces = len(given["unknown"]), len(given["ends"])
        sizes = [places] * (len(_RESULTS) - 3) + [faces, faces, places * (3 * band.reach + 1)]
        buffer, at = np.empty(sum(sizes)), 0
        self.arrays = given | {"order": band.order, "number": band.number}
        self.arrays["at"] = np.empty_like(band.order)
        for name, size in zip(_RESULTS, sizes, strict=True):
            self.arrays[name] = buffer[at : at + size]
            at += size
        self._film = _Film(places, faces, band.reach, scale, smoothing)
        for name, array in self.arrays.items():
            self.point(name, array)

    def point(self, name: str, array: NDArray[Any]) -> None:
        """Let the loops read or write an array."""
        self.arrays[name] = array = np.ascontiguousarray(array)
        setattr(self._film, name, start_of(array).value)

    def parts(self) -> None:
        """Pressure and filling of the unknown."""
        self._code.tribox_film_parts(ctypes.byref(self._film))

    def assemble(self) -> bool:
        """Flow, balance and matrix for the parts at hand; whether all places balance."""
        return bool(self._code.tribox_film_assemble(ctypes.byref(self._film)))

    def solved(self, right: Floats) -> Floats:
        """Solution with the matrix, spent with ``right`` (n,) or (n, r); NaN if singular."""
        right = np.ascontiguousarray(right)
        out = np.empty_like(right)
        columns = right.size // max(len(right), 1)
        film, ends = ctypes.byref(self._film), (start_of(right), start_of(out))
        if self._code.tribox_film_solve(film, ctypes.c_int64(columns), *ends):
            out[:] = np.nan
        return out


@functools.cache
def _code() -> ctypes.CDLL:
    """The compiled loops; RuntimeError if their structure is not ``_Film``."""
    code = library("film_balance.c")
    require_size(code.tribox_film_size(), _Film, "film_balance.c")
    return code


@dataclass(frozen=True, slots=True)
class ReynoldsFilm:
    """The film on some places."""

    cells: FilmCells  # its places
    rheology: FilmRheology  # of the oil
    rough: RoughGap  # the surfaces' roughness
    scale: float  # p_s, Pa, of the order of the pressures
    smoothing: float = SMOOTHING  # ε

    def solve(self, step: FilmStep, start: Floats) -> FilmSolution:
        """The film at a step's end from ``start`` (n,), a guess of w; FilmError without one."""
        try:
            return self._solve(step, start)
        except FilmError:
            if self.rheology.barus == 0.0:
                raise
        # Where it is not yet known which places are full, pressures overshoot, and thicken the oil.
        plain = replace(self, rheology=replace(self.rheology, barus=0.0))
        return self._solve(step, plain.solve(step, start).unknown)

    def _solve(self, step: FilmStep, start: Floats) -> FilmSolution:
        """The same, without another start."""
        given = self._given(step)
        loops = self._loops(step, given, np.where(step.fixed, given.held, start))
        w, made = loops.arrays["unknown"], loops.arrays
        for iteration in range(1, MOST_ITERATIONS + 1):
            # One step more than the balance asks for: it converges quadratically, and what follows
            # takes derivatives at the solution.
            balanced = self._balance(loops, given)
            change = loops.solved(-made["residual"])
            if not np.isfinite(change).all():
                break
            w += self._bounded(change)
            if balanced:
                self._balance(loops, given)
                p, theta = made["pressure"], made["filled"]
                supply = np.where(step.fixed, made["balance"], 0.0)
                volume = theta * step.film * self.cells.area
                flux = made["flux"]
                return FilmSolution(w, p, theta, volume, flux, supply, iteration, given, loops)
        raise FilmError(f"the film's mass balance was not met in {iteration} iterations")

    def slopes(self, step: FilmStep, solution: FilmSolution) -> FilmSlopes:
        """Derivatives of a solution."""
        given, loops, cells = solution._given, solution._loops, self.cells
        theta = solution.filled
        of_film, of_speed = self._given_slopes(step, given, loops)
        free = np.where(step.fixed, 0.0, 1.0)
        plain = of_film.reshape(-1)
        # What leaves the first end of a face arrives at its second; the diagonal is what is stored.
        data = np.concatenate([plain, -plain, theta * self._per_time(step)])
        data *= free[cells.band.row]
        # At a reservoir the balance reads w = held, and held follows the films of the faces beside
        # it.
        held = np.where(step.fixed, -given.d_held, 0.0)[cells.band.row[: 4 * len(cells.ends)]]
        by_both: Floats = np.tile(given.d_film.reshape(-1), 2)
        data[: len(held)] += held * by_both
        by_film = cells.band.matrix(data)
        by_speed = np.stack([of_speed, -of_speed], axis=1) * free[cells.ends]
        d_p, d_theta = loops.arrays["d_pressure"], loops.arrays["d_filled"]
        return FilmSlopes(d_p, d_theta, by_film, cells.ends, by_speed, loops)

    def _bounded(self, change: Floats) -> Floats:
        """A change of w (n,) by which no viscosity grows more than e-fold."""
        if self.rheology.barus == 0.0:
            return change
        growth = self.rheology.barus * self.scale * float(np.max(change, initial=0.0))
        return change * (1.0 / max(1.0, growth))

    def _loops(self, step: FilmStep, given: _Given, start: Floats) -> _Loops:
        """The loops of a step, from ``start`` (n,)."""
        cells, stores = self.cells, step.film * self._per_time(step)
        had: Floats = np.zeros_like(stores)
        if step.volume is not None and np.isfinite(step.dt):
            had = np.asarray(step.volume / step.dt)
        return _Loops(
            cells.band,
            self.scale,
            self.smoothing,
            ends=cells.ends,
            leads=given.cube * cells.width / (12.0 * cells.length),
            moves=step.speed * given.film * cells.width,
            stores=stores,
            had=had,
            held=given.held,
            limit=given.limit,
            fixed=step.fixed,
            unknown=start,
        )

    def _balance(self, loops: _Loops, given: _Given) -> bool:
        """Evaluate everything at the w of the loops; whether all places balance."""
        loops.parts()
        # The shear rate does not depend on w: unless pressure thickens the oil, once is enough.
        if "viscosity" not in loops.arrays or self.rheology.feels_pressure:
            flow = self.rheology.viscosity(given.rate, loops.arrays["middle"])
            loops.point("viscosity", flow.value)
            loops.point("thickens", flow.d_pressure)
        return loops.assemble()

    def _given(self, step: FilmStep) -> _Given:
        """What a step's film is sought with."""
        cells, (a, b), h = self.cells, self.cells.ends.T, step.film
        if step.before is None or not np.isfinite(step.dt):
            film, d_film = wedge_film(h[cells.ends])
        else:
            film, d_film = wedge_film(0.5 * (h + step.before)[cells.ends])
            d_film = 0.5 * d_film
        cube, d_cube = self._mobility(step)
        held, d_held = _reservoir(step, cells, film)
        eta = max(self.rheology.eta_b, np.finfo(float).tiny)
        pressed = cells.width * cube * self.scale / (12.0 * eta * cells.length)
        moved = TOLERANCE * cells.width * np.abs(step.speed) * film + _ROUNDOFF * pressed
        limit: Floats = np.zeros(len(h))
        limit += np.bincount(a, moved, len(h)) + np.bincount(b, moved, len(h))
        limit += TOLERANCE * h * self._per_time(step)
        limit = np.where(step.fixed, _ROUNDOFF, limit)
        # u is half the speed of one surface over the other.
        rate = 2.0 * np.abs(step.speed) / film
        return _Given(cube, d_cube, film, d_film, rate, held, d_held, limit)

    def _per_time(self, step: FilmStep) -> Floats:
        """What is stored (n,) in a step per thickness of film, over its duration; 0 if steady."""
        if step.volume is None or not np.isfinite(step.dt):
            return np.zeros_like(self.cells.area)
        return self.cells.area * (1.0 / step.dt)

    def _mobility(self, step: FilmStep) -> tuple[Floats, Floats]:
        """The k of faces (f,), m³, and its derivatives (f, 2) for the h of both ends."""
        h, ends = step.film, self.cells.ends
        if step.before is None or not np.isfinite(step.dt):
            mean, d_mean = h, np.ones_like(h)
        else:  # whose cube is the time mean of h³
            first = step.before
            cube = 2.0 * first**2 * h**2 / (first + h)
            mean = np.cbrt(cube)
            # d ln m/dh = [2/h − 1/(h₀ + h)]/3
            d_mean = mean * (h + 2.0 * first) / (3.0 * h * (first + h))
        factor, d_factor = self.rough.flow(h)
        first, last = mean[ends].T
        whole = 2.0 * first**2 * last**2 / (first + last)
        # ∂/∂a of 2a²b²/(a + b) is that times (a + 2b)/(a (a + b)).
        slope = whole[:, None] * (mean[ends] + 2.0 * mean[ends[:, ::-1]])
        slope /= mean[ends] * (first + last)[:, None]
        shared = factor[ends].mean(axis=1)
        by_film = 0.5 * d_factor[ends] * whole[:, None]
        return shared * whole, by_film + shared[:, None] * slope * d_mean[ends]

    def _given_slopes(self, step: FilmStep, given: _Given, loops: _Loops) -> tuple[Floats, Floats]:
        """Derivatives of the flow for the film at both ends (f, 2), and for the speed (f,)."""
        cells, (a, b), film, rate = self.cells, self.cells.ends.T, given.film, given.rate
        p, theta = loops.arrays["pressure"], loops.arrays["filled"]
        # ∂γ̇/∂h̄ = −γ̇/h̄ and ∂γ̇/∂u = 2 sign(u)/h̄ change the viscosity of an oil that thins.
        flow = self.rheology.viscosity(rate, loops.arrays["middle"])
        slope = (p[b] - p[a]) / cells.length
        thinning = given.cube / (12.0 * flow.value) * slope / flow.value
        filled = np.where(step.speed >= 0.0, theta[a], theta[b])
        carried = step.speed * filled
        by_film = -(slope / (12.0 * flow.value))[:, None] * given.d_cube
        by_film += given.d_film * (carried - thinning * flow.d_rate * rate / film)[:, None]
        by_speed = filled * film
        by_speed += thinning * flow.d_rate * 2.0 * np.sign(step.speed) / film
        return cells.width[:, None] * by_film, cells.width * by_speed


def wedge_film(film: Floats) -> tuple[Floats, Floats]:
    """h̄ (f,), m, of films linear between ``film`` (f, 2), m, and its derivatives (f, 2)."""
    total = film.sum(axis=1)
    mean: Floats = 2.0 * film.prod(axis=1) / total
    slopes: Floats = 2.0 * (film[:, ::-1] / total[:, None]) ** 2
    return mean, slopes


def _reservoir(step: FilmStep, cells: FilmCells, faces: Floats) -> tuple[Floats, Floats]:
    """Values w (n,) that the reservoirs keep, and dw/dh̄ (n,), 1/m, for each of a place's faces.

    What lies between the surfaces is carried in with the mean film h̄ of a face (f,), m: θ is that
    of this film. The slope is 0 where the film is flooded.
    """
    place, count = cells.ends.reshape(-1), len(step.film)
    number = np.maximum(np.bincount(place, minlength=count), 1)
    film = np.bincount(place, np.repeat(faces, 2), count) / number
    film = np.where(film > 0.0, film, step.film)
    short: Bools = step.content < (1.0 - UNFILLED) * film
    content = np.where(short, step.content, film)
    # Well below 0 the unknown is the oil that is missing, but for ε²: w = θ − 1.
    given = np.where(short, content / film - 1.0, -UNFILLED)
    return given, np.where(short, -content / (film**2 * number), 0.0)
