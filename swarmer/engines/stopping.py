"""Ctrl-C and its like end a run in one process in good order."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from collections.abc import Callable, Iterator
from types import FrameType

from swarmer.interrupts import ENDINGS, heeded, one_was_lost

PATIENCE_S = (
    2.0  # after which whoever has been told and goes on is taken to hang, in somebody's technique say
)


@contextlib.contextmanager
def told_to_stop(tell: Callable[[], None]) -> Iterator[None]:
    """Call `tell` on SIGINT, SIGTERM and SIGHUP instead of ending; in a thread that gets no signals, do nothing.

    Another one, later than that takes to be heeded, raises KeyboardInterrupt wherever the run is.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    told_at: list[float] = []

    def answer(_: int, __: FrameType | None) -> None:
        if told_at and time.monotonic() - told_at[0] > PATIENCE_S:
            raise KeyboardInterrupt
        told_at.append(time.monotonic())
        tell()

    before = {number: signal.signal(number, answer) for number in filter(heeded, ENDINGS)}
    try:
        if one_was_lost():
            tell()
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
