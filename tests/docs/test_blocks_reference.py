"""The blocks of each page of the group "reference" (tests/docs/pages.py) run as they stand."""

import pytest

from tests.docs.pages import pages_of, run_page


@pytest.mark.parametrize("page", pages_of("reference"))
def test_the_blocks_run_and_print_what_is_shown(page, tmp_path):
    run_page(page, tmp_path)
