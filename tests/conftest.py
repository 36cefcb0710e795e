"""What all tests share: a small pair of blocks, and the problems that are made from it."""

import gc
import os
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import dolfinx
import hypothesis
import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc

import tests.loaded_once  # noqa: F401
import tribox.app
from tribox.app.equilibrium.constraints import Prescribed, component_dofs
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.forms.bodies.materials import Material, NeoHookean
from tribox.forms.bodies.solid import Solid
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.friction.law import FrictionLaw
from tribox.geometry.generators.two_blocks import Block, TwoBlocks
from tribox.geometry.meshes.mesh import NamedMesh, generate
from tribox.geometry.surfaces.facets import FacetShape, facet_shape
from tribox.geometry.surfaces.surface import ContactSurface

TESTS = Path(__file__).parent
pytest_plugins = ["tests.blank_figures", "tests.ranks"]
if "TRIBOX_CONTAINED" in os.environ and "TRIBOX_TESTS" not in os.environ:
    os.environ["CC"] = str(TESTS / "quick-cc")  # what is compiled goes with the container
os.environ["TRIBOX_TESTS"] = "1"  # processes of the tests read this file again
os.environ["TRIBOX_CONTAINED"] = "1"  # as in the image: drawings of these tests are our own
# Two processes may want a form at once: s that one waits for the other's compiler.
dolfinx.jit.DOLFINX_DEFAULT_JIT_OPTIONS["timeout"] = (300, "Timeout for JIT compilation")
# The same examples every time: a change is not to fail by what another run would not have tried.
hypothesis.settings.register_profile("the same", derandomize=True, deadline=None)
hypothesis.settings.load_profile("the same")
Motion = Callable[[np.ndarray], np.ndarray]
SOFT = NeoHookean(shear_modulus=1.0, bulk_modulus=5.0)
STIFF = NeoHookean(shear_modulus=3.0, bulk_modulus=8.0)


@dataclass
class Pair:
    """Two blocks, of the order of one in size, modulus and pressure: the upper is the slave."""

    named: NamedMesh
    u: dolfinx.fem.Function = field(init=False)

    def __post_init__(self) -> None:
        space = dolfinx.fem.functionspace(self.named.mesh, ("Lagrange", 1, (2,)))
        self.u = dolfinx.fem.Function(space)

    def surface(self, degree: int = 5) -> ContactSurface:
        names = ("elastomer_contact", "aluminium_contact")
        return ContactSurface(self.u.function_space, *map(self.named.facets, names), degree)

    def solids(
        self, upper: Material = SOFT, lower: Material = STIFF, formulation: str = "q1-sri"
    ) -> list[Solid]:
        named = self.named
        return [
            Solid("elastomer", self.u, named.cells("elastomer"), upper, formulation),
            Solid("aluminium", self.u, named.cells("aluminium"), lower, formulation),
        ]

    def held(self, surface: str, component: int) -> Prescribed:
        facets = self.named.facets(surface)
        return Prescribed(component_dofs(self.u.function_space, facets, component))

    def problem(
        self, law: FrictionLaw | None, penalty: float = 50.0, film: float = 0.0, **parts
    ) -> Equilibrium:
        """Both bodies, free but for ``parts``, with one contact (none without a law)."""
        degree, pressure = parts.pop("degree", 5), parts.pop("pressure", "averaged")
        contacts = []
        if law is not None:
            contacts.append(ContactTerm(self.surface(degree), law, penalty, film, pressure))
        return Equilibrium(self.u, self.solids(), contacts, **parts)

    def nodes(self, body: str) -> np.ndarray:
        """Nodes of the displacement on one body."""
        return np.unique(self.u.function_space.dofmap.list[self.named.cells(body)])

    def displaced(self, upper: Motion, lower: Motion) -> PETSc.Vec:
        """Unknowns that move each body by a function of the reference positions (n, 2)."""
        space = self.u.function_space
        where = space.tabulate_dof_coordinates()[:, :2]
        values = np.zeros_like(where)
        for body, motion in (("elastomer", upper), ("aluminium", lower)):
            at = self.nodes(body)
            values[at] = motion(where[at])
        owned = space.dofmap.index_map.size_local
        x = PETSc.Vec().createMPI((2 * owned, None), bsize=2, comm=self.named.mesh.comm)
        x.array[:] = values[:owned].reshape(-1)
        return x


@lru_cache
def make_pair(
    cell: str = "quadrilateral",
    upper: tuple[int, int] = (6, 2),
    lower: tuple[int, int] = (7, 2),
    gap: float = 0.0,
) -> Pair:
    blocks = TwoBlocks(
        Block(1.0, 0.5, upper), Block(2.0, 0.5, lower), offset=0.47, gap=gap, cell=cell
    )
    return Pair(generate(blocks, MPI.COMM_SELF))


@pytest.fixture(scope="session")
def pair() -> Callable[..., Pair]:
    """Makes pairs of blocks; each kind is meshed once. Every test sets its own displacements."""
    return make_pair


def pytest_configure(config: pytest.Config) -> None:
    """Say nothing of what hypothesis looks for among the objects that are frozen below."""
    config.addinivalue_line("filterwarnings", "ignore:It looks like .register_random. was passed")


def pytest_collection_finish() -> None:
    """Leave the million objects of the imports out of the collections between tests."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True, scope="session")
def _bytecode(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Let processes share what they compile of sources beside which nothing may be written.

    Without bytecode each would compile all that it imports, which takes a third of a short run.
    """
    with pytest.MonkeyPatch.context() as patch:
        if not Path(tribox.app.__spec__.cached or "").exists():
            base = tmp_path_factory.getbasetemp()
            shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
            patch.setenv("PYTHONPYCACHEPREFIX", str(shared / "bytecode"))
            patch.delenv("PYTHONDONTWRITEBYTECODE", raising=False)
        yield


@pytest.fixture(autouse=True)
def _keeps_interrupt() -> Iterator[None]:
    """See that Ctrl-C is left as it was."""
    before = signal.getsignal(signal.SIGINT)
    yield
    assert signal.getsignal(signal.SIGINT) == before, "the test keeps Ctrl-C for itself"


class _Collector:
    """Frees PETSc's objects between tests, before others are made, at a bounded cost.

    A collection takes most of a tenth of a second, far more than most tests: it waits until tests
    have run for a hundred times as long as the last one took.
    """

    def __init__(self) -> None:
        self.ended, self.took = time.process_time(), 0.0

    def collect(self) -> None:
        begun = time.process_time()
        if begun - self.ended > 100.0 * self.took:
            gc.collect()
            self.ended = time.process_time()
            self.took = self.ended - begun


_COLLECTOR = _Collector()


@pytest.fixture(autouse=True)
def _collect() -> Iterator[None]:
    """Free PETSc's objects before the next tests make more."""
    yield
    _COLLECTOR.collect()


def make_sheet(
    cell: str, degree: int, count: tuple[int, ...], height: Callable[..., np.ndarray]
) -> tuple[FacetShape, np.ndarray, np.ndarray]:
    """Shape, facets (f, a) and nodes (n, i) of a surface over the unit interval or square."""
    shape = facet_shape(cell, degree)
    lines = [np.linspace(0.0, 1.0, degree * n + 1) for n in count]
    grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, len(count))
    nodes = np.column_stack([grid, height(*grid.T)])
    starts = np.stack(np.meshgrid(*map(np.arange, count), indexing="ij"), axis=-1)
    starts = degree * starts.reshape(-1, 1, len(count))
    local = np.rint(degree * shape.points).astype(int)
    places = [starts + local]
    if cell == "triangle":
        places.append(starts + degree - local)
    size = [degree * n + 1 for n in count]
    facets = np.ravel_multi_index(tuple(np.moveaxis(np.concatenate(places), -1, 0)), size)
    if cell == "interval":
        # The body lies to the right of a segment from left to right: upwards is its left.
        assert (np.diff(nodes[facets[:, :2], 0], axis=1) > 0.0).all()
    return shape, facets.astype(np.int32), nodes


@pytest.fixture(scope="session")
def sheet() -> Callable[..., tuple[FacetShape, np.ndarray, np.ndarray]]:
    """Makes surfaces of facets without a mesh."""
    return make_sheet
