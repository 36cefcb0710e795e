"""Sizes that are surely mistakes are refused before a mesh is made of them."""

from __future__ import annotations

import re
import time

import pytest

from tests.app.conftest import BLOCK, BOXES
from tribox.app.case.reading import check_case

ROUND = re.sub(r"\[geometry\].*?\n\[bodies", "{}\n[bodies", BLOCK, count=1, flags=re.DOTALL)
CYLINDER = """[geometry]
kind = "cylinder-on-block"
contact_width = "4 mm"
contact_size = "SIZE"
cylinder = { radius = "RADIUS" }
block = { width = "20 mm", height = "5 mm" }
"""
SPHERE = """[geometry]
kind = "sphere-on-block"
contact_width = "4 mm"
contact_size = "SIZE"
sphere = { radius = "RADIUS" }
block = { radius = "20 mm", height = "5 mm" }
"""


def made(geometry: str, size: str, radius: str) -> str:
    return ROUND.replace("{}", geometry.replace("SIZE", size).replace("RADIUS", radius), 1)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            re.sub(r"elements = \[\d+, \d+\]", "elements = [3000, 3000]", BLOCK),
            "geometry.max_cells = 5000000: the mesh would have 1.8e+07 cells; make it coarser by "
            "elements or size of upper and lower, or raise this",
        ),
        (
            re.sub(r"elements = \[\d+, \d+, \d+\]", "elements = [200, 200, 200]", BOXES),
            "geometry.max_cells = 5000000: the mesh would have 1.6e+07 cells",
        ),
        (
            made(CYLINDER, "0.1 um", "10 mm"),
            "cells; make it coarser by contact_size or growth, or raise this",
        ),
        (made(CYLINDER, "1e-30 m", "10 mm"), "contact_size = 1e-30 m is not allowed"),
        (made(CYLINDER, "1 mm", "1e30 m"), "radius = 1e+30 m is not allowed"),
        (made(SPHERE, "1e-30 m", "10 mm"), "contact_size = 1e-30 m is not allowed"),
        (made(SPHERE, "1 mm", "1e30 m"), "radius = 1e+30 m is not allowed"),
    ],
    ids=["blocks", "boxes", "zone", "zone-size", "cylinder", "sphere-size", "sphere"],
)
def test_absurd_sizes_are_refused_at_once(case_file, text, said):
    begin = time.process_time()
    lines = check_case(case_file(text))
    assert time.process_time() - begin < 1.0
    assert any(said in line for line in lines), lines


def test_the_limit_is_the_users(case_file):
    limited = BLOCK.replace('kind = "two-blocks"', 'kind = "two-blocks"\nmax_cells = {}')
    [line] = check_case(case_file(limited.replace("{}", "2")))
    cells = int(re.search(r"would have (\d+) cells", line)[1])
    assert check_case(case_file(limited.replace("{}", str(cells)))) == []
    assert check_case(case_file(limited.replace("{}", str(cells - 1)))) != []
