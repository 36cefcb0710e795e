"""Bodies whose material points remember: stress and tangent at quadrature points.

The points are updated by the kernel of their kind (:class:`MaterialPoints`), whatever that is. With
its stress P and tangent A = ∂P/∂F a loop over the cells (:mod:`tribox.forms.bodies.point_cells`)
gives

    ∫ P·B(v) dΩ₀,   ∫ B(v)·A·B(δu) dΩ₀,   B(v) = (v_1,1, v_1,2, v_2,1, v_2,2, v_1/x),

the same for every material and kind of cell; in space B has the nine components of the gradient,
row by row; in plane strain the last one, across the plane, is zero. What the points remember keeps
the volume. Where their stress stands for all of the material's, only the distortional part of
``q1-sri`` goes this way: the volumetric energy at the centre of a cell is that of
:mod:`tribox.forms.bodies.solid`, with the pressure that its tangent carries. Where it is added to
that of a strain energy, that energy stays beside it.
"""

from __future__ import annotations

import math

import basix
import dolfinx
import numpy as np
from numpy.typing import NDArray

from tribox.forms.bodies.elastoplastic import PLASTIC_STRAIN
from tribox.forms.bodies.kinematics import Section, section_of
from tribox.forms.bodies.materials import Hencky, Material
from tribox.forms.bodies.point_cells import NAMES, PointCells, cells_of, moduli_in_place
from tribox.forms.bodies.point_state import (
    DISSIPATED,
    Evaluation,
    Floats,
    Kernel,
    MaterialPoints,
    Origin,
    PointHistory,
    PointState,
)
from tribox.forms.bodies.point_stress import PointStress, StressAt, as_tensors, cauchy_of
from tribox.forms.bodies.solid import Formulation, Solid

Ints = NDArray[np.int32]


def make_solid(
    name: str,
    u: dolfinx.fem.Function,
    cells: Ints,
    material: Material,
    formulation: Formulation,
    density: float = 0.0,
    section: Section | None = None,
) -> Solid:
    """The body of a material, whether its points remember or not; as :class:`Solid`."""
    space = section_of(u.function_space.mesh.geometry.dim, section) == "3D"
    kind = Solid if material.points(space) is None else MemorySolid
    return kind(name, u, cells, material, formulation, density, section)


class MemorySolid(Solid):
    """A body of a material whose points remember; ``count``: of a cell; ``point_cells``: loop.

    ``law``: how they answer; ``points``: what they remember, in the order of the cells.
    """

    remembers = True

    # -- forms --------------------------------------------------------------------------------

    def _start_points(self) -> None:
        """Make the points, and the loop over the cells that evaluates them."""
        space = self.section == "3D"
        law = self.material.points(space)
        assert law is not None, "the material has no points that remember"
        self.law, self._frozen, self.flows = law, law.frozen(), law.flows
        cells = cells_of(self._u.function_space, self.section, self.cells, self.full_degree)
        self._volumes = cells.weights
        self.point_cells = PointCells(self.section, cells)
        self.count, self._width = len(cells.shape), 9 if space else 5
        self.points = PointState(law.start(cells.count))
        self._forces: Floats = np.zeros_like(self._u.x.array)
        self._dissipated: Floats = np.zeros(2)
        self._last_kernel: tuple[MaterialPoints, float, Kernel | None] | None = None
        self._adopted: Origin | None = None  # of a step that is still to be made again

    @property
    def elastic(self) -> Material | None:
        if self.law.added:
            return self.material.elastic
        elastic = self.material.elastic if self.reduced else None
        return Hencky(0.0, elastic.bulk_modulus) if isinstance(elastic, Hencky) else None

    # -- evaluation ---------------------------------------------------------------------------

    def evaluate(self, dt: float = math.inf, tangent: bool = False) -> bool:
        u, points = self._u.x.array, self.points
        # The duration that the material feels.
        dt = dt if self.law.rated else math.inf
        found = points.known(u, dt)
        if found is None:
            self.point_cells.moduli.end = None  # it may be in the arrays that are used again
            origin = Origin(points.committed, dt)
            found = points.trial = self._evaluated(origin, points.spare())
        if tangent:
            self._prepare_tangent(self._tangent_start(u, dt))
        self._forces = found.forces
        return found.valid

    def _prepare_tangent(self, origin: Origin) -> None:
        """Let the loop know how to come to the moduli from ``origin``, or give it those."""
        law, moduli = self._frozen if origin.elastic else self.law, self.point_cells.moduli
        self.points.lend(origin.values)  # they may be asked for until long after this step
        moduli.kernel, moduli.state = self._kernel(law, origin.dt), origin.values
        if moduli.kernel is None:
            F = self._gradients()
            update = law.update(F, origin.values, origin.dt, True, volumetric=not self.reduced)
            assert update.A is not None
            moduli.A = moduli_in_place(F, update.P, update.A)
            return
        moduli.end = None
        if not self.flows:  # the end has a closed form, quicker than to read it
            return
        # The loop differentiates the return mapping where it ended. If an evaluation went from this
        # origin to this displacement, its end is known and the local Newton iterations are not made
        # again.
        known = (self.points.trial, self.points.last)
        u = self._u.x.array
        same = (one for one in known if one is not None and one.led_from(origin, u))
        found = next(same, None) or self._evaluated(origin)
        moduli.end = found.values if found.valid else None

    def _gradients(self) -> Floats:
        """Deformation gradients (k, p) at the present displacement."""
        return self.point_cells.deformation(self._u.x.array)

    def _tangent_start(self, u: Floats, dt: float) -> Origin:
        """From where the tangent at ``u`` (n,), m, is taken."""
        if self.unloading:
            return Origin(self.points.committed, dt, elastic=True)
        if not self.flows:  # there is no edge to be on: see `PointState.tangent_origin`
            return Origin(self.points.committed, dt)
        return self.points.tangent_origin(u, dt)

    def evaluate_elastic(self) -> bool:
        found = self._evaluated(Origin(self.points.committed, math.inf, elastic=True))
        self._forces = found.forces
        return found.valid

    def add_point_forces(self, out: Floats) -> None:
        out += self._forces

    def _kernel(self, law: MaterialPoints, dt: float) -> Kernel | None:
        """What the loop updates the points with; None: they are updated in Python."""
        last = self._last_kernel
        if last is None or last[0] is not law or last[1] != dt:
            kernel = law.kernel(NAMES[self.section], dt, volumetric=not self.reduced)
            self._last_kernel = last = law, dt, kernel
        return last[2]

    def _evaluated(self, origin: Origin, spare: Evaluation | None = None) -> Evaluation:
        """The points at the present displacement, from ``origin``, with their forces."""
        law = self._frozen if origin.elastic else self.law
        energies: Floats = np.zeros(3)
        kernel = self._kernel(law, origin.dt)
        if spare is None or kernel is None:
            u: Floats = np.empty_like(self._u.x.array)
            forces: Floats = np.empty_like(self._u.x.array)
            end: Floats = np.empty_like(origin.values)
        else:
            u, forces, end = spare.u, spare.forces, spare.values
        u[:], forces[:] = self._u.x.array, 0.0
        if kernel is None:
            F = self._gradients()
            update = law.update(F, origin.values, origin.dt, False, volumetric=not self.reduced)
            self.point_cells.add_forces(u, update.P, forces)
            end, valid = update.state, update.valid
            energies = np.array([self._integral(x) for x in (update.elastic, update.dissipation)])
        else:
            out = {"end": end, "energies": energies, "forces": forces}
            valid = self.point_cells.evaluate(kernel, u, origin.values, **out)
        return Evaluation(u, origin, self.points.number, end, energies, forces, valid)

    def _present(self) -> Evaluation:
        """The points at the present displacement, evaluated at rest if that was not done last."""
        found = self.points.at(self._u.x.array)
        return found or self._evaluated(Origin(self.points.committed, math.inf))

    # -- history ------------------------------------------------------------------------------

    def commit(self) -> None:
        before = self.points.last
        done = self.points.commit(self._u.x.array)
        if done is not None and self._adopted is None:
            comm = self._u.function_space.mesh.comm
            self._dissipated = self._dissipated + done.dissipation(before, comm)
        self._adopted = None

    def _integral(self, values: Floats) -> float:
        """Integral over this rank's part of the body of values (k,), by reference volume."""
        return float(self._volumes @ values)

    @property
    def dissipated(self) -> Floats:
        return self._dissipated

    @property
    def dissipated_by_part(self) -> Floats:
        # Branches sum up in their state what each has lost; metals and softening have no such
        # parts.
        at = self.law.columns.get(DISSIPATED, slice(0, 0))
        return np.array([self._integral(lost) for lost in self.points.committed[:, at].T])

    def point_energy(self) -> float:
        return float(self._present().energies[0])

    def history(self) -> PointHistory:
        last = self.points.last
        if last is not None:
            self.points.lend(last.origin.values)
        return PointHistory(None if last is None else last.origin, self._dissipated)

    def cell_rows(self, values: Floats) -> Floats:
        return values.reshape(len(self.cells), self.count * self.points.width)

    def point_rows(self, values: Floats) -> Floats:
        return np.ascontiguousarray(values).reshape(-1, self.points.width)

    def adopt(self, history: PointHistory) -> None:
        origin = history.origin
        self.points.begin(None if origin is None else origin.values)
        self._dissipated = np.asarray(history.dissipated, dtype=np.float64)
        self._adopted = origin

    def repeat_step(self) -> None:
        if self._adopted is not None:
            self.evaluate(self._adopted.dt)
            self.commit()

    # -- results ------------------------------------------------------------------------------

    def stress_at(self, cells: Ints, xi: Floats | None) -> StressAt:
        beside = PointStress(self.material, self.section) if self.law.added else None
        return PointValues(self, cells, xi, beside)

    def point_stress(self) -> Floats:
        """Cauchy stress (c, q, 3, 3), Pa, that the forms take from the points.

        All of it, of ``q1-sri`` the distortional part, or what is added to a strain energy's.
        """
        origin = self._present().origin
        law = self._frozen if origin.elastic else self.law
        F = self._gradients()
        found = law.update(F, origin.values, origin.dt, False, volumetric=not self.reduced)
        sigma = cauchy_of(as_tensors(found.P), as_tensors(F))
        return sigma.reshape(len(self.cells), self.count, 3, 3)

    @property
    def felt_step(self) -> float:
        """Duration of the last committed step as the points felt it, s; infinite without rates."""
        last = self.points.last
        return math.inf if last is None else last.origin.dt

    def largest_flow(self) -> tuple[float, float]:
        """Largest equivalent plastic strain of this rank, and its largest growth in one step.

        Both of what was committed; the growth is that of the last step.
        """
        last = self.points.last
        if last is None:
            return 0.0, 0.0
        at = self.law.columns[PLASTIC_STRAIN]
        now, before = last.values[:, at], last.origin.values[:, at]
        return float(now.max(initial=0.0)), float((now - before).max(initial=0.0))

    def plastic_strain(self) -> Floats:
        """Equivalent plastic strain (c, q) at the points; of those that do not flow 0."""
        if not self.flows:
            return np.zeros((len(self.cells), self.count))
        return self.variable(PLASTIC_STRAIN)[..., 0]

    def variable(self, name: str) -> Floats:
        """What the points remember under a name (c, q, …), see ``MaterialPoints.columns``."""
        values = self._present().values[:, self.law.columns[name]].copy()
        return np.asarray(values.reshape(len(self.cells), self.count, -1))


# -- Values of material points at other places of their cells --------------------------------------
#
# Stress and plastic strain are known at the quadrature points alone. Elsewhere in a cell they are
# taken from the linear function of the reference coordinates that fits the cell's points best: the
# function through them where there are no more of them than it has coefficients, and their mean at
# the centre.
#
# Axis letters: k places, c cells, q quadrature points of a cell, p components.


def fit_weights(kind: str, degree: int, xi: Floats) -> Floats:
    """Shares (k, q) of a cell's quadrature points in values at ξ (k, α)."""
    points, _ = basix.make_quadrature(basix.CellType[kind], degree)
    centre = points.mean(axis=0)

    def linear(at: Floats) -> Floats:
        return np.column_stack([np.ones(len(at)), at - centre])

    # Least squares over the quadrature points: value at ξ = row(ξ) · (pseudo-inverse of the points'
    # rows) · values, so that the product is the weight of each of them.
    return np.asarray(linear(xi) @ np.linalg.pinv(linear(points)))


class PointValues:
    """Stress and equivalent plastic strain of a body at places of its cells."""

    def __init__(
        self, solid: MemorySolid, cells: Ints, xi: Floats | None, beside: StressAt | None = None
    ) -> None:
        """Find the shares for cells (k,), ξ (k, α); ``beside``: gives what they are added to."""
        self._solid, self._beside = solid, beside
        self._rows = np.searchsorted(solid.cells, cells)
        self._share: Floats | None = None
        if xi is not None:
            share = fit_weights(solid.cell, solid.full_degree, xi)
            self._share = np.broadcast_to(share, (len(cells), share.shape[1]))

    def cauchy(self, F: Floats, volumetric: Floats | None = None) -> Floats:
        """Cauchy stress (k, 3, 3), Pa, at F (k, 3, 3) of what is beside the points.

        ``volumetric``: (k, 3, 3), of the volumetric energy in selective reduced integration.
        """
        found = self._at_places(self._solid.point_stress())
        if self._beside is not None:
            return found + self._beside.cauchy(F, volumetric)
        if volumetric is not None:
            found = found + _volumetric_stress(self._solid.material, volumetric)
        return found

    def plastic_strain(self) -> Floats:
        """Equivalent plastic strain (k,), not negative."""
        # The linear fit undershoots 0 beside the edge of the plastic zone.
        return np.maximum(self._at_places(self._solid.plastic_strain()), 0.0)

    def _at_places(self, values: Floats) -> Floats:
        """Values (k, …) from those (c, q, …) of the points."""
        if self._share is None:
            return np.ascontiguousarray(values.swapaxes(0, 1)).reshape(-1, *values.shape[2:])
        return np.asarray(np.einsum("kq,kq...->k...", self._share, values[self._rows]))


def _volumetric_stress(material: Material, F: Floats) -> Floats:
    """Stress K ln J/J I (k, 3, 3), Pa, of the volumetric energy K/2 (ln J)²."""
    J = np.linalg.det(F)
    return np.asarray((material.bulk_modulus * np.log(J) / J)[:, None, None] * np.eye(3))
