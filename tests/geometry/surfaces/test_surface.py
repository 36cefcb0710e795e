"""Contact forces of a surface in the plane do not depend on the ranks."""

import dolfinx
import numpy as np
import pytest
from petsc4py import PETSc

from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.friction.coulomb import CoulombLaw, CoulombParameters
from tribox.geometry.generators.two_blocks import Block, TwoBlocks
from tribox.geometry.meshes.mesh import generate
from tribox.geometry.surfaces.surface import ContactSurface

SLAVE, MASTER = "elastomer_contact", "aluminium_contact"


def space_on(named):
    return dolfinx.fem.functionspace(named.mesh, ("Lagrange", 1, (2,)))


def surface_on(space, named, degree):
    return ContactSurface(space, named.facets(SLAVE), named.facets(MASTER), degree)


def contact_facts(comm, directory):
    """Contact forces of a deformed pair, summarised so that no numbering enters; collective."""
    blocks = TwoBlocks(Block(1.0, 0.5, (6, 6)), Block(2.0, 0.5, (19, 4)), 0.47)
    named = generate(blocks, comm)
    space = space_on(named)
    term = ContactTerm(
        surface_on(space, named, 3), CoulombLaw(CoulombParameters(mu=0.3, K_T=40.0)), 50.0
    )
    down = np.where(space.tabulate_dof_coordinates()[:, 1] > -1e-9, 1.0, 0.0)
    u = dolfinx.fem.Function(space)
    u.interpolate(lambda X: 0.03 * np.stack([np.cos(3.0 * X[1]), np.sin(4.0 * X[0])]))
    u.x.array[1::2] -= 0.03 * down * np.isin(np.arange(len(down)), upper_nodes(named, space))
    x = PETSc.Vec().createMPI((2 * space.dofmap.index_map.size_local, None), bsize=2, comm=comm)
    x.array[:] = u.x.array[: x.getLocalSize()]
    trial = term.evaluate(x, 1.0)
    f = x.duplicate()
    f.set(0.0)
    nodes, values = term.nodal_forces(trial)
    dofs = (nodes[..., None] * 2 + np.arange(2)).astype(PETSc.IntType)
    f.setValues(dofs.reshape(-1), values.reshape(-1), addv=PETSc.InsertMode.ADD_VALUES)
    f.assemble()
    where = space.tabulate_dof_coordinates()[: space.dofmap.index_map.size_local, 0]
    # Sum and first moment vanish (action and reaction); the second moment does not.
    force = f.array_r.reshape(-1, 2)
    return {
        "norm": f.norm(),
        "second moment x": comm.allreduce(float(force[:, 0] @ where**2)),
        "second moment y": comm.allreduce(float(force[:, 1] @ where**2)),
        "pressed": comm.allreduce(int(np.count_nonzero(trial.pressure))),
        "energy": comm.allreduce(term.interface_energy(trial)),
        "points": comm.allgather(len(term.surface.slave.weight)),
        "masters": comm.allgather(
            term.surface.master.position[term.surface.master.facets].tolist()
        ),
    }


def upper_nodes(named, space):
    return np.unique(space.dofmap.list[named.cells("elastomer")])


@pytest.mark.mpi(contact_facts, 3)
def test_contact_forces_do_not_depend_on_the_ranks(on_ranks):
    """Three ranks, of which one at least owns no slave facet, against one."""
    one, three = on_ranks(contact_facts, 1), on_ranks(contact_facts, 3)
    assert min(three["points"]) == 0 < max(three["points"]), three["points"]
    assert sum(three["points"]) == one["points"][0]
    assert three["pressed"] == one["pressed"] > 0
    for name in ("norm", "second moment x", "second moment y", "energy"):
        assert three[name] == pytest.approx(one[name], rel=1e-10, abs=0.0)
    # The facets have the same order too, on every rank and however many there are.
    for facets in three["masters"]:
        np.testing.assert_allclose(facets, one["masters"][0], rtol=0, atol=1e-15)
