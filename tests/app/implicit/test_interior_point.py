"""Contacts that are found from inside: flush sheets, on which Newton's method chatters."""

from __future__ import annotations

import pytest

from tests.tool_cases import run

E, NU = 70e9, 0.33
WIDTH = 0.1  # m, of the slab


def strip(cells, length, tools, stroke_steps):
    """A strip of aluminium 1 mm high, free of friction, symmetric at its left end."""
    side = {"bed": "bottom", "die": "bottom"}
    return {
        "geometry": {
            "kind": "blocks",
            "thickness": WIDTH,
            "blocks": {"strip": {"x": [0, length], "y": [0, 1e-3], "elements": cells}},
        },
        "bodies": {"strip": {"material": "hencky", "E": E, "nu": NU}},
        "tools": {name: {"shape": "polyline", **keys} for name, keys in tools.items()},
        "contact": [
            {
                "slave": f"strip_{side.get(name, 'top')}",
                "master": name,
                "friction": {"law": "frictionless"},
            }
            for name in tools
        ],
        "boundary": [{"surface": "strip_left", "symmetry": True}],
        "stage": [{"name": "press", "duration": "1 s", "steps": stroke_steps}],
    }


def down(stroke):
    return {"y": [[0, 0], [1, -stroke]]}


@pytest.mark.parametrize("cells", [40, 120])
def test_a_flush_flat_takes_no_more_iterations_on_a_finer_mesh(cells):
    """The right half is clamped by 0.1 µm; a third flat touches the left half, at no gap.

    Half the load has the same contact: further steps follow from the first, and the force is that
    of plane compression, E/(1 − ν²) of the strain.
    """
    tools = {
        "bed": {"points": [[0.02, 0], [0.05, 0]]},
        "lid": {"points": [[0.05, 1e-3], [0.02, 1e-3]], "displacement": down(1e-7)},
        "third": {"points": [[0.018, 1e-3], [-0.001, 1e-3]]},
    }
    rows = run(strip([cells, 2], 0.04, tools, 3)).state.rows
    iterations = [row.newton_iterations for row in rows]
    assert len(rows) == 3 and iterations[0] <= 15 and max(iterations[1:]) <= 3
    each = E / (1.0 - NU**2) * 1e-4 * 0.02 * WIDTH
    # The total of all pairs: the lid's force and the bed's. The clamped end adds a little.
    assert rows[-1].normal_force == pytest.approx(2.0 * each, rel=0.02)
    assert rows[0].normal_force == pytest.approx(rows[-1].normal_force / 3.0, rel=1e-4)


def test_a_strip_that_lies_flush_on_a_die_is_bent_without_a_cut():
    tools = {
        "die": {
            "points": [[0.0201, -0.04], [0.0201, 0], [0.08, 0]],
            "fillet_radius": 5e-3,
            "continued": [True, True],
        },
        "punch": {
            "points": [[0.0185, 0.04], [0.0185, 1e-3], [-0.005, 1e-3]],
            "fillet_radius": 2.5e-3,
            "continued": [True, True],
            "displacement": down(6e-4),
        },
    }
    rows = run(strip([80, 2], 0.06, tools, 4)).state.rows
    assert len(rows) == 4 and max(row.newton_iterations for row in rows) <= 25
    assert abs(rows[-1].energy_error) <= 0.01 * rows[-1].external_work
