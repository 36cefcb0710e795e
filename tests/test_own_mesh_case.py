"""``cases/forming/own-mesh.toml`` in reduced form: a drawing, three bodies, two pairs, a tool."""

from pathlib import Path

import numpy as np

from tests.forming_pictures import draw_picture
from tribox import load_case, run_case
from tribox.app.results.recorder import force_balance
from tribox.app.simulation.history import energy_gap

CASE = Path(__file__).parents[1] / "cases" / "forming" / "own-mesh.toml"
SHORTER = [
    'boundary.2.displacement.y=[["0 s", "0 mm"], ["1 s", "-2 mm"], ["2 s", "-1.4 mm"]]',
    "stage.0.steps=8", "solver.tolerance=1e-10", "stage.1.steps=5", "stage.1.duration=1",
    "output.figures=false", "output.fields_every=0",
]  # fmt: skip


def test_a_sheet_bent_by_a_bonded_punch_springs_back(tmp_path):
    """What the punch presses with, the die carries; names with spaces stand in the results."""
    done = run_case(load_case(CASE, SHORTER), tmp_path / "results", quiet=True)
    draw_picture("own-mesh", tmp_path / "results")
    assert abs(energy_gap(done.rows)) < 1e-2
    assert force_balance(done) < 1e-8
    assert [row.attempts for row in done.rows[:3]] == [1, 1, 1]
    assert any(
        note.startswith("bodies steel tube and rubber sleeve share") for note in done.model.notes
    )
    tools = done.state.tools
    force = tools.columns.index("force_y")
    assert {row[tools.columns.index("tool")] for row in tools.rows} == {"round die"}
    carried = -np.array([row[force] for row in tools.rows])
    punch = -done.state.motion.of_surface("tube bore", "force_y")
    np.testing.assert_allclose(punch, carried, atol=1e-6 * carried.max())
    assert carried[-1] < 1e-6 * carried.max()

    middle = done.state.motion.of_surface("sheet middle", "displacement_y")
    end = [row.stage for row in done.rows].index("lift") - 1
    way = -middle[end]
    assert 0.8 * 2e-3 < way < 2e-3  # the sleeve is compressed by the rest
    assert 0.05 * way < middle[-1] - middle[end] < 0.6 * way
    # All that is left of the work has flowed or is rubbed off, but for residual stresses.
    last, top = done.rows[-1], done.rows[end]
    assert last.strain_energy < 0.2 * top.strain_energy
    assert last.plastic_dissipation > 0.5 * last.external_work > 0.0
