"""Ctrl-C while nothing has been begun that needs an end in good order: the process is gone at once.

Python turns Ctrl-C into an exception, and one that arrives within an import may get lost, or come out as a traceback of
the library that was being imported. So while a command only imports, reads and computes, it says `ends_at_once`.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager

INTERRUPTED = 130  # exit status


def at_once() -> None:
    """From here on Ctrl-C ends the process with its line and its status. Where it is ignored or caught, it stays so."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)


def in_order() -> None:
    """From here on Ctrl-C is a KeyboardInterrupt, as usual."""
    if signal.getsignal(signal.SIGINT) is _end:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@contextmanager
def ends_at_once() -> Iterator[None]:
    """Ctrl-C ends the process at once within the block, which must leave nothing half-done. In the main thread."""
    at_once()
    try:
        yield
    finally:
        in_order()


def _end(*_: object) -> None:
    os.write(2, b"interrupted\n")
    os._exit(INTERRUPTED)
