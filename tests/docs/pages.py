"""The pages whose blocks are tested, in groups of about the same cost."""

from pathlib import Path

import pytest

from tests.docs.blocks import find_blocks, is_long
from tests.docs.page_run import PageRun

ROOT = Path(__file__).resolve().parents[2]
_PLACES = ("*.md", "docs/**/*.md", "benchmarks/**/*.md", "examples/**/*.md", "paper/**/*.md")
_LEFT_OUT = ("CHANGELOG.md",)
# Its blocks are run, and the pictures that they draw looked for, by tests/docs/test_gallery.py.
_GALLERY = "docs/gallery.md"
# Words of a block that starts ranks.
_RANKS = ("--np ", "mpirun ", "mpiexec ")
# Each group is one file of tests; what is in none of them is in the last, "reference".
_GROUPS = {
    "start": (
        "README.md",
        "CONTRIBUTING.md",
        "docs/install.md",
        "docs/tutorials/1-first-run.md",
        "examples",
    ),
    "guides": ("docs/tutorials", "docs/how-to"),
}


def all_pages() -> list[Path]:
    """Every page of the project."""
    found = {page for place in _PLACES for page in ROOT.glob(place)}
    return sorted(page for page in found if page.name not in _LEFT_OUT)


def name_of(page: Path) -> str:
    """Path of a page within the project."""
    return page.relative_to(ROOT).as_posix()


def group_of(page: Path) -> str:
    """Which file of tests runs a page."""
    name = name_of(page)
    for group, places in _GROUPS.items():
        if any(name == place or name.startswith(f"{place}/") for place in places):
            return group
    return "reference"


def pages_of(group: str) -> list[object]:
    """The pages of a group that have blocks, as parameters of a test."""
    own = [page for page in all_pages() if name_of(page) != _GALLERY]
    pages = [page for page in own if group_of(page) == group]
    with_blocks = [page for page in pages if "```" in page.read_text(encoding="utf-8")]
    return [pytest.param(page, id=name_of(page), marks=_marks(page)) for page in with_blocks]


def _marks(page: Path) -> list[pytest.MarkDecorator]:
    found = [pytest.mark.long] if is_long(page) else []
    return [*found, pytest.mark.mpi] if _starts_ranks(page) else found


def run_page(page: Path, directory: Path) -> None:
    """Run the blocks of a page in an empty directory."""
    PageRun(directory).run(page)


def _starts_ranks(page: Path) -> bool:
    text = page.read_text(encoding="utf-8")
    if not any(word in text for word in _RANKS):
        return False
    run = [block.text for block in find_blocks(page) if "not run" not in block.marks]
    return any(word in block for block in run for word in _RANKS)
