"""The table of explicit timings, on meshes that cost nothing."""

import pytest

from benchmarks.explicit import contact_table, kernel_table, sliding, step_table


def cells_of(line):
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_kernels_and_steps_are_measured():
    lines = list(kernel_table(cells=6))
    assert len(lines) == 2 + 6 and "36 cells" in lines[0]
    for line in lines[2:]:
        assert all(float(number) > 0.0 for number in cells_of(line)[1:])
    head, _, *rows = step_table((0.2,))
    for row in rows:
        found = dict(zip(cells_of(head), cells_of(row), strict=True))
        assert int(found["cells"]) == 8 * 4 + 12 * 3
        assert float(found["ms per step"]) > 0.0
        shares = [
            float(found[part].rstrip("% ")) for part in ("assembly", "contact", "time integration")
        ]
        assert sum(shares) == pytest.approx(100.0, abs=3.0)
    assert len(rows) == 2


def test_contact_pairs_are_measured():
    head, _, *rows = contact_table(0.2)
    assert len(rows) == 2
    for row in rows:
        found = dict(zip(cells_of(head), cells_of(row), strict=True))
        ratio = float(found["numpy (ms)"]) / float(found["compiled (ms)"])
        assert float(found["ratio"]) == pytest.approx(ratio, abs=0.2)


@pytest.mark.parametrize("friction", ["film", "coulomb"])
def test_what_is_measured_slides(friction):
    case = sliding(0.3, friction)
    case.run(600)
    trial = case.stepper.problem.trials[0]
    assert (trial.pressure > 0.0).mean() > 0.5
    assert trial.response.traction[:, 0].max() > 0.0
