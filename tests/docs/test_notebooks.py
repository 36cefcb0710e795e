"""The notebooks run on a standard kernel, anywhere, and print what is committed with them."""

import base64
import os
import re
from pathlib import Path

import nbformat
import pytest

from tests.docs.notebooks import NOTEBOOKS, execute, pictures, printed
from tests.docs.printed import difference

LARGEST = 100 * 1024
PLACE = re.compile(r"/(?:home|root|tmp|work|opt|tribox)/")

every_notebook = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def test_there_are_three():
    assert [path.stem for path in NOTEBOOKS] == ["1-law", "2-run-and-results", "3-calibration"]


@every_notebook
def test_what_is_committed_was_run_from_top_to_bottom(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    assert notebook.metadata["kernelspec"]["name"] == "python3"
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    assert not any(o.output_type == "error" for cell in code for o in cell.outputs)
    assert not any(PLACE.search(text) for text in printed(notebook))
    sizes = [len(base64.b64decode(picture)) for picture in pictures(notebook)]
    assert sizes and max(sizes) < LARGEST


@every_notebook
@pytest.mark.long
def test_it_runs_and_prints_what_is_committed(path: Path, tmp_path: Path):
    committed = nbformat.read(path, as_version=4)
    (tmp_path / "elsewhere").mkdir()
    notebook = execute(path, tmp_path / "elsewhere")
    shown, now = printed(committed), printed(notebook)
    for number, (old, new) in enumerate(zip(shown, now, strict=True)):
        assert not difference(old, new), f"cell {number}: {difference(old, new)}"
    assert len(pictures(notebook)) == len(pictures(committed))
    assert os.listdir(tmp_path / "elsewhere") == [".ipython"]  # nothing is left where it ran


def test_a_notebook_that_fails_says_so(tmp_path):
    cell = nbformat.v4.new_code_cell("import tribox\nprint(1 / 0)")
    broken = tmp_path / "broken.ipynb"
    nbformat.write(nbformat.v4.new_notebook(cells=[cell]), broken)
    with pytest.raises(Exception, match="division by zero"):
        execute(broken, tmp_path)
