"""Residual, energy and tangent by the compiled loops against those by DOLFINx's forms."""

import numpy as np
import pytest
from petsc4py import PETSc

from tests.conftest import Pair
from tests.forms.bodies.in_forms import KINDS, InForms, carried_tangent, forms_of
from tests.laws import coulomb
from tribox.app.equilibrium.bodies import Bodies
from tribox.app.equilibrium.constraints import Platen
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.step_mode import DEFAULT_STEP
from tribox.forms.bodies.compiled_cells import CompiledCells, OwnCells
from tribox.forms.bodies.materials import Hencky, MooneyRivlin, NeoHookean
from tribox.forms.contact.penalty import ContactTerm
from tribox.geometry.compat import add_matrix
from tribox.geometry.generators.two_blocks import Block, TwoBlocks
from tribox.geometry.meshes.mesh import generate

RUBBER = MooneyRivlin(0.4, 0.1, 5.0)
STEEL = Hencky(300.0, 700.0)  # far stiffer than the other body
TRIALS = {"pressed": (0.0, -0.06), "slid": (1.5, -0.06)}


Own = KINDS[NeoHookean]  # an energy of one's own, as far as the program knows


class ByForms(Bodies):
    """The same by what DOLFINx assembles."""

    def __init__(self, problem):
        super().__init__(problem.u, problem.solids)
        self._constraints = problem.constraints

    def add_forces(self, out):
        for solid in self.solids:
            InForms(solid).add_forces(out)
        return bool(np.isfinite(out.sum()))

    def strain_energies(self):
        return [InForms(solid).strain_energy() for solid in self.solids]

    def add_tangent(self, A, index, pattern, carried):
        solid = self.solids[index]
        forms = [part.tangent for part in forms_of(solid)]
        for form in [*forms, carried_tangent(solid)] if carried and solid.reduced else forms:
            add_matrix(A, form, unrolled=bool(self._constraints.aligned))


class Scene:
    """Two blocks in contact under a platen, solved by no one."""

    def __init__(self, comm, cell, formulation, lower):
        blocks = TwoBlocks(
            Block(1.0, 0.5, (6, 3)), Block(2.0, 0.5, (9, 2)), offset=0.47, gap=0.0, cell=cell
        )
        self.pair = Pair(generate(blocks, comm))
        self.platen = Platen(self.pair.held("top", 1).dofs, force=-0.1, stiffness=0.3)
        contact = ContactTerm(self.pair.surface(), coulomb(0.3), 50.0, 0.0, "averaged")
        solids = self.pair.solids(RUBBER, lower, formulation)
        self.problem = Equilibrium(self.pair.u, solids, [contact], platens=[self.platen])
        self.A = self.problem.new_matrix(self.at((0.0, 0.0)))

    def at(self, shift, ripple=0.01):
        """Unknowns of a strained and shifted upper block, on a lower one that hardly moves."""

        def upper(x):
            strained = np.sin(x @ [[5.0, 3.0], [2.0, 7.0]]) + 0.3 * x**2
            return ripple * strained + np.array(shift) * (0.5 + x[:, 1:])

        return self.pair.displaced(upper, lambda x: 1e-5 * np.cos(4.0 * x[:, ::-1]))

    def apart(self, x, before=None):
        """Largest differences of residual, energy and tangent, over the largest of each."""
        problem, found = self.problem, []
        by_loops = problem.bodies
        for bodies in (by_loops, ByForms(problem)):
            problem.bodies = problem.tangent.bodies = bodies
            f = self.problem.new_vector()
            self.problem.residual(None, x, f)
            energy = self.problem.strain_energy()
            self.problem.assemble_tangent(x, self.A, DEFAULT_STEP, before)
            found.append((f, energy, self.A.copy()))
        problem.bodies = problem.tangent.bodies = by_loops
        if before is not None:  # or it would make no difference whether pressures are carried
            self.problem.assemble_tangent(x, self.A)
            self.A.axpy(-1.0, found[0][2], PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
            assert self.A.norm() > 1e-8 * found[0][2].norm()
        (f, energy, A), (g, other, B) = found
        largest = g.norm(PETSc.NormType.INFINITY), B.norm(PETSc.NormType.INFINITY)
        f.axpy(-1.0, g)
        A.axpy(-1.0, B, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        return [
            f.norm(PETSc.NormType.INFINITY) / largest[0],
            abs(energy / other - 1.0),
            A.norm(PETSc.NormType.INFINITY) / largest[1],
        ]


def differences(comm, cell, formulation, lower):
    """Of each state of contact and platen, what is apart, and numbers that say what was at hand."""
    scene = Scene(comm, cell, formulation, lower)
    tangent, found, outside = scene.problem.tangent, {}, {}
    for acts in (True, False):
        scene.platen.acts = acts
        for name, shift in TRIALS.items():
            x = scene.at(shift)
            found[f"{name}, {acts}"] = scene.apart(x)
            if formulation == "q1-sri":
                found[f"{name}, {acts}, carried"] = scene.apart(x, scene.at(shift, 0.02))
            placed = scene.problem.bodies._placed.values()
            outside[str(acts)] = comm.allreduce(sum(len(one.places.dense) for one in placed))
    return {"apart": found, "patterns": tangent.pattern_changes, "outside": outside}


def all_differences(comm, directory):
    softer = NeoHookean(3.0, 8.0)
    return [differences(comm, "quadrilateral", "q1-sri", lower) for lower in (STEEL, softer)]


@pytest.mark.mpi(all_differences, 3)
@pytest.mark.parametrize("ranks", [1, 3])
def test_loops_give_what_forms_give(ranks, on_ranks):
    """With platens or without, at one pattern and the next, with carried pressures."""
    for scene in on_ranks(all_differences, ranks):
        for state, (residual, energy, tangent) in scene["apart"].items():
            assert residual < 1e-12, state
            assert energy < 1e-11, state  # strains of 1 %: differences of numbers 1e4 as large
            assert tangent < 1e-12, state
        assert scene["patterns"] >= 3
        # Cells of the platen, and those at the seam of two ranks, which may be that of two bodies.
        assert scene["outside"]["True"] > scene["outside"]["False"]
        assert (scene["outside"]["False"] > 0) == (ranks > 2)


def test_who_is_covered(pair):
    blocks = pair()
    upper, lower = blocks.solids(Own(1.0, 5.0), NeoHookean(3.0, 8.0))
    own, loops = Bodies(blocks.u, [upper, lower]).cells
    assert type(own) is OwnCells and type(loops) is CompiledCells
    assert len(loops.loops[0].nodes) == len(lower.cells)


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
