"""Cases with films that are found, and what is read off their runs, for tests."""

import tomllib
from pathlib import Path

import numpy as np

from tribox import load_case, run_case
from tribox.app.results.reading import read_table

FILMS = Path(__file__).parents[3] / "cases" / "film"

CASE = """
geometry.kind = "blocks"
geometry.thickness = "1 m"
geometry.blocks = { rubber = { x = ["-6 mm", "6 mm"], y = ["-4 mm", "0 mm"], elements = [60, 4] } }
bodies = { rubber = { material = "neo-hookean", E = "3 MPa", nu = 0.45 } }
tools.roll.shape = "circle"
tools.roll.centre = ["0 mm", "10 mm"]
tools.roll.radius = "10 mm"
tools.roll.displacement = { x = 0 }
tools.roll.force = { y = [["0 s", "0 N"], ["1 s", "-400 N"]] }
tools.roll.rotation = { rate = [["0 s", 0], ["1 s", 0], ["1.1 s", "0.1 rad/s"]] }
boundary = [{ surface = "rubber_bottom", displacement = { x = 0, y = 0 } }]
stage = [
    { name = "press", duration = "1 s", steps = 3, rate_dependent = false },
    { name = "slide", duration = "2 s", steps = 4 },
]
output = { figures = false, checkpoint_every = 1, checkpoints_kept = 100 }
[[contact]]
slave = "rubber_top"
master = "roll"
friction = { law = "frictionless" }
film.model = "reynolds"
film.sigma = "1 um"
film.oil = "flooded"
film.share = "contact"
film.eta_b = "0.8 Pa*s"
film.h_max = "0.2 mm"
"""
OIL = {"oil": "2 g/m^2", "density": "900 kg/m^3"}


def data_of(**film):
    data = tomllib.loads(CASE)
    data["contact"][0]["film"] |= film
    return data


def column(directory, name):
    return np.array([float(row[name]) for row in read_table(directory / "contacts.csv")])


def shipped(name, directory, *overrides):
    quick = ("output.figures=false", "output.fields_every=0")
    run_case(load_case(FILMS / f"{name}.toml", [*overrides, *quick]), directory, quiet=True)
    return directory


def words_of(directory):
    """All that was said, in one line."""
    return " ".join((directory / "log.txt").read_text().split())


def warnings_of(directory):
    return [line for line in (directory / "log.txt").read_text().splitlines() if "warning" in line]
