"""What it costs to evaluate bodies that flow: ``python3 -m benchmarks.plastic_tangent``.

Update of all material points with their tangent, and assembly of residual and matrix, beside the
assembly of residual and matrix of an elastic body of Hencky's energy on the same mesh; both through
the body, as Newton's iterations ask for them. All of the metal flows.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence

import dolfinx
import dolfinx.fem.petsc
import numpy as np

from tribox.app.verify.flowing import SATURATING, metal
from tribox.app.verify.flowing_body import FlowingBody, Shape, rectangle
from tribox.forms.bodies.kinematics import Section
from tribox.forms.bodies.materials import Material
from tribox.forms.bodies.memory_solid import MemorySolid
from tribox.forms.bodies.solid import Formulation
from tribox.geometry.compat import add_matrix

KINDS: tuple[tuple[Formulation, Section], ...] = (
    ("q1-sri", "plane-strain"),
    ("q1", "plane-strain"),
    ("q2", "plane-strain"),
    ("q1-sri", "axisymmetric"),
    ("q1-sri", "3D"),
    ("q1", "3D"),
)


def body(material: Material, formulation: Formulation, section: Section, cells: int) -> FlowingBody:
    """A square or cube of about so many cells, sheared and stretched so far that it flows."""
    dim = 3 if section == "3D" else 2
    side = round(cells ** (1.0 / dim))
    low = (1e-2,) + (0.0,) * (dim - 1)
    place = rectangle(low, tuple(value + 1e-2 for value in low))
    made = FlowingBody(Shape((side,) * dim, place, section, formulation), material)
    gradient = 0.02 * np.array([[0.5, 1.0, 0.3], [0.2, -0.8, 0.1], [0.4, 0.0, 0.3]])[:dim, :dim]
    random = np.random.default_rng(1).standard_normal(made.X.shape)
    made.u.x.array[:] = (made.X @ gradient.T + 1e-5 / side * random).reshape(-1)
    return made


Calls = dict[str, Callable[[], object]]


def calls(made: FlowingBody) -> Calls:
    """The update with its tangent, the residual and the matrix, each as a call."""
    solid = made.solid
    A = dolfinx.fem.petsc.create_matrix(solid.forms[0].tangent)
    b = dolfinx.la.vector(made.u.function_space.dofmap.index_map, made.X.shape[1])

    def update() -> None:
        if isinstance(solid, MemorySolid):
            solid.points.begin(None)
        solid.evaluate(tangent=True)

    def residual() -> None:
        b.array[:] = 0.0
        for part in solid.forms:
            dolfinx.fem.assemble_vector(b.array, part.residual)

    def matrix() -> None:
        A.zeroEntries()
        for part in solid.forms:
            add_matrix(A, part.tangent, False)
        A.assemble()

    return {"update": update, "residual": residual, "matrix": matrix}


def shortest(of: Sequence[Calls], repeat: int) -> list[dict[str, float]]:
    """Seconds of each call, the shortest of many; taken in turn, since machines are shared."""
    best = [dict.fromkeys(one, float("inf")) for one in of]
    for _ in range(repeat):
        for times, one in zip(best, of, strict=True):
            for name, call in one.items():
                start = time.perf_counter()
                call()
                times[name] = min(times[name], time.perf_counter() - start)
    return best


def rows(cells: int, repeat: int) -> list[str]:
    """The table, one line for each kind of elements."""
    lines = [
        "| elements | cells | points | update (µs/point) | its matrix | elastic matrix | ratio |"
        " residuals |",
        "|---|---|---|---|---|---|---|---|",
    ]
    flowing = metal(SATURATING)
    for formulation, section in KINDS:
        bodies = [body(m, formulation, section, cells) for m in (flowing, flowing.elastic)]
        made, elastic = shortest([calls(one) for one in bodies], repeat)
        solid = bodies[0].solid
        assert isinstance(solid, MemorySolid) and solid.plastic_strain().min() > 0.0
        number, each = solid.plastic_strain().shape
        count = number * each
        ratio = (made["update"] + made["matrix"]) / elastic["matrix"]
        values = (
            f"{formulation}, {section}",
            f"{number}",
            f"{count}",
            f"{1e6 * made['update'] / count:.2f}",
            f"{1e3 * made['matrix']:.1f} ms",
            f"{1e3 * elastic['matrix']:.1f} ms",
            f"**{ratio:.2f}**",
            f"{1e3 * made['residual']:.1f}, {1e3 * elastic['residual']:.1f} ms",
        )
        lines.append(f"| {' | '.join(values)} |")
    return lines


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=10_000)
    parser.add_argument("--repeat", type=int, default=40)
    chosen = parser.parse_args()
    print("\n".join(rows(chosen.cells, chosen.repeat)))


if __name__ == "__main__":
    main()
