"""A recorded run in the terminal: the swarm in braille dots, turning slowly, with its HD below."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from swarmer.observe.palette import Palette
from swarmer.observe.saved_run import SavedTimeline
from swarmer.observe.words import DOTS, braille_curve, cells, swarms
from swarmer.shapes.views import View, seen_from, usual_view

TURN_DEG_PER_S = 6.0  # of what the watcher's clock shows
FRAMES_PER_S = 20.0
CURVE_ROWS = 3
STILLS = 5  # frames printed where nobody watches
END = "\x1b[0m"
BITS = np.array(DOTS).T  # row, column


class Stage:
    """A fixed window on the display: every picture of a run has the same place and scale."""

    def __init__(self, timeline: SavedTimeline, columns: int, rows: int, colour: bool) -> None:
        """columns, rows: characters of the picture, without the lines below it."""
        truth = timeline.truth
        self.timeline, self.columns, self.rows, self.colour = timeline, columns, rows, colour
        self._dim = 2 if np.ptp(truth[:, 2]) == 0 else 3
        self._centre = (truth.min(axis=0) + truth.max(axis=0)) / 2
        self._radius = max(float(np.linalg.norm(truth - self._centre, axis=1).max()), 0.5) * 1.02
        self._palette = Palette(len(truth))
        self._swarms = timeline.swarms()
        shown = np.isfinite(timeline.hd_cells) & (timeline.hd_cells > 0)
        self._log_hd = np.where(shown, np.log10(np.where(shown, timeline.hd_cells, 1.0)), np.nan)

    def picture(self, at: int, turned_deg: float) -> str:
        """Sample `at`, with the view turned so far: `rows` lines."""
        start = usual_view(self._dim)
        view = View(start.azimuth_deg + (turned_deg if self._dim == 3 else 0.0), start.elevation_deg)
        lit = self.timeline.lit[at]
        seen = seen_from(self.timeline.position[at].astype(float) - self._centre, view)
        dots = min((2 * self.columns - 1), (4 * self.rows - 1)) / (2 * self._radius)
        column = np.rint(seen[:, 0] * dots + self.columns).astype(np.int64)
        row = np.rint(2 * self.rows - seen[:, 1] * dots).astype(np.int64)
        inside = (column >= 0) & (column < 2 * self.columns) & (row >= 0) & (row < 4 * self.rows)
        order = np.flatnonzero(inside)[np.argsort(seen[inside, 2])]
        return self._lines(
            column[order], row[order], self._palette.colours(self.timeline.swarm[at], lit)[order]
        )

    def _lines(self, column: NDArray[Any], row: NDArray[Any], colours: NDArray[np.uint8]) -> str:
        grid = np.zeros((self.rows, self.columns), dtype=np.int64)
        np.bitwise_or.at(grid, (row // 4, column // 2), BITS[row % 4, column % 2])
        front = np.zeros((self.rows, self.columns, 3), dtype=np.uint8)
        front[row // 4, column // 2] = colours  # the nearest comes last
        return "\n".join(_line(grid[i], front[i], self.colour) for i in range(self.rows))

    def facts(self, at: int) -> str:
        """The line below the picture."""
        timeline = self.timeline
        return (
            f"{timeline.t_s[at]:6.1f} of {timeline.t_s[-1]:.1f} s   HD {cells(timeline.hd_cells[at]):>7} cells   "
            f"{swarms(int(self._swarms[at]))}   {int(timeline.lit[at].sum())}/{len(timeline.truth)} lit"
        )

    def curve(self, at: int) -> list[str]:
        """log10 HD up to sample `at`, CURVE_ROWS lines."""
        finite = self._log_hd[np.isfinite(self._log_hd)]
        if not len(finite):
            return [""] * CURVE_ROWS
        low, high = math.floor(finite.min()), max(math.ceil(finite.max()), math.floor(finite.min()) + 1)
        step = max(1, (at + 1) // 400)
        t_s, log_hd = self.timeline.t_s[: at + 1 : step].tolist(), self._log_hd[: at + 1 : step].tolist()
        span = (0.0, max(float(self.timeline.t_s[-1]), 1e-9), float(low), float(high))
        lines = braille_curve(t_s, log_hd, max(8, self.columns - 8), CURVE_ROWS, span)
        labels = [f"{10.0**high:>6g}", "    HD", f"{10.0**low:>6g}"]
        return [f"{label} {line}".rstrip() for label, line in zip(labels, lines, strict=True)]

    def frame(self, at: int, turned_deg: float) -> str:
        """Picture, facts and curve: rows + 1 + CURVE_ROWS lines."""
        return "\n".join([self.picture(at, turned_deg), self.facts(at), *self.curve(at)])


def _line(bits: NDArray[np.int64], colours: NDArray[np.uint8], colour: bool) -> str:
    text, last = [], ""
    for dots, (red, green, blue) in zip(bits.tolist(), colours.tolist(), strict=True):
        code = f"\x1b[38;2;{red};{green};{blue}m" if colour and dots else last
        text.append((code if code != last else "") + (chr(0x2800 + dots) if dots else " "))
        last = code
    line = "".join(text).rstrip()
    return line + END if last else line


def play(
    timeline: SavedTimeline,
    out: TextIO,
    speed: float,
    columns: int,
    rows: int,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> None:
    """Play to the end; columns, rows: of the whole terminal. Ctrl-C gives the terminal back and goes on up.

    speed: emulated seconds per second.
    """
    stage = Stage(timeline, columns - 1, max(4, rows - CURVE_ROWS - 2), colour=True)
    out.write("\x1b[?1049h\x1b[?25l")
    try:
        begun, first = clock(), float(timeline.t_s[0])
        while True:
            passed = clock() - begun
            at = int(np.searchsorted(timeline.t_s, first + passed * speed, side="right")) - 1
            lines = stage.frame(max(at, 0), passed * TURN_DEG_PER_S).split("\n")
            out.write("\x1b[H" + "".join(f"{line}\x1b[K\n" for line in lines) + "\x1b[J")
            out.flush()
            if at >= len(timeline.t_s) - 1:
                sleep(1.5)
                return
            sleep(1 / FRAMES_PER_S)
    finally:
        out.write(f"{END}\x1b[?25h\x1b[?1049l")
        out.flush()


def stills(timeline: SavedTimeline, out: TextIO, columns: int = 72, rows: int = 20) -> None:
    """A few frames one below the other, without colours: for a file or a pipe."""
    stage = Stage(timeline, columns, rows, colour=False)
    last = len(timeline.t_s) - 1
    for at in dict.fromkeys(round(last * i / (STILLS - 1)) for i in range(STILLS)):
        out.write(stage.picture(at, 0.0) + "\n" + stage.facts(at) + "\n\n")
    out.write("\n".join(stage.curve(last)) + "\n")
