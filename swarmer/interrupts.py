"""Ctrl-C while nothing has been begun that needs an end in good order: the process is gone at once.

Python turns Ctrl-C into an exception, and one that arrives within an import may get lost, or come out as a traceback of
the library that was being imported. So while a command only imports, reads and computes, it says `ends_at_once`.
"""

from __future__ import annotations

import os
import signal

# Nothing else: until `at_once` is called a Ctrl-C is a traceback.

INTERRUPTED = 130  # exit status


def at_once() -> None:
    """From here on Ctrl-C ends the process with its line and its status. Where it is ignored or caught, it stays so."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)


def in_order() -> None:
    """From here on Ctrl-C is a KeyboardInterrupt, as usual."""
    if signal.getsignal(signal.SIGINT) is _end:
        signal.signal(signal.SIGINT, signal.default_int_handler)


class ends_at_once:
    """Ctrl-C ends the process at once within the block, which must leave nothing half-done. In the main thread."""

    def __enter__(self) -> None:
        at_once()

    def __exit__(self, *_: object) -> None:
        in_order()


def _end(*_: object) -> None:
    os.write(2, b"interrupted\n")
    os._exit(INTERRUPTED)
