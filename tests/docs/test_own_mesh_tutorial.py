"""The files that tutorial 2 builds step by step are those in ``examples/own-mesh``."""

import pytest

from tests.docs.blocks import find_blocks
from tests.docs.pages import ROOT

PAGE = ROOT / "docs" / "tutorials" / "2-own-mesh.md"


@pytest.mark.parametrize("language", ["geo", "toml"])
def test_the_parts_on_the_page_make_the_file_in_examples(language):
    parts = {
        block.marks["file"]: block.text
        for block in find_blocks(PAGE)
        if block.language == language and "file" in block.marks
    }
    shipped = ROOT / "examples" / "own-mesh" / f"strip-pull.{language}"
    assert "".join(parts[name] for name in sorted(parts)) == shipped.read_text(encoding="utf-8")
