"""Fields by ADIOS2: displacement and contact pressure at nodes, stress in the cells.

Each rank writes its own part. ParaView reads the files by its reader "ADIOS2VTX".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import dolfinx

from app.results.fields import ContactPressureField, StressField
from forms.bodies.solid import Solid
from geometry.surfaces.facets import Floats
from geometry.surfaces.surface import ContactSurface


class BpWriter:
    """Writes ``fields.bp`` and ``stress.bp``, by ADIOS2; collective."""

    def __init__(
        self,
        u: dolfinx.fem.Function,
        solids: Sequence[Solid],
        directory: Path,
        surfaces: Sequence[ContactSurface] = (),
        times: Mapping[int, float] | None = None,
    ) -> None:
        """Open the files.

        Args:
            u: displacement, m.
            solids: the bodies.
            directory: where the files go.
            surfaces: of the contact pairs.
            times: s, by step, of what is there and kept, of a run that goes on. These files cannot
                be added to: others follow, named after the step.
        """
        ending = "" if times is None else f"_after_{max(times, default=0):06d}"
        self._stress = StressField(u, solids)
        self._contact = ContactPressureField(u, surfaces) if surfaces else None
        nodes = [u, self._contact.pressure] if self._contact else [u]
        comm = u.function_space.mesh.comm
        cells = [self._stress.stress, self._stress.von_mises, self._stress.pressure]
        # The default engine writes garbage from a rank without cells; BP4 does not.
        self._writers = [
            dolfinx.io.VTXWriter(comm, directory / name, functions, engine="BP4")
            for name, functions in (
                (f"fields{ending}.bp", nodes),
                (f"stress{ending}.bp", cells),
            )
        ]

    def write(self, time: float, pressures: Sequence[Floats] = ()) -> None:
        """Write the present state at ``time`` (s).

        Args:
            time: s.
            pressures: Pa, (v,) at the vertices of each slave surface.
        """
        self._stress.update()
        if self._contact is not None:
            self._contact.update(pressures)
        for writer in self._writers:
            writer.write(time)

    def close(self) -> None:
        """Finish the files."""
        for writer in self._writers:
            writer.close()
