"""Element matrices of compiled loops, added up into a whole matrix."""

import numpy as np

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
