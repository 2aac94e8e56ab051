"""What holds for all tests: hypothesis draws the same examples in every run, unless fresh ones are asked for.

Tests of pages that were skipped for want of a browser are told in capitals at the end.
"""

import os
import signal

import pytest
from hypothesis import settings

# No deadline: a busy machine is no bug.
settings.register_profile("fixed", derandomize=True, deadline=None)
settings.register_profile("fresh", deadline=None, print_blob=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "fixed"))


def pytest_configure(config):
    """Started by nohup, or in the background of a script, the suite inherits ignored signals, and so would runs."""
    for number, rule in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, rule)


@pytest.fixture(autouse=True)
def signals_stay():
    """A run that was played within a test is deaf at its end, for its process would be over then."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    yield
    for number, rule in before.items():
        signal.signal(number, rule)


def pytest_addoption(parser):
    parser.addoption(
        "--rewrite-scenarios",
        action="store_true",
        help="write into tests/scenarios and docs/explain.md what scenarios and commands give now, not comparing",
    )


def pytest_terminal_summary(terminalreporter):
    skipped = [report for report in terminalreporter.stats.get("skipped", ()) if "web" in report.keywords]
    if skipped:
        reasons = {report.longrepr[2].removeprefix("Skipped: ") for report in skipped}
        terminalreporter.section("PAGES WERE NOT TESTED", red=True, bold=True)
        terminalreporter.line(f"{len(skipped)} TESTS WERE SKIPPED: {'; '.join(sorted(reasons))}", red=True)
