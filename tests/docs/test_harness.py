"""What is wrong on a page does not get past the tests of its blocks."""

import re
from pathlib import Path

import pytest

from tests.docs.blocks import PageError, find_blocks, is_long, without_blocks
from tests.docs.commands import problems
from tests.docs.fragments import merged
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


RIGHT = [
    ("sh", "cp cases/sfa.toml mine.toml"),
    ("sh", "./tribox test tests/forms -k map  # checked only", "tribox materials PU-70A > one.txt"),
    ("python", "from pathlib import Path", 'n = len(Path("mine.toml").name)'),
    ("python", 'print(f"{n}: {n / 3:.4f} of all")', 'print("done")'),
]


def test_blocks_of_a_page_share_a_directory_and_names(run):
    shown = ("text", "9: 3.0001 of all", "...")
    run(*(fenced(*block) for block in RIGHT), fenced(*shown))


@pytest.mark.parametrize(
    ("block", "what"),
    [
        (fenced("sh", "./tribox rum case.toml"), "page.md:3: .*No such command 'rum'"),
        (fenced("sh", "tribox run case.toml --forse"), "No such option: --forse"),
        (fenced("sh", "tribox run --np 0 \\", "  case.toml"), "0 is not in the range"),
        (fenced("sh", "cd x && TWO=2 python3 -m tribox plott x"), "No such command 'plott'"),
        (fenced("sh", 'new="--fast"', "tribox run x.toml $new"), "No such option: --fast"),
        (fenced("sh", "docker run x tribox rum", mark="not run: needs root"), "No such command"),
        (fenced("sh", "srun tribox run", mark="not run: needs a cluster"), "Missing argument"),
        (fenced("sh", "./tribox test tests/nothing"), "tests/nothing: no such file"),
        (fenced("sh", "python3 -m benchmarks.none"), "benchmarks.none: no such module"),
        (fenced("sh", "python3 -m benchmarks.law --hasty"), "--hasty: not in its source"),
        (fenced("sh", "python3 -m none"), "none: no such module"),
        (fenced("sh", "if true; then"), "syntax error|unexpected end"),
        (fenced("", "ls"), "without a language"),
        (fenced("shell", "ls"), "language 'shell'"),
        (fenced("python", "for x in y"), "expected ':'"),
        (fenced("toml", "a = b"), "Invalid value"),
        (fenced("json", "{,}"), "Expecting"),
        (fenced("sh", "ls", mark="not run: too tired"), "must be one of .*needs a cluster"),
        (fenced("sh", "ls", mark="not run:"), "nothing behind it"),
        (fenced("sh", "ls", mark="do not run: needs root"), "no mark: 'do not run'"),
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
        ([fenced("sh", "false | cat")], "exit code 1"),
        ([fenced("sh", "./tribox check nothing.toml")], r"exit code 2.*\n.*nothing.toml"),
        ([fenced("sh", "exit 3", mark="fails with: 2")], "exit code 3, not 2"),
        ([fenced("sh", "true", mark="fails with: 2")], "exit code 0, not 2"),
        ([fenced("sh", "echo 1.25"), fenced("text", "1.27")], "not printed: '1.27'"),
        ([fenced("sh", "echo 40 steps"), fenced("text", "41 steps")], "not printed: '41 steps'"),
        ([fenced("sh", "echo 1; echo 2"), fenced("text", "1")], "other lines are printed too"),
        ([fenced("python", "1 / 0")], r"(?s)exit code 1.*ZeroDivisionError"),
        ([fenced("python", "x = 1", mark="fails with: ValueError")], "exit code 0"),
        ([fenced("python", "1 / 0", mark="fails with: ValueError")], "ZeroDivisionError"),
        ([fenced("text", "1")], "no block above prints it"),
        ([fenced("text", "1", mark="printed by: echo 2")], "not printed: '1'"),
        ([fenced("sh", "ls", mark="in the test first: false")], "in the test first: exit code 1"),
        ([fenced("toml", "[solver]", "tolerence = 1")], r'unknown key "tolerence" in solver'),
        ([fenced("toml", "[solver]", 'kind = "fast"')], r"solver\S* = \"fast\""),
        ([fenced("toml", "m = 3", mark="in: cases/sfa.toml at contact.friction")], 'key "m"'),
        ([fenced("toml", "m = 3", mark="in: cases/none.toml")], "no such case"),
        ([fenced("toml", "[solver]", mark="fails with: unknown key")], "does not fail with"),
    ],
)
def test_what_is_wrong_is_seen_when_it_runs(run, blocks, what):
    with pytest.raises(PageError, match=what):
        run(*blocks)


def test_the_program_prints_nothing_else(run):
    correct = "cases/block-slide.toml: correct (1 run, 2 stages)"
    run(fenced("sh", "./tribox check cases/block-slide.toml"), fenced("text", correct))


def test_modules_of_a_page_are_not_those_of_the_next(page, tmp_path):
    blocks = [fenced("python", "x = {}", mark="file: mine.py"), fenced("python", "import mine")]
    for value in (1, 2):
        (tmp_path / str(value)).mkdir()
        made = page(blocks[0].format(value), blocks[1], fenced("python", "print(mine.x)"))
        shown = fenced("text", str(value))
        made.write_text(made.read_text(encoding="utf-8") + shown, encoding="utf-8")
        PageRun(tmp_path / str(value)).run(made)


def test_a_page_goes_on_behind_a_block_that_fails(run):
    with pytest.raises(PageError, match=r"(?s)page.md:3: exit code 1.*page.md:8: not printed: '2'"):
        run(fenced("sh", "echo 1", "false"), fenced("text", "2"))


def test_a_whole_case_is_checked_as_it_is(run):
    text = (Path(__file__).parents[2] / "cases" / "block-slide.toml").read_text(encoding="utf-8")
    assert "\nsteps = " in text
    run(fenced("toml", text), fenced("toml", text, mark="file: mine.toml"))


def test_a_wrong_key_in_a_whole_case_is_seen(run):
    text = (Path(__file__).parents[2] / "cases" / "block-slide.toml").read_text(encoding="utf-8")
    with pytest.raises(PageError, match='unknown key "stepps" in stage'):
        run(fenced("toml", text.replace("\nsteps = ", "\nstepps = ")))


def test_errors_on_purpose_pass(run):
    run(
        fenced("sh", "./tribox check cases/sfa.toml --set solver.x=1", mark="fails with: 2"),
        fenced("text", 'cases/sfa.toml: unknown key "x" in solver...'),
        fenced("python", "[][1]", mark="fails with: IndexError"),
        fenced("text", "IndexError: list index out of range"),
        fenced("toml", "[solver]", "x = 1", mark='fails with: unknown key "x"'),
    )


def test_a_text_below_a_block_that_is_not_run_is_not_compared(run):
    left_out = fenced("sh", "docker ps", mark="not run: needs a container engine")
    ran = fenced("sh", "echo 1"), fenced("text", "2")
    with pytest.raises(PageError, match=r"^page\.md:\d+: not printed: '2'"):
        run(left_out, fenced("text", "CONTAINER ID"), *ran)


def test_keys_can_be_set_for_the_test_alone(run):
    mark = "in the test with: --set solver.x=1"
    with pytest.raises(PageError, match='unknown key "x" in solver'):
        run(fenced("sh", "./tribox check cases/sfa.toml", mark=mark))


def test_files_of_a_page_are_written(run):
    run(
        fenced("csv", "a,b", "1,2", mark="file: data/table.csv"),
        fenced("python", 'print("here")', mark="file: my.py"),
        fenced("sh", "cat data/table.csv", "./tribox python my.py"),
        fenced("text", "a,b", "1,2", "here"),
    )


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


def test_what_rounding_decides_is_not_compared():
    shown = "step  3  N 0.26 N  Newton 5 (residual 2.6e-09)\n40 steps, 71 Newton iterations"
    other = "step  3  N 0.26 N  Newton 12 (residual 3.0e-10)\n40 steps, 249 Newton iterations"
    assert difference(shown, other) is None
    assert difference(shown, other.replace("0.26", "0.28")) is not None
    assert difference(shown, other.replace("40", "41")) is not None


def test_numbers_of_another_machine_are_named():
    assert difference("3 runs, 12.5 s", "3 runs, 7 s", "12.5 s") is None
    assert difference("3 runs, 12.5 s", "4 runs, 7 s", "12.5 s") is not None
    with pytest.raises(AssertionError, match="not in the text"):
        difference("3 runs", "3 runs", "12.5 s")


def test_blocks_in_lists_and_quotes_are_found(tmp_path):
    path = tmp_path / "page.md"
    path.write_text(
        "1. first\n\n   ```sh\n   ls \\\n     -l\n   ```\n\n````text\n```\n````\n"
        "> ```text\n> a\n> ```\n\n```{toctree}\nindex\n```\n<!-- long test -->\n",
        encoding="utf-8",
    )
    blocks = find_blocks(path)
    assert [(b.line, b.language, b.text) for b in blocks] == [
        (3, "sh", "ls \\\n  -l\n"),
        (8, "text", "```\n"),
        (11, "text", "a\n"),
    ]
    assert is_long(path)
    assert re.findall(r"[a-z]+", without_blocks(path.read_text(encoding="utf-8"))) == ["first"]


def test_other_programs_may_call_something_tribox():
    assert problems("conda create -n tribox numpy\ndocker build -t tribox .\n") == []
    assert problems("docker save tribox | gzip > tribox.tar.gz\n./tribox --version\n") == []
    assert problems("python3 -m benchmarks.other_codes run tribox --out records\n") == []


def test_a_fragment_takes_the_place_of_what_it_chooses_anew():
    base = {
        "geometry": {"kind": "two-blocks", "gap": 1},
        "contact": [{"slave": "a", "friction": {"law": "coulomb", "mu": 1}, "penalty": 2}],
        "boundary": [{"surface": "top", "displacement": {"x": 0}}, {"surface": "bottom"}],
        "solver": {"tolerance": 1},
    }
    over = {
        "geometry": {"mesh": "a.msh"},
        "contact": {"friction": {"law": "stribeck"}},
        "boundary": [{"surface": "top", "force": 1}],
        "solver": {"petsc": {"x": 1}},
    }
    assert merged(base, over) == {
        "geometry": {"mesh": "a.msh"},
        "contact": [{"slave": "a", "friction": {"law": "stribeck"}, "penalty": 2}],
        "boundary": [{"surface": "bottom"}, {"surface": "top", "force": 1}],
        "solver": {"tolerance": 1, "petsc": {"x": 1}},
    }
    assert base["solver"] == {"tolerance": 1}
