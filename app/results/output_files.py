"""All field output of a run: bodies and contact, in the formats that the case asks for."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from tribox.app.build.model import Model
from tribox.app.results.bp_files import BpWriter
from tribox.app.results.contact_nodes import nodal_pressure
from tribox.app.results.contact_series import ContactSeries
from tribox.app.results.field_series import FieldSeries
from tribox.app.results.saving import Saving
from tribox.app.results.series import Series
from tribox.app.results.tool_series import ToolSeries


class OutputFiles:
    """Writes a state to all files; all ranks take part.

    Attributes:
        times: s, by the number of the step, of what has been written.
    """

    def __init__(
        self,
        model: Model,
        directory: Path,
        saving: Saving,
        times: Mapping[int, float] | None = None,
    ) -> None:
        """Open the files; collective.

        Args:
            model: what is solved.
            directory: of the results.
            saving: keeps errors of writing.
            times: s, by the number of the step, of what a run that goes on has written and keeps.
        """
        problem, formats = model.problem, model.case.output.formats
        surfaces = [term.surface for term in problem.contacts]
        told = (problem.u, problem.solids, directory, surfaces, times)
        self._model, self._saving = model, saving
        self._fields = FieldSeries(*told) if "vtu" in formats else None
        self._bp = BpWriter(*told) if "adios2" in formats else None
        self._contact = ContactSeries(model, directory, times) if surfaces else None
        self._tools = ToolSeries(model, directory, times) if problem.tools else None
        self.times: dict[int, float] = dict(times or {})

    def write(self, step: int, time: float) -> None:
        """Write the displacement and the last converged state of the contacts; collective.

        Args:
            step: number of the step.
            time: s.
        """
        self.times[step] = time
        pairs = zip(self._model.problem.contacts, self._model.problem.committed, strict=True)
        pressures = [nodal_pressure(*pair) for pair in pairs]
        if self._fields is not None:
            with self._saving:
                self._fields.write(step, time, pressures)
        if self._bp is not None:
            with self._saving:
                self._bp.write(time, pressures)
        if self._contact is not None:
            with self._saving:
                self._contact.write(step, time)
        if self._tools is not None:
            with self._saving:
                self._tools.write(step, time)

    def described(self, step: int) -> str:
        """Where the output of a step is, in words."""
        name = f"{step:06d}.vtu"
        files = [f"fields/{name}"] if self._fields is not None else []
        files += ["fields.bp and stress.bp"] if self._bp is not None else []
        files += [f"contact/{name}"] if self._contact is not None else []
        files += [f"tools/{name}"] if self._tools is not None else []
        return ", ".join(files) or "no files"

    def write_indices(self) -> None:
        """Bring the indices by time up to date; not collective."""
        for series in self._series():
            with self._saving:
                series.write_index()

    def close(self) -> None:
        """Finish the files; collective."""
        self.write_indices()
        if self._bp is not None:
            with self._saving:
                self._bp.close()

    def _series(self) -> list[Series]:
        contact = self._contact.series if self._contact is not None else []
        fields = self._fields.series if self._fields is not None else None
        tools = self._tools.series if self._tools is not None else None
        return [*contact, *(series for series in (fields, tools) if series is not None)]
