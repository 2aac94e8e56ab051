"""One run from its settings to its run directory, without a word on the terminal: what a sweep's workers do."""

from __future__ import annotations

import errno
import sys
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from swarmer.errors import RunFailed, SwarmerError
from swarmer.observe.run_directory import SUMMARY, RunDirectory

if TYPE_CHECKING:
    from swarmer.config import RunConfig
    from swarmer.plan import Plan

DISK_FULL = {errno.ENOSPC, errno.EDQUOT}


class Outcome(NamedTuple):
    """How a run ended."""

    status: str  # done | interrupted | failed
    message: str = ""  # why, if it is not done
    summary: dict[str, Any] | None = None
    disk_full: bool = False  # then no other run can go on either


def perform(config: RunConfig, path: Path, plan: Plan | None = None) -> Outcome:
    """Make one run, whatever an earlier, unfinished one left in its directory; never raises but for Ctrl-C.

    plan: of these settings, where it cannot be made here: the file of the shape lies on another machine.
    """
    try:
        return _perform(config, path, plan)
    except SwarmerError as error:
        return Outcome("failed", str(error), disk_full=disk_full(error))
    except Exception as error:  # a fault of ours: it must not end the other runs
        return Outcome("failed", _fault(error))


def _perform(config: RunConfig, path: Path, plan: Plan | None) -> Outcome:
    from swarmer.engines.named import make_engine
    from swarmer.observe.collector import Collector
    from swarmer.plan import make_plan

    plan = plan or make_plan(config)
    _make_way(path)
    with make_engine(plan) as engine:
        collector = Collector(RunDirectory.create(path, config.shape, config.seed, sys.argv))
        result = engine.run(collector)
    summary = collector.finish(result)
    status = str(summary.get("status"))
    full = collector.failure is not None and disk_full(collector.failure)
    return Outcome(status, summary.get("message") or "", summary, full)


def _make_way(path: Path) -> None:
    """A summary marks a finished run; that of a failed or interrupted one is in the way of its repetition."""
    try:
        (path / SUMMARY).unlink(missing_ok=True)
    except OSError as error:
        raise RunFailed(f"cannot clear {path}: {error.strerror}") from error


def disk_full(failure: BaseException) -> bool:
    """Did it fail because nothing more can be written?"""
    cause = failure.__cause__ or failure.__context__
    return isinstance(cause, OSError) and cause.errno in DISK_FULL


def _fault(error: Exception) -> str:
    """An exception on one line, with the place that raised it."""
    frames = traceback.extract_tb(error.__traceback__)
    place = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}: {' '.join(str(error).split())}{place}"
