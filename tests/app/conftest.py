"""What the tests of the application share: two small cases, and tribox as its users start it."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

BLOCK = """
title = "small block"
[geometry]
kind = "two-blocks"
thickness = "1 mm"
upper = { width = "1.0 mm", height = "0.5 mm", elements = [10, 5] }
lower = { width = "2.0 mm", height = "0.5 mm", elements = [15, 4] }
[bodies.elastomer]
material = "neo-hookean"
E = "5 MPa"
nu = 0.45
[bodies.aluminium]
material = "neo-hookean"
E = "70 GPa"
nu = 0.33
[[contact]]
slave = "elastomer_contact"
master = "aluminium_contact"
[contact.friction]
law = "coulomb"
mu = 0.2
[[boundary]]
surface = "bottom"
displacement = { x = 0, y = 0 }
[[boundary]]
surface = "top"
[boundary.displacement]
x = [["1 s", "0 mm"], ["2 s", "0.15 mm"]]
y = [["0 s", "0 mm"], ["1 s", "-0.05 mm"]]
[[stage]]
name = "press"
duration = "1 s"
steps = 3
[[stage]]
name = "slide"
duration = "1 s"
steps = 6
[output]
figures = false
"""

FILM = """
title = "small sliding test"
[geometry]
kind = "two-blocks"
thickness = "1 mm"
upper = { width = "1 mm", height = "0.1 mm", elements = [14, 3] }
lower = { width = "2 mm", height = "0.3 mm", elements = [31, 3] }
[bodies.elastomer]
material = "mooney-rivlin"
C10 = "0.738 MPa"
C01 = "0.184 MPa"
K = "50 MPa"
[bodies.aluminium]
material = "hencky"
E = "70 GPa"
nu = 0.33
[[contact]]
slave = "elastomer_contact"
master = "aluminium_contact"
[contact.film]
thickness = "30 nm"
[contact.friction]
law = "friction-map"
preset = "friction-map"
mu_s = 0.12
mu_d = 0.10
A_d = "1 um"
B = "1e6 1/m"
K_T = "1e12 Pa/m"
alpha = 0.5
V_star = "1 mm/s"
V_star_at = "10 nm"
[[boundary]]
surface = "bottom"
displacement = { x = 0, y = 0 }
[[boundary]]
surface = "top"
displacement = { x = "driven" }
platen = { direction = "y", pressure = [["0 s", "0 MPa"], ["1 s", "0.5 MPa"]] }
[[stage]]
name = "press"
duration = "1 s"
steps = 3
rate_dependent = false
[[stage]]
name = "slide"
velocities = ["1e-5 m/s", "2e-3 m/s"]
slip_step = "4 um"
max_steps = 30
[output]
figures = false
fields_every = 0
"""


@pytest.fixture(scope="session")
def block() -> str:
    """A small block pressed and slid with Coulomb friction, as a case file; it takes no second."""
    return BLOCK


@pytest.fixture(scope="session")
def film() -> str:
    """A small layer under a platen, slid on a film at two velocities, as a case file."""
    return FILM


@pytest.fixture
def case_file(tmp_path: Path) -> Callable[..., Path]:
    """Writes a case file and returns where it is."""

    def write(text: str, name: str = "case-file.toml") -> Path:
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.fixture(scope="session")
def environment() -> dict[str, str]:
    """Environment for another process: without what MPI, once started here, has put into ours."""
    kept = {
        key: value
        for key, value in os.environ.items()
        if not key.startswith(("PMIX_", "OMPI_COMM_WORLD", "OMPI_UNIVERSE", "PMI_"))
    }
    return kept | {"PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg", "OMP_NUM_THREADS": "1"}


@pytest.fixture
def tribox(
    tmp_path: Path, environment: dict[str, str]
) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Runs tribox with arguments in an empty directory of its own, waiting until it ends."""
    home = tmp_path / "home"
    home.mkdir()

    def run(
        *words: object, ranks: int | None = None, timeout: float = 120.0
    ) -> subprocess.CompletedProcess[str]:
        start = [] if ranks is None else ["mpirun", "--oversubscribe", "-n", str(ranks)]
        return subprocess.run(
            [*start, sys.executable, "-m", "app", *map(str, words)],
            cwd=home,
            env=environment,
            capture_output=True,
            text=True,
            timeout=timeout,
            stdin=subprocess.DEVNULL,
        )

    return run


@pytest.fixture(scope="session")
def sfa(tmp_path_factory: pytest.TempPathFactory, environment: dict[str, str]) -> Path:
    """Results of cases/sfa.toml, swept over four thicknesses by the command line."""
    directory = tmp_path_factory.mktemp("sfa") / "sfa"
    case = ROOT / "cases" / "sfa.toml"
    done = subprocess.run(
        [sys.executable, "-m", "app", "run", str(case), "--out", str(directory)],
        cwd=directory.parent,
        env=environment,
        capture_output=True,
        text=True,
        timeout=500.0,
    )
    assert done.returncode == 0, done.stderr
    return directory
