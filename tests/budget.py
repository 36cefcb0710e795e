"""What tests cost: their CPU time, beside what each took when ``budget.csv`` was written.

Processes that a test starts count with it, but for the ranks that tests share: they have lines of
their own (`tests/ranks.py`). Anything else that is shared counts with the first that asks for it.
Nothing fails for its cost: the summary of a run shows what has grown.
"""

import csv
import os
from collections import Counter, OrderedDict
from collections.abc import Generator, Iterator, Mapping
from pathlib import Path

import pytest

BUDGET = Path(__file__).with_name("budget.csv")
LEAST = 0.2  # s; cheaper tests are noted together, one line for each file
GROWTH = 2.0  # what is pointed out costs so many times its budget,
EXCESS = 0.5  # and so many seconds more
RANKS = "tests/ranks.py"  # the file whose lines are those of ranks that tests share

# CPU time in seconds by tier and test, or by tier and file for all of its cheap tests together.
Costs = Mapping[tuple[str, str], float]


def cpu_time() -> float:
    """CPU time of this process and of all it has started and waited for, in seconds."""
    return sum(os.times()[:4])


def file_of(test: str) -> str:
    return test.partition("::")[0]


def read_budget(path: Path = BUDGET) -> dict[tuple[str, str], float]:
    """Costs as they were last written; none if they never were."""
    if not path.exists():
        return {}
    with path.open(newline="", encoding="utf-8") as stream:
        return {(row["tier"], row["test"]): float(row["cpu"]) for row in csv.DictReader(stream)}


def write_budget(costs: Costs, path: Path = BUDGET) -> None:
    """Note costs of tests; lines of files that were not run stay, unless the file is gone."""
    run = {(tier, file_of(test)) for tier, test in costs}
    kept = {
        (tier, test): cost
        for (tier, test), cost in read_budget(path).items()
        if (tier, file_of(test)) not in run and Path(file_of(test)).exists()
    }
    noted = kept | grouped(costs, {key for key, cost in costs.items() if cost >= LEAST})
    with path.open("w", newline="", encoding="utf-8") as stream:
        out = csv.writer(stream, lineterminator="\n")
        out.writerow(["cpu", "tier", "test"])
        for tier, test in sorted(noted, key=lambda key: (file_of(key[1]), key[1], key[0])):
            out.writerow([f"{noted[tier, test]:.1f}", tier, test])


def grouped(costs: Costs, alone: set[tuple[str, str]]) -> dict[tuple[str, str], float]:
    """The same costs with those of tests that have no line of their own summed by file."""
    found: Counter[tuple[str, str]] = Counter()
    for (tier, test), cost in costs.items():
        found[tier, test if (tier, test) in alone else file_of(test)] += cost
    return dict(found)


def report(costs: Costs, budget: Costs) -> Iterator[str]:
    """Lines on what each tier cost, what has no budget, and what costs much more than its own."""
    found = grouped(costs, set(budget))
    for tier in sorted({tier for tier, _ in costs}):
        count = sum(mine == tier and not test.startswith(RANKS) for mine, test in costs)
        total = sum(cost for (mine, _), cost in found.items() if mine == tier)
        noted = sum(budget.get(key, 0.0) for key in found if key[0] == tier)
        yield f"{tier}: {total:.0f} s of CPU time in {count} tests, budget {noted:.0f} s"
    new = {
        (tier, test): cost
        for (tier, test), cost in costs.items()
        if (tier, test) not in budget and (tier, file_of(test)) not in budget
    }
    if new:
        files = len({file_of(test) for _, test in new})
        where = f"{len(new)} tests in {files} files"
        yield f"no budget yet: {where}, {sum(new.values()):.1f} s together"
    grown = {
        key: cost
        for key, cost in found.items()
        if key in budget and cost > max(GROWTH * budget[key], budget[key] + EXCESS)
    }
    for key in sorted(grown, key=lambda key: -grown[key]):
        _, test = key
        what = test if "::" in test else f"{test}, all its cheap tests"
        yield f"over budget: {grown[key]:.1f} s instead of {budget[key]:.1f} s: {what}"


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
    for (_, test), seconds in read_budget().items():
        cost[file_of(test)] += seconds

    class CostlyFirst(LoadFileScheduling):
        def _assign_work_unit(self, node) -> None:
            order = sorted(self.workqueue, key=lambda file: -cost.get(file, float("inf")))
            self.workqueue = OrderedDict((file, self.workqueue[file]) for file in order)
            super()._assign_work_unit(node)

    return CostlyFirst(config, log)
