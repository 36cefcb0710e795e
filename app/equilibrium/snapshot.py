"""What a part of a run remembers, in a form that can be written and read back on other ranks.

A snapshot is a tree of dictionaries and lists. Its leaves are numbers, texts and None, the same on
all ranks; arrays, likewise; and the four kinds of values here that are spread over the ranks.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from tribox.app.equilibrium.step_mode import HoldingSprings, StepMode
from tribox.forms.bodies.point_state import Origin, PointHistory
from tribox.forms.bodies.solid import Solid
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.state import ContactMode, ContactState
from tribox.geometry.surfaces.facets import Floats

Array = NDArray[Any]
Snapshot = dict[str, Any]
"""A tree as it is taken, with the kinds of leaves below; or as it is read, plain arrays instead."""


@dataclass(frozen=True, slots=True)
class Nodal:
    """Values (n,) of this rank's owned unknowns."""

    values: Floats


@dataclass(frozen=True, slots=True)
class AtPoints:
    """Values (q, …) at this rank's slave points of the pair with this number."""

    pair: int
    values: Array


@dataclass(frozen=True, slots=True)
class InCells:
    """Values (c, …) of this rank's own cells of the body with this number, in their order."""

    body: int
    values: Array


@dataclass(frozen=True, slots=True)
class Partial:
    """This rank's part of sums over the ranks; read, the first rank has all of them."""

    values: Array


Spread = Nodal | AtPoints | InCells | Partial


# -- Attributes that are kept as they are ----------------------------------------------------------

T = TypeVar("T")
Kept = Annotated[T, "kept"]
"""In the body of a class that :class:`Remembers`: an attribute that a checkpoint keeps."""
KeptAtPoints = Annotated[T, AtPoints]
"""The same, of a list with the values of each pair at its points."""


class Remembers:
    """What has attributes that a checkpoint keeps; the kinds declared are made again from data."""

    def snapshot(self) -> Snapshot:
        """What the rest of a run depends on; views, not copies."""
        kept = {}
        for name, kind in _kept(self):
            value = getattr(self, name)
            if AtPoints in get_args(kind):
                value = [AtPoints(pair, points) for pair, points in enumerate(value)]
            kept[name.lstrip("_")] = _plain(value)
        return kept

    def restore(self, kept: Snapshot) -> None:
        """Go on from what :meth:`snapshot` has seen."""
        for name, kind in _kept(self):
            own: Any = getattr(self, name, None)
            value = kept[name.lstrip("_")]
            if hasattr(own, "restore"):
                own.restore(value)
            else:
                setattr(self, name, _made(get_args(kind)[0], value))


def _kept(owner: Remembers) -> list[tuple[str, Any]]:
    hints = get_type_hints(type(owner), include_extras=True)
    return [(name, kind) for name, kind in hints.items() if get_origin(kind) is Annotated]


def _plain(value: Any) -> Any:
    """A value as a tree; a dictionary as pairs, for its keys need not be texts."""
    if hasattr(value, "snapshot"):
        return value.snapshot()
    if isinstance(value, dict):
        return [[_plain(key), _plain(one)] for key, one in value.items()]
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if is_dataclass(value) and not isinstance(value, Spread):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    return value


def _made(kind: Any, value: Any) -> Any:
    """A value of a kind from its tree."""
    origin, parts = get_origin(kind), get_args(kind)
    if value is None:
        return None
    if origin in (Union, UnionType):  # of something or None
        return _made(parts[0], value)
    if isinstance(kind, type) and is_dataclass(kind):
        kinds = get_type_hints(kind)
        return kind(**{name: _made(kinds[name], one) for name, one in value.items()})
    if origin is dict:
        return {_made(parts[0], key): _made(parts[1], one) for key, one in value}
    if origin is list or (origin is tuple and parts[-1] is Ellipsis):
        return origin(_made(parts[0], one) for one in value)
    if origin is tuple:
        return tuple(_made(part, one) for part, one in zip(parts, value, strict=True))
    return value


# -- What holds kinds of forms ---------------------------------------------------------------------


def scattered(dofs: Array, values: Floats | float, owned: int) -> Nodal:
    """Values (c,) of the owned unknowns ``dofs`` (c,), zero at the others of (n,)."""
    out = np.zeros(owned)
    out[dofs] = values
    return Nodal(out)


def of_contact(pair: int, term: ContactTerm, state: ContactState) -> Snapshot:
    """A history of one pair."""
    state = replace(state, facet=term.surface.numbers(state.facet))
    names = [name for name in ContactState.__slots__ if name not in ("friction", "film")]
    points = {name: AtPoints(pair, getattr(state, name)) for name in names}
    law = {name: AtPoints(pair, values) for name, values in state.friction.arrays().items()}
    film = None if state.film is None else asdict(state.film)
    return {"points": points, "law": law, "film": film}


def to_contact(term: ContactTerm, kept: Snapshot) -> ContactState:
    """The history of a pair that :func:`of_contact` kept; collective."""
    law = type(term.state.friction).from_arrays(kept["law"])
    film, own = kept.get("film"), term.state.film
    film = None if film is None or own is None else type(own)(**film)
    points = kept["points"] | {"facet": term.surface.numbered(kept["points"]["facet"])}
    return ContactState(**points, friction=law, film=film)


def of_contacts(terms: Sequence[ContactTerm], states: Sequence[ContactState]) -> list[Snapshot]:
    """The histories of all pairs."""
    pairs = enumerate(zip(terms, states, strict=True))
    return [of_contact(pair, term, state) for pair, (term, state) in pairs]


def to_contacts(terms: Sequence[ContactTerm], kept: Sequence[Snapshot]) -> list[ContactState]:
    """The histories of all pairs; collective."""
    return [to_contact(term, one) for term, one in zip(terms, kept, strict=True)]


def of_origin(body: int, solid: Solid, origin: Origin | None) -> Snapshot | None:
    """From where the material points of a body were evaluated."""
    if origin is None:
        return None
    # JSON has no number for the endless step of points that do not feel time.
    dt = origin.dt if math.isfinite(origin.dt) else None
    values = InCells(body, solid.cell_rows(origin.values))
    return {"values": values, "dt": dt, "elastic": origin.elastic}


def to_origin(solid: Solid, kept: Snapshot | None) -> Origin | None:
    """From where points are evaluated, as :func:`of_origin` kept it."""
    if kept is None:
        return None
    dt = math.inf if kept["dt"] is None else kept["dt"]
    return Origin(solid.point_rows(kept["values"]), dt, kept["elastic"])


def of_bodies(solids: Sequence[Solid]) -> list[Snapshot | None]:
    """What the bodies remember."""
    kept: list[Snapshot | None] = []
    for body, solid in enumerate(solids):
        history = solid.history()
        kept.append(
            None
            if history is None
            else {
                "origin": of_origin(body, solid, history.origin),
                "dissipated": Partial(history.dissipated),
            }
        )
    return kept


def to_bodies(solids: Sequence[Solid], kept: Sequence[Snapshot | None]) -> None:
    """Take all bodies back to before the last step that :func:`of_bodies` has seen."""
    for solid, one in zip(solids, kept, strict=True):
        if one is not None:
            solid.adopt(PointHistory(to_origin(solid, one["origin"]), one["dissipated"]))


def of_step(terms: Sequence[ContactTerm], step: StepMode) -> Snapshot:
    """How a step is evaluated."""
    holding = step.holding
    springs: Snapshot | None = None
    if holding is not None:
        at = {"stiffness": Nodal(holding.stiffness), "place": Nodal(holding.place)}
        springs = {**at, "weak": holding.weak}
    modes = []
    for pair, mode in enumerate(step.modes):
        frozen = mode.frozen_facets
        frozen = None if frozen is None else terms[pair].surface.numbers(frozen)
        kept = asdict(replace(mode, interior=None))
        kept |= {"frozen_facets": None if frozen is None else AtPoints(pair, frozen)}
        modes.append(kept)
    return {"dt": step.dt, "modes": modes, "holding": springs, "rates": step.rate_dependent}


def to_step(terms: Sequence[ContactTerm], kept: Snapshot) -> StepMode:
    """How a step is evaluated, as :func:`of_step` kept it; collective."""
    springs, modes = kept["holding"], []
    for term, mode in zip(terms, kept["modes"], strict=False):
        frozen = mode["frozen_facets"]
        frozen = None if frozen is None else term.surface.numbered(frozen)
        modes.append(ContactMode(**mode | {"frozen_facets": frozen}))
    return StepMode(
        dt=kept["dt"],
        modes=tuple(modes),
        holding=None if springs is None else HoldingSprings(**springs),
        rate_dependent=kept["rates"],
    )
