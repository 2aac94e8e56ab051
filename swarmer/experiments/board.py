"""How far a sweep is, on stderr: a panel with the time left and what failed, or a plain line every 5 seconds."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TextIO

from swarmer.observe.panel import DRAW_EVERY_S, PLAIN_EVERY_S, WIDTH_MAX
from swarmer.observe.words import clock

if TYPE_CHECKING:
    from swarmer.experiments.one_run import Outcome
    from swarmer.experiments.runs import Run

FAILURES_SHOWN = 5


class Board:
    """Shows a sweep. Every method returns at once; nothing here may stop it."""

    def __init__(self, stream: TextIO | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        """stream: stderr if None. clock: wall seconds."""
        self._stream = sys.stderr if stream is None else stream
        self._clock = clock
        self._terminal = self._stream.isatty()
        self._live: Any = None
        self._title, self._total, self._before, self._jobs = "", 0, 0, 1
        self._ended = 0  # in this go
        self._done, self._done_s = 0, 0.0  # those of them that tell how long a run takes; their seconds
        self._running: dict[str, float] = {}  # name: since when
        self._failures: list[str] = []
        self._began = self._shown_at = clock()

    def planned(self, title: str, total: int, before: int, jobs: int) -> None:
        """total: runs of the sweep, of which `before` are finished already. jobs: at a time; 0 if none is missing."""
        self._title, self._total, self._before, self._jobs = title, total, before, max(jobs, 1)
        self._began = self._shown_at = self._clock()
        there = f", {before} of them finished already" if before else ""
        self.say(f"{title}: {total} runs{there}, " + (f"{jobs} at a time" if jobs else "nothing is missing"))

    def started(self, run: Run) -> None:
        """A run begins."""
        self._running[str(run.path)] = self._clock()

    def ended(self, run: Run, outcome: Outcome) -> None:
        """A run has ended; a failure is told at once."""
        now = self._clock()
        since = self._running.pop(str(run.path), now)
        self._ended += 1
        if outcome.status == "done":
            self._done += 1
            self._done_s += now - since
        else:
            line = f"{outcome.status}: {run.path}: {outcome.message}".rstrip(": ")
            self._failures.append(line)
            if not self._terminal:
                self.say(line)

    def tick(self) -> None:
        """Draw if it is time."""
        now = self._clock()
        if now - self._shown_at < (DRAW_EVERY_S if self._terminal else PLAIN_EVERY_S):
            return
        self._shown_at = now
        if self._terminal:
            self._draw()
        else:
            self.say(self.line())

    def line(self) -> str:
        """How far it is, on one line."""
        done = self._before + self._ended
        failed = f", {len(self._failures)} failed" if self._failures else ""
        return (
            f"{done} of {self._total} runs{failed}, {len(self._running)} running, wall {clock(self._wall)}, "
            f"ETA {self._eta()}"
        )

    def say(self, line: str) -> None:
        """Print a line, above the panel if there is one."""
        if self._live is not None:
            self._live.console.print(line, highlight=False, markup=False)
        else:
            self._stream.write(f"{line}\n")
            self._stream.flush()

    def close(self) -> None:
        """Give the terminal back, and leave what failed. A second call does nothing."""
        if self._live is not None:
            live, self._live = self._live, None
            live.stop()
            for line in self._failures:
                self.say(line)

    @property
    def _wall(self) -> float:
        return self._clock() - self._began

    def _eta(self) -> str:
        """As long as the runs so far took, each; unknown before the first is done. A failed one tells nothing."""
        left = self._total - self._before - self._ended
        if not left or not self._done:
            return "–" if left else clock(0)
        each, now = self._done_s / self._done, self._clock()
        spent = sum(min(each, now - since) for since in self._running.values())
        return clock((each * left - spent) / min(self._jobs, left))

    def _draw(self) -> None:
        from rich import box
        from rich.console import Console
        from rich.live import Live
        from rich.panel import Panel as Frame
        from rich.text import Text

        if self._live is None:
            self._live = Live(console=Console(file=self._stream), auto_refresh=False, transient=True)
            self._live.start()
        width = min(self._live.console.width, WIDTH_MAX)
        text = Text("\n".join(self.lines(width - 4)), no_wrap=True, overflow="ellipsis")
        frame = Frame(
            text, title=self._title, title_align="left", box=box.ROUNDED, width=width, border_style="bright_black"
        )  # fmt: skip
        self._live.update(frame, refresh=True)

    def lines(self, width: int) -> list[str]:
        """What the panel holds, in lines of about `width` characters."""
        done = self._before + self._ended
        share = done / max(self._total, 1)
        tail = f"  {done} of {self._total}   wall {clock(self._wall)}   ETA {self._eta()}"
        room = max(width - len(tail), 10)
        bar = "━" * round(room * share)
        lines = [f"{bar:─<{room}}{tail}"]
        now = self._clock()
        lines += [f"running  {clock(now - since):>7}  {name}" for name, since in self._running.items()]
        if self._failures:
            lines += [f"{len(self._failures)} failed", *self._failures[-FAILURES_SHOWN:]]
        return lines
