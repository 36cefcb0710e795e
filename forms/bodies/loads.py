"""Loads on surfaces: forms that are compiled once, and the values they are set to."""

from __future__ import annotations

from typing import Any

import dolfinx
import numpy as np
import ufl
from numpy.typing import NDArray
from petsc4py import PETSc

from tribox.forms.bodies.kinematics import Section, body_measure, circumference, section_of
from tribox.geometry.compat import integration_facets
from tribox.geometry.surfaces.facets import Floats, Ints


class Load:
    """What an equilibrium needs of a load: forms, proportional to ``value``, set before.

    A dead load, which the displacement does not change, has no tangent.
    """

    def __init__(
        self,
        value: dolfinx.fem.Constant,
        residual: dolfinx.fem.Form,
        tangent: dolfinx.fem.Form | None = None,
    ) -> None:
        self.value, self.residual, self.tangent = value, residual, tangent

    @property
    def amount(self) -> Floats:
        """The present value (k,), a copy."""
        return np.array(self.value.value, dtype=np.float64).reshape(-1)

    @amount.setter
    def amount(self, amount: Floats) -> None:
        self.value.value = np.reshape(amount, self.value.value.shape)

    @property
    def acts(self) -> bool:
        """Whether the value is anything but zero."""
        return bool(np.any(self.value.value))

    @property
    def drive(self) -> Floats:
        """What pushes, all in one unit (k,): what the path of a solution is continued by."""
        return self.amount


class FollowerPressure(Load):
    """A pressure normal to the deformed surface: δW = −∫ p cof(F) N · δu dΓ₀.

    Attributes:
        value: the present pressure, Pa.
    """

    def __init__(
        self, u: dolfinx.fem.Function, facets: NDArray[np.int32], section: Section | None = None
    ) -> None:
        """Compile the forms for local facets with ghosts, and ``u``, m; a usual section if None."""
        space = u.function_space
        mesh, dim = space.mesh, space.mesh.geometry.dim
        section = section_of(dim, section)
        value = dolfinx.fem.Constant(mesh, PETSc.ScalarType(0.0))
        # Tangents of the deformed surface, their product and δu: exact on straight facets.
        degree = 2 if space.ufl_element().degree == 1 else 5
        ds = surface_measure(mesh, facets, degree)
        test, trial = ufl.TestFunction(space), ufl.TrialFunction(space)
        gradient = ufl.Identity(dim) + ufl.grad(u)
        if dim == 3:
            area = ufl.dot(ufl.cofac(gradient), ufl.FacetNormal(mesh))
        else:
            # Deformed, without a division that fails on the axis.
            across = circumference(mesh, section, u)
            area = across * ufl.det(gradient) * ufl.inv(gradient).T * ufl.FacetNormal(mesh)
        power = value * ufl.inner(area, test) * ds
        tangent = dolfinx.fem.form(ufl.derivative(power, u, trial))
        super().__init__(value, dolfinx.fem.form(power), tangent)

    def set(self, pressure: float) -> None:
        """Set the pressure, Pa, positive when it pushes on the body."""
        self.value.value = pressure


class DeadTraction(Load):
    """A force over reference area that keeps its direction: δW = −∫ t · δu dΓ₀.

    Attributes:
        value: the present traction (i,), Pa.
    """

    def __init__(
        self, u: dolfinx.fem.Function, facets: Ints, section: Section | None = None
    ) -> None:
        """Compile the load's form for local facets, owned and ghosts; see FollowerPressure."""
        space = u.function_space
        mesh = space.mesh
        value = _vector(mesh, mesh.geometry.dim)
        weight = circumference(mesh, section_of(mesh.geometry.dim, section))
        ds = surface_measure(mesh, facets, space.element.basix_element.degree + 1)
        power = -weight * ufl.inner(value, ufl.TestFunction(space)) * ds
        super().__init__(value, dolfinx.fem.form(power))


class BodyForce(Load):
    """An acceleration g on the mass of a body: δW = −∫ ρ g · δu dΩ₀.

    Attributes:
        value: the present acceleration (i,), m/s².
    """

    def __init__(
        self, u: dolfinx.fem.Function, cells: Ints, density: float, section: Section | None = None
    ) -> None:
        """Compile the load's form.

        Args:
            u: displacement, m.
            cells: owned cells of the body.
            density: kg/m³, of the undeformed body.
            section: what the mesh stands for; by default plane strain, or a body in space.
        """
        space = u.function_space
        mesh = space.mesh
        value = _vector(mesh, mesh.geometry.dim)
        mass = dolfinx.fem.Constant(mesh, PETSc.ScalarType(density))
        weight = circumference(mesh, section_of(mesh.geometry.dim, section))
        dx = body_measure(mesh, cells, space.element.basix_element.degree + 1)
        power = -mass * weight * ufl.inner(value, ufl.TestFunction(space)) * dx
        super().__init__(value, dolfinx.fem.form(power))


class Foundation(Load):
    r"""Springs all over a surface, with the normal N of the undeformed surface.

    .. math:: \delta W = \int (k_n N N^T + k_t (I - N N^T)) (u - u_0) \cdot \delta u \, d\Gamma_0

    Attributes:
        value: displacement u₀ (i,) of the base, m, then k_n and k_t, Pa/m.
        strongest: Pa/m, the largest stiffness that was ever set.
        shares: (n,), m² (per unit thickness m), integrals of the shape functions of the owned
            unknowns over the surface; along: those times the square of the normal's component.
    """

    def __init__(
        self, u: dolfinx.fem.Function, facets: Ints, section: Section | None = None
    ) -> None:
        """Compile the forms for local facets, owned and ghosts; see FollowerPressure."""
        space = u.function_space
        mesh, dim = space.mesh, space.mesh.geometry.dim
        value = _vector(mesh, dim + 2)
        weight = circumference(mesh, section_of(dim, section))
        ds = surface_measure(mesh, facets, 2 * space.element.basix_element.degree + 1)
        test, trial = ufl.TestFunction(space), ufl.TrialFunction(space)
        normal, along = ufl.FacetNormal(mesh), value[dim] - value[dim + 1]

        def power(moved: Any) -> Any:
            stretched = ufl.inner(moved, normal) * ufl.inner(normal, test)
            return weight * (along * stretched + value[dim + 1] * ufl.inner(moved, test)) * ds

        base = ufl.as_vector([value[i] for i in range(dim)])
        super().__init__(value, dolfinx.fem.form(power(u - base)), dolfinx.fem.form(power(trial)))
        self.strongest = 0.0
        mix = _vector(mesh, 2)
        squares = ufl.as_vector([mix[0] + mix[1] * normal[i] ** 2 for i in range(dim)])
        form = dolfinx.fem.form(weight * ufl.inner(squares, test) * ds)
        mix.value = [1.0, 0.0]
        self.shares = owned_values(space, form)
        mix.value = [0.0, 1.0]
        self.along = owned_values(space, form)

    @property
    def amount(self) -> Floats:
        """The present value (i + 2,), a copy."""
        return super().amount

    @amount.setter
    def amount(self, amount: Floats) -> None:
        self.value.value = amount
        self.strongest = max(self.strongest, self.stiffness)

    @property
    def stiffness(self) -> float:
        """The larger of k_n and k_t, Pa/m."""
        return float(np.max(self.value.value[-2:]))

    @property
    def acts(self) -> bool:
        """Whether there is any stiffness."""
        return self.stiffness > 0.0

    @property
    def held(self) -> Ints:
        """Owned local unknowns that the springs draw at."""
        normal, tangential = self.value.value[-2:]
        springs = normal * self.along + tangential * (self.shares - self.along)
        return np.nonzero(np.abs(springs) > 1e-12 * self.stiffness * self.shares)[0].astype(
            np.int32
        )

    @property
    def drive(self) -> Floats:
        """The base's displacement times each stiffness (2 i,), Pa."""
        value = self.value.value
        return np.outer(value[-2:], value[:-2]).reshape(-1)


def owned_values(space: dolfinx.fem.FunctionSpace, form: dolfinx.fem.Form) -> Floats:
    """A linear form's values (n,) at the owned unknowns; collective."""
    index, dim = space.dofmap.index_map, space.dofmap.index_map_bs
    vector = dolfinx.la.vector(index, dim)
    dolfinx.fem.assemble_vector(vector.array, form)
    vector.scatter_reverse(dolfinx.la.InsertMode.add)
    return vector.array[: index.size_local * dim].copy()


def _vector(mesh: dolfinx.mesh.Mesh, size: int) -> dolfinx.fem.Constant:
    return dolfinx.fem.Constant(mesh, np.zeros(size, dtype=PETSc.ScalarType))


def reference_area(
    mesh: dolfinx.mesh.Mesh, facets: NDArray[np.int32], section: Section | None = None
) -> float:
    """Area of local facets, undeformed, m², of whole rings; m in plane strain; collective."""
    section = section_of(mesh.geometry.dim, section)
    one = dolfinx.fem.Constant(mesh, PETSc.ScalarType(1.0))
    form = dolfinx.fem.form(one * circumference(mesh, section) * surface_measure(mesh, facets))
    return float(mesh.comm.allreduce(dolfinx.fem.assemble_scalar(form)))


def mean_normal(mesh: dolfinx.mesh.Mesh, facets: NDArray[np.int32]) -> Floats:
    """Mean (i,) of outward normals over facets, of length one where they are flat; collective."""
    ds = surface_measure(mesh, facets)
    unit = _vector(mesh, mesh.geometry.dim)
    form = dolfinx.fem.form(ufl.inner(ufl.FacetNormal(mesh), unit) * ds)
    total = np.zeros(mesh.geometry.dim)
    for component in range(mesh.geometry.dim):
        unit.value = np.eye(mesh.geometry.dim)[component]
        total[component] = dolfinx.fem.assemble_scalar(form)
    total = mesh.comm.allreduce(total)
    size = reference_area(mesh, facets)
    return total / size if size > 0.0 else total


def surface_measure(
    mesh: dolfinx.mesh.Mesh, facets: NDArray[np.int32], degree: int | None = None
) -> Any:
    """Surface measure over local facets, of a quadrature degree."""
    return ufl.Measure(
        "ds",
        domain=mesh,
        subdomain_data=[(1, integration_facets(mesh, facets))],
        metadata={} if degree is None else {"quadrature_degree": degree},
    )(1)
