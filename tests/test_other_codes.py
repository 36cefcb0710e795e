"""The side by side with other codes: all get the same problem; their forces are read rightly."""

import itertools
import math

import numpy as np
import pytest

from benchmarks.other_codes.inputs import MICRO, case_text, deck, forces_in, iterations_in
from benchmarks.other_codes.problem import press_and_slide, shear_and_lame
from tribox.app.case.reading import load_case

SMALL = press_and_slide(4)
DAT = """
 total force (fx,fy,fz) for set TOP and time  0.1000000E+01

       -8.239937E-18 -1.514981E-01  7.806256E-18

 total force (fx,fy,fz) for set TOP and time  0.2000000E+01

        6.139534E-02 -8.254334E-01 -9.629633E-09
"""
STA = """SUMMARY OF JOB INFORMATION
  STEP      INC     ATT  ITRS     TOT TIME     STEP TIME      INC TIME
     1          1     1     4  0.100000E+01  0.100000E+01  0.100000E+01
     2         15     1     2  0.200000E+01  0.150000E+02  0.100000E+01
"""


def block(text: str, head: str) -> list[list[str]]:
    """Data lines after a keyword of CalculiX."""
    lines = text.splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith(head)) + 1
    rows = itertools.takewhile(lambda line: not line.startswith("*"), lines[start:])
    return [[word for word in row.split(",") if word] for row in rows]


def test_elements_of_the_deck_fill_both_boxes():
    """By an integral: each is right-handed, and their volumes add up to the boxes'."""
    text = deck(SMALL)
    at = {int(n): np.array([float(v) for v in x]) for n, *x in block(text, "*NODE, NSET=ALL")}
    for name, box in (("SOFT", SMALL.upper), ("STIFF", SMALL.lower)):
        volume = 0.0
        for _, *nodes in block(text, f"*ELEMENT, TYPE=C3D8, ELSET={name}"):
            a = np.array([at[int(n)] for n in nodes])
            one = np.linalg.det([a[1] - a[0], a[3] - a[0], a[4] - a[0]])
            assert one > 0.0
            volume += one
        assert volume == pytest.approx(math.prod(box.size))


def test_contact_sides_of_the_deck_touch():
    """S3 and S5 by CalculiX' numbers of the corners; all their nodes lie where the boxes meet."""
    corners = {"S3": (0, 1, 5, 4), "S5": (2, 3, 7, 6)}
    text = deck(SMALL)
    at = {int(n): [float(v) for v in x] for n, *x in block(text, "*NODE, NSET=ALL")}
    cells = {}
    for name in ("SOFT", "STIFF"):
        rows = block(text, f"*ELEMENT, TYPE=C3D8, ELSET={name}")
        cells |= {int(row[0]): [int(n) for n in row[1:]] for row in rows}
    for name, box in (("SLAVE", SMALL.upper), ("MASTER", SMALL.lower)):
        sides = block(text, f"*SURFACE, NAME={name}")
        assert len(sides) == box.counts[0] * box.counts[2]
        for cell, side in sides:
            heights = {at[cells[int(cell)][corner]][1] for corner in corners[side]}
            assert heights == {0.5}


def test_the_deck_has_the_same_constants_in_any_unit():
    plain, scaled = deck(SMALL), deck(SMALL, tolerance=1e-5)
    for head in ("*ELASTIC", "*SURFACE BEHAVIOR", "*HYPERELASTIC", "*FRICTION"):
        a, b = ([float(v) for row in block(text, head) for v in row] for text in (plain, scaled))
        # Poisson's ratio and the coefficient of friction are numbers; D1 is one over a modulus.
        powers = {"*ELASTIC": (1, 0), "*FRICTION": (0, 1), "*HYPERELASTIC": (1, -1)}
        assert b == pytest.approx([v * MICRO**p for v, p in zip(a, powers.get(head, (1,)))])
    shear, lame = shear_and_lame(SMALL.soft)
    ((c10, d1),) = block(plain, "*HYPERELASTIC")
    assert 2.0 * float(c10) == pytest.approx(shear)
    assert 2.0 / float(d1) == pytest.approx(lame + 2.0 / 3.0 * shear)


@pytest.fixture
def case_of(tmp_path):
    def load(text: str):
        path = tmp_path / "blocks.toml"
        path.write_text(text, encoding="utf-8")
        return load_case(path)

    return load


@pytest.mark.parametrize("calculix", [False, True])
def test_the_case_is_the_problem(case_of, calculix):
    case = case_of(case_text(SMALL, calculix=calculix))
    soft, stiff = (case.bodies[name] for name in ("elastomer", "aluminium"))
    upper, lower = case.geometry.upper, case.geometry.lower
    assert (upper.elements, lower.elements) == SMALL.counts
    assert case.geometry.offset == pytest.approx((0.5e-3, 0.5e-3))
    (contact,) = case.contact
    assert contact.penalty == pytest.approx(1e9 * SMALL.penalty)
    assert contact.friction.K_T == pytest.approx(1e9 * SMALL.stick)
    shear, lame = shear_and_lame(SMALL.soft)
    assert soft.shear_modulus == pytest.approx(1e6 * shear)
    assert soft.bulk_modulus == pytest.approx(1e6 * (lame + 2.0 / 3.0 * shear))
    assert stiff.formulation == soft.formulation == "q1"
    assert [stage.steps for stage in case.stage] == [SMALL.press_steps, SMALL.slide_steps]


def test_forces_and_iterations_of_calculix_are_read():
    assert forces_in(DAT) == [
        (1.0, -8.239937e-18, -0.1514981, 7.806256e-18),
        (2.0, 0.06139534, -0.8254334, -9.629633e-09),
    ]
    assert iterations_in(STA) == [4, 2]
