"""One taught fake cell with its daemon, shared by the tests that leave it alive, and how its times are judged."""

import os
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import pytest

from fakes.cell.daemon import Daemon
from fakes.cell.load import Load
from fakes.cell.processes import MARK, left_behind
from fakes.cell.taught import TaughtCell, rehearse
from fakes.perturbation import Perturbation, installed
from vgrd.calibration.calibration import Calibration

TIMEOUT_S = 900  # of any test: 10 s of computing took 120 on a machine with nine times as much work as processors
GONE_WITHIN_S = 20.0  # SIGKILL takes no time, the scheduler of a busy machine does
FAILED = pytest.StashKey[bool]()
PERTURBATION = pytest.StashKey[Perturbation]()
TOO_BUSY = pytest.StashKey[list[str]]()


class Live(NamedTuple):
    """A taught fake cell and the daemon that serves it."""

    cell: TaughtCell
    daemon: Daemon


class Keeper:
    """The shared cell and its daemon: put back for every test, replaced after a test that failed."""

    def __init__(self, factory: pytest.TempPathFactory, calibration: Calibration) -> None:
        self._factory = factory
        self._calibration = calibration
        self._stack = ExitStack()
        self._live: Live | None = None

    def restored(self) -> Live:
        """The cell as it was at the start, with a daemon that serves; a new one where that cannot be had."""
        if self._live is not None:
            try:
                self._live.cell.restore(self._live.daemon)
            except (TimeoutError, OSError):
                self.discard()
        if self._live is None:
            cell = TaughtCell(self._factory.mktemp("live"), self._calibration)
            self._live = Live(
                self._stack.enter_context(cell), self._stack.enter_context(cell.daemon())
            )
            self._live.cell.restore(self._live.daemon)
        return self._live

    def discard(self) -> None:
        """End the daemon and the cell."""
        self._live = None
        self._stack.close()


class Stopwatch:
    """Judges figures of time: a missed one counts only where the machine had time to spare.

    On a machine that was too busy the test goes on, and is told as skipped with the evidence.
    """

    def __init__(self, load: Load, told: list[str]) -> None:
        self._load = load
        self._told = told
        self._since = load.now()

    def judge(self, what: str, figure_s: float, limit_s: float) -> None:
        """Fail unless `figure_s` is below `limit_s` or the machine was too busy since the test began."""
        if figure_s < limit_s:
            return
        missed = f"{what}: {figure_s:.2f} s, limit {limit_s:g} s"
        evidence = self._load.evidence(self._since, figure_s - limit_s)
        assert evidence, missed
        self._told.append(f"{missed}; {evidence}")

    def give_up(self, what: str) -> None:
        """Something that needs time did not come about: a failure unless the machine was too busy."""
        evidence = self._load.evidence(self._since)
        assert evidence, what
        pytest.skip(f"machine too busy: {what}; {evidence}")


def pytest_addoption(parser: pytest.Parser) -> None:
    text = "change the last digits and the order of what the solvers are given"
    parser.addoption("--perturb", type=int, metavar="SEED", help=text)


def pytest_configure(config: pytest.Config) -> None:
    seed = config.getoption("--perturb")
    if seed is not None:
        stack = ExitStack()
        config.stash[PERTURBATION] = stack.enter_context(installed(Perturbation(seed)))
        config.add_cleanup(stack.close)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item):
    """Every test says how often its solvers got perturbed input; xdist brings it along."""
    perturbation = item.config.stash.get(PERTURBATION, None)
    if perturbation:
        perturbation.keep_order = item.get_closest_marker("ordered") is not None
        perturbation.calls.clear()
    return (yield)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    if terminalreporter.config.getoption("--perturb") is None:
        return
    reports = terminalreporter.getreports("passed") + terminalreporter.getreports("failed")
    calls = [n for one in reports if one.when == "call" for n in _perturbed(one)]
    reached = sum(n > 0 for n in calls)
    terminalreporter.write_line(
        f"perturbed: {sum(calls)} calls of solvers, by {reached} of {len(calls)} tests"
    )


def _perturbed(report: pytest.TestReport) -> list[int]:
    return [value for name, value in report.user_properties if name == "perturbed"]


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if PERTURBATION in config.stash:
        exact = [item for item in items if item.get_closest_marker("exact")]
        config.hook.pytest_deselected(items=exact)
        items[:] = [item for item in items if item not in exact]
    for item in items:
        if not item.get_closest_marker("timeout"):
            item.add_marker(pytest.mark.timeout(TIMEOUT_S))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item):
    result = yield
    if perturbation := item.config.stash.get(PERTURBATION, None):
        item.user_properties.append(("perturbed", sum(perturbation.calls.values())))
    if told := item.stash.get(TOO_BUSY, []):
        pytest.skip(f"machine too busy: {', '.join(told)}")
    return result


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item):
    report = yield
    item.stash[FAILED] = item.stash.get(FAILED, False) or report.failed
    return report


@pytest.fixture(scope="session", autouse=True)
def nothing_left_behind() -> Iterator[None]:
    """No process that these tests started is there when they have ended; whatever is left is ended."""
    mark = f"{os.getpid()}-{time.monotonic_ns()}"
    os.environ[MARK] = mark
    yield
    left = left_behind(mark, GONE_WITHIN_S)
    assert not left, f"processes left behind by the tests: {left}"


@pytest.fixture(scope="session")
def load() -> Iterator[Load]:
    with Load() as load:
        yield load


@pytest.fixture
def stopwatch(load: Load, request: pytest.FixtureRequest) -> Stopwatch:
    return Stopwatch(load, request.node.stash.setdefault(TOO_BUSY, []))


@pytest.fixture(scope="session")
def calibration(tmp_path_factory: pytest.TempPathFactory) -> Calibration:
    return rehearse(tmp_path_factory.mktemp("rehearsal"))


@pytest.fixture
def taught(tmp_path: Path, calibration: Calibration) -> Iterator[TaughtCell]:
    """A cell of one's own, its daemon not started."""
    with TaughtCell(tmp_path / "cell", calibration) as cell:
        yield cell


@pytest.fixture(scope="session")
def keeper(tmp_path_factory: pytest.TempPathFactory, calibration: Calibration) -> Iterator[Keeper]:
    keeper = Keeper(tmp_path_factory, calibration)
    yield keeper
    keeper.discard()


@pytest.fixture
def live(keeper: Keeper, request: pytest.FixtureRequest) -> Iterator[Live]:
    """The shared cell, put back as it was at the start; a test may do to it what heals."""
    yield keeper.restored()
    if request.node.stash.get(FAILED, False):
        keeper.discard()
