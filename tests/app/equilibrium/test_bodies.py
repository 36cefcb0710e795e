"""Which bodies the compiled loops stand for, and what they make of inverted cells."""

import numpy as np

from tribox.app.equilibrium.bodies import Bodies
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.forms.bodies.materials import Hencky, MooneyRivlin, NeoHookean

RUBBER = MooneyRivlin(0.4, 0.1, 5.0)
STEEL = Hencky(300.0, 700.0)  # far stiffer than the other body


class Own(NeoHookean):
    """An energy of one's own, as far as the program knows."""


def test_who_is_covered(pair):
    blocks = pair()
    upper, lower = blocks.solids(Own(1.0, 5.0), NeoHookean(3.0, 8.0))
    covered, loops = Bodies(blocks.u, [upper, lower]).cells
    assert covered is None
    assert loops is not None and len(loops.loops[0].nodes) == len(lower.cells)
    assert Bodies(blocks.u, [upper, lower], compiled=False).cells == [None, None]


def test_the_residual_of_an_inverted_cell_is_no_number(pair):
    """And the place that is named is where it is."""
    blocks = pair()
    problem = Equilibrium(blocks.u, blocks.solids(RUBBER, STEEL, "q1"), [])
    x, f = blocks.displaced(np.zeros_like, np.zeros_like), problem.new_vector()
    where = problem.space.tabulate_dof_coordinates()[:, :2]
    corner = int(np.argmax(where.sum(axis=1)))
    x.array[2 * corner : 2 * corner + 2] = -0.2
    problem.residual(None, x, f)
    assert np.isnan(f.norm()) and not np.isfinite(problem.strain_energy())
    bad = where[np.isnan(f.array_r.reshape(-1, 2)[:, 0])]
    assert 0 < len(bad) <= 4
    assert np.linalg.norm(bad - where[corner], axis=1).max() < 0.5
