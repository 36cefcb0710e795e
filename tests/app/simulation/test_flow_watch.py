"""How far bodies flow: warned of where data end and steps are long, once, and after a restart."""

from types import SimpleNamespace

import pytest

from tests.app.checkpoint.going_on import case_of, run
from tests.app.read_log import read_log
from tests.flowing import soft_block
from tribox.app.build.mesh_notes import locking_bodies
from tribox.app.simulation.watches import FlowWatch


@pytest.mark.parametrize(
    ("end", "steps", "said"),
    [
        (0.02, 2, ["beyond 0.02, where its hardening table ends"]),
        (9.0, 2, []),
        (9.0, 1, ["grew by 0.1", "in one step"]),
    ],
)
def test_it_is_said_once(tmp_path, end, steps, said):
    table = {"law": "table", "points": [[0, 0.3e6], [end, 0.3e6 + 1e6 * end]]}
    deep = {"stage": [{"name": "press", "duration": "1 s", "steps": steps}]}
    if steps == 1:
        deep["boundary.1.displacement"] = {"x": 0, "y": [["0 s", 0], ["1 s", "-0.09 mm"]]}
    keys = deep | {"bodies__aluminium__hardening": table}
    simulation = run(case_of(soft_block(**keys), fields_every=0), tmp_path / "out")
    log = read_log(tmp_path / "out")
    lines = [line for line in log.splitlines() if "equivalent plastic strain" in line]
    assert len(lines) == bool(said) and all(word in lines[0] for word in said)
    problem = simulation.model.problem
    watch = FlowWatch(problem)
    watch.restore(watch.snapshot() | {"found": [["table aluminium", "known"]]})
    watch.step(simulation.rows[-1])
    assert list(watch.warnings())[:1] == ["known"]
    assert watch.snapshot()["found"][0] == ("table aluminium", "known")


def test_full_integration_of_a_metal_is_said_to_lock():
    named = SimpleNamespace(
        mesh=SimpleNamespace(topology=SimpleNamespace(cell_name=lambda: "quadrilateral"))
    )
    usual = SimpleNamespace(bulk_modulus=2.6, shear_modulus=1.0)
    metal = SimpleNamespace(name="strip", flows=True, carried=None, material=usual)
    [line] = locking_bodies(named, [metal], 1)
    assert "body strip" in line and "q1-sri" in line
    assert list(locking_bodies(named, [metal], 2)) == []
    metal.material = SimpleNamespace(bulk_modulus=5e3, shear_modulus=1.0)
    [line] = locking_bodies(named, [metal], 2)
    assert "body strip" in line and "quadratic" in line and "q1-sri" in line
    metal.carried = object()
    assert list(locking_bodies(named, [metal], 1)) == []
