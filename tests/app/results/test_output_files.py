"""What a run leaves: indices whole at any moment, contact files; read back as one."""

import errno
import os
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
import pyvista
from mpi4py import MPI

from tests.app.results.test_contact_nodes import SPACE
from tribox.app.build.model import build_model
from tribox.app.case.case import Case
from tribox.app.errors import OutputError
from tribox.app.results import Results, read
from tribox.app.results.directory import GrowingTable, prepare
from tribox.app.results.reading import read_table
from tribox.app.results.recorder import Recorder
from tribox.app.results.saving import Saving
from tribox.app.run.progress import Together
from tribox.app.simulation.history import COLUMNS
from tribox.app.simulation.run_state import Observer
from tribox.app.simulation.simulation import Simulation

SERIES = ("fields", "contact", "contact_points")


class Watch(Observer):
    """Opens what is there after every step, as somebody who cannot wait does."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self.seen: list[list[int]] = []
        self.status: set[str] = set()

    def step(self, state, row, result) -> None:
        for name in SERIES:
            reader = pyvista.get_reader(self.directory / f"{name}.pvd")
            assert reader.time_values[-1] <= state.time
            assert reader.read()[0].n_points > 0
        results = read(self.directory)
        self.seen.append(results.steps.tolist())
        self.status.add(results.summary["status"])


def run(data: dict, directory: Path, *observers: Observer) -> Simulation:
    prepare(directory)
    model = build_model(Case.model_validate(data), MPI.COMM_SELF)
    simulation, recorder = Simulation(model), Recorder(model, directory)
    simulation.run(Together(recorder, *observers))
    recorder.close(simulation, "done")
    return simulation


@pytest.fixture(scope="module")
def pressed(tmp_path_factory) -> tuple[Simulation, Watch, Results]:
    directory = tmp_path_factory.mktemp("pressed") / "out"
    watch = Watch(directory)
    return run(tomllib.loads(SPACE), directory, watch), watch, read(directory)


def test_indices_can_be_read_while_the_run_goes_on(pressed):
    simulation, watch, results = pressed
    assert watch.seen[0] == [1] and watch.status == {"running"}
    assert all(seen in ([1], [1, 2]) for seen in watch.seen)
    assert results.steps.tolist() == [1, 2] == [row.step for row in simulation.rows]
    assert results.times.tolist() == [row.time for row in simulation.rows]
    for name in SERIES:
        reader = pyvista.get_reader(results.directory / f"{name}.pvd")
        assert reader.time_values == results.times.tolist()
    assert not list(results.directory.rglob("*.part"))


def test_fields_and_contact_are_those_of_the_step(pressed):
    simulation, _, results = pressed
    assert results.summary["bodies"] == ["elastomer", "aluminium"]
    row, problem = simulation.rows[-1], simulation.model.problem
    fields, contact = results.fields(), results.contact(2)
    assert fields.field_data["step"] == [2] and fields.field_data["TimeValue"] == [row.time]
    moved = fields.point_data["displacement"]
    assert np.sort(moved, axis=0) == pytest.approx(
        np.sort(problem.u.x.array.reshape(-1, 3), axis=0)
    )
    assert results.fields(1).field_data["step"] == [1]
    body = fields.cell_data["body"][0]
    height = fields.points[fields.cells[0].data].mean(axis=1)[:, 1]
    assert (body == 0).tolist() == (height > 0.0).tolist()
    pressure = contact.point_data["pressure"]
    for place, expected in zip(contact.points, pressure, strict=True):
        at = np.linalg.norm(fields.points - place, axis=1).argmin()
        assert fields.point_data["contact_pressure"][at] == pytest.approx(expected)
    force = contact.point_data["area"] @ pressure
    assert force == pytest.approx(row.normal_force)
    assert contact.cell_data["pair"][0].tolist() == [0] * 6


@pytest.mark.parametrize(("slave", "sign"), [("elastomer", 1.0), ("aluminium", -1.0)])
def test_normals_are_unit_and_point_out_of_the_master(pressed, tmp_path, slave, sign):
    results = pressed[2]
    if slave == "aluminium":
        data = tomllib.loads(SPACE)
        data["contact"][0] |= {"slave": "aluminium_contact", "master": "elastomer_contact"}
        run(data, tmp_path / "out")
        results = read(tmp_path / "out")
    for mesh in (results.contact(), results.contact_points()):
        normal, above = mesh.point_data["normal"], ~np.isnan(mesh.point_data["gap"])
        assert above.sum() >= 6
        assert np.linalg.norm(normal, axis=1) == pytest.approx(above.astype(float), abs=1e-14)
        assert np.all(sign * normal[above, 1] > 0.99)
    assert above.all() == (slave == "elastomer")


def test_the_history_is_that_of_the_run(pressed):
    simulation, _, results = pressed
    history = results.history
    assert list(history.columns) == list(COLUMNS)
    assert history["velocity"].isna().all()  # nothing is driven
    for name in set(COLUMNS) - {"velocity"}:
        assert history[name].tolist() == [getattr(row, name) for row in simulation.rows]
    assert results.load_steps["label"].tolist() == ["press"]
    assert results.load_steps["steady"].tolist() == [-1.0]
    assert results.case == simulation.model.case


# -- Errors of writing: nothing is torn, all ranks hear of them, and room is kept for the end ------


def full(*arguments: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def short(descriptor: int, data: memoryview, at: int) -> int:
    """A disk that becomes full in the middle of what is written."""
    if len(data) < 4:
        full()
    return WRITE(descriptor, data[: len(data) // 2], at)


WRITE = os.pwrite


def test_a_row_is_appended_whole_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "history.csv"
    table = GrowingTable(path, ("step", "time"))
    table.extend([(1, 0.1)])
    with monkeypatch.context() as patch:
        patch.setattr(os, "pwrite", short)
        with pytest.raises(OSError, match="No space left"):
            table.extend([(2, 0.2)])
    assert path.read_text() == "step,time\n1,0.1\n" and table.written == 1
    table.extend([(2, 0.2), (3, 0.3)])
    assert [row["step"] for row in read_table(path)] == [1.0, 2.0, 3.0]


def test_rows_do_not_go_where_their_file_has_gone(tmp_path):
    directory = tmp_path / "out"
    directory.mkdir()
    table = GrowingTable(directory / "t.csv", ("step",))
    shutil.rmtree(directory)
    with pytest.raises(FileNotFoundError):
        table.extend([(1,)])


def test_the_first_error_is_kept_and_others_pass(tmp_path):
    saving = Saving(tmp_path)
    saving.raise_together(MPI.COMM_SELF)
    with saving:
        full()
    with saving:
        (tmp_path / "a" / "b").touch()
    with pytest.raises(OutputError, match=r"cannot be written \(No space left on device\)$"):
        saving.raise_together(MPI.COMM_SELF)
    with pytest.raises(ZeroDivisionError), saving:
        raise ZeroDivisionError
