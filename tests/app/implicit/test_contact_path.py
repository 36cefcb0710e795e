"""Newton steps along which contacts open and close."""

import numpy as np
import pytest

from tests.app.implicit.test_interior_point import down, strip
from tests.solved import solved
from tribox.app.implicit.contact_path import Changed
from tribox.app.implicit.newton import Newton

E, NU, LENGTH, HEIGHT, STROKE = 70e9, 0.3, 0.05, 1e-3, 2e-3
LEAF = {"material": "hencky", "formulation": "q2", "E": E, "nu": NU}


def leaves(slave, master):
    """Two leaves that lie flush on each other, clamped at one end; the upper one's other is moved.

    It goes down by 2 mm in five steps, and up again.
    """
    block = {"x": [0.0, LENGTH], "elements": [25, 2]}
    blocks = {
        "lower": block | {"y": [0.0, HEIGHT]},
        "upper": block | {"y": [HEIGHT, 2.0 * HEIGHT]},
    }
    clamped = [{"surface": f"{one}_left", "displacement": {"x": 0, "y": 0}} for one in blocks]
    moved = {"y": [[0, 0], [1, -STROKE], [2, 0]]}
    return {
        "geometry": {"kind": "blocks", "blocks": blocks},
        "bodies": dict.fromkeys(blocks, LEAF),
        "contact": [{"slave": slave, "master": master, "friction": {"law": "frictionless"}}],
        "boundary": [*clamped, {"surface": "upper_right", "displacement": moved}],
        "stage": [{"name": one, "duration": 1, "steps": 5} for one in ("down", "up")],
    }


@pytest.mark.parametrize(
    ("slave", "master"), [("upper_bottom", "lower_top"), ("lower_top", "upper_bottom")]
)
def test_flush_leaves_are_bent_in_few_iterations(slave, master):
    """346 iterations and a cut before; the force of a cantilever is 3 E' I w/L^3.

    It is handed over within the last facet, of 2 mm: the arm may be shorter by as much.
    """
    rows = solved(leaves(slave, master)).state.rows
    assert len(rows) == 10 and max(row.newton_iterations for row in rows) <= 10
    bending = E / (1.0 - NU**2) * HEIGHT**3 / 12.0
    whole = 3.0 * bending * (STROKE / 5.0) / LENGTH**3
    assert whole < rows[0].normal_force < whole / (1.0 - 2e-3 / LENGTH) ** 3
    assert abs(rows[-1].normal_force) < 1e-6 * rows[4].normal_force


def test_a_step_goes_to_the_end_of_the_path(monkeypatch):
    """Of a strip that hardly moves: what is linear is solved at once, whatever opens and closes."""
    left = []

    def seen(self: Newton, x, y):
        before = y.copy()
        changed = lead(self, x, y)
        norms = []
        for step in (before, y):
            there = x.copy()
            there.axpy(-1.0, step)
            norms.append(self._norm_at(there) / self._residual.norm())
        self._norm_at(x)
        if changed:
            left.append(norms)
        return changed

    lead = Newton._lead
    monkeypatch.setattr(Newton, "_lead", seen)
    tools = {
        "bed": {"points": [[0.02, 0], [0.05, 0]]},
        "lid": {"points": [[0.05, 1e-3], [0.02, 1e-3]], "displacement": down(1e-9)},
        "third": {"points": [[0.018, 1e-3], [-0.001, 1e-3]]},
    }
    solved(strip([20, 2], 0.04, tools, 1))
    assert left and max(whole for whole, _ in left) > 1.0
    assert min(followed for _, followed in left) < 1e-3


@pytest.mark.parametrize("stiffness", [1e3, 1e-12, -0.5])
def test_a_vertex_whose_loss_leaves_nothing_to_resist_stays_closed(stiffness):
    """One unknown, held by the spring of its contact, 1 N/m, and by another or none."""
    changed = Changed()
    compliance = np.array([1.0 / (1.0 + stiffness)])
    changed.add(0, -1.0, None, compliance)
    assert changed.is_stable(np.ones(1)) == (stiffness == 1e3)
