"""Names for the parts of a drawing that has none, such as a STEP file; inside gmsh's process.

Parts are chosen by gmsh's numbers of them, which `tribox mesh` shows, or by points on them, which
stay the same where the drawing is made anew.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import ModuleType

import numpy as np

from tribox.geometry.meshes.gmsh_model import MeshError

OFF = 1e-3
"""Distance over the extent of the drawing up to which a point counts as on a part."""

_KIND = {1: "curve", 2: "face", 3: "volume"}
Spots = Mapping[str, Sequence[int | Sequence[float]]]


def name_parts(gmsh: ModuleType, bodies: Spots, surfaces: Spots, plain: bool) -> None:
    """Name bodies and surfaces.

    Args:
        gmsh: The module, with the drawing.
        bodies: Numbers of, or points in, the volumes (in the plane faces) by name.
        surfaces: Likewise of their faces (curves).
        plain: Whether the drawing has no names of its own: bodies are then called "body 1", ...,
            unless they are named.

    Raises:
        MeshError: There is no such part, or it has two names.
    """
    if not (bodies or surfaces or plain):
        return
    dim = 3 if gmsh.model.getEntities(3) else 2
    for d, kind, parts in ((dim, "bodies", bodies), (dim - 1, "surfaces", surfaces)):
        taken: dict[int, str] = {}
        for name, spots in parts.items():
            tags = sorted({_tag_of(gmsh, d, spot, f"{kind}.{name}") for spot in spots})
            for tag in tags:
                if (other := taken.setdefault(tag, name)) != name:
                    raise MeshError(f'{kind}: {_KIND[d]} {tag} is "{other}" and "{name}"')
            gmsh.model.addPhysicalGroup(d, tags, name=name)
    if plain and not bodies:
        for _, tag in gmsh.model.getEntities(dim):
            gmsh.model.addPhysicalGroup(dim, [tag], name=f"body {tag}")


def name_every_part(gmsh: ModuleType) -> None:
    """Name every body "body N" and every surface "surface N", by their numbers."""
    gmsh.model.removePhysicalGroups()
    dim = 3 if gmsh.model.getEntities(3) else 2
    for d, word in ((dim, "body"), (dim - 1, "surface")):
        for _, tag in gmsh.model.getEntities(d):
            gmsh.model.addPhysicalGroup(d, [tag], name=f"{word} {tag}")


def _tag_of(gmsh: ModuleType, dim: int, spot: int | Sequence[float], place: str) -> int:
    """The number of a part, by itself or by a point."""
    tags = [int(tag) for _, tag in gmsh.model.getEntities(dim)]
    if not tags:
        raise MeshError(f"{place}: the drawing has no {_KIND[dim]}s")
    if isinstance(spot, int):
        if spot not in tags:
            raise MeshError(f"{place}: no {_KIND[dim]} {spot}; there are {_listed(tags)}")
        return spot
    point = [*map(float, spot), 0.0, 0.0][:3]
    away = [_distance(gmsh, dim, tag, point) for tag in tags]
    box = np.reshape(gmsh.model.getBoundingBox(-1, -1), (2, 3))
    best = int(np.argmin(away))
    if away[best] > OFF * float(np.ptp(box, axis=0).max()):
        where = ", ".join(f"{value:g}" for value in point)
        raise MeshError(
            f"{place}: no {_KIND[dim]} at ({where}); the nearest is {tags[best]}, {away[best]:.3g} "
            "away, in units of the drawing"
        )
    return tags[best]


def _distance(gmsh: ModuleType, dim: int, tag: int, point: list[float]) -> float:
    """Distance of a point from a part; of a volume 0 inside and infinite outside."""
    if dim == 3:
        return 0.0 if gmsh.model.isInside(3, tag, point) else np.inf
    nearest = gmsh.model.getClosestPoint(dim, tag, point)[0]
    away = float(np.linalg.norm(np.subtract(nearest, point)))
    # What is nearest on the whole curve or plane may be beyond its ends.
    low, high = np.reshape(gmsh.model.getBoundingBox(dim, tag), (2, 3))
    outside = np.maximum(np.maximum(low - point, np.subtract(point, high)), 0.0)
    inside = gmsh.model.isInside(dim, tag, list(map(float, nearest)))
    return max(away, float(np.linalg.norm(outside))) if inside else np.inf


def _listed(tags: Sequence[int]) -> str:
    """Numbers, where many the first and the last."""
    return ", ".join(map(str, tags)) if len(tags) <= 12 else f"{tags[0]} to {tags[-1]}"
