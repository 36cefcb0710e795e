"""Bodies in UFL: kinematics, energies and forms that loops over cells are held to."""

import itertools
from dataclasses import dataclass, fields, replace
from typing import Any

import dolfinx
import numpy as np
import ufl
from ufl.algorithms import expand_derivatives
from ufl.corealg.multifunction import MultiFunction
from ufl.corealg.traversal import unique_pre_traversal

from tribox.forms.bodies.kinematics import body_measure, circumference
from tribox.forms.bodies.materials import Hencky, MooneyRivlin, NeoHookean, Yeoh
from tribox.forms.bodies.memory_solid import MemorySolid

Expr = Any

# -- kinematics ------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class PlanePart:
    """The in-plane part of a deformation that does not tilt the normal of the plane."""

    # λ₃ across the plane: one in plane strain, the hoop stretch of a body of revolution
    stretch: Expr
    J: Expr  # det F of the in-plane part
    I1: Expr  # tr FᵀF of the in-plane part


@dataclass(frozen=True, slots=True)
class Kinematics:
    """A deformation and its invariants."""

    F: Expr  # deformation gradient (i, j), a UFL variable; of a plane the in-plane part
    J: Expr  # det of the whole, three-dimensional deformation gradient
    # tr C and ½((tr C)² − tr C²) of the three-dimensional C = FᵀF. In space these and J are UFL
    # variables, and all that a material may depend on
    I1: Expr
    I2: Expr  # likewise
    plane: PlanePart | None  # the in-plane part; None in space


def kinematics(u: Expr, section) -> Kinematics:
    """Kinematics of the displacement ``u`` (m)."""
    return _spatial(u) if section == "3D" else _plane(u, stretch_across(u, section))


def stretch_across(u: Expr, section) -> Expr:
    """λ₃ across the plane: 1 in plane strain, 1 + u_x/x of a body of revolution."""
    return 1.0 if section == "plane-strain" else 1.0 + u[0] / radius(u)


def radius(u: Expr) -> Expr:
    """Distance from the axis, m, reference."""
    return ufl.SpatialCoordinate(ufl.domain.extract_unique_domain(u))[0]


def centre_kinematics(u: Expr, section) -> Kinematics:
    """Kinematics from which the volume of a cell is taken at its centre.

    The volume of a ring's cell of width h at the radius R has its centroid at R + h²/(12 R). The
    work of an axial stress in a rectangular cell is that at the centroid, the work of a hoop stress
    that at R; next to the axis the two are h/6 apart. The in-plane gradient is therefore
    extrapolated to the centroid by its own derivative.
    """
    if section != "axisymmetric":
        return kinematics(u, section)
    edges = ufl.Jacobian(ufl.domain.extract_unique_domain(u))
    # J Jᵀ e_R/(12 R), see `tribox.forms.bodies.deformation.centre_rows`, which is the same in
    # numpy.
    away = ufl.dot(edges, edges[0, :]) / (12.0 * radius(u))
    gradient = ufl.Identity(2) + ufl.grad(u) + ufl.dot(ufl.grad(ufl.grad(u)), away)
    return _plane(u, stretch_across(u, section), gradient)


def _plane(u: Expr, stretch: Expr, gradient: Expr = None) -> Kinematics:
    F = ufl.variable(ufl.Identity(2) + ufl.grad(u) if gradient is None else gradient)
    return plane_kinematics(F, PlanePart(stretch, ufl.det(F), ufl.inner(F, F)))


def plane_kinematics(F: Expr, plane: PlanePart) -> Kinematics:
    """Kinematics of an in-plane deformation gradient with the invariants of ``plane``."""
    # Eigenvalues of C: those of the in-plane part, with product J₂², and λ₃².
    return Kinematics(
        F=F,
        J=plane.J * plane.stretch,
        I1=plane.I1 + plane.stretch**2,
        I2=plane.I1 * plane.stretch**2 + plane.J**2,
        plane=plane,
    )


def _spatial(u: Expr) -> Kinematics:
    F = ufl.variable(ufl.Identity(3) + ufl.grad(u))
    # I2 is the sum of squares of all cofactors: no cancellation as in (tr C)² − tr C².
    cofactors = ufl.cofac(F)
    invariants = (ufl.det(F), ufl.inner(F, F), ufl.inner(cofactors, cofactors))
    J, I1, I2 = (ufl.variable(invariant) for invariant in invariants)
    return Kinematics(F=F, J=J, I1=I1, I2=I2, plane=None)


class WithoutVariables(MultiFunction):
    """Replaces variables by their expressions; UFL's own visits shared parts many times.

    Variables are numbered over the whole process and the number enters FFCx's cache key: with
    them, the same expression would be compiled again in almost every run.
    """

    expr = MultiFunction.reuse_if_untouched

    def variable(self, o: Any, operand: Any, label: Any) -> Any:
        """The expression itself."""
        return operand


# -- energies --------------------------------------------------------------------------------------

LOGARITHM_TERMS = 10  # of the series for the logarithmic strain in space


def isochoric(k):
    return k.J ** (-2.0 / 3.0) * k.I1, k.J ** (-4.0 / 3.0) * k.I2


def simo_taylor(k, c):
    return 0.25 * c["K"] * (k.J**2 - 1.0 - 2.0 * ufl.ln(k.J))


def neo_hookean(k, c):
    return 0.5 * c["G"] * (k.I1 - 3.0) - c["G"] * ufl.ln(k.J)


def mooney_rivlin(k, c):
    I1, I2 = isochoric(k)
    return c["C10"] * (I1 - 3.0) + c["C01"] * (I2 - 3.0)


def yeoh(k, c):
    x = isochoric(k)[0] - 3.0
    return x * (c["C10"] + x * (c["C20"] + x * c["C30"]))


def hencky(k, c):
    if getattr(k, "plane", None) is None:
        return c["G"] * squared_logarithm(*isochoric(k))
    plane = k.plane
    in_plane = squared_arcosh(plane.I1 / (2.0 * plane.J) - 1.0) + ufl.ln(plane.J) ** 2
    return c["G"] * (0.5 * in_plane + ufl.ln(plane.stretch) ** 2 - ufl.ln(k.J) ** 2 / 3.0)


def squared_arcosh(x):
    """arcosh(1 + x)² by its Taylor series up to x = 0.02, where arcosh is not differentiable."""
    series = x * (
        2.0 + x * (-1 / 3 + x * (4 / 45 + x * (-1 / 35 + x * (16 / 1575 + x * (-8 / 2079)))))
    )
    large = ufl.conditional(ufl.gt(x, 0.02), x, 0.02)
    exact = ufl.ln(1.0 + large + ufl.sqrt(large * (large + 2.0))) ** 2
    return ufl.conditional(ufl.gt(x, 0.02), exact, series)


def squared_logarithm(I1, I2):
    """|dev ln U|² in space by the series of Hencky's docstring, by the invariants of Z.

    These are (Ī2 − Ī1, 6 − Ī1 − Ī2, Ī1 − Ī2)/(Ī1 + Ī2 + 2); from those of Z² the traces of its
    powers follow by Newton's identities.
    """
    below = I1 + I2 + 2.0
    even, odd = (I1 + I2 - 6.0) / below, ((I2 - I1) / below) ** 2
    e1, e2, e3 = 2.0 * even + odd, even**2 + 2.0 * odd, odd
    powers = [e1, e1**2 - 2.0 * e2]
    powers.append(e1 * powers[1] - e2 * e1 + 3.0 * e3)
    while len(powers) < LOGARITHM_TERMS:
        powers.append(e1 * powers[-1] - e2 * powers[-2] + e3 * powers[-3])
    factor, total = 0.0, 0.0
    for n, power in enumerate(powers, start=1):
        factor += 1.0 / (2 * n - 1)
        total = total + factor / n * power
    return total


class _InUfl:
    """No C source knows these, so that forms are compiled for them."""

    def energy(self, k, c):
        return self.distortional(k, c), self.volumetric(k, c)


def _kind(material, distortional, volumetric):
    of = {"distortional": staticmethod(distortional), "volumetric": staticmethod(volumetric)}
    return type(f"{material.__name__}InUfl", (_InUfl, material), of)


KINDS = {
    material: _kind(material, *parts)
    for material, parts in {
        NeoHookean: (neo_hookean, lambda k, c: 0.5 * c["L"] * ufl.ln(k.J) ** 2),
        MooneyRivlin: (mooney_rivlin, simo_taylor),
        Yeoh: (yeoh, simo_taylor),
        Hencky: (hencky, lambda k, c: 0.5 * c["K"] * ufl.ln(k.J) ** 2),
    }.items()
}


def in_ufl(material):
    """The same material, with its energy in UFL."""
    values = {field.name: getattr(material, field.name) for field in fields(material)}
    return KINDS[type(material)](**values)


def parts_of(material, k, c):
    """Distortional and volumetric energy, of the constants ``c``."""
    if type(material) not in KINDS:
        return material.energy(k, c)
    return material.energy(k, c) if hasattr(material, "energy") else in_ufl(material).energy(k, c)


# -- forms -----------------------------------------------------------------------------------------


@dataclass(slots=True)
class CompiledForms:
    """Forms of one integral: energy (scalar), residual (vector) and tangent (matrix)."""

    energy: dolfinx.fem.Form
    residual: dolfinx.fem.Form
    tangent: dolfinx.fem.Form


def compile_energy(density: Any, measure: Any, u: dolfinx.fem.Function) -> CompiledForms:
    """Compile ∫ W dΩ₀ and its first and second derivatives in the direction of ``u``'s space."""
    total = density * measure
    test, trial = ufl.TestFunction(u.function_space), ufl.TrialFunction(u.function_space)
    residual = ufl.derivative(total, u, test)
    return CompiledForms(
        energy=dolfinx.fem.form(total),
        residual=dolfinx.fem.form(residual),
        tangent=dolfinx.fem.form(ufl.derivative(residual, u, trial)),
    )


def compile_isotropic(
    energy, k: Kinematics, measure: Any, u: dolfinx.fem.Function
) -> CompiledForms:
    """Compile an energy W(J, I1, I2) in space, by the chain rule over the invariants.

    δW = W_i δI_i and ΔδW = W_ij δI_i ΔI_j + W_i ΔδI_i: test and trial functions stay out of W and
    its derivatives, which may be long.
    """
    space = u.function_space
    test, trial = ufl.TestFunction(space), ufl.TrialFunction(space)
    density, invariants = energy(k), (k.J, k.I1, k.I2)
    # What a derivative depends on is seen of bare variables, whose own need not be expanded.
    bare = [ufl.variable(dolfinx.fem.Constant(space.mesh, 1.0)) for _ in invariants]
    plain = energy(replace(k, J=bare[0], I1=bare[1], I2=bare[2]))
    used = [i for i, own in enumerate(bare) if _depends(plain, own)]
    shapes = {i: expand_derivatives(ufl.diff(plain, bare[i])) for i in used}
    slopes = {i: ufl.diff(density, invariants[i]) for i in used}
    first = {i: ufl.derivative(invariants[i], u, test) for i in used}
    second = {i: ufl.derivative(invariants[i], u, trial) for i in used}
    residual = sum(slopes[i] * first[i] for i in used)
    tangent = sum(slopes[i] * ufl.derivative(first[i], u, trial) for i in used)
    for i, j in itertools.product(used, repeat=2):
        if _depends(shapes[i], bare[j]):
            tangent += ufl.diff(slopes[i], invariants[j]) * first[i] * second[j]
    return CompiledForms(
        energy=dolfinx.fem.form(density * measure),
        residual=dolfinx.fem.form(residual * measure),
        tangent=dolfinx.fem.form(tangent * measure),
    )


def _depends(expression: Any, variable: Any) -> bool:
    return any(part == variable for part in unique_pre_traversal(expression))


def forms_of(solid):
    """The forms of a body's strain energy, but for what is at points that remember.

    A linear form of two quadrature degrees is compiled wrongly by FFCx 0.9: each has its own.
    """
    material = solid.material
    beside = isinstance(solid, MemorySolid) and not solid.law.added
    material = getattr(material, "elastic", material)
    known = solid.__dict__.setdefault("forms_in_ufl", {})
    key = tuple(material.parameters().items())
    if key in known:
        return known[key]
    u, section = solid.displacement, solid.section
    mesh = u.function_space.mesh
    c = {name: dolfinx.fem.Constant(mesh, value) for name, value in material.parameters().items()}

    def compiled(k, energy, degree):
        dx = body_measure(mesh, solid.cells, degree)
        if section == "3D":
            return compile_isotropic(energy, k, dx, u)
        return compile_energy(circumference(mesh, section) * energy(k), dx, u)

    k, whole, found = kinematics(u, section), solid.full_degree, []
    if not beside and not solid.reduced:
        found.append(compiled(k, lambda k: sum(parts_of(material, k, c)), whole))
    elif not beside:
        found.append(compiled(k, lambda k: parts_of(material, k, c)[0], whole))
    if solid.reduced:
        centre = centre_kinematics(u, section)
        found.append(compiled(centre, lambda k: parts_of(material, k, c)[1], 1))
    known[key] = found
    return found


class InForms:
    """What :class:`Bodies` has of one body, by its forms."""

    def __init__(self, solid):
        self._solid = solid

    def add_forces(self, out):
        for part in forms_of(self._solid):
            dolfinx.fem.assemble_vector(out, part.residual)
        return bool(np.isfinite(out.sum()))

    def evaluate(self, u, out):
        out[:] = 0.0
        return self.add_forces(out)

    def strain_energy(self):
        return sum(dolfinx.fem.assemble_scalar(part.energy) for part in forms_of(self._solid))


def carried_tangent(solid):
    """The form of (p − U') ∂²J/∂u² for the pressures that were carried last."""
    u = solid.displacement
    space = u.function_space
    excess = dolfinx.fem.Function(dolfinx.fem.functionspace(space.mesh, ("DG", 0)))
    excess.x.array[excess.function_space.dofmap.list[solid.cells, 0]] = solid.carried.excess()
    test, trial = ufl.TestFunction(space), ufl.TrialFunction(space)
    J = centre_kinematics(u, solid.section).J
    second = ufl.derivative(ufl.derivative(J, u, test), u, trial)
    weight = circumference(space.mesh, solid.section)
    return dolfinx.fem.form(weight * excess * second * body_measure(space.mesh, solid.cells, 1))
