"""The terminal while something plays in it: taken, its keys read, and given back as it was, however it ends."""

from __future__ import annotations

import os
import re
import select
import signal
import sys
import termios
import tty
from collections.abc import Sequence
from types import FrameType, TracebackType
from typing import Any, Self

ENTER = "\x1b[?1049h\x1b[?25l\x1b[?7l\x1b[2J"  # a page of its own, no cursor, lines are not wrapped
LEAVE = "\x1b[0m\x1b[?7h\x1b[?25h\x1b[?1049l"
KEY = re.compile(r"\x1b\[[0-?]*[ -/]*[@-~]|\x1bO[@-~]|[\s\S]")
NAMES = {
    " ": "space", "\x1b[A": "up", "\x1b[B": "down", "\x1b[C": "right", "\x1b[D": "left",
    "\x1bOA": "up", "\x1bOB": "down", "\x1bOC": "right", "\x1bOD": "left",
    "\x1b[H": "home", "\x1b[F": "end", "\x1bOH": "home", "\x1bOF": "end",
    "\x1b[1~": "home", "\x1b[4~": "end", "\x1b[7~": "home", "\x1b[8~": "end",
    "\x1b[5~": "page up", "\x1b[6~": "page down",
}  # fmt: skip
ENDING = (signal.SIGTERM, signal.SIGHUP)
CLOSED = "closed"  # the key that says that nobody can press one any more


def keys_in(text: str) -> list[str]:
    r"""The keys behind what a terminal sends; of those without a name here only letters, digits and signs.

    >>> keys_in("q\x1b[C \x1b[1;5C+")
    ['q', 'right', 'space', '+']
    """
    found = (NAMES.get(key, key) for key in KEY.findall(text))
    return [key for key in found if key.isprintable()]


class Screen:
    """A terminal taken for the length of a `with`. Ctrl-C, SIGTERM, SIGHUP and Ctrl-Z leave it as it was, too."""

    def __init__(self, out: int, keys: int | None) -> None:
        """out, keys: descriptors of the terminal to draw on and of the one to read keys from, None if there is none."""
        self._out, self._in = out, keys
        self._old: list[Any] | None = None
        self._handlers: dict[int, Any] = {}
        self.fresh = True  # what was drawn is not there any more

    @classmethod
    def standard(cls) -> Screen:
        """stdout, and stdin where it is a terminal."""
        keys = sys.stdin.fileno() if sys.stdin is not None and sys.stdin.isatty() else None
        return cls(sys.stdout.fileno(), keys)

    @property
    def interactive(self) -> bool:
        """True if keys can come."""
        return self._in is not None

    def __enter__(self) -> Self:
        for number in ENDING:
            self._handlers[number] = signal.signal(number, _end)
        self._handlers[signal.SIGTSTP] = signal.signal(signal.SIGTSTP, self._stop)
        try:
            self._take()
        except BaseException:  # a signal in the middle of it
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self._give_back()
        for number, handler in self._handlers.items():
            signal.signal(number, handler)

    def _take(self) -> None:
        if self._in is not None:
            self._old = termios.tcgetattr(self._in)
            tty.setcbreak(self._in)
        self._write(ENTER)
        self.fresh = True

    def _give_back(self) -> None:
        try:
            self._write(LEAVE)
        except OSError:
            pass  # it is gone
        if self._in is not None and self._old is not None:
            try:
                termios.tcsetattr(self._in, termios.TCSADRAIN, self._old)
            except (OSError, termios.error):
                pass

    def _stop(self, *_: int | FrameType | None) -> None:
        """Ctrl-Z: the shell finds its terminal as it was, and `fg` finds us."""
        self._give_back()
        signal.signal(signal.SIGTSTP, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGTSTP)
        signal.signal(signal.SIGTSTP, self._stop)  # here after the return
        self._take()

    def size(self) -> tuple[int, int]:
        """Columns and rows to draw on. Not the last column: clearing what follows a line would clear that, too."""
        try:
            columns, rows = os.get_terminal_size(self._out)
        except OSError:
            columns, rows = 80, 24
        return max(columns - 1, 1), max(rows, 1)

    def show(self, lines: Sequence[str]) -> None:
        """Draw the lines from the top; the rest is empty. Raises OSError if the terminal is gone."""
        clear = "\x1b[2J" if self.fresh else ""
        self.fresh = False
        self._write(clear + "\x1b[H" + "\r\n".join(f"{line}\x1b[K" for line in lines) + "\x1b[J")

    def keys(self, wait_s: float) -> list[str]:
        """What was pressed, after at most `wait_s` seconds; [CLOSED] if the terminal is gone."""
        sources = [] if self._in is None else [self._in]
        ready, _, _ = select.select(sources, [], [], wait_s)
        if not ready or self._in is None:
            return []
        try:
            data = os.read(self._in, 1024)
        except OSError:
            data = b""
        return keys_in(data.decode("utf-8", "ignore")) if data else [CLOSED]

    def _write(self, text: str) -> None:
        data = memoryview(text.encode("utf-8", "replace"))
        while data:
            data = data[os.write(self._out, data) :]


def _end(number: int, _: FrameType | None) -> None:
    sys.exit(128 + number)
