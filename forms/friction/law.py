r"""The interface of friction laws: one vectorised update of a state, and its results.

Axis letters: q quadrature points, i, j space (d = 2 or 3 components; any d >= 1 works). All vectors
lie in the tangent plane of the contact, but are given in world components: no law needs the normal.

Signs: the slip increment :math:`\Delta g_T` is the slave's motion relative to the master. The
friction traction T has the direction of the slip; **it acts on the slave as -T** and on the master
as +T, so that :math:`T \cdot \Delta g_T` is the work that the bodies do on the contact. Tractions
are per reference area of the slave surface.

Energy, at every point and step, up to round-off:

.. math:: T \cdot \Delta g_T - (\psi_{n+1} - \psi_n) = \text{coulomb} + \text{viscous}
   + \text{switching} + \text{numerical} + \text{opening}

with :math:`\psi` from ``stored_energy``. The normal (penalty) part does not belong to the law.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from enum import IntEnum
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Regime(IntEnum):
    """State of motion of a contact point at the end of a step.

    ``STICK`` means that the asperities do not slip (no permanent slip in the step), also where a
    film with 0 < alpha < 1 creeps along with their elastic deformation. ``MIXED`` is permanent slip
    with 0 < alpha < 1, ``SLIP`` permanent slip without a film (alpha = 0), ``VISCOUS`` a film that
    carries all (alpha = 1), moving or not.
    """

    OPEN = 0
    STICK = 1
    SLIP = 2
    MIXED = 3
    VISCOUS = 4


@dataclass(slots=True)
class FrictionState:
    """History of the friction law at q points, as a structure of arrays.

    Attributes:
        elastic_slip: (q, i), m, elastic part of the slip, in the current tangent plane.
        slip_path: (q,), m, length of the permanent slip so far.
        alpha: (q,), -, film fraction of the last converged step.
        speed: (q,), m/s, slip speed of the last converged step.
        closed: (q,), whether the point was in contact.
    """

    elastic_slip: Floats
    slip_path: Floats
    alpha: Floats
    speed: Floats
    closed: NDArray[np.bool_]

    @classmethod
    def zeros(cls, n: int, dim: int) -> Self:
        """The state of n open points without history in dim space dimensions."""
        return cls(
            elastic_slip=np.zeros((n, dim)),
            slip_path=np.zeros(n),
            alpha=np.zeros(n),
            speed=np.zeros(n),
            closed=np.zeros(n, dtype=np.bool_),
        )

    def copy(self) -> Self:
        """A state that shares no memory with this one."""
        return type(self)(**{name: value.copy() for name, value in self._items()})

    def take(self, points: NDArray[Any]) -> Self:
        """The state of some points; ``points``: (p,) indices or (q,) mask."""
        return type(self)(**{name: value[points] for name, value in self._items()})

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Every array by name, contiguous, for a checkpoint; ``from_arrays`` is the inverse."""
        return {name: np.ascontiguousarray(value) for name, value in self._items()}

    @classmethod
    def from_arrays(cls, arrays: dict[str, NDArray[Any]]) -> Self:
        """The state written by ``arrays``; ValueError if one is missing, or too many."""
        expected = {field.name for field in fields(cls)}
        if set(arrays) != expected:
            raise ValueError(
                f"friction state: got arrays {sorted(arrays)}, expected {sorted(expected)}"
            )
        return cls(**{name: np.array(value) for name, value in arrays.items()})

    def _items(self) -> list[tuple[str, NDArray[Any]]]:
        return [(field.name, getattr(self, field.name)) for field in fields(self)]


@dataclass(frozen=True, slots=True)
class Dissipation:
    """The parts of the work of one step, per reference area. Each array (q,), J/m^2 per step.

    Attributes:
        coulomb: Permanent slip against the friction threshold.
        viscous: Shear of the film.
        switching: Elastic energy set free by a change of the film fraction alpha. Negative only
            under the literal re-entry rule.
        numerical: Part of the time integration, 1/2 k |g_e - r g_e,old|^2: falls as 1/N with the
            number of steps N.
        opening: Elastic slip energy lost where the contact opened.
    """

    coulomb: Floats
    viscous: Floats
    switching: Floats
    numerical: Floats
    opening: Floats

    @property
    def total(self) -> Floats:
        """Sum of the parts, (q,), J/m^2 per step."""
        return self.coulomb + self.viscous + self.switching + self.numerical + self.opening


@dataclass(frozen=True, slots=True)
class FrictionResponse:
    """Results of a friction law at q points.

    The arrays may be views that are not C-contiguous. Derivatives are exact; at a kink (onset of
    slip, end of a transition) they are those of the branch taken. All are zero at open points.

    Attributes:
        traction: (q, i), Pa, friction traction T; it acts on the slave as -T.
        d_traction_d_slip: (q, i, j), Pa/m, derivative for the slip increment, j its component.
        d_traction_d_elastic: (q, i, j), Pa/m, derivative for the elastic slip of the input state.
        d_traction_d_pressure: (q, i), -, derivative for the contact pressure.
        d_traction_d_film: (q, i), Pa/m, derivative for the film thickness.
        state: Trial state at the end of the step; the caller commits or discards it.
        regime: (q,), codes of ``Regime``.
        dissipation: The work of the step, split.
        held_back: (q,), Pa, traction that the law leaves out since bodies unload in the step; where
            something drives them instead, it would be there. None: nowhere.
    """

    traction: Floats
    d_traction_d_slip: Floats
    d_traction_d_elastic: Floats
    d_traction_d_pressure: Floats
    d_traction_d_film: Floats
    state: FrictionState
    regime: NDArray[np.int8]
    dissipation: Dissipation
    held_back: Floats | None = None


def without_stiffness(response: FrictionResponse) -> FrictionResponse:
    """The same traction, as a load that does not change with motion and pressure."""
    none = np.zeros_like(response.d_traction_d_slip)
    return replace(
        response,
        d_traction_d_slip=none,
        d_traction_d_elastic=none,
        d_traction_d_pressure=np.zeros_like(response.d_traction_d_pressure),
    )


class FrictionLaw(Protocol):
    """A friction law: anything with these four methods.

    It may also say where its friction tends: :mod:`tribox.forms.friction.law`.
    """

    def initial_state(self, n: int, dim: int) -> FrictionState:
        """State of n points that have never been in contact, in dim space dimensions."""
        ...

    def update(
        self,
        slip_increment: Floats,
        dt: float,
        pressure: Floats,
        film: Floats,
        state: FrictionState,
        *,
        area_ratio: Floats | float = 1.0,
        rate_dependent: bool = True,
    ) -> FrictionResponse:
        """Traction, its derivatives and the trial state at the end of one step.

        Args:
            slip_increment: (q, i), m, slip of the step, in the current tangent plane.
            dt: s, length of the step, > 0.
            pressure: (q,), Pa, contact pressure t_N >= 0 per reference area; 0 means open.
            film: (q,), m, film thickness D >= 0.
            state: Last converged state, its elastic slip transported to the current tangent plane.
                It is not modified.
            area_ratio: (q,) or a number, -, da/dA of the slave surface. A law whose attribute
                ``takes_film_cover`` is true is also given ``film_cover``, (q,), the share of the
                area at each point that its viscous traction acts on: less than 1 at the rim of a
                contact. One whose ``looks_inside`` is true is given ``look_inside=False`` in
                explicit steps, which are too short for anything to change within them.
            rate_dependent: False switches off all that depends on time.

        Raises:
            ValueError: dt is not positive in a rate-dependent step.
        """
        ...

    def stored_energy(self, state: FrictionState) -> Floats:
        """Elastic energy of the slip, (q,), J/m^2 of reference area."""
        ...

    def coefficient(self, state: FrictionState) -> Floats:
        """Coefficient of friction of the asperities at the slip reached, (q,)."""
        ...


def require_time_step(dt: Floats | float, rate_dependent: bool) -> None:
    """ValueError if a rate-dependent step has no dt > 0."""
    if rate_dependent and not (dt > 0.0 if isinstance(dt, float) else np.all(dt > 0.0)):
        raise ValueError(f"dt = {dt!r} s is not allowed: a rate-dependent step needs dt > 0")


# -- What a friction law may say, beside its four methods, of where its friction tends  -----------


SETTLED = 1e-3
"""Distance of friction from where it tends, relative, at which it counts as being there."""


def knows_its_end(law: FrictionLaw) -> bool:
    """Whether it is known, at every point, how far friction is from where it tends."""
    return hasattr(law, "unsettled") or settling_slip(law) == 0.0


def settling_slip(law: FrictionLaw) -> float:
    """Slip after which a law's coefficient of friction has settled, m; 0 if it does not say."""
    return float(getattr(law, "settling_slip", 0.0))


def unsettled(law: FrictionLaw, state: FrictionState, pressure: Floats) -> Floats:
    """Friction above the traction it tends to, (q,), Pa, 0 at open points; t_N (q,), Pa."""
    own: Any = law
    left = own.unsettled(state, pressure) if hasattr(law, "unsettled") else 0.0
    return np.where(pressure > 0.0, left, 0.0)


def presliding_length(law: FrictionLaw, state: FrictionState, pressure: Floats) -> Floats:
    """Slip in which friction follows a change, (q,), m, 0 at open points; t_N (q,), Pa."""
    own: Any = law
    if hasattr(law, "presliding_length"):
        length = own.presliding_length(state, pressure)
    else:
        length = np.linalg.norm(state.elastic_slip, axis=1)
    return np.where(pressure > 0.0, length, 0.0)
