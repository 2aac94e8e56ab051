"""Limits of the system: raised where that is allowed, else named with the command that raises them."""

import os
import resource

import pytest

from swarmer.engines import control_groups, limits
from swarmer.engines.control_groups import Grant
from swarmer.errors import BadInput


class Limits:
    """Stands for getrlimit and setrlimit; `most`: the hard limit that this user may set."""

    def __init__(self, soft, hard, most):
        self.now, self.most = (soft, hard), most

    def get(self, _):
        return self.now

    def set(self, _, wanted):
        if wanted[1] > self.most:
            raise ValueError("not allowed to raise maximum limit")
        self.now = wanted


def limited(monkeypatch, soft, hard, most):
    system = Limits(soft, hard, most)
    monkeypatch.setattr(resource, "getrlimit", system.get)
    monkeypatch.setattr(resource, "setrlimit", system.set)
    return system


def test_a_low_soft_limit_is_raised_and_no_farther_than_needed(monkeypatch):
    system = limited(monkeypatch, 50, 1000, 1000)
    limits.check_limits(100)
    assert system.now == (100 + limits.PROCESSES_OWN, 1000)


def test_a_low_hard_limit_is_raised_by_who_may(monkeypatch):
    system = limited(monkeypatch, 50, 60, 10_000)
    limits.check_limits(100)
    assert system.now == (100 + limits.PROCESSES_OWN,) * 2


def test_a_low_hard_limit_is_named_to_who_may_not(monkeypatch):
    system = limited(monkeypatch, 50, 60, 60)
    with pytest.raises(BadInput, match=r"hard limit on processes is 60, 108 are needed; .*ulimit -u 108"):
        limits.check_limits(100)
    assert system.now == (50, 60)


def test_a_control_group_that_allows_fewer_processes_is_named(monkeypatch):
    monkeypatch.setattr(control_groups, "processes", lambda: Grant(150, 60))
    limits.check_limits(90 - limits.PROCESSES_OWN)
    with pytest.raises(
        BadInput, match=r"the control group allows 90 more processes, 91 are needed; .*pids\.max"
    ):
        limits.check_limits(91 - limits.PROCESSES_OWN)


def test_where_there_are_no_files_no_event_loop_is_begun():
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    limits.check_loop()
    lowest = os.open(os.devnull, os.O_RDONLY)
    os.close(lowest)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (lowest + 2, before[1]))  # of the three that it needs
        with pytest.raises(OSError, match="Too many open files"):
            limits.check_loop()
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)
    limits.check_loop()
