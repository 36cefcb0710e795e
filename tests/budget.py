"""What tests cost: CPU time by file, from which the costly files are handed out first.

Processes that a test starts count with it, but for the ranks that tests share: they have a line of
their own (`tests/ranks.py`). Anything else that is shared counts with the first that asks for it.
Nothing fails for its cost, nor is a single test held against what it took once: on a busy machine,
or on another, that points at the machine. ``--durations`` tells which tests are long.
"""

import csv
import os
from collections import Counter, OrderedDict
from collections.abc import Generator, Iterator, Mapping
from pathlib import Path

import pytest

BUDGET = Path(__file__).with_name("budget.csv")
RANKS = "tests/ranks.py"  # the file whose lines are those of ranks that tests share

# CPU time in seconds by tier and test, or by tier and file.
Costs = Mapping[tuple[str, str], float]


def cpu_time() -> float:
    """CPU time of this process and of all it has started and waited for, in seconds."""
    return sum(os.times()[:4])


def by_file(costs: Costs) -> Counter[tuple[str, str]]:
    """The costs of tests summed by tier and file."""
    found: Counter[tuple[str, str]] = Counter()
    for (tier, test), cost in costs.items():
        found[tier, test.partition("::")[0]] += cost
    return found


def read_budget(path: Path = BUDGET) -> dict[tuple[str, str], float]:
    """Costs of files as they were last written; none if they never were."""
    if not path.exists():
        return {}
    with path.open(newline="", encoding="utf-8") as stream:
        return {(row["tier"], row["file"]): float(row["cpu"]) for row in csv.DictReader(stream)}


def write_budget(costs: Costs, path: Path = BUDGET) -> None:
    """Note costs of files; lines of those that were not run stay, unless the file is gone."""
    known = {key: cost for key, cost in read_budget(path).items() if Path(key[1]).exists()}
    noted = known | by_file(costs)
    with path.open("w", newline="", encoding="utf-8") as stream:
        out = csv.writer(stream, lineterminator="\n")
        out.writerow(["cpu", "tier", "file"])
        for tier, file in sorted(noted, key=lambda key: key[::-1]):
            out.writerow([f"{noted[tier, file]:.1f}", tier, file])


def report(costs: Costs, budget: Costs) -> Iterator[str]:
    """A line for each tier: what it cost, and what its files did when that was written."""
    for tier in sorted({tier for tier, _ in costs}):
        mine = {key: cost for key, cost in costs.items() if key[0] == tier}
        count = sum(not test.startswith(RANKS) for _, test in mine)
        noted = sum(budget.get(key, 0.0) for key in by_file(mine))
        total = sum(mine.values())
        yield f"{tier}: {total:.0f} s of CPU time in {count} tests, noted {noted:.0f} s"


class Meter:
    """Measures each test, and tells at the end; under xdist each worker measures its own."""

    def __init__(self) -> None:
        self.costs: Counter[tuple[str, str]] = Counter()
        self.since = cpu_time()
        self.apart: list[tuple[str, str, float]] = []

    def charge(self, tier: str, name: str, seconds: float) -> None:
        """Note CPU time that has just been used on a line of its own, not on that of the test."""
        self.apart.append((tier, name, seconds))

    def pytest_collection_finish(self) -> None:
        self.since = cpu_time()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        made = yield
        now = cpu_time()
        made.cpu_time = now - self.since - sum(seconds for *_, seconds in self.apart)
        made.cpu_apart, self.apart, self.since = self.apart, [], now
        return made

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        tier = "long" if "long" in report.keywords else "guard"
        self.costs[tier, report.nodeid] += getattr(report, "cpu_time", 0.0)
        for tier, name, seconds in getattr(report, "cpu_apart", ()):
            self.costs[tier, name] += seconds

    def pytest_terminal_summary(self, terminalreporter, config: pytest.Config) -> None:
        if config.option.collectonly or not self.costs:
            return
        terminalreporter.section("cost of the tests")
        for line in report(self.costs, read_budget()):
            terminalreporter.line(line)
        if config.option.write_budget:
            write_budget(self.costs)
            terminalreporter.line(f"written: {BUDGET}")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--write-budget",
        action="store_true",
        help="note in tests/budget.csv what the tests of this run cost; run whole files",
    )


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(Meter(), "meter")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log):
    """Hand out the costly files first, so that both processes end at about the same time.

    By itself xdist begins with the files of most tests.
    """
    from xdist.scheduler import LoadFileScheduling

    if config.getvalue("dist") != "loadfile":
        return None
    cost: Counter[str] = Counter()
    for (_, file), seconds in read_budget().items():
        cost[file] += seconds

    class CostlyFirst(LoadFileScheduling):
        def _assign_work_unit(self, node) -> None:
            order = sorted(self.workqueue, key=lambda file: -cost.get(file, float("inf")))
            self.workqueue = OrderedDict((file, self.workqueue[file]) for file in order)
            super()._assign_work_unit(node)

    return CostlyFirst(config, log)
