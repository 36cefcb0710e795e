"""What a run tells of its rigid tools at its end: a line each."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tribox.app.simulation.run_state import RunState
from tribox.geometry.surfaces.facets import Floats

ROUND_OFF = 1e-10  # of the largest force of the run, or its moment on the size of the mesh


def tool_lines(state: RunState) -> Iterator[str]:
    """A line on each tool: how far it has come, and the force and moment of the bodies on it.

    Args:
        state: of a run with at least one step.
    """
    columns, rows = state.tools.columns, state.tools.rows
    if not rows:
        return
    kinds = {
        kind: [at for at, name in enumerate(columns) if name.rpartition("_")[0] == kind]
        for kind in ("displacement", "force", "moment")
    }
    values = {kind: np.array([[row[at] for at in ats] for row in rows], dtype=np.float64)
              for kind, ats in kinds.items()}  # fmt: skip
    names, turned = columns.index("tool"), columns.index("rotation")
    noise = ROUND_OFF * float(np.max(np.abs(values["force"])))
    for tool in state.model.problem.tools:
        mine = np.array([row[names] == tool.name for row in rows])
        moved = _vector(values["displacement"][mine][-1], 0.0)
        angle = float(rows[int(np.flatnonzero(mine)[-1])][turned])
        yield (
            f"tool {tool.name}: moved by {moved} m"
            + (f", turned by {angle:.4g} rad" if angle else "")
            + f"; force on it {_end_and_most(values['force'][mine], 'N', noise)}"
            + f"; moment {_end_and_most(values['moment'][mine], 'N m', noise * tool.motion.length)}"
        )


def _end_and_most(values: Floats, unit: str, noise: float) -> str:
    """The last of vectors (s, i), and the size of the largest."""
    most = float(np.max(np.linalg.norm(np.where(np.abs(values) > noise, values, 0.0), axis=1)))
    return f"{_vector(values[-1], noise)} {unit}, at most {most:.4g} {unit}"


def _vector(components: Floats, noise: float) -> str:
    """Components, those that are noise as 0; one alone without brackets."""
    texts = [f"{0.0 if abs(one) <= noise else one:.4g}" for one in components]
    return texts[0] if len(texts) == 1 else f"({', '.join(texts)})"
