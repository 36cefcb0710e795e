"""tribox verify: every case within its bars, checks that can fail, table, report, exit codes."""

import math
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import benchmarks.verify.report as verification
from benchmarks.verify.contact import block_slide, cattaneo_mindlin, fit_ellipse, hertz_line
from benchmarks.verify.report import (
    CASES,
    block_compression,
    plane_strain_pressure,
    plane_strain_stress,
    run_verify,
)
from benchmarks.verify.result import Check, Line, Panel, Verification, compare
from tribox.app.errors import InputError, SolutionError

COARSE = (
    "geometry.contact_size=22 um",
    "geometry.contact_width=0.7 mm",
    "geometry.growth=1.5",
    "stage.0.steps=2",
)
COARSE_BLOCK = (*COARSE, "geometry.block.contact_size=30 um")

PAGE = Path(__file__).parents[3] / "docs" / "verification.md"


@cache
def result(name: str) -> Verification:
    return CASES[name]()


def failed(found: Verification) -> set[str]:
    return {check.quantity for check in found.checks if not check.passed}


# --- the cases themselves ------------------------------------------------------------------------


# Cases in space of tens of seconds; test_space.py runs them coarse.
APART = {"hertz-point", "sphere-twist", "curved-sliding"}
# Those of which cheaper ones see as much: coarse in test_space.py and test_flowing.py; of the same
# parts as cattaneo-mindlin, and reversed in simulation/test_reversal.py.
APART |= {"patch-space", "isotropy", "cook-membrane", "springback", "mindlin-reversal"}


def documented_checks() -> dict[str, int]:
    """How many checks of each case the page of verification tells of."""
    rows = re.findall(r"^\| `([\w-]+)` \| (\d+) \|", PAGE.read_text("utf-8"), re.MULTILINE)
    return {name: int(count) for name, count in rows}


@pytest.mark.parametrize("name", [name for name in CASES if name not in APART])
def test_every_check_is_within_its_bar(name):
    found = result(name)
    assert found.name == name and found.title and found.setup and not found.failure
    assert found.checks and failed(found) == set()
    assert found.passed
    assert len(found.checks) == documented_checks()[name]
    for check in found.checks:
        assert 0.0 <= check.error and 0.0 < check.bar <= (0.2 if name == "penalty" else 0.05)


PRESSURE = {"half-width a", "largest pressure", "pressure profile, rms / p0"}
TRACTION = {"stick half-width c", "traction profile, rms / (µ p0)"}


@pytest.mark.parametrize(
    ("name", "wanted"),
    [
        ("hertz-line", PRESSURE),
        ("hertz-two-cylinders", PRESSURE),
        ("cattaneo-mindlin", PRESSURE | TRACTION),
    ],
)
def test_bars_of_the_contact_cases_are_two_per_cent(name, wanted):
    assert wanted <= {check.quantity for check in result(name).checks}
    assert {check.bar for check in result(name).checks} == {0.02}


def test_compression_is_held_to_half_a_per_cent():
    bars = {check.quantity: check.bar for check in result("block-compression").checks}
    stress = [bar for quantity, bar in bars.items() if quantity.startswith("nominal stress")]
    assert len(stress) == 6 and set(stress) == {5e-3}


# --- checks that can fail ------------------------------------------------------------------------


def test_a_soft_penalty_fails_hertz():
    assert hertz_line(COARSE_BLOCK).checks[0].error < 0.02
    soft = failed(hertz_line([*COARSE_BLOCK, "contact.0.penalty_factor=0.1"]))
    assert {"half-width a", "pressure profile, rms / p0"} <= soft


def test_a_soft_stick_fails_the_stick_half_width():
    soft = cattaneo_mindlin([*COARSE, "stage.1.steps=4", "contact.0.friction.K_T=1e9"])
    assert "traction profile, rms / (µ p0)" in failed(soft)


def test_compression_of_a_block_follows_from_its_energy():
    G, step = 1.2e6, 1e-6
    for stretch in (0.6, 0.9, 1.3):
        energy = [0.5 * G * (s**2 + s**-2 - 2.0) for s in (stretch - step, stretch + step)]
        slope = (energy[1] - energy[0]) / (2.0 * step)
        assert plane_strain_stress(stretch, G) == pytest.approx(slope, rel=1e-8)
    assert plane_strain_stress(1.0, G) == plane_strain_pressure(1.0, G) == 0.0
    # Uniform stress: the pressure is a third of the trace, sigma_y = lambda * nominal.
    across = G * (1.0 - 0.7**-2)
    trace = 0.7 * plane_strain_stress(0.7, G) + across
    assert plane_strain_pressure(0.7, G) == pytest.approx(-trace / 3.0, rel=1e-12)


def test_a_compressible_block_fails_the_closed_form():
    coarse = ["geometry.upper.elements=[4, 4]", "bodies.elastomer.nu=0.45"]
    assert "nominal stress at λ = 0.70" in failed(block_compression(coarse))


def test_pressures_of_neighbours_show_a_disturbance():
    """A glued upper face makes the pressure uneven: the check must see it."""
    glued = ["boundary.2.displacement.x=0", "geometry.upper.elements=[8, 8]"]
    found = failed(block_compression(glued))
    assert "neighbouring elements' pressures, max difference / mean" in found


def test_a_low_penalty_fails_the_forces_of_the_other_codes():
    fast = ["contact.0.penalty_factor=3", 'stage=[{name="press", duration=1}]']
    assert "normal force, pressed" in failed(block_slide(fast))


def test_contact_that_leaves_the_fine_zone_is_no_result(monkeypatch):
    narrow = [*COARSE_BLOCK, "geometry.contact_width=0.48 mm"]
    monkeypatch.setitem(verification.CASES, "hertz-line", lambda: hertz_line(narrow))
    found = verification.verify("hertz-line")
    assert not found.passed and "contact_width" in found.failure


# --- parts ---------------------------------------------------------------------------------------


def test_an_ellipse_is_fitted_exactly_and_through_noise():
    x = np.linspace(-0.88, 0.88, 45)
    y = 3.0 * np.sqrt(np.maximum(1.0 - (x / 0.9) ** 2, 0.0))
    assert fit_ellipse(x, y) == pytest.approx((0.9, 3.0), rel=1e-9)
    noise = 0.02 * (-1.0) ** np.arange(len(x))
    assert fit_ellipse(x, y * (1.0 + noise)) == pytest.approx((0.9, 3.0), rel=5e-3)
    wrong = np.where(np.abs(x) < 0.1, 0.5 * y, y)  # beside the middle, where there is no area
    assert fit_ellipse(x, wrong, np.abs(x) >= 0.1) == pytest.approx((0.9, 3.0), rel=1e-9)
    assert fit_ellipse(x, wrong)[1] < 2.9


def test_a_number_that_is_none_never_passes():
    assert not Check("x", math.nan, 1.0).passed
    assert not compare("x", 1.0, 0.0, 1.0).passed
    assert not compare("x", math.nan, 1.0, 1.0).passed
    assert compare("x", 1.01, 1.0, 0.0101).passed and not compare("x", 1.01, 1.0, 0.0099).passed
    assert compare("x", 0.99, 1.0, 0.0101).passed and not compare("x", 0.99, 1.0, 0.0099).passed


# --- the command ---------------------------------------------------------------------------------

GOOD = Verification("good", "a good one", "Set up.", (compare("force", 1.001, 1.0, 0.01, "N"),))
BAD = Verification(
    "bad",
    "a bad one",
    "Set up.",
    (compare("width", 1.5e-3, 1e-3, 0.01, "mm"), Check("profile", 0.001, 0.01)),
    (Panel("x", "y", (Line("a", np.arange(3.0), np.arange(3.0), exact=True),)),),
)


def broken() -> Verification:
    raise SolutionError("no way")


@pytest.fixture
def cases(monkeypatch):
    monkeypatch.setattr(
        verification, "CASES", {"good": lambda: GOOD, "bad": lambda: BAD, "broken": broken}
    )


def test_passing_cases_end_well(cases, capsys):
    run_verify(["good"], None, False)
    head, row, last = capsys.readouterr().out.splitlines()
    assert head.split() == ["case", "quantity", "computed", "closed", "form", "error", "bar"]
    assert row.split() == ["good", "force", "(N)", "1.001", "1", "0.1", "%", "1", "%", "pass"]
    assert last == "all 1 checks of 1 cases passed"


def test_a_failed_check_ends_with_exit_code_3_after_all_have_run(cases, capsys, tmp_path):
    with pytest.raises(SolutionError) as error:
        run_verify([], tmp_path / "report", False)
    assert error.value.exit_code == 3
    assert str(error.value) == "1 of 3 checks failed; not computed: broken"
    out = capsys.readouterr().out
    assert "FAIL" in next(line for line in out.splitlines() if line.startswith("bad "))
    assert "broken: FAIL: not computed: no way" in out
    report = (tmp_path / "report" / "verification.md").read_text(encoding="utf-8")
    assert "| width (mm) | 1.5 | 1 | 50 % | 1 % | **FAIL** |" in report
    assert "| profile |  |  | 0.1 % | 1 % | pass |" in report
    assert "**Not computed:** no way" in report
    assert "![a bad one](figures/verify_bad.png)" in report
    assert (tmp_path / "report" / "figures" / "verify_bad.png").stat().st_size > 1000
    assert not (tmp_path / "report" / "figures" / "verify_good.png").exists()


def test_a_report_is_not_overwritten_unasked(cases, tmp_path):
    run_verify(["good"], tmp_path, False)
    with pytest.raises(InputError, match="--force"):
        run_verify(["good"], tmp_path, False)
    run_verify(["good"], tmp_path, True)


def test_an_unknown_case_is_refused_before_any_runs(cases, capsys):
    with pytest.raises(InputError, match='no case "god"; did you mean "good"'):
        run_verify(["bad", "god"], None, False)
    with pytest.raises(InputError, match="there are good, bad, broken"):
        run_verify(["xyz"], None, False)
    assert capsys.readouterr().out == ""


def test_the_command(tribox):
    done = tribox("verify", "friction-law", "--out", "report", process=True)
    assert done.returncode == 0, done.stderr
    assert "checks of 1 cases passed" in done.stdout and "report in report" in done.stdout
