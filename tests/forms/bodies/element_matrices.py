"""Compiled loops over cells beside what DOLFINx assembles, in the plane and in space."""

import dolfinx
import numpy as np
import pytest

from tests.forms.bodies.in_forms import InForms, carried_tangent, forms_of
from tribox.forms.bodies.compiled_cells import CompiledCells, compiled_cells
from tribox.forms.bodies.point_cells import add_tangent


def summed(u, loops, excess=None):
    """The tangent (n, n) by loops, from element matrices that lie one after the other."""
    nodes = loops[0].nodes
    dim, corners = u.function_space.dofmap.index_map_bs, nodes.shape[1]
    shape = (*nodes.shape, dim, corners)
    starts = dim * np.arange(np.prod(shape), dtype=np.int32).reshape(shape)
    values = np.zeros((*shape, dim))
    add_tangent(loops, u.x.array, values, starts, excess)
    at = (dim * nodes[..., None] + np.arange(dim)).reshape(len(values), dim * corners)
    total = np.zeros((len(u.x.array),) * 2)
    np.add.at(total, (at[:, :, None], at[:, None, :]), values.reshape(*at.shape, at.shape[1]))
    return total


def cells_of(u, solid):
    cells = compiled_cells(u.function_space, solid)
    assert isinstance(cells, CompiledCells)
    return cells


def dense(forms):
    """The matrix (n, n) of bilinear forms."""
    return sum(dolfinx.fem.assemble_matrix(form).to_scipy().toarray() for form in forms)


def compare(u, solid, forces=1e-12, energies=1e-12, tangents=1e-14):
    """Forces, energy and tangent of the loop and of the forms, to shares of the largest.

    Returns the largest force over the largest stiffness.
    """
    cells, slow = cells_of(u, solid), InForms(solid)
    mine, theirs = np.ones_like(u.x.array), np.ones_like(u.x.array)
    assert cells.add(u.x.array, mine) and slow.add_forces(theirs)
    stiffness = dense([part.tangent for part in forms_of(solid)])
    # What rounds F is an error of the stress of the modulus times 1e-16.
    rounding = 2e-15 * np.abs(stiffness).max()  # the body is 1 m long
    largest = np.abs(theirs - 1.0).max()
    np.testing.assert_allclose(mine, theirs, rtol=0, atol=max(forces * largest, rounding))
    energy = slow.strain_energy()
    assert cells.energy(u.x.array) == pytest.approx(energy, rel=energies, abs=rounding)
    found, bar = summed(u, cells.loops), np.abs(stiffness).max()
    np.testing.assert_allclose(found, stiffness, rtol=0, atol=tangents * bar)
    np.testing.assert_allclose(found, found.T, rtol=0, atol=1e-14 * bar)
    return largest / bar


def same_carried_pressures(u, solid, tolerance):
    """Compare the tangents of pressures that are carried from another displacement."""
    before = u.x.array + 0.01 * np.random.default_rng(8).uniform(-1, 1, len(u.x.array))
    solid.carried.carry(before)
    wanted = dense([*(part.tangent for part in forms_of(solid)), carried_tangent(solid)])
    found = summed(u, cells_of(u, solid).loops, solid.carried.excess())
    np.testing.assert_allclose(found, wanted, rtol=0, atol=tolerance * np.abs(wanted).max())
    plain = summed(u, cells_of(u, solid).loops)
    assert np.abs(found - plain).max() > 1e-4 * np.abs(plain).max()


def no_number_in_an_inverted_cell(u, solid, corner):
    """What loop and forms say where the last corner is moved by ``corner`` (i,), m.

    Where the forms have a finite residual the loop has it too: iterates pass through there.
    """
    dim = len(corner)
    last = dim * int(np.argmax(u.function_space.tabulate_dof_coordinates().sum(axis=1)))
    u.x.array[last : last + dim] = corner
    cells, mine, theirs = cells_of(u, solid), np.zeros_like(u.x.array), np.zeros_like(u.x.array)
    assert not cells.add(u.x.array, mine)
    assert cells.energy(u.x.array) == np.inf
    for part in forms_of(solid):
        dolfinx.fem.assemble_vector(theirs, part.residual)
    largest = np.nanmax(np.abs(theirs))
    np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-13 * largest, equal_nan=True)
    finite = np.isfinite(dense([part.tangent for part in forms_of(solid)])).all()
    assert np.isfinite(summed(u, cells.loops)).all() == finite
    u.x.array[last] = np.nan
    assert not cells.add(u.x.array, mine)
