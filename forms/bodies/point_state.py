"""What the material points of a body remember: committed values, and those of the last evaluation.

:class:`MaterialPoints` is what a kind of points must be able to do; that of metals that flow is in
:mod:`tribox.forms.bodies.elastoplastic`.

Newton's method, line search, predictor and approach phases evaluate in any order and often in vain.
An evaluation therefore starts from committed values alone, and is known by what it depends on: the
displacements, the duration of the step and the number of the committed values. Committing makes
its values those that the next step starts from; whatever else was evaluated leaves no trace.

Axis letters: k material points of the body's own cells, cell by cell; s values of a point; p
components of F and P, in the plane 11, 12, 21, 22, 33, in space nine, row by row.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from tribox.forms.native import library

Floats = NDArray[np.float64]
DISSIPATED = "dissipated"  # of variables that sum up, J/m³, what each part of a point has lost
CELLS = "point_cells.c"


@dataclass(frozen=True, slots=True)
class PointUpdate:
    """What an update of n points gives; energies per reference volume.

    At points that are not valid all but the state is NaN, and the state is that of the begin.
    """

    P: Floats  # (n, p), Pa, first Piola stress
    state: Floats  # (n, s) at the end of the step
    A: Floats | None  # (n, p, p), Pa, consistent tangent ∂P/∂F; None if not asked for
    elastic: Floats  # (n,), J/m³, stored at the end
    dissipation: Floats  # (n,), in the step, not negative
    numerical: Floats  # (n,), the part of it that is due to the step's size
    valid: bool  # whether all points could be evaluated


def address_of(source: str, name: str) -> int:
    """Of the function ``tribox_NAME`` of a C source."""
    function = getattr(library(source), f"tribox_{name}")
    address = ctypes.cast(function, ctypes.c_void_p).value
    assert address is not None
    return address


@dataclass(frozen=True, slots=True)
class Kernel:
    """A compiled update of points, ``Update`` of ``point_lanes.h``, with its arguments."""

    function: int  # its address
    material: ctypes.Structure  # what it reads, and what is read from there
    symmetric: bool  # whether A is
    read: int = 0  # how many columns of the state moduli need, the first ones; 0: all

    @classmethod
    def of(
        cls, source: str, name: str, material: ctypes.Structure, symmetric: bool, read: int = 0
    ) -> Kernel:
        """The function ``tribox_NAME`` of a C source, for parameters as it lays them out."""
        return cls(address_of(source, name), material, symmetric, read)

    def update(self, F: Floats, state: Floats, tangent: bool) -> PointUpdate:
        """Update points by themselves, see :meth:`MaterialPoints.update`."""
        F, state = (np.ascontiguousarray(x, dtype=np.float64) for x in (F, state))
        n, p = F.shape
        P, end, energies = np.empty_like(F), np.empty_like(state), np.empty((3, n))
        A = np.empty((n, p, p)) if tangent else None
        arrays = (F, state, P, end, A, energies)
        places = [None if array is None else array.ctypes.data for array in arrays]
        call = library(CELLS).tribox_points
        call.argtypes = [*[ctypes.c_void_p] * 2, *[ctypes.c_int64] * 4, *[ctypes.c_void_p] * 6]
        call.restype = ctypes.c_int64
        sizes = p, state.shape[1], self.symmetric, n
        bad = call(self.function, ctypes.byref(self.material), *sizes, *places)
        elastic, dissipation, numerical = energies
        return PointUpdate(P, end, A, elastic, dissipation, numerical, not bad)


class MaterialPoints:
    """Material points that remember, of one kind. They keep no state: what comes in stays.

    A material has them (``Material.points``), a body keeps their state
    (:mod:`tribox.forms.bodies.memory_solid`): nothing else has to know of another kind. A kind
    gives the kernel that updates its points, or else updates them itself.

    Attributes:
        space: whether F and P have nine components, not the plane's five; components: their number.
        columns: where in a state the variables lie, by name.
        first: (s,) state of a point that nothing has happened to.
        flows: whether they yield, so that a load taken back is answered elastically; those that
            only creep have no such edge.
        rated: whether the duration of a step counts.
        added: whether their stress is added to that of the material's strain energy, whose forms
            stay beside them; if not it stands for that energy, of which selective reduced
            integration keeps the volumetric part at the centre (``volumetric=False``).
    """

    flows = rated = added = False

    def __init__(self, space: bool, columns: Mapping[str, slice], first: Floats) -> None:
        self.space, self.columns, self.first = space, columns, first
        self.components = 9 if space else 5

    def start(self, points: int) -> Floats:
        """State (points, s) of a body that nothing has happened to."""
        return np.tile(self.first, (points, 1))

    def frozen(self) -> MaterialPoints:
        """The same points with what they remember held: their instantaneous, elastic answer."""
        raise NotImplementedError

    def kernel(self, section: str, dt: float, volumetric: bool = True) -> Kernel | None:
        """What updates them in a loop over cells, in "strain", "ring" or "space"; None: nothing.

        ``dt``: s; ``volumetric``: False leaves the volumetric energy out.
        """
        return None

    def update(
        self, F: Floats, state: Floats, dt: float, tangent: bool, volumetric: bool = True
    ) -> PointUpdate:
        """Stress, new state and energies at the deformation gradients ``F``.

        Args:
            F: (n, p) deformation gradients at the end of the step.
            state: (n, s) at its begin.
            dt: s, its length; infinite where rates do not count.
            tangent: whether to compute A.
            volumetric: False leaves the volumetric energy out.

        Raises:
            ValueError: arrays of other shapes, or a ``dt`` that is not positive where it counts.
        """
        wanted = (len(F), self.components), (len(F), len(self.first))
        if (F.shape, state.shape) != wanted:
            raise ValueError(f"F and state have shapes {F.shape}, {state.shape}, not {wanted}")
        kernel = self.kernel("space" if self.space else "ring", dt, volumetric)
        assert kernel is not None, "who has no kernel updates points itself"
        return kernel.update(F, state, tangent)


class PointsBeside(MaterialPoints):
    """Kinds of points whose stresses are added to one body: branches and softening."""

    added = True

    def __init__(self, parts: Sequence[MaterialPoints]) -> None:
        """Take them; their columns have names of their own."""
        self.parts = tuple(parts)
        ends = np.cumsum([0, *(len(part.first) for part in parts)])
        self._places = [slice(int(a), int(b)) for a, b in pairwise(ends)]
        columns = {
            name: slice(at.start + place.start, at.stop + place.start)
            for part, place in zip(self.parts, self._places, strict=True)
            for name, at in part.columns.items()
        }
        super().__init__(parts[0].space, columns, np.concatenate([part.first for part in parts]))
        self.rated = any(part.rated for part in parts)

    def frozen(self) -> PointsBeside:
        """The same with what they remember held."""
        return PointsBeside([part.frozen() for part in self.parts])

    def update(
        self, F: Floats, state: Floats, dt: float, tangent: bool, volumetric: bool = True
    ) -> PointUpdate:
        """The sums of what the parts give."""
        found = [
            part.update(F, np.ascontiguousarray(state[:, place]), dt, tangent, volumetric)
            for part, place in zip(self.parts, self._places, strict=True)
        ]

        def total(name: str) -> Floats:
            first, *others = (getattr(one, name) for one in found)
            return np.asarray(sum(others, start=first))

        return PointUpdate(
            total("P"),
            np.hstack([one.state for one in found]),
            total("A") if tangent else None,
            total("elastic"),
            total("dissipation"),
            total("numerical"),
            all(one.valid for one in found),
        )


@dataclass(frozen=True, slots=True)
class Origin:
    """From where material points are evaluated."""

    values: Floats  # (k, s), committed
    dt: float  # s, duration of the step, infinite where rates do not count
    # whether nothing flows on from there, as in the first moment of unloading
    elastic: bool = False


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Material points at one displacement."""

    u: Floats  # (n,), m, local unknowns
    origin: Origin  # from where
    number: int  # of the committed values
    values: Floats  # (k, s), what is remembered
    # (2 or 3,), J, of this rank's part of the body: stored, and dissipated since the origin
    energies: Floats
    forces: Floats  # (n,), N (N/m), of the stress on the nodes of this rank
    valid: bool  # whether all points could be evaluated; where not, all but the values are NaN

    def led_from(self, origin: Origin, u: Floats) -> bool:
        """Whether this is where ``origin`` leads at the displacements ``u`` (n,), m."""
        own = self.origin
        same = own.values is origin.values and (own.dt, own.elastic) == (origin.dt, origin.elastic)
        return same and np.array_equal(self.u, u)

    def dissipation(self, before: Evaluation | None, comm: MPI.Comm) -> Floats:
        """Energy (2,), J, this rank lost since the origin, and the step's part of it; collective.

        External forces do work by the trapezoidal rule, so that of the stress is the mean of the
        forces at both ends times the change of the displacements. What that leaves beside the
        stored energy is less than the dissipation by the stress at the end of the step. While a
        point flows all through a step that is ½ Δσ_Y Δα; where it begins to flow within it is
        more, and falls with the step too. Branches that steps resolve count their mean stress:
        what is left of them is of second order, of either sign. A step in which nothing is lost on
        any rank has no such part; where some lose, others have theirs: forces at nodes that they
        share do work on both sides.

        Args:
            before: what was committed before; None: an undeformed body without stress.
            comm: the ranks that the body is spread over.
        """
        stored, lost = self.energies[:2]
        forces, moved = self.forces, self.u
        if before is not None:
            forces, moved = forces + before.forces, moved - before.u
            stored = stored - before.energies[0]
        work = 0.5 * (forces @ moved)
        flows = comm.allreduce(bool(lost > 0.0), op=MPI.LOR)
        return np.array([lost, lost - (work - stored) if flows else 0.0])


@dataclass(frozen=True, slots=True)
class PointHistory:
    """All that a body is restored from: what was committed last, to be evaluated once more."""

    origin: Origin | None  # of the last committed step; None: there was none
    dissipated: Floats  # (2,), J, of this rank in all steps, and the numerical part of it


class PointState:
    """Committed and trial values of the material points of one body.

    Attributes:
        committed: (k, s); width: s; number: how often they were committed.
        trial: the evaluation that a commit would take; None: none since the last commit.
        last: the evaluation committed last; None before; retired: the one before, of which
            nothing but the values is wanted any more.
    """

    def __init__(self, initial: Floats) -> None:
        """Begin with the ``initial`` values (k, s)."""
        self._initial, self.width = initial, initial.shape[1]
        self.begin(initial)

    def begin(self, values: Floats | None) -> None:
        """Start from ``values`` (k, s), or from the initial ones, as if nothing had been."""
        self.committed = self._initial if values is None else values
        self.number = 0
        self.trial: Evaluation | None = None
        self.last: Evaluation | None = None
        self.retired: Evaluation | None = None
        self._free: Floats | None = None
        self._lent: list[Floats] = [] if values is None else [values]

    def spare(self) -> Evaluation | None:
        """An evaluation whose arrays may be used again; it is given away.

        Memory that is asked for anew costs more than what is computed.
        """
        if self.trial is not None:
            trial, self.trial = self.trial, None
            return trial
        found, self.retired = self.retired, None
        if found is None:
            return None
        free, self._free = self._free, None
        return replace(found, values=np.empty_like(found.values) if free is None else free)

    def lend(self, values: Floats) -> None:
        """Never write over ``values`` (k, s) again: they are an origin for others, too."""
        if not any(values is one for one in self._lent):
            self._lent.append(values)

    def _release(self, values: Floats) -> None:
        """Write over ``values`` (k, s) of two commits ago, unless they are lent or the initial."""
        lent = len(self._lent)
        self._lent = [one for one in self._lent if one is not values]
        if len(self._lent) == lent and values is not self._initial:
            self._free = values

    def known(self, u: Floats, dt: float) -> Evaluation | None:
        """The trial, if it is that of the displacements ``u`` (n,), m, and ``dt`` (s)."""
        found = self.trial
        if found is None or found.number != self.number or found.origin.dt != dt:
            return None
        return found if np.array_equal(found.u, u) else None

    def at(self, u: Floats) -> Evaluation | None:
        """What was committed or tried last, if it was at the displacements ``u`` (n,), m."""
        for found in (self.last, self.trial):
            if found is not None and np.array_equal(found.u, u):
                return found
        return None

    def tangent_origin(self, u: Floats, dt: float) -> Origin:
        """From where the tangent at ``u`` (n,), m, of a step of ``dt`` (s) is taken.

        At the displacements of the last committed step all points that flowed in it are on the edge
        of their elastic range. Seen from there the tangent is elastic, and the step that it
        predicts far too stiff: the tangent is that of the step that led there.
        """
        if self.last is not None and np.array_equal(self.last.u, u):
            return self.last.origin
        return Origin(self.committed, dt)

    def commit(self, u: Floats) -> Evaluation | None:
        """Start from the trial's values, at ``u`` (n,), m, and give them; None without any."""
        done = self.trial
        if done is None:
            return None
        same = np.array_equal(done.u, u) or np.array_equal(done.u, u, equal_nan=True)
        assert same, "what is committed is evaluated last"
        if self.last is not None:
            self._release(self.last.origin.values)
        self.retired = self.last
        self.committed, self.last, self.trial = done.values, done, None
        self.number += 1
        return done
