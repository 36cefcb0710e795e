"""A pressed block that slides off a shorter one over its end, until nothing touches."""

import tomllib

import numpy as np
import pytest
from mpi4py import MPI

from tribox.app.build.model import build_model
from tribox.app.case.case import Case
from tribox.app.case.reading import load_case
from tribox.app.case.toml_files import toml_text
from tribox.app.errors import InputError
from tribox.app.simulation.run_state import Observer
from tribox.app.simulation.simulation import Simulation


class Cuts(Observer):
    """Counts steps that were cut."""

    def __init__(self):
        self.count = 0

    def cut(self, *arguments):
        self.count += 1


def data_of(block, **contact):
    data = tomllib.loads(block)
    data["geometry"]["lower"] = {"width": "1.2 mm", "height": "0.5 mm", "elements": [18, 4]}
    data["geometry"]["upper"] = {"width": "1.0 mm", "height": "0.5 mm", "elements": [10, 4]}
    data["geometry"]["offset"] = "0.1 mm"
    data["contact"][0] |= contact
    data["boundary"][1]["displacement"] = {
        "x": [["1 s", "0 mm"], ["2 s", "1.3 mm"]],
        "y": [["0 s", "0 mm"], ["1 s", "-0.03 mm"]],
    }
    data["stage"][1]["steps"] = 40
    return data


def drawn_off(block, **contact):
    case = Case.model_validate(data_of(block, **contact))
    simulation, cuts = Simulation(build_model(case, MPI.COMM_SELF)), Cuts()
    simulation.run(cuts)
    return simulation.rows, cuts.count


def test_it_leaves_without_a_cut_and_without_a_jolt(block):
    """T/N = μ as soon as all slides; N falls in proportion to what is left; energies close."""
    rows, cuts = drawn_off(block, fade_length="0.15 mm")
    assert cuts == 0
    last = rows[-1]
    assert last.normal_force == last.contact_area == last.interface_energy == 0.0
    assert last.strain_energy < 1e-6 * max(row.strain_energy for row in rows)
    sliding = [row for row in rows[8:] if row.normal_force > 0.0]
    assert len(sliding) > 20
    assert all(abs(row.friction_coefficient - 0.2) < 1e-6 for row in sliding)
    force = np.array([row.normal_force for row in rows[3:]])
    assert np.all(np.diff(force) <= 1e-3 * force[0])
    assert np.abs(np.diff(force)).max() < 0.06 * force[0]
    assert abs(last.energy_error) < 0.01 * last.external_work


def test_what_is_lost_is_what_pressing_has_stored(block):
    """Without friction nothing else can dissipate it."""
    rows, cuts = drawn_off(block, fade_length="0.15 mm", friction={"law": "frictionless"})
    pressed, last = rows[2], rows[-1]
    assert cuts == 0
    assert last.external_work == pytest.approx(pressed.external_work, rel=0.01)
    assert last.dissipation == pytest.approx(pressed.strain_energy, rel=0.07)


@pytest.mark.parametrize(
    ("keys", "line"),
    [
        ({"fade_length": "0 mm"}, 'fade_length = "0 mm": must be > 0 m'),
        ({"fade_length": "1 mm", "pressure": "pointwise"}, "fade_length = 0.001: goes with"),
        ({"fade_length": "1 s"}, '"s" has the wrong dimension'),
    ],
)
def test_wrong_lengths_are_refused(block, keys, line, tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(toml_text(data_of(block, **keys)))
    with pytest.raises(InputError) as error:
        load_case(path)
    assert line in str(error.value) and "\n" not in str(error.value)


def test_a_master_that_would_fade_everywhere_is_refused(block):
    case = Case.model_validate(data_of(block, fade_length="0.7 mm"))
    with pytest.raises(InputError, match=r"contact\.0: fade_length = 0\.0007 m: no part of the"):
        build_model(case, MPI.COMM_SELF)
