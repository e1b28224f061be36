"""With ELLIPTUDE_SKIPS=listed, as in .ci/run, the tests fail where one is skipped for a reason that is not here."""

import os
import signal
from dataclasses import dataclass

import pytest


@dataclass(frozen=True)
class Skip:
    """What may be skipped."""

    reason: str
    """As pytest shows it."""
    unless_set: str
    """A variable of the environment: where it is set there is what the tests need, and none is skipped."""
    why: str


LISTED = (
    Skip(
        reason="no datasets: ELLIPTUDE_DATASETS may name their folder",
        unless_set="ELLIPTUDE_DATASETS",
        why="The recordings are not part of the project, which is built and tested without them, too.",
    ),
    Skip(
        reason="no Basilisk: pip install 'elliptude[basilisk]'",
        unless_set="ELLIPTUDE_BASILISK",
        why="The simulator is 0.6 GB with what it needs, and holds back the versions of NumPy and Matplotlib.",
    ),
)


def pytest_configure():
    # A shell that runs the tests in the background ignores Ctrl-C, and so would every program that the tests interrupt.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def is_listed(reason: str) -> bool:
    return any(reason == skip.reason and not os.environ.get(skip.unless_set) for skip in LISTED)


def unlisted(reports) -> list[str]:
    """The reasons that are not listed, each with a test that was skipped for it."""
    found: dict[str, str] = {}
    for report in reports:
        # A skip, or a failure that was expected: there is no reason for the latter here.
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        reason = reason.removeprefix("Skipped: ")
        if not is_listed(reason):
            found.setdefault(reason, report.nodeid)
    return [f"{test}: {reason}" for reason, test in found.items()]


@pytest.hookimpl(tryfirst=True)
def pytest_sessionfinish(session) -> None:
    """On the process that gathers the reports of all."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if os.environ.get("ELLIPTUDE_SKIPS") != "listed" or reporter is None:
        return
    if found := unlisted(reporter.stats.get("skipped", [])):
        reporter.ensure_newline()
        reporter.section("skipped, and not on the list in tests/python/conftest.py", red=True)
        for line in found:
            reporter.line(line)
        if session.exitstatus == pytest.ExitCode.OK:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED
