"""What the tests of the application share: two small cases, and tribox as its users start it."""

import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from functools import wraps
from pathlib import Path
from typing import TextIO

import pytest

from tests.ranks import LIMIT
from tribox.app.cli import main
from tribox.app.results.recorder import force_balance
from tribox.app.simulation.run_state import Observer
from tribox.app.simulation.simulation import Simulation

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
max_steps = 60
[output]
figures = false
fields_every = 0
"""

# Boxes pressed by a platen and slid, in space.
BOXES = """
[geometry]
kind = "two-boxes"
upper = { width = "1 mm", height = "0.5 mm", depth = "1 mm", elements = [4, 2, 4] }
lower = { width = "1.5 mm", height = "0.5 mm", depth = "1.5 mm", elements = [6, 2, 6] }
[bodies.elastomer]
material = "neo-hookean"
E = "5 MPa"
nu = 0.49
[bodies.aluminium]
material = "neo-hookean"
E = "70 GPa"
nu = 0.33
[[contact]]
slave = "elastomer_contact"
master = "aluminium_contact"
friction = { law = "coulomb", mu = 0.2 }
[[boundary]]
surface = "bottom"
displacement = { x = 0, y = 0, z = 0 }
[[boundary]]
surface = "top"
displacement = { x = [["1 s", "0 mm"], ["2 s", "0.1 mm"]], z = 0 }
platen = { direction = "y", pressure = [["0 s", "0 MPa"], ["1 s", "0.4 MPa"]] }
[[stage]]
name = "press"
duration = "1 s"
steps = 2
[[stage]]
name = "slide"
duration = "1 s"
steps = 1
"""

# A layer pressed by the implicit solver and slid on its film by the explicit one. The metal is so
# soft that waves in it shorten the steps no more than those in the layer.
SLID = """
title = "small explicit sliding"
[geometry]
kind = "two-blocks"
thickness = "1 mm"
upper = { width = "0.6 mm", height = "0.05 mm", elements = [9, 2] }
lower = { width = "1 mm", height = "0.2 mm", elements = [13, 2] }
[bodies.elastomer]
material = "mooney-rivlin"
C10 = "0.738 MPa"
C01 = "0.184 MPa"
K = "0.1 GPa"
density = 1100
[bodies.aluminium]
material = "hencky"
E = "7 GPa"
nu = 0.33
density = 2700
[[contact]]
slave = "elastomer_contact"
master = "aluminium_contact"
penalty_factor = 1
film = { thickness = "30 nm" }
[contact.friction]
law = "friction-map"
preset = "friction-map"
mu_s = 0.12
mu_d = 0.10
A_d = "0.2 um"
B = "1e6 1/m"
K_T = "1e12 Pa/m"
alpha = 0.5
eta_b = "0.02 Pa*s"
V_star = "1 m/s"
V_star_at = "30 nm"
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
steps = 2
rate_dependent = false
solver = "implicit"
[[stage]]
name = "slide"
velocity = "0.2 m/s"
duration = "20 us"
steps = 10
[solver]
kind = "explicit"
tolerance = 1e-11
[output]
fields_every = 0
figures = false
"""


@pytest.fixture(scope="session")
def block() -> str:
    """A small block pressed and slid with Coulomb friction, as a case file; it takes no second."""
    return BLOCK


@pytest.fixture(scope="session")
def film() -> str:
    """A small layer under a platen, slid on a film at two velocities, as a case file."""
    return FILM


@pytest.fixture(autouse=True, scope="session")
def forces_balance() -> Iterator[None]:
    """Hold the forces on each body against each other in every run that a test makes.

    Of their largest, 1e-8 or three times what the case asks of the residual may be left; rounding
    may leave more than that of a stiff body under a light load.
    """
    run = Simulation.run

    @wraps(run)
    def run_and_look(simulation: Simulation, observer: Observer) -> None:
        run(simulation, observer)
        allowed = max(1e-8, 3.0 * simulation.model.case.solver.tolerance)
        problem, left = simulation.model.problem, force_balance(simulation)
        rounding = problem.roundoff / max(problem.reference_force, 1e-300)
        assert left is None or left < max(allowed, 10.0 * rounding), left

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Simulation, "run", run_and_look)
        yield


@pytest.fixture
def case_file(tmp_path: Path) -> Callable[..., Path]:
    """Writes a case file and returns where it is."""

    def write(text: str, name: str = "case-file.toml") -> Path:
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.fixture
def tribox(
    tmp_path: Path,
    environment: dict[str, str],
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Runs tribox with arguments in an empty directory of its own, waiting until it ends.

    A process of its own takes a second for imports alone. So the command is called in this one,
    unless it is to run on ranks or to replace or start processes: that is to be asked for.
    """
    home = tmp_path / "home"
    home.mkdir()

    def run(
        *words: object, ranks: int | None = None, process: bool = False, timeout: float = LIMIT
    ) -> subprocess.CompletedProcess[str]:
        arguments = [str(word) for word in words]
        if ranks is None and not process:
            assert "--np" not in arguments, "it would replace this process"
            monkeypatch.chdir(home)
            monkeypatch.setattr(sys, "argv", ["tribox", *arguments])
            return _call(capfd)
        start = [] if ranks is None else ["mpirun", "--oversubscribe", "-n", str(ranks)]
        return subprocess.run(
            [*start, sys.executable, "-m", "tribox", *arguments],
            cwd=home,
            env=environment,
            capture_output=True,
            text=True,
            timeout=timeout,
            stdin=subprocess.DEVNULL,
        )

    return run


def _call(capfd: pytest.CaptureFixture[str]) -> subprocess.CompletedProcess[str]:
    """Call the command line with ``sys.argv`` as if it were a process of its own."""
    capfd.readouterr()
    with warnings.catch_warnings(), pytest.raises(SystemExit) as ended:
        # Those that Python prints are printed: pytest would keep them.
        for category in (DeprecationWarning, PendingDeprecationWarning, ResourceWarning):
            warnings.simplefilter("ignore", category)
        warnings.showwarning = _warn
        main()
    done = capfd.readouterr()
    code = ended.value.code
    assert code is None or isinstance(code, int)
    return subprocess.CompletedProcess(sys.argv, code or 0, done.out, done.err)


def _warn(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    sys.stderr.write(warnings.formatwarning(message, category, filename, lineno, line))
