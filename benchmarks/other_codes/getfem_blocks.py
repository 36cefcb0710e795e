"""The problem by GetFEM, as its own users would write it.

``python3 getfem_blocks.py PROBLEM.json REPORT.json WAY``, by the Python that has GetFEM. It imports
nothing of tribox. WAY is how contact is enforced:

penalty: pressure and friction of a penalty, as in the other codes, written in GetFEM's language of
    weak forms; the friction stress of the last step is kept at the integration points.
multipliers: GetFEM's own brick for large sliding, with Lagrange multipliers (augmented
    Lagrangian): no penetration and no elastic slip.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import getfem as gf
import numpy as np

TOP, BOTTOM, CONTACT = 1, 2, 3
RELEASE = 0.2  # mm, how far apart surfaces may be to be looked at
ENERGY = "0.5*G{k}*(Norm_sqr(F{k}) - 3) - G{k}*log(Det(F{k})) + 0.5*L{k}*sqr(log(Det(F{k})))"
NORMAL = "Transformed_unit_vector(Grad_u1, Normal)"
SLIP = "(u1 - Interpolate(u2,pair) - w1 + Interpolate(w2,pair))"
GAP = f"((Interpolate(X,pair) + Interpolate(u2,pair) - X - u1).{NORMAL})"
TRACTION = f"Coulomb_friction_coupled_projection(kept, {NORMAL}, ratio*{SLIP}, {GAP}, mu, r)"
# The same of two sides: normals of the slave only.


def mesh_of(box: dict) -> gf.Mesh:
    """Equal hexahedra, with the regions of the sides at the bottom and at the top."""
    axes = [
        box["corner"][i] + box["size"][i] * np.arange(box["counts"][i] + 1) / box["counts"][i]
        for i in range(3)
    ]
    mesh = gf.Mesh("cartesian Q1", *axes)
    sides = mesh.outer_faces()
    up = mesh.normal_of_faces(sides)[1]
    mesh.set_region(BOTTOM, sides[:, np.nonzero(up < -0.9)[0]])
    mesh.set_region(TOP, sides[:, np.nonzero(up > 0.9)[0]])
    return mesh


class Blocks:
    """Both boxes as a model of GetFEM.

    Attributes:
        model: the model; contact: integration on the slave's sides.
    """

    def __init__(self, problem: dict, way: str) -> None:
        """Put the model together; see the module."""
        self.problem, self.way = problem, way
        self.used: list = []  # the model does not keep what it refers to
        self.model = gf.Model("real")
        self.meshes = [mesh_of(problem["upper"]), mesh_of(problem["lower"])]
        self.fields = [gf.MeshFem(mesh, 3) for mesh in self.meshes]
        rule = gf.Integ("IM_GAUSS_PARALLELEPIPED(3,3)")  # two points each way
        for k, name in enumerate(("soft", "stiff"), 1):
            field = self.fields[k - 1]
            field.set_fem(gf.Fem("FEM_QK(3,1)"))
            self.model.add_fem_variable(f"u{k}", field)
            self.model.add_fem_data(f"w{k}", field)
            E, nu = problem[name]
            self.model.add_initialized_data(f"G{k}", E / (2 * (1 + nu)))
            self.model.add_initialized_data(f"L{k}", E * nu / ((1 + nu) * (1 - 2 * nu)))
            self.model.add_macro(f"F{k}", f"(Id(3)+Grad_u{k})")
            points = gf.MeshIm(self.meshes[k - 1], rule)
            self.used.append(points)
            self.model.add_nonlinear_term(points, ENERGY.format(k=k))
        self._hold()
        self.contact = gf.MeshIm(self.meshes[0], gf.Integ("IM_GAUSS_PARALLELEPIPED(3,5)"))
        self.model.add_initialized_data("mu", problem["friction"])
        {"penalty": self._penalty, "multipliers": self._multipliers}[way]()

    def _hold(self) -> None:
        model = self.model
        for k, region in ((1, TOP), (2, BOTTOM)):
            model.add_initialized_data(f"held{k}", np.zeros(3))
            model.add_Dirichlet_condition_with_simplification(f"u{k}", region, f"held{k}")

    def _penalty(self) -> None:
        problem, model = self.problem, self.model
        model.add_initialized_data("r", problem["penalty"])
        model.add_initialized_data("ratio", problem["stick"] / problem["penalty"])
        self.store = gf.MeshImData(self.contact, BOTTOM, [3])
        model.add_im_data("kept", self.store)
        model.add_raytracing_transformation("pair", RELEASE)
        slave, master = self.meshes
        model.add_slave_contact_boundary_to_raytracing_transformation("pair", slave, "u1", BOTTOM)
        model.add_master_contact_boundary_to_raytracing_transformation("pair", master, "u2", TOP)
        work = f"Interpolate_filter(pair, {TRACTION}.(Interpolate(Test_u2,pair) - Test_u1), 1)"
        model.add_nonlinear_term(self.contact, work, BOTTOM)

    def _multipliers(self) -> None:
        problem, model = self.problem, self.model
        model.add_initialized_data("r", problem["penalty"])
        model.add_initialized_data("alpha", 1.0)
        forces = gf.MeshFem(self.meshes[0], 3)
        points = gf.MeshIm(self.meshes[1], gf.Integ("IM_GAUSS_PARALLELEPIPED(3,5)"))
        self.used += [forces, points]
        forces.set_fem(gf.Fem("FEM_QK(3,1)"))
        model.add_filtered_fem_variable("force", forces, BOTTOM)
        brick = model.add_integral_large_sliding_contact_brick_raytracing(
            "r", RELEASE, "mu", "alpha", 0
        )
        model.add_slave_contact_boundary_to_large_sliding_contact_brick(
            brick, self.contact, BOTTOM, "u1", "force", "w1"
        )
        model.add_master_contact_boundary_to_large_sliding_contact_brick(
            brick, points, TOP, "u2", "w2"
        )

    def step(self, x: float, y: float, solver: str) -> int:
        """Move the top, N, to (x, y) in mm and solve; returns the Newton iterations."""
        model = self.model
        now = [model.variable(f"u{k}") for k in (1, 2)]
        before = [model.variable(f"w{k}") for k in (1, 2)]
        for k in (1, 2):
            # As the steps are equal, the next is likely to go on as the last.
            model.set_variable(f"w{k}", now[k - 1])
            model.set_variable(f"u{k}", 2.0 * now[k - 1] - before[k - 1])
        model.set_variable("held1", np.array([x, y, 0.0]))
        options = ["max_res", self.limit(), "max_iter", 60, "lsolver", solver]
        count, converged = model.solve(*options, *self.search)
        if not converged:
            raise SystemExit(f"getfem: the step to {x:g}, {y:g} mm has not converged")
        return int(count)

    def limit(self) -> float:
        """Largest residual, which GetFEM takes relative to the forces that act."""
        return self.problem["tolerance"]

    search: list = []

    def forces(self) -> list[float]:
        """Force of the upper box on the lower along x, y and z, N."""
        if self.way == "multipliers":
            terms = [f"force({i})" for i in (1, 2, 3)]
        else:
            terms = [f"Interpolate_filter(pair, ({TRACTION})({i}), 1)" for i in (1, 2, 3)]
        return [-float(gf.asm_generic(self.contact, 0, term, BOTTOM, self.model)) for term in terms]

    def commit(self) -> None:
        """Keep what the next step starts from."""
        if self.way == "penalty":
            normal = f"({TRACTION}.{NORMAL})*{NORMAL}"
            kept = f"Interpolate_filter(pair, {TRACTION} - {normal}, 1)"
            self.model.set_variable("kept", self.model.interpolation(kept, self.store, BOTTOM))


def main() -> None:
    """Solve and write the report."""
    source, report, way = sys.argv[1:4]
    gf.util_trace_level(0)
    problem = json.loads(Path(source).read_text())
    started = time.process_time()
    blocks = Blocks(problem, way)
    rows = []
    for x, y in problem["steps"]:
        count = blocks.step(x, y, "mumps")
        rows.append({"x": x, "y": y, "forces": blocks.forces(), "iterations": count})
        print(f"{time.process_time() - started:8.2f} s", rows[-1], flush=True)
        blocks.commit()
    Path(report).write_text(json.dumps({"steps": rows, "dofs": int(blocks.model.nbdof())}))


if __name__ == "__main__":
    main()
