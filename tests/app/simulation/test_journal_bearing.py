"""A journal bearing as a run with a film that is found, against the integral of a long one."""

import gmsh
import numpy as np
import pytest
from scipy.optimize import brentq

from tribox import load_case, run_case
from tribox.app.results.reading import read_table

RING = """
For i In {0:3}
  Point(N + 10 + i) = {R * Cos(i * Pi / 2), R * Sin(i * Pi / 2), 0};
  Point(N + 20 + i) = {S * Cos(i * Pi / 2), S * Sin(i * Pi / 2), 0};
  Line(N + 50 + i) = {N + 10 + i, N + 20 + i};
EndFor
For i In {0:3}
  j = (i + 1) % 4;
  Circle(N + 30 + i) = {N + 10 + i, 1, N + 10 + j};
  Circle(N + 40 + i) = {N + 20 + i, 1, N + 20 + j};
EndFor
For i In {0:3}
  j = (i + 1) % 4; Curve Loop(N + 60 + i) = {N + 50 + i, N + 40 + i, -(N + 50 + j), -(N + 30 + i)};
  Plane Surface(N + 70 + i) = {N + 60 + i}; Transfinite Curve{N + 30 + i, N + 40 + i} = 46;
  Transfinite Curve{N + 50 + i} = 2; Transfinite Surface{N + 70 + i};
  Recombine Surface{N + 70 + i};
EndFor
"""
BUSH = "Point(1) = {0, 0, 0}; N = 0; R = 0.02002; S = 0.024;" + RING
ONE = """
Physical Surface("bush") = {70:73};
Physical Curve("bore") = {30:33}; Physical Curve("back") = {40:43};
"""
TWO = f"""
N = 100; R = 0.04004; S = 0.044; {RING} Physical Surface("bush") = {{70:73, 170:173}};
Physical Curve("bore") = {{30:33, 130:133}}; Physical Curve("back") = {{40:43, 140:143}};
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
    (tmp_path / "bush.geo").write_text(BUSH + ONE)
    (tmp_path / "case.toml").write_text(JOURNAL)
    run_case(load_case(tmp_path / "case.toml"), tmp_path / "out", quiet=True)
    (down, across), drag = long_bearing(0.8)
    tool = read_table(tmp_path / "out" / "tools.csv")[-1]
    x, y, moment = (float(tool[name]) for name in ("force_x", "force_y", "moment_z"))
    assert [y, x] == pytest.approx([down, across], rel=3e-3)
    assert -moment / 0.02 == pytest.approx(drag, rel=3e-3)
    assert "warning" not in (tmp_path / "out" / "log.txt").read_text()


def two_journals(file):
    """Circles of 20 and 40 mm round one axis, 16 um below that of the bores, of curved lines."""
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        circles = [gmsh.model.occ.addCircle(0.0, -16e-6, 0.0, r) for r in (0.02, 0.04)]
        gmsh.model.occ.synchronize()
        for circle in circles:
            gmsh.model.mesh.setTransfiniteCurve(circle, 121)
        gmsh.model.addPhysicalGroup(1, circles, name="journals")
        gmsh.model.mesh.generate(1)
        gmsh.model.mesh.setOrder(2)
        gmsh.write(str(file))
    finally:
        gmsh.finalize()


def test_closed_films_of_one_pair_are_fed_one_by_one_and_have_their_own_speeds(tmp_path):
    """A stepped shaft in the bores of one body: another radius, clearance and speed in each."""
    (tmp_path / "bush.geo").write_text(BUSH + TWO)
    two_journals(tmp_path / "journals.msh")
    tool = 'tools.journal = { shape = "mesh", file = "journals.msh", surface = "journals", '
    tool += 'turned_over = true, rotation = { rate = 50, centre = ["0 mm", "-16 um"] } }'
    lines = [line for line in JOURNAL.splitlines() if not line.startswith("tools")]
    (tmp_path / "case.toml").write_text("\n".join([tool, *lines]))
    run_case(load_case(tmp_path / "case.toml"), tmp_path / "out", quiet=True)
    loads, drags = zip(long_bearing(0.8), long_bearing(0.4, 4e-5, 0.04, speed=2.0), strict=True)
    tool = read_table(tmp_path / "out" / "tools.csv")[-1]
    x, y, moment = (float(tool[name]) for name in ("force_x", "force_y", "moment_z"))
    assert [y, x] == pytest.approx(np.sum(loads, axis=0), rel=3e-3)
    assert -moment == pytest.approx(0.02 * drags[0] + 0.04 * drags[1], rel=3e-3)
