"""What is wrong on a page does not get past the tests of its blocks."""

from pathlib import Path

import pytest

from tests.docs.blocks import PageError
from tests.docs.page_run import PageRun, check_page
from tests.docs.printed import difference

FENCE = "```"


def fenced(language: str, *lines: str, mark: str = "") -> str:
    comment = f"<!-- {mark} -->\n\n" if mark else ""
    return "\n".join([f"{comment}{FENCE}{language}", *lines, FENCE, "", ""])


@pytest.fixture
def page(tmp_path):
    """Writes a page of these blocks."""

    def write(*blocks: str) -> Path:
        path = tmp_path / "page.md"
        path.write_text("Some text.\n\n" + "".join(blocks), encoding="utf-8")
        return path

    return write


@pytest.fixture
def run(page, tmp_path):
    """Runs a page of these blocks."""

    def run_page(*blocks: str) -> None:
        directory = tmp_path / "run"
        directory.mkdir()
        PageRun(directory).run(page(*blocks))

    return run_page


@pytest.mark.parametrize(
    ("block", "what"),
    [
        (fenced("sh", "./tribox rum case.toml"), "page.md:3: .*No such command 'rum'"),
        (fenced("sh", "tribox run --np 0 \\", "  case.toml"), "0 is not in the range"),
        (fenced("sh", 'new="--fast"', "tribox run x.toml $new"), "No such option: --fast"),
        (fenced("sh", "docker run x tribox rum", mark="not run: needs root"), "No such command"),
        (fenced("sh", "./tribox test tests/nothing"), "tests/nothing: no such file"),
        (fenced("sh", "python3 -m benchmarks.law --hasty"), "--hasty: not in its source"),
        (fenced("sh", "if true; then"), "syntax error|unexpected end"),
        (fenced("", "ls"), "without a language"),
        (fenced("python", "for x in y"), "expected ':'"),
        (fenced("toml", "a = b"), "Invalid value"),
        (fenced("sh", "ls", mark="not run: too tired"), "must be one of .*needs a cluster"),
        (fenced("python", "x = 1", mark="in: cases/sfa.toml"), "not for a block of python"),
        (f"{FENCE}sh\nls\n", "not closed"),
    ],
)
def test_what_is_wrong_is_seen_without_running(page, block, what):
    with pytest.raises(PageError, match=what):
        check_page(page(block))


@pytest.mark.parametrize(
    ("blocks", "what"),
    [
        ([fenced("sh", "false", "echo never")], "page.md:3: exit code 1, not 0"),
        ([fenced("sh", "./tribox check nothing.toml")], r"exit code 2.*\n.*nothing.toml"),
        ([fenced("sh", "true", mark="fails with: 2")], "exit code 0, not 2"),
        ([fenced("sh", "echo 40 steps"), fenced("text", "41 steps")], "not printed: '41 steps'"),
        ([fenced("sh", "echo 1; echo 2"), fenced("text", "1")], "other lines are printed too"),
        ([fenced("python", "1 / 0")], r"(?s)exit code 1.*ZeroDivisionError"),
        ([fenced("python", "1 / 0", mark="fails with: ValueError")], "ZeroDivisionError"),
        ([fenced("text", "1")], "no block above prints it"),
        ([fenced("sh", "ls", mark="in the test first: false")], "in the test first: exit code 1"),
        ([fenced("toml", "[solver]", "tolerence = 1")], r'unknown key "tolerence" in solver'),
        ([fenced("toml", "m = 3", mark="in: cases/sfa.toml at contact.friction")], 'key "m"'),
        ([fenced("toml", "[solver]", mark="fails with: unknown key")], "does not fail with"),
    ],
)
def test_what_is_wrong_is_seen_when_it_runs(run, blocks, what):
    with pytest.raises(PageError, match=what):
        run(*blocks)


@pytest.mark.parametrize(
    ("shown", "printed"),
    [
        ("N 0.877 N", "N 0.8765 N"), ("1.6e-04 of", "1.61e-04 of"), ("a\n...\nd 5", "a\nb\nc\nd 5"),
        ("took … s, 3 steps", "took 1 min 2.5 s, 3 steps"),
        ("a  b", "a b\n\n"), ("-0.5", "-0.50"),
    ],
)  # fmt: skip
def test_outputs_that_are_the_same(shown, printed):
    assert difference(shown, printed) is None


@pytest.mark.parametrize(
    ("shown", "printed"),
    [
        ("N 0.877 N", "N 0.879 N"), ("0.5", "-0.5"), ("1.6e-04 of", "1.6e-03 of"),
        ("40 steps", "40.0 steps"), ("a\n...\nd 5", "a\nb\nd 6"),
        ("took … s, 3 steps", "took 2 s, 4 steps"), ("a b", "a b c"), ("a", ""),
    ],
)  # fmt: skip
def test_outputs_that_are_not_the_same(shown, printed):
    assert difference(shown, printed) is not None
