"""Cases of two blocks, or bodies like them, one on the other, as plain data."""

from collections.abc import Sequence
from typing import Any

Data = dict[str, Any]
Size = tuple[float, float, Sequence[int]]  # width, height, elements along x and y


def two_blocks(
    sizes: tuple[Size, Size],
    bodies: tuple[Data, Data],
    contact: Data,
    boundaries: Sequence[Data],
    stages: Sequence[Data],
    geometry: Data | None = None,
    **tables: Any,
) -> Data:
    """A case of an upper and a lower block, whose bottom is held; ``geometry``: more of it."""
    upper, lower = (dict(zip(("width", "height", "elements"), s, strict=True)) for s in sizes)
    blocks = {"kind": "two-blocks", "upper": upper, "lower": lower}
    pair = {"slave": "elastomer_contact", "master": "aluminium_contact"}
    return {
        "geometry": blocks | (geometry or {}),
        "bodies": dict(zip(("elastomer", "aluminium"), bodies, strict=True)),
        "contact": [pair | contact],
        "boundary": [{"surface": "bottom", "displacement": {"x": 0, "y": 0}}, *boundaries],
        "stage": list(stages),
        **tables,
    }


def pressed(most: float, **motion: Any) -> Data:
    """The top under a pressure that grows for a second, moved as well."""
    platen = {"direction": "y", "pressure": [[0.0, 0.0], [1.0, most]]}
    return {"surface": "top", "platen": platen, **motion}


def press(**keys: Any) -> Data:
    """The stage in which they are pressed."""
    return {"name": "press", "duration": 1.0, "steps": 2, "rate_dependent": False} | keys
