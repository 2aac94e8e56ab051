"""What holds for all tests: hypothesis draws the same examples in every run, unless fresh ones are asked for."""

import os

from hypothesis import settings

# No deadline: a busy machine is no bug.
settings.register_profile("fixed", derandomize=True, deadline=None)
settings.register_profile("fresh", deadline=None, print_blob=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "fixed"))


def pytest_addoption(parser):
    parser.addoption(
        "--rewrite-scenarios",
        action="store_true",
        help="write into tests/scenarios and docs/explain.md what scenarios and commands give now, not comparing",
    )
