"""Ctrl-C while nothing has been begun that needs an end in good order: the process is gone at once.

So are `kill` and a terminal that is closed, while a run is planned. Python turns Ctrl-C into an exception, and one that
arrives within an import may get lost, or come out as a traceback of the library that was being imported. So while a
command only imports, reads and computes, it says `ends_at_once`.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

# Nothing else: until `at_once` is called a Ctrl-C is a traceback.

INTERRUPTED = 130  # exit status


# What ends a run in good order: Ctrl-C, `kill`, a terminal that is closed (elsewhere than on Unix there is no such).
ENDINGS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))


def at_once() -> None:
    """From here on an ending ends the process with its line and status. Where it is ignored or caught, it stays so."""
    for number in ENDINGS:
        if signal.getsignal(number) is _as_usual(number):
            signal.signal(number, _end)


def in_order() -> None:
    """From here on Ctrl-C is a KeyboardInterrupt, as usual, and the others end the process without a word."""
    for number in ENDINGS:
        if signal.getsignal(number) is _end:
            signal.signal(number, _as_usual(number))


def _as_usual(number: int) -> Any:
    return signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL


class ends_at_once:
    """An ending ends the process at once within the block, which must leave nothing half-done. In the main thread."""

    def __enter__(self) -> None:
        at_once()

    def __exit__(self, *_: object) -> None:
        in_order()


def heeded(number: int) -> bool:
    """False if a run must stay deaf to this signal, as under `nohup`; a sweep's worker leaves Ctrl-C to its run."""
    return number == signal.SIGINT or signal.getsignal(number) is not signal.SIG_IGN


@contextmanager
def endings_wait() -> Iterator[Callable[[], None]]:
    """Within the block every ending waits until what the block gives is called; then it is a KeyboardInterrupt.

    So what must not be left half-done can be begun and given into the hands of whoever finishes it. (To block signals
    would not do: one that is for the process reaches any thread of a library that does not.)
    """
    came: list[int] = []
    _lost.clear()
    before = {number: signal.getsignal(number) for number in ENDINGS}
    waiting = {number for number, handler in before.items() if handler is not signal.SIG_IGN}

    def note(number: int, frame: FrameType | None) -> None:
        came.append(number)

    def let_them_come() -> None:
        while waiting:
            signal.signal(waiting.pop(), _as_ctrl_c)
        if came:
            raise KeyboardInterrupt

    for number in waiting:
        signal.signal(number, note)
    try:
        yield let_them_come
    finally:
        _lost.clear()
        for number in waiting:  # nothing was begun
            signal.signal(number, before[number])


def endings_over() -> None:
    """From here on nothing cuts off what is left to be written down."""
    for number in ENDINGS:
        signal.signal(number, signal.SIG_IGN)


_lost: list[int] = []  # endings that were raised as exceptions, until who plays the run has asked


def one_was_lost() -> bool:
    """True if an ending came and the run goes on all the same: a library has caught the exception that it became.

    Finalizers, and callbacks from compiled code, cannot pass one on. For the engine to ask when it begins to listen.
    """
    return bool(_lost)


def _as_ctrl_c(number: int, frame: FrameType | None) -> None:
    _lost.append(number)
    raise KeyboardInterrupt


def _end(*_: object) -> None:
    os.write(2, b"interrupted\n")
    os._exit(INTERRUPTED)
