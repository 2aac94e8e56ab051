"""What holds for all tests: hypothesis draws the same examples in every run, unless fresh ones are asked for.

Tests of pages that were skipped for want of a browser are told in capitals at the end, and so are those of runs over
several hosts, for want of the privilege to make network namespaces.
"""

import os
import signal

import pytest
from hypothesis import settings

# No deadline: a busy machine is no bug.
settings.register_profile("fixed", derandomize=True, deadline=None)
settings.register_profile("fresh", deadline=None, print_blob=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "fixed"))


def heard() -> None:
    """Signals as in a terminal. Started by nohup or in the background, the suite would inherit ignored ones."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def pytest_configure(config):
    heard()


@pytest.fixture(autouse=True)
def signals_are_heard():
    """A run that is played by a test is deaf at its end, for its process would be over then."""
    heard()
    yield
    heard()


def pytest_addoption(parser):
    parser.addoption(
        "--rewrite-scenarios",
        action="store_true",
        help="write into tests/scenarios and docs/explain.md what scenarios and commands give now, not comparing",
    )


def pytest_terminal_summary(terminalreporter):
    for word, title in (("web", "PAGES WERE NOT TESTED"), ("namespaces", "RUNS OVER HOSTS WERE NOT TESTED")):
        skipped = [report for report in terminalreporter.stats.get("skipped", ()) if word in report.keywords]
        if skipped:
            reasons = {report.longrepr[2].removeprefix("Skipped: ") for report in skipped}
            terminalreporter.section(title, red=True, bold=True)
            terminalreporter.line(
                f"{len(skipped)} TESTS WERE SKIPPED: {'; '.join(sorted(reasons))}", red=True
            )
