"""The compiled tangent against the matrix that DOLFINx assembles, and what is no number."""

from __future__ import annotations

import dolfinx
import dolfinx.fem.petsc
import numpy as np
import pytest

from forms.bodies.compiled_cells import compiled_cells
from forms.bodies.plane_cells import PlaneCells
from tests.forms.bodies.test_internal_force import KINDS, MATERIALS, body, stretched


def assembled(u, forms):
    """The matrix (n, n) of bilinear forms."""
    total = np.zeros((len(u.x.array),) * 2)
    for form in forms:
        A = dolfinx.fem.petsc.assemble_matrix(form)
        A.assemble()
        total += A[:, :]
    return total


def summed(u, cells, excess=None):
    """The same by the compiled loop, from element matrices that lie one after the other."""
    shape = (*cells.nodes.shape, 2, cells.nodes.shape[1])
    starts = 2 * np.arange(np.prod(shape), dtype=np.int32).reshape(shape)
    values = np.zeros((*shape, 2))
    cells.add_tangent(u.x.array, values, starts, excess)
    at = (2 * cells.nodes[..., None] + np.arange(2)).reshape(len(values), 2 * cells.nodes.shape[1])
    total = np.zeros((len(u.x.array),) * 2)
    np.add.at(total, (at[:, :, None], at[:, None, :]), values.reshape(*at.shape, at.shape[1]))
    return total


def cells_of(u, solid):
    cells = compiled_cells(u.function_space, solid)
    assert isinstance(cells, PlaneCells)
    return cells


@pytest.mark.parametrize("size", [0.5, 0.1, 1e-4])
@pytest.mark.parametrize(("cell", "formulation"), KINDS)
@pytest.mark.parametrize("name", MATERIALS)
def test_compiled_tangent_is_that_of_the_generated_kernel(name, cell, formulation, size):
    """At the largest size some cells of a block of eight are beyond the logarithm's series."""
    u, solid = body(cell, MATERIALS[name], formulation)
    stretched(u, size)
    wanted = assembled(u, [part.tangent for part in solid.forms])
    found = summed(u, cells_of(u, solid))
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())
    np.testing.assert_allclose(found, found.T, rtol=0, atol=1e-14 * np.abs(wanted).max())


@pytest.mark.parametrize("name", MATERIALS)
def test_carried_pressures(name):
    u, solid = body("quadrilateral", MATERIALS[name], "q1-sri")
    stretched(u, 0.1)
    before = u.x.array + 0.01 * np.random.default_rng(8).uniform(-1, 1, len(u.x.array))
    solid.carried.carry(before)
    wanted = assembled(u, [*(part.tangent for part in solid.forms), solid.carried.tangent])
    found = summed(u, cells_of(u, solid), solid.carried.excess())
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())
    plain = summed(u, cells_of(u, solid))
    assert np.abs(found - plain).max() > 1e-4 * np.abs(plain).max()


@pytest.mark.parametrize(("cell", "formulation"), KINDS)
def test_parts_add_up_to_the_whole(cell, formulation):
    u, solid = body(cell, MATERIALS["hencky"], formulation)
    stretched(u, 0.1)
    cells = cells_of(u, solid)
    take = np.random.default_rng(1).uniform(size=len(cells.nodes)) < 0.4
    halves = [summed(u, cells.part(mask)) for mask in (take, ~take, np.zeros_like(take))]
    assert not halves[2].any()
    whole = summed(u, cells)
    np.testing.assert_allclose(halves[0] + halves[1], whole, rtol=0, atol=1e-15 * whole.max())


@pytest.mark.parametrize("formulation", ["q1", "q1-sri"])
@pytest.mark.parametrize("name", MATERIALS)
@pytest.mark.parametrize("depth", [0.8, 1.3])
def test_what_is_no_number_in_an_inverted_cell(name, formulation, depth):
    """The centre is inverted too, or not.

    Where the forms have a finite residual the loop has it too: iterates pass through there.
    """
    u, solid = body("quadrilateral", MATERIALS[name], formulation, distortion=0.0)
    stretched(u, 1e-3)
    x = u.function_space.tabulate_dof_coordinates()[:, :2]
    corner = int(np.argmax(x.sum(axis=1)))
    u.x.array[2 * corner : 2 * corner + 2] = -depth * np.array([0.2, 0.7 / 3.0])
    cells, mine, theirs = cells_of(u, solid), np.zeros_like(u.x.array), np.zeros_like(u.x.array)
    assert not cells.add(u.x.array, mine, None)
    for part in solid.forms:
        dolfinx.fem.assemble_vector(theirs, part.residual)
    largest = np.nanmax(np.abs(theirs))
    np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-13 * largest, equal_nan=True)
    wanted, found = assembled(u, [part.tangent for part in solid.forms]), summed(u, cells)
    assert np.isfinite(found).all() == np.isfinite(wanted).all()
