"""A rubber cylinder whose contact grows in each step, and friction on points that stay closed."""

import numpy as np
import pytest

import tribox.app.implicit.newton
from tests.solved import solved
from tribox.app.implicit.newton import NEWTON_PHASES, Settling


def ring():
    """Pressed on a flat by a tenth of its diameter."""
    top = {"displacement": {"x": 0, "y": [["0 s", 0], ["1 s", "-0.4 mm"]]}}
    return {
        "geometry": {
            "kind": "cylinder-on-block",
            "thickness": "1 mm",
            "contact_width": "1.8 mm",
            "contact_size": "60 um",
            "growth": 1.3,
            "cylinder": {"radius": "2 mm"},
            "block": {"width": "10 mm", "height": "4 mm", "contact_size": "100 um"},
        },
        "bodies": {
            "elastomer": {"material": "neo-hookean", "E": "5 MPa", "nu": 0.49},
            "aluminium": {"material": "hencky", "E": "70 GPa", "nu": 0.33},
        },
        "contact": [
            {
                "slave": "elastomer_contact",
                "master": "aluminium_contact",
                "friction": {"law": "coulomb", "mu": 0.3},
            }
        ],
        "boundary": [
            {"surface": "bottom", "displacement": {"x": 0, "y": 0}},
            {"surface": "top", **top},
        ],
        "stage": [{"name": "press", "duration": "1 s", "steps": 12}],
    }


def test_a_contact_that_grows_takes_fewer_iterations_without_a_line_search(monkeypatch):
    found = []
    for searched in (False, True):
        if searched:
            monkeypatch.setattr(tribox.app.implicit.newton, "ELASTIC_PHASES", NEWTON_PHASES)
        rows = solved(ring()).rows
        assert [row.attempts for row in rows] == [1] * 12
        iterations = sum(row.newton_iterations for row in rows)
        found.append((iterations, [row.normal_force for row in rows]))
    assert found[0][0] < 0.8 * found[1][0]
    assert found[0][1] == pytest.approx(found[1][1], rel=1e-8)


class Trial:
    """A contact of which some points touch."""

    def __init__(self, *touching):
        self.normal_contact = self
        self.touching = np.array(touching)


class Alone:
    """A problem on one rank."""

    def __init__(self, *touching):
        self.trials, self.comm = [Trial(*touching)], self

    def allreduce(self, value, op):
        return value


def test_what_has_settled_touches_as_before_and_gains_nothing():
    settling = Settling()
    assert not settling.see(Alone(True, False), 1.0)
    assert not settling.see(Alone(True, True), 9.0)
    assert not settling.see(Alone(True, True), 3.0)
    assert settling.see(Alone(True, True), 4.0) and settling.done
