"""A journal bearing as a run with a film that is found, against the integral of a long one."""

import numpy as np
import pytest
from scipy.optimize import brentq

from tribox import load_case, run_case
from tribox.app.results.directory import read_table

BUSH = """
R = 0.02002; S = 0.024; Point(1) = {0, 0, 0};
For i In {0:3}
  Point(10 + i) = {R * Cos(i * Pi / 2), R * Sin(i * Pi / 2), 0};
  Point(20 + i) = {S * Cos(i * Pi / 2), S * Sin(i * Pi / 2), 0};
  Line(50 + i) = {10 + i, 20 + i};
EndFor
For i In {0:3}
  j = (i + 1) % 4; Circle(30 + i) = {10 + i, 1, 10 + j}; Circle(40 + i) = {20 + i, 1, 20 + j};
EndFor
For i In {0:3}
  j = (i + 1) % 4; Curve Loop(60 + i) = {50 + i, 40 + i, -(50 + j), -(30 + i)};
  Plane Surface(70 + i) = {60 + i}; Transfinite Curve{30 + i, 40 + i} = 46;
  Transfinite Curve{50 + i} = 2; Transfinite Surface{70 + i}; Recombine Surface{70 + i};
EndFor
Physical Surface("bush") = {70, 71, 72, 73};
Physical Curve("bore") = {30, 31, 32, 33}; Physical Curve("back") = {40, 41, 42, 43};
"""
JOURNAL = """
geometry.mesh = "bush.geo"
bodies.bush = { material = "hencky", E = "200 TPa", nu = 0.3 }
tools.journal = { shape = "circle", centre = [0, "-16 um"], radius = "20 mm", rotation.rate = 50 }
boundary = [{ surface = "back", displacement = { x = 0, y = 0 } }]
stage = [{ name = "turn", duration = "1 ms", steps = 1 }]
output = { figures = false, fields_every = 0 }
[[contact]]
slave = "bore"
master = "journal"
friction = { law = "frictionless" }
film.model = "reynolds"
film.sigma = 0
film.oil = "flooded"
film.share = "contact"
film.eta_b = "0.02 Pa*s"
film.h_max = "1 mm"
film.steady = true
"""


def long_bearing(share, clearance=2e-5, radius=0.02, eta=0.02, speed=1.0):
    """Load (2,), N/m, along the eccentricity and across, and drag, N/m, of a long bearing.

    By the integral of Reynolds' equation from the widest gap to where p and its slope are zero;
    beyond, streamers of what passes.
    """

    def of(end, count=20001):
        angle = np.linspace(0.0, end, count)
        film, last = clearance * (1.0 + share * np.cos(np.array([angle, angle * 0.0 + end])))
        slope = 6.0 * eta * speed * radius * (film - last) / film**3
        steps = 0.5 * (slope[1:] + slope[:-1]) * np.diff(angle)
        return angle, film, slope, np.concatenate([[0.0], np.cumsum(steps)])

    end = brentq(lambda end: of(end)[3][-1], 3.2, 4.7)
    angle, film, slope, p = of(end)
    load = [np.trapezoid(p * part, angle) * radius for part in (-np.cos(angle), np.sin(angle))]
    drag = np.trapezoid(eta * speed / film + 0.5 * film * slope / radius, angle)
    rest = np.linspace(end, 2.0 * np.pi, 2001)
    thin = clearance * (1.0 + share * np.cos(rest))
    return load, radius * (drag + np.trapezoid(eta * speed * film[-1] / thin**2, rest))


def test_a_journal_bearing_carries_and_drags_as_a_long_one(tmp_path):
    """Its film has no end: it is fed where it is widest."""
    (tmp_path / "bush.geo").write_text(BUSH)
    (tmp_path / "case.toml").write_text(JOURNAL)
    run_case(load_case(tmp_path / "case.toml"), tmp_path / "out", quiet=True)
    (down, across), drag = long_bearing(0.8)
    tool = read_table(tmp_path / "out" / "tools.csv")[-1]
    x, y, moment = (float(tool[name]) for name in ("force_x", "force_y", "moment_z"))
    assert [y, x] == pytest.approx([down, across], rel=3e-3)
    assert -moment / 0.02 == pytest.approx(drag, rel=3e-3)
    assert "warning" not in (tmp_path / "out" / "log.txt").read_text()
