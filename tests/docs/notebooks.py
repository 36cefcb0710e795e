"""The notebooks of examples/notebooks: how they are executed, and what they print.

``python3 -m tests.docs.notebooks`` executes them and writes their outputs into them; do so after a
change of a notebook, or of the program where the change is meant.
"""

import os
import sys
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbformat import NotebookNode

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))
MOST_SECONDS = 500  # that only a hang takes, however busy the machine is


def execute(path: Path, directory: Path) -> NotebookNode:
    """The notebook with the outputs of a new kernel, started in another directory."""
    notebook = nbformat.read(path, as_version=4)
    client = NotebookClient(
        notebook,
        timeout=MOST_SECONDS,
        kernel_name="python3",
        record_timing=False,
        resources={"metadata": {"path": str(directory)}},
    )
    own = {"PYTHONPATH": str(ROOT / "src"), "IPYTHONDIR": str(directory / ".ipython")}
    client.execute(env={**os.environ, **own})
    return notebook


def printed(notebook: NotebookNode) -> list[str]:
    """What each cell with code prints, pictures left out."""
    return [
        "".join(_text(output) for output in cell.outputs)
        for cell in notebook.cells
        if cell.cell_type == "code"
    ]


def pictures(notebook: NotebookNode) -> list[str]:
    """The pictures in the outputs, base64."""
    outputs = [o for cell in notebook.cells if cell.cell_type == "code" for o in cell.outputs]
    return [o.data["image/png"] for o in outputs if "image/png" in o.get("data", {})]


def _text(output: NotebookNode) -> str:
    if output.output_type == "stream":
        return str(output.text)
    return "" if "image/png" in output.data else str(output.data.get("text/plain", ""))


def _joined(outputs: list[NotebookNode]) -> list[NotebookNode]:
    """Outputs with texts that follow each other put together."""
    found: list[NotebookNode] = []
    for output in outputs:
        if found and output.output_type == found[-1].output_type == "stream":
            found[-1].text += output.text
        else:
            found.append(output)
    return found


def main() -> None:
    """Write the outputs of all notebooks, or of those named."""
    for path in [path for path in NOTEBOOKS if path.stem in sys.argv[1:] or not sys.argv[1:]]:
        with tempfile.TemporaryDirectory() as directory:
            notebook = execute(path, Path(directory))
        notebook.metadata = {
            "kernelspec": notebook.metadata["kernelspec"],
            "language_info": {"name": "python"},
        }
        for cell in notebook.cells:
            if cell.cell_type == "code":
                cell.outputs = _joined(cell.outputs)
        nbformat.write(notebook, path)
        print(path.name, path.stat().st_size // 1024, "kB")


if __name__ == "__main__":
    main()
