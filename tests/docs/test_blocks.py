"""The blocks of each page run as they stand."""

import pytest

from tests.docs.blocks import is_long
from tests.docs.page_run import PageRun
from tests.docs.pages import all_pages, name_of

PAGES = [
    pytest.param(page, id=name_of(page), marks=[pytest.mark.long] if is_long(page) else [])
    for page in all_pages()
    # Blocks of the gallery are run, and pictures that they draw looked for, by test_gallery.py.
    if "```" in page.read_text(encoding="utf-8") and name_of(page) != "docs/gallery.md"
]


@pytest.mark.parametrize("page", PAGES)
def test_the_blocks_run_and_print_what_is_shown(page, tmp_path):
    PageRun(tmp_path).run(page)
