"""What can be seen of all pages without running their blocks: languages, commands, links."""

import pytest

from tests.docs.page_run import check_page
from tests.docs.pages import all_pages, name_of

PAGES = [pytest.param(page, id=name_of(page)) for page in all_pages()]


@pytest.mark.parametrize("page", PAGES)
def test_each_block_has_a_language_and_its_commands_exist(page):
    for line in check_page(page):
        print(f"not run: {line}")


def test_the_pages_are_found():
    names = {name_of(page) for page in all_pages()}
    assert {"README.md", "docs/law.md", "docs/forming/pad.md", "benchmarks/RESULTS.md"} <= names
