"""Contact added to vectors and matrices of one's own: what the equilibrium has, and no more."""

import dolfinx
import dolfinx.fem.petsc
import numpy as np
import pytest
import scipy.sparse
import ufl
from mpi4py import MPI
from petsc4py import PETSc

from tests.laws import coulomb
from tribox.app.equilibrium.added_contact import AddedContact
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.friction.friction_map import FrictionMap
from tribox.forms.friction.parameters import FrictionMapParameters, with_preset
from tribox.geometry.generators.two_blocks import Block, TwoBlocks
from tribox.geometry.meshes.mesh import generate

SIZE = 0.01


class Scene:
    """A block that is pressed into another and slides, twice: once here, once for comparison."""

    def __init__(self, comm=MPI.COMM_SELF):
        blocks = TwoBlocks(Block(SIZE, SIZE, (4, 2)), Block(3 * SIZE, SIZE, (14, 2)))
        self.named = generate(blocks, comm)
        self.space = dolfinx.fem.functionspace(self.named.mesh, ("Lagrange", 1, (2,)))
        self.u = dolfinx.fem.Function(self.space)
        form = ufl.inner(ufl.TrialFunction(self.space), ufl.TestFunction(self.space)) * ufl.dx
        self.mass = dolfinx.fem.form(form)

    def term(self):
        law = coulomb(0.3, 1e9)
        facets = (self.named.facets(f"{b}_contact") for b in ("elastomer", "aluminium"))
        return ContactTerm.between(self.u, *facets, law, penalty=1e10)

    def support(self):
        """Of the whole left side of the upper block, one node of which is in contact."""
        nodes = dolfinx.fem.locate_dofs_topological(
            self.space, 1, self.named.facets("elastomer_left")
        )
        return dolfinx.fem.dirichletbc(np.zeros(2), nodes, self.space)

    def displaced(self, slide, press):
        """The upper block moved, with some bending so that no two points are alike."""
        x = self.space.tabulate_dof_coordinates()
        upper = np.zeros(len(x), dtype=bool)
        upper[np.unique(self.space.dofmap.list[self.named.cells("elastomer")])] = True
        bent = 1e-5 * np.sin(400.0 * x[:, :2] + [0.3, 0.1])
        moved = self.u.x.array.reshape(-1, 2)
        moved[:] = np.where(upper[:, None], bent + np.array([slide, -press]), 0.3 * bent)
        return self.u.x.petsc_vec


def dense(A):
    indptr, indices, data = A.getValuesCSR()
    return scipy.sparse.csr_matrix((data, indices, indptr), shape=A.getSize()).toarray()


def test_a_film_is_handed_in_with_the_surfaces():
    """Faster than V* the film carries all: eta V/D at each pressed point."""
    scene, dt, slide, film = Scene(), 0.5, 1e-3, 30e-9
    own = {"mu_s": 0.1, "K_T": 1e11, "V_star": 1e-6, "V_star_at": film, "eta_b": 0.5}
    law = FrictionMap(FrictionMapParameters(**with_preset("friction-map", own)))
    facets = (scene.named.facets(f"{b}_contact") for b in ("elastomer", "aluminium"))
    pair = ContactTerm.between(scene.u, *facets, law, penalty=1e10, film=film)
    contact = AddedContact(scene.u, [pair])
    contact.evaluate(scene.displaced(0.0, 1e-4), dt)
    contact.commit()
    contact.evaluate(scene.displaced(slide, 1e-4), dt)
    [trial] = contact.trials
    drag = 0.5 * slide / dt / film
    traction = np.linalg.norm(trial.response.traction, axis=1)
    assert np.median(traction[trial.pressure > 0.0]) == pytest.approx(drag, rel=0.1)


def test_residual_and_tangent_are_those_of_the_equilibrium_and_are_added():
    scene = Scene()
    contact = AddedContact(scene.u, [scene.term()])
    other = Equilibrium(scene.u, [], [scene.term()])
    A = dolfinx.fem.petsc.assemble_matrix(scene.mass)
    A.assemble()
    mass = dense(A)
    b = scene.u.x.petsc_vec.duplicate()
    f = other.new_vector()
    for slide in (2e-5, 4e-3):  # past several facets of the master
        x = scene.displaced(slide, 1e-4)
        contact.evaluate(x, 0.5)
        b.set(7.0)
        contact.add_residual(b)
        A.zeroEntries()
        dolfinx.fem.petsc.assemble_matrix(A, scene.mass)
        A.assemble()
        contact.add_tangent(A)
        other.residual(None, x, f)
        K = other.new_matrix(x)
        other.assemble_tangent(x, K)
        assert f.norm() > 1.0
        assert np.allclose(b.array_r - 7.0, f.array_r, rtol=0, atol=1e-12 * f.norm())
        assert np.allclose(dense(A) - mass, dense(K), rtol=0, atol=1e-12 * K.norm())
        contact.commit()
        other.commit()
    pressed = other.trials[0].pressure @ other.contacts[0].surface.slave.weight
    assert contact.normal_forces()[0] == pytest.approx(pressed, rel=1e-12)


def test_supports_keep_their_rows_and_columns():
    scene = Scene()
    support = scene.support()
    contact = AddedContact(scene.u, [scene.term()], [support])
    free = AddedContact(scene.u, [scene.term()])
    A = dolfinx.fem.petsc.assemble_matrix(scene.mass, bcs=[support])
    A.assemble()
    before, x = dense(A), scene.displaced(1e-5, 1e-4)
    b = scene.u.x.petsc_vec.duplicate()
    b.set(0.0)
    K = dolfinx.fem.petsc.assemble_matrix(scene.mass)
    K.assemble()
    for one, matrix in ((contact, A), (free, K)):
        one.evaluate(x, 1.0)
        one.add_tangent(matrix)
    contact.add_residual(b)
    fixed = support.dof_indices()[0]
    rest = np.setdiff1d(np.arange(len(before)), fixed)
    added = dense(A) - before
    assert not added[fixed].any() and not added[:, fixed].any() and not b.array_r[fixed].any()
    # What would have been there, were it not for the support.
    assert np.abs(dense(K)[fixed]).max() > 1e6
    assert np.abs(added[np.ix_(rest, rest)]).max() > 1e6


def test_what_cannot_be_is_said():
    scene = Scene()
    contact = AddedContact(scene.u, [scene.term()])
    with pytest.raises(RuntimeError, match="call evaluate"):
        contact.commit()
    contact.evaluate(scene.displaced(0.0, 1e-4), 1.0)
    larger = PETSc.Vec().createSeq(scene.u.x.petsc_vec.getSize() + 5)
    with pytest.raises(ValueError, match="hand in the displacement's block"):
        contact.add_residual(larger)


def sums(comm, directory):
    """Numbers of forces and tangent with a support, that no numbering enters; collective."""
    scene = Scene(comm)
    support = scene.support()
    contact = AddedContact(scene.u, [scene.term()], [support])
    found = []
    for slide in (2e-5, 3e-3):
        x = scene.displaced(slide, 1e-4)
        b = x.duplicate()
        b.set(0.0)
        contact.evaluate(x, 1.0)
        contact.add_residual(b)
        A = dolfinx.fem.petsc.assemble_matrix(scene.mass, bcs=[support])
        A.assemble()
        contact.add_tangent(A)
        contact.commit()
        found += [b.norm(), A.norm(), contact.normal_forces()[0]]
    return found


@pytest.mark.mpi(sums, 2)
def test_ranks_agree(on_ranks):
    assert np.allclose(on_ranks(sums, 2), on_ranks(sums, 1), rtol=1e-11, atol=0)
