"""The structure that the compiled loops of an explicit contact pair work on, and its arrays.

Axis letters: q slave points, n master nodes, i space, α surface directions.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tribox.forms.contact.kinematics import ContactKinematics
from tribox.forms.contact.state import Fading
from tribox.geometry.surfaces.projection import Projection

SOURCES = {2: "plane_contact.c", 3: "space_contact.c"}  # by the dimension of space
FACET_NOTES, FAR_NOTES = 10, 13  # numbers that the projection in space notes

_LONGS = (
    *("points", "corners", "candidates", "nodes", "first_master", "vertices", "averaged"),
    *("facet_count", "facet_nodes", "facet_vertices", "around_most"),
)
_DOUBLES = ("touching", "roundoff", "slack", "tie", "moved")
_INPUTS = (
    *("weight", "shape", "slope", "reference", "direction", "rows", "master", "facets"),
    *("previous", "next", "around", "around_corner", "across", "across_side", "open"),
    *("facet_notes", "far_notes", "penalty", "reach", "damping"),
    *("of_point", "vertex_shape", "sums", "nodal_pressure", "active"),
    *("candidate", "searched_points", "searched_nodes", "values", "load"),
)
# Of the state before the step, by the results that they are after it.
BEFORE = {
    "facet_before": "facet",
    "xi_before": "xi",
    "component_before": "component",
    "length_before": "length",
    "share_before": "present",
    "sunk_before": "sunk",
}
_VECTORS = ("position", "foot", "normal", "slip", "elastic", "traction", "friction")
_RESULTS = (
    *("current", "position", "area_ratio", "xi", "foot", "normal", "tangent", "gap", "slip"),
    *("elastic", "pressure", "traction", "component", "length", "gap_after", "friction"),
    *("viscous", "work", "share", "present", "sunk", "lost"),
    *("facet", "clamped", "on_surface", "closed"),
)
_FILM = ("tau", "film", "dry", "compliance")


class PairStructure(ctypes.Structure):
    """``Pair`` of the C header, field by field in the same order."""

    _fields_ = (
        *((name, ctypes.c_int64) for name in _LONGS),
        *((name, ctypes.c_double) for name in _DOUBLES),
        *((name, ctypes.c_void_p) for name in (*_INPUTS, *BEFORE, *_RESULTS, *_FILM)),
    )


def check_layout(code: ctypes.CDLL, structure: type[ctypes.Structure] = PairStructure) -> None:
    """Compare a structure with that of a compiled library.

    Args:
        code: the library of one of ``SOURCES``.
        structure: what its functions will be given.

    Raises:
        RuntimeError: they are not of one size, so that fields would be taken for one another.
    """
    code.tribox_pair_size.argtypes, code.tribox_pair_size.restype = [], ctypes.c_int64
    theirs, ours = code.tribox_pair_size(), ctypes.sizeof(structure)
    if theirs != ours:
        raise RuntimeError(
            f"contact_pair.h: its structure Pair takes {theirs} bytes, the one of {__name__} "
            f"{ours}; both must list the same fields in the same order"
        )


class PairArrays:
    """One set of results, and the structure that points at them.

    Attributes:
        arrays: by the field of the structure; pair: the structure; at: reference to it.
    """

    def __init__(self, points: int, nodes: int, dim: int) -> None:
        """Allocate the results of ``points`` over ``nodes`` of the master in ``dim`` dimensions."""
        self.arrays: dict[str, NDArray[Any]] = {}
        shapes = {
            "current": (nodes, dim),
            "xi": (points, dim - 1),
            "component": (points, dim - 1),
            "tangent": (points, dim - 1, dim),
            **dict.fromkeys(_VECTORS, (points, dim)),
        }
        kinds: dict[str, type] = {"facet": np.int32}
        kinds |= dict.fromkeys(("clamped", "on_surface", "closed"), np.bool_)
        self.pair = PairStructure()
        self.at = ctypes.byref(self.pair)
        for name in _RESULTS:
            array: NDArray[Any] = np.zeros(
                shapes.get(name, (points,)), dtype=kinds.get(name, np.float64)
            )
            self.arrays[name] = array
            self.point(name, array)

    def point(self, name: str, array: NDArray[Any]) -> None:
        """Point the structure's field at an array, which the caller must keep alive."""
        assert array.flags.c_contiguous
        setattr(self.pair, name, array.ctypes.data)

    def projection(self) -> Projection:
        """The arrays as a projection, without what only its variation needs."""
        a = self.arrays
        fades = self.pair.averaged and a["position"].shape[1] == 2
        return Projection(
            facet=a["facet"],
            xi=a["xi"],
            foot=a["foot"],
            normal=a["normal"],
            tangents=a["tangent"],
            gap=a["gap"],
            clamped=a["clamped"],
            on_surface=a["on_surface"],
            share=a["share"] if fades else None,
        )

    def kinematics(self) -> ContactKinematics:
        """The arrays as kinematics without variations."""
        a = self.arrays
        return ContactKinematics(
            normal=a["normal"],
            gap=a["gap"],
            closed=a["closed"],
            slip=a["slip"],
            elastic_slip=a["elastic"],
        )

    def fading(self) -> Fading | None:
        """What fades in the step; None with the pressure point by point."""
        if not self.pair.averaged:
            return None
        return Fading(self.arrays["present"], self.arrays["sunk"], self.arrays["lost"])
