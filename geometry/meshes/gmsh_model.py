"""A quiet gmsh session, and the checks a gmsh model must pass before it becomes a mesh.

Everything here runs on one process. gmsh is imported only when a session is opened, so that
commands that need no mesh do not load it.
"""

from __future__ import annotations

import contextlib
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

import tribox

PLANE_TOLERANCE = 1e-9  # largest |z| of a plane mesh, relative to its size in the plane

SAME_PLACE = 1e-8  # distance of two nodes that are one place, relative to the extent of all

LONGEST_NAME = 100  # letters of the name of a body or surface

FARTHEST = 1e30  # largest coordinate, m: the fourth power of a length is still a number

_ENTITY = {0: "point", 1: "curve", 2: "face", 3: "volume"}


class MeshError(ValueError):
    """A mesh, or a name looked up in it, cannot be used; the message is one line."""


@dataclass(frozen=True, slots=True)
class NamedGroups:
    """The named parts of a gmsh model."""

    dim: int  # dimension of the cells, 2 or 3
    bodies: dict[str, int]  # physical tag of each named group of cells
    surfaces: dict[str, int]  # physical tag of each named group of facets
    # dimension and entities of each named group of points, and in 3D of curves
    groups: dict[str, tuple[int, list[int]]]


class Shape(Protocol):
    """A built-in geometry."""

    def build(self) -> None:
        """Draw, name and mesh it in the current gmsh model."""
        ...


@contextlib.contextmanager
def gmsh_session(name: str) -> Iterator[ModuleType]:
    """A new gmsh model called ``name``; at the end it is removed and gmsh's state restored.

    A session that is already open is used and stays open. gmsh prints nothing, reads no personal
    options file and installs no handler of Ctrl-C, so a mesh does not depend on the machine that
    it is made on.

    Yields:
        The module ``gmsh``, with the new model current.
    """
    import gmsh

    ours = not gmsh.isInitialized()
    if ours:
        gmsh.initialize(readConfigFiles=False, interruptible=False)
    terminal = gmsh.option.getNumber("General.Terminal")
    previous = gmsh.model.getCurrent()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add(name)
        yield gmsh
    finally:
        if ours:
            gmsh.finalize()
        else:
            gmsh.model.remove()
            gmsh.model.setCurrent(previous)
            gmsh.option.setNumber("General.Terminal", terminal)


def write_msh(shape: Shape, path: Path) -> None:
    """Write a built-in geometry as a gmsh file of version 4.1, whole, on one process.

    ValueError if ``path`` does not end in ``.msh``; FileNotFoundError without its directory.
    """
    path = Path(path)
    if path.suffix != ".msh":
        raise ValueError(f"{path}: the name of a gmsh mesh file must end in .msh")
    if not path.parent.is_dir():
        raise FileNotFoundError(f"{path.parent}: no such directory")
    partial = path.with_name(f".{path.stem}.partial.msh")
    try:
        with gmsh_session(type(shape).__name__) as gmsh:
            shape.build()
            gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
            gmsh.write(str(partial))
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def named_groups(gmsh: ModuleType, source: str) -> NamedGroups:
    """Check the current model and return names and tags of its parts, and the other groups.

    Nodes are renumbered without holes and groups of points (in 3D also of curves) are dropped from
    the model: DOLFINx fails on both. ``source``: name of the model in messages. MeshError without
    cells or named groups, if a cell is in no body or an entity in two groups, if cells are of a
    kind that cannot be read, folded or listed twice, or a plane mesh is not in z = 0.
    """
    dim = _cell_dimension(gmsh, source)
    groups = gmsh.model.getPhysicalGroups()
    if not any(d in (dim, dim - 1) for d, _ in groups):
        raise MeshError(
            f"{source}: no physical groups; name the bodies ({_ENTITY[dim]}s) and their surfaces "
            f"({_ENTITY[dim - 1]}s) in gmsh, and save without Mesh.SaveAll, which can drop them"
        )
    _check_one_group_each(gmsh, dim, source)
    bodies = _names(gmsh, dim, source)
    surfaces = _names(gmsh, dim - 1, source)
    for name, tag in bodies.items():
        _check_meshed(gmsh, dim, tag, f"{source}: body {name!r}")
    _check_all_cells_named(gmsh, dim, source)
    low = [(d, tag) for d, tag in groups if d < dim - 1]
    others = _other_groups(gmsh, low, source, {**bodies, **surfaces})
    if low:  # an empty list would remove all groups
        gmsh.model.removePhysicalGroups(low)
    gmsh.model.mesh.renumberNodes()
    _check_coordinates(gmsh, source)
    _check_cells(gmsh, dim, source)
    if dim == 2:
        _check_plane(gmsh, source)
    nodes = np.unique(np.concatenate(gmsh.model.mesh.getElements(dim)[2]).astype(np.int64))
    for name, tag in surfaces.items():
        _check_facets(gmsh, dim, tag, name, source, nodes)
    return NamedGroups(dim, bodies, surfaces, others)


def elements_of(gmsh: ModuleType, dim: int, tag: int) -> dict[int, npt.NDArray[np.int64]]:
    """Node tags (e, a) of a group's elements, by gmsh's number of their kind."""
    found: dict[int, list[npt.NDArray[np.int64]]] = {}
    for entity in gmsh.model.getEntitiesForPhysicalGroup(dim, tag):
        types, _, nodes = gmsh.model.mesh.getElements(dim, entity)
        for kind, row in zip(types, nodes, strict=True):
            found.setdefault(int(kind), []).append(_rows(gmsh, kind, row))
    return {kind: np.concatenate(rows) for kind, rows in found.items()}


def _other_groups(
    gmsh: ModuleType, low: list[tuple[int, int]], source: str, taken: dict[str, int]
) -> dict[str, tuple[int, list[int]]]:
    """Dimension and entities of the named ones among groups of points and curves."""
    found: dict[str, tuple[int, list[int]]] = {}
    for d, tag in low:
        name = _name_of(gmsh, d, tag, source)
        if name in found or name in taken:
            raise MeshError(
                f"{source}: two physical groups, one of them of {_ENTITY[d]}s, are named {name!r}"
            )
        if name:
            entities = gmsh.model.getEntitiesForPhysicalGroup(d, tag)
            found[name] = (d, [int(entity) for entity in entities])
    return found


def _cell_dimension(gmsh: ModuleType, source: str) -> int:
    """The highest dimension that has elements, 2 or 3."""
    for dim in (3, 2):
        if len(gmsh.model.mesh.getElementTypes(dim)):
            return dim
    raise MeshError(f"{source}: the mesh has no faces and no volumes")


def _check_one_group_each(gmsh: ModuleType, dim: int, source: str) -> None:
    """Each entity may carry one physical tag only: a cell or facet keeps a single tag."""
    for d, entity in gmsh.model.getEntities(dim) + gmsh.model.getEntities(dim - 1):
        tags = gmsh.model.getPhysicalGroupsForEntity(d, entity)
        if len(tags) > 1:
            names = " and ".join(repr(_name_of(gmsh, d, tag, source) or int(tag)) for tag in tags)
            raise MeshError(
                f"{source}: {_ENTITY[d]} {entity} is in the physical groups {names}; "
                "it may be in one only: make groups that do not overlap, and name each in the case"
            )


def _names(gmsh: ModuleType, dim: int, source: str) -> dict[str, int]:
    """The physical groups of dimension ``dim`` by name."""
    found: dict[str, int] = {}
    for _, tag in gmsh.model.getPhysicalGroups(dim):
        name = _name_of(gmsh, dim, tag, source)
        if not name:
            raise MeshError(
                f"{source}: physical group {tag} ({_ENTITY[dim]}s) has no name of its own; every "
                "body and surface needs one"
            )
        if name in found:
            raise MeshError(
                f"{source}: the physical groups {found[name]} and {tag} ({_ENTITY[dim]}s) are "
                f"both named {name!r}"
            )
        found[name] = int(tag)
    return found


def _name_of(gmsh: ModuleType, dim: int, tag: int, source: str) -> str:
    """The name of a physical group, without blanks around it; empty if it has none."""
    try:
        name = str(gmsh.model.getPhysicalName(dim, tag)).strip()
    except UnicodeDecodeError:
        name = "\0"
    if not name.isprintable() or len(name) > LONGEST_NAME:
        raise MeshError(
            f"{source}: the name of physical group {tag} ({_ENTITY[dim]}s) cannot be used; it must "
            f"be printable text in UTF-8, of at most {LONGEST_NAME} letters"
        )
    return name


def _check_all_cells_named(gmsh: ModuleType, dim: int, source: str) -> None:
    """Every cell must belong to a body, otherwise it would silently be left out."""
    missing = 0
    for _, entity in gmsh.model.getEntities(dim):
        if not len(gmsh.model.getPhysicalGroupsForEntity(dim, entity)):
            missing += sum(len(tags) for tags in gmsh.model.mesh.getElements(dim, entity)[1])
    if missing:
        raise MeshError(
            f"{source}: {missing} cells are in no named body; put every {_ENTITY[dim]} that is "
            "meshed into a physical group"
        )


def _check_coordinates(gmsh: ModuleType, source: str) -> None:
    """All coordinates must be numbers that can be calculated with."""
    x = np.reshape(gmsh.model.mesh.getNodes()[1], (-1, 3))
    wrong = np.flatnonzero(~(np.abs(x) <= FARTHEST).all(axis=1))
    if len(wrong):
        found = ", ".join(f"{value:g}" for value in x[wrong[0]])
        raise MeshError(
            f"{source}: {len(wrong)} of the {len(x)} nodes are nowhere, the first at "
            f"({found}); coordinates must be finite, in m, and at most {FARTHEST:g}"
        )


def _check_cells(gmsh: ModuleType, dim: int, source: str) -> None:
    """Cells must be of kinds that can be read, each listed once and not folded."""
    types = [int(kind) for kind in gmsh.model.mesh.getElementTypes(dim)]
    _check_kinds(gmsh, types, source)
    for kind in types:
        tags, nodes = gmsh.model.mesh.getElementsByType(kind)
        repeated = _repeated(_rows(gmsh, kind, nodes))
        if repeated:
            raise MeshError(f"{source}: {repeated} cells are listed twice")
        low = np.asarray(gmsh.model.mesh.getElementQualities(tags, "minDetJac"))
        high = np.asarray(gmsh.model.mesh.getElementQualities(tags, "maxDetJac"))
        # Cells numbered clockwise have two negative values: fine for DOLFINx.
        folded = np.flatnonzero(~(np.sign(low) * np.sign(high) > 0.0))
        if len(folded):
            where = _middle_of(gmsh, tags[folded[0]])
            raise MeshError(
                f"{source}: {len(folded)} cells are folded or without extent, the first at {where}"
            )


def _check_kinds(gmsh: ModuleType, types: list[int], source: str) -> None:
    """Kinds that can be read: all of first order, or one of second order with all its nodes."""
    described = ", ".join(gmsh.model.mesh.getElementProperties(t)[0] for t in types)
    if PYRAMIDS & set(types):
        raise MeshError(
            f"{source}: cells are of the kind {described}; pyramids cannot be divided into "
            "hexahedra: mesh bodies with tetrahedra or hexahedra that do not touch"
        )
    if INCOMPLETE & set(types):
        raise MeshError(
            f"{source}: second-order cells without all of their nodes ({described}); mesh it with "
            "Mesh.SecondOrderIncomplete = 0"
        )
    orders = {gmsh.model.mesh.getElementProperties(t)[2] for t in types}
    if max(orders) > 2 or not set(types) <= KINDS.keys():
        raise MeshError(
            f"{source}: cells of the kind {described}; first and second order are read (in gmsh: "
            "Mesh.ElementOrder = 1 or 2)"
        )
    if max(orders) == 2 and len(types) > 1:
        raise MeshError(
            f"{source}: cells of several kinds ({described}), which have to be of first order (in "
            "gmsh: Mesh.ElementOrder = 1)"
        )


def _middle_of(gmsh: ModuleType, cell: int) -> str:
    """The place of a cell, as text."""
    nodes = gmsh.model.mesh.getElement(cell)[1]
    middle = np.mean([gmsh.model.mesh.getNode(node)[0] for node in nodes], axis=0)
    return "(" + ", ".join(f"{value:.4g}" for value in middle) + ")"


def _check_meshed(gmsh: ModuleType, dim: int, tag: int, what: str) -> None:
    """Every entity of a group must have elements, and there must be one."""
    entities = gmsh.model.getEntitiesForPhysicalGroup(dim, tag)
    for entity in entities:
        if len(gmsh.model.mesh.getElementTypes(dim, entity)) == 0:
            raise MeshError(f"{what} contains {_ENTITY[dim]} {entity}, which is not meshed")
    if len(entities) == 0:
        raise MeshError(f"{what} is empty")


def _check_facets(
    gmsh: ModuleType, dim: int, tag: int, name: str, source: str, nodes: npt.NDArray[np.int64]
) -> None:
    """Facets of a surface must be on cells and listed once."""
    what = f"surface {name!r}"
    _check_meshed(gmsh, dim - 1, tag, f"{source}: {what}")
    blocks = elements_of(gmsh, dim - 1, tag)
    total = sum(map(len, blocks.values()))
    for facets in blocks.values():
        # Nodes that are of no cell would make DOLFINx abort the program.
        adrift = ~np.isin(facets, nodes).all(axis=1)
        if adrift.any():
            raise MeshError(
                f"{source}: {np.count_nonzero(adrift)} of the {total} facets of surface {name!r} "
                f"are not on the boundary of any cell; {_why_adrift(gmsh, dim, facets, nodes)}"
            )
        repeated = _repeated(facets)
        if repeated:
            raise MeshError(f"{source}: {repeated} facets of surface {name!r} are listed twice")


def _why_adrift(
    gmsh: ModuleType, dim: int, facets: npt.NDArray[np.int64], nodes: npt.NDArray[np.int64]
) -> str:
    """What is wrong with facets of which some have nodes that are not among those of cells."""
    numbers, x, _ = gmsh.model.mesh.getNodes()
    place = np.empty((len(numbers), 3))
    place[np.asarray(numbers, dtype=np.int64) - 1] = np.reshape(x, (-1, 3))
    every = np.concatenate([nodes, np.setdiff1d(facets, nodes)])
    twice = len(doubled(place[every - 1]))
    if twice > len(doubled(place[nodes - 1])):
        return (
            f"duplicate nodes: {twice} of {len(every)} lie where others do, within "
            f"{SAME_PLACE:g} of the extent; join them (Coherence before the curve loops of a gmsh "
            "drawing, or Coherence Mesh)"
        )
    return f"is their {_ENTITY[dim]} in a physical group?"


def doubled(place: npt.NDArray[np.float64]) -> npt.NDArray[np.int64]:
    """Which of the places (n, 3) of nodes lie where another one of them does, but for the first."""
    extent = float(np.ptp(place, axis=0).max())
    # The shift keeps round numbers off the borders of the boxes.
    box = np.floor((place - place.min(axis=0)) / (SAME_PLACE * extent) + 0.37)
    order = np.lexsort(box.T)
    return order[1:][(np.diff(box[order], axis=0) == 0.0).all(axis=1)]


def _check_plane(gmsh: ModuleType, source: str) -> None:
    """A mesh of faces must lie in the plane z = 0; nodes of no cell do not count."""
    nodes = np.concatenate(gmsh.model.mesh.getElements(2)[2])
    tags, x, _ = gmsh.model.mesh.getNodes()
    x = np.asarray(x).reshape(-1, 3)[np.isin(tags, nodes)]
    size = float(np.ptp(x[:, :2], axis=0).max())
    if np.abs(x[:, 2]).max() <= PLANE_TOLERANCE * size:
        return
    low, high = float(x[:, 2].min()), float(x[:, 2].max())
    where = f"z = {low:g}" if high - low <= PLANE_TOLERANCE * size else f"z = {low:g} to {high:g}"
    raise MeshError(f"{source}: a mesh of faces must lie in the plane z = 0; it has {where}")


def _rows(gmsh: ModuleType, element_type: int, nodes: Any) -> npt.NDArray[np.int64]:
    """Node tags by element: shape (number of elements, nodes of one)."""
    per_element = gmsh.model.mesh.getElementProperties(element_type)[3]
    return np.asarray(nodes, dtype=np.int64).reshape(-1, per_element)


def _repeated(rows: npt.NDArray[np.int64]) -> int:
    """Number of elements with the same nodes as an earlier one, in any order."""
    return len(rows) - len(np.unique(np.sort(rows, axis=1), axis=0))


# -- Kinds of cells and facets: corners, sides and second-order nodes, in gmsh's order -------------
#
# Axis letters: a nodes, i space.

INTERVAL, TRIANGLE, QUADRILATERAL = "interval", "triangle", "quadrilateral"
TETRAHEDRON, HEXAHEDRON, PRISM = "tetrahedron", "hexahedron", "prism"

DIMENSION = {INTERVAL: 1, TRIANGLE: 2, QUADRILATERAL: 2, TETRAHEDRON: 3, HEXAHEDRON: 3, PRISM: 3}
CORNERS = {INTERVAL: 2, TRIANGLE: 3, QUADRILATERAL: 4, TETRAHEDRON: 4, HEXAHEDRON: 8, PRISM: 6}
"""Number of corners of a cell or facet."""

FACETS = {
    TRIANGLE: INTERVAL,
    QUADRILATERAL: INTERVAL,
    TETRAHEDRON: TRIANGLE,
    HEXAHEDRON: QUADRILATERAL,
}
"""Shape of a cell's facets."""

SIDES: dict[str, tuple[tuple[int, ...], ...]] = {
    TRIANGLE: ((0, 1), (1, 2), (2, 0)),
    QUADRILATERAL: ((0, 1), (1, 2), (2, 3), (3, 0)),
    TETRAHEDRON: ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)),
    HEXAHEDRON: (
        (0, 3, 2, 1),
        (4, 5, 6, 7),
        (0, 1, 5, 4),
        (1, 2, 6, 5),
        (2, 3, 7, 6),
        (3, 0, 4, 7),
    ),
    PRISM: ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
}
"""Corners of the facets of a cell, seen from outside counter-clockwise."""

# Corners of cells of extent 1; the middle is at 0, but for simplices.
_CYCLE = ((-0.5, -0.5, 0.0), (0.5, -0.5, 0.0), (0.5, 0.5, 0.0), (-0.5, 0.5, 0.0))
PLACES: dict[str, tuple[tuple[float, ...], ...]] = {
    TRIANGLE: _CYCLE[:3],
    QUADRILATERAL: _CYCLE,
    TETRAHEDRON: ((-0.5,) * 3, (0.5, -0.5, -0.5), (-0.5, 0.5, -0.5), (-0.5, -0.5, 0.5)),
    HEXAHEDRON: tuple((x, y, z) for z in (-0.5, 0.5) for x, y, _ in _CYCLE),
    PRISM: tuple((x, y, z) for z in (-0.5, 0.5) for x, y, _ in _CYCLE[:3]),
}
"""Corners of one undistorted cell of each shape."""


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of elements that can be read."""

    shape: str  # of it, for instance "triangle"
    order: int  # 1 or 2; of order 2 with all nodes that a product of quadratic functions has
    nodes: int  # number of its nodes; the corners come first


KINDS = {
    1: Kind(INTERVAL, 1, 2),
    2: Kind(TRIANGLE, 1, 3),
    3: Kind(QUADRILATERAL, 1, 4),
    4: Kind(TETRAHEDRON, 1, 4),
    5: Kind(HEXAHEDRON, 1, 8),
    6: Kind(PRISM, 1, 6),
    8: Kind(INTERVAL, 2, 3),
    9: Kind(TRIANGLE, 2, 6),
    10: Kind(QUADRILATERAL, 2, 9),
    11: Kind(TETRAHEDRON, 2, 10),
    12: Kind(HEXAHEDRON, 2, 27),
}
"""By gmsh's number."""
NUMBERS = {(kind.shape, kind.order): number for number, kind in KINDS.items()}
INCOMPLETE = frozenset((16, 17, 18, 19))  # of second order without nodes on faces and inside
PYRAMIDS = frozenset((7, 14, 19))


def nodes_of(shape: str, order: int) -> int:
    """Number of nodes of an element."""
    return KINDS[NUMBERS[shape, order]].nodes


# -- Starts the process that gmsh reads foreign files in, and tells what became of it --------------


REFUSED = 9  # exit code of the process where it knows what is wrong: the line is on standard output

MODULE = "tribox.geometry.meshes.foreign"

# Variables by which a process is taken for a rank of the MPI run that its parent is a rank of.
_OF_RANKS = ("OMPI_", "PMIX_", "PRTE_", "PMI_", "HYDRA_")


def ask(task: str, source: Path, last: str, seconds: float, memory: int) -> bytes:
    """The answer of `tribox.geometry.meshes.foreign` in a process of its own.

    ``task``: "read" or "draw" a ``source``, with a ``last`` argument; ``seconds``, ``memory``: that
    are enough, bytes. MeshError if gmsh cannot use the file, broke down or took too long.
    """
    command = [sys.executable, "-P", "-m", MODULE, task, os.fspath(source), last]
    limit = int(seconds) + 1
    try:
        # No memory, locks or threads are shared with it, as they would be after a fork alone.
        with subprocess.Popen(
            command,
            env=_environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        ) as process:
            try:
                _limit(process.pid, limit, memory)
                answer, _ = process.communicate(timeout=WAITING * limit)
            except BaseException:
                process.kill()
                raise
    except subprocess.TimeoutExpired:
        raise MeshError(f"{source}: gmsh has not come to an end in {WAITING * limit} s") from None
    except OSError as error:
        raise MeshError(f"{source}: no process to read it in ({error.strerror})") from None
    if process.returncode == REFUSED:
        raise MeshError(answer.decode(errors="surrogateescape"))
    if process.returncode != 0 or not answer:
        raise MeshError(f"{source}: {_end(process.returncode, limit)}")
    return answer


WAITING = 10
"""Seconds on the clock for one of processor time: other programs may want the cores too."""


def _limit(pid: int, seconds: int, memory: int) -> None:
    """Let a process use so much processor time (s) and memory (bytes), or what a shell allows."""
    wanted = {resource.RLIMIT_CPU: (seconds, seconds + 1), resource.RLIMIT_AS: (memory, memory)}
    with contextlib.suppress(ProcessLookupError):  # it may have ended already
        for kind, (soft, hard) in wanted.items():
            most = resource.prlimit(pid, kind)[1]
            if most != resource.RLIM_INFINITY:  # only the system's administrator may raise it
                soft, hard = min(soft, most), min(hard, most)
            resource.prlimit(pid, kind, (soft, hard))


def _environment() -> dict[str, str]:
    """The environment without MPI's variables, and with the place of this package."""
    root = str(Path(tribox.__file__).parents[1])
    kept = {key: value for key, value in os.environ.items() if not key.startswith(_OF_RANKS)}
    before = kept.get("PYTHONPATH")
    kept["PYTHONPATH"] = root if not before else f"{root}{os.pathsep}{before}"
    return kept


def _end(code: int, seconds: int) -> str:
    """How a process ended that gave no answer."""
    if code in (-signal.SIGXCPU, -signal.SIGKILL):
        return (
            f"gmsh was stopped; it may use {seconds} s of processor time, and the memory there is"
        )
    if code < 0:
        return f"gmsh broke down on it ({signal.Signals(-code).name}): the file is damaged"
    return "gmsh ended without a mesh: the file is damaged"
