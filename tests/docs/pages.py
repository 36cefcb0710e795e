"""The pages whose blocks are tested."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
_PLACES = ("*.md", "docs/**/*.md", "benchmarks/**/*.md", "examples/**/*.md", "paper/**/*.md")
_LEFT_OUT = ("CHANGELOG.md",)


def all_pages() -> list[Path]:
    """Every page of the project."""
    found = {page for place in _PLACES for page in ROOT.glob(place)}
    return sorted(page for page in found if page.name not in _LEFT_OUT)


def name_of(page: Path) -> str:
    """Path of a page within the project."""
    return page.relative_to(ROOT).as_posix()
