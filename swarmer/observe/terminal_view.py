"""A run drawn in characters: the swarm in braille dots, where one is in time, HD and swarms below."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmer.errors import shown
from swarmer.observe.palette import Palette
from swarmer.observe.report_drawing import SECONDS, Clock
from swarmer.observe.saved_timeline import SavedTimeline
from swarmer.observe.words import DOTS, braille_curve, cells, swarms
from swarmer.shapes.cloud import UP_AXIS
from swarmer.shapes.views import View, seen_from, shade, usual_view

END, DIM, BOLD = "\x1b[0m", "\x1b[2m", "\x1b[1m"
BITS = np.array(DOTS).T  # row, column
CURVE_ROWS = 3
MARGIN = 1.04  # around the shape: an FLS may be off its place
LABEL = 7  # characters before a curve
TWO_CURVES = 64  # columns from which the swarms have a curve, too
FEWEST = (20, 6)  # columns and rows of a terminal in which anything can be seen
CURVE_POINTS = 400
SHADES = 4  # steps from the farthest to the nearest; few, so that few codes are needed
FARTHEST = 0.5  # of the brightness of the nearest
TRUE_COLOUR, CUBE, NONE = 1 << 24, 256, 0


class Means(NamedTuple):
    """What a terminal can show."""

    colours: int = NONE  # TRUE_COLOUR, CUBE or NONE
    braille: bool = True  # False: plain characters

    @classmethod
    def of(cls, environment: Mapping[str, str], encoding: str | None) -> Means:
        """As the environment tells, which over ssh is TERM and little else.

        >>> Means.of({"TERM": "xterm-256color"}, "utf-8"), Means.of({"TERM": "vt100"}, "ascii")
        (Means(colours=256, braille=True), Means(colours=0, braille=False))
        """
        braille = (encoding or "").lower().replace("-", "").replace("_", "") == "utf8"
        term = environment.get("TERM", "")
        if environment.get("NO_COLOR"):
            return cls(NONE, braille)
        if environment.get("COLORTERM", "").lower() in ("truecolor", "24bit") or term.endswith("-direct"):
            return cls(TRUE_COLOUR, braille)
        return cls(CUBE if "256" in term else NONE, braille)


class Moment(NamedTuple):
    """What one frame shows."""

    at: int  # the sample
    turned_deg: float = 0.0
    raised_deg: float = 0.0
    paused: bool = False
    speed: float = 1.0  # emulated seconds per second


class Stage:
    """A fixed window on the display: every picture of a run has the same place and scale."""

    def __init__(
        self,
        timeline: SavedTimeline,
        size: tuple[int, int],
        means: Means,
        title: str = "",
        unit: Clock = SECONDS,
    ) -> None:
        """size: columns and rows of all that is drawn. title: any text; what does not print is left out. unit: what
        the run counts its time in.
        """
        self.timeline, self.size, self._means, self._unit = timeline, size, means, unit
        truth = np.concatenate([shape.truth[shape.member] for shape in timeline.standings()])
        self._title = shown(title).strip("'\"")
        self._dim = 2 if np.ptp(truth[:, 2]) == 0 else 3
        self._centre = (truth.min(axis=0) + truth.max(axis=0)) / 2
        around = np.delete(truth - self._centre, UP_AXIS, axis=1)
        self._reach = MARGIN * max(
            float(np.linalg.norm(around, axis=1).max()), 0.5
        )  # from the axis it turns about
        self._height = MARGIN * float(np.ptp(truth[:, UP_AXIS])) / 2
        self._palette = Palette(len(timeline.truth))
        self._swarms = timeline.swarms()
        columns, rows = size
        self._curve_rows = CURVE_ROWS if rows >= 14 and columns >= FEWEST[0] else 0
        self._words = rows >= 9  # title and keys
        self.columns, self.rows = columns, max(1, rows - 2 - self._curve_rows - 2 * self._words)
        self._curves = self._drawn_curves() if self._curve_rows else []

    def picture(self, moment: Moment) -> list[str]:
        """The swarm, `rows` lines."""
        start = usual_view(self._dim)
        solid = self._dim == 3
        raised_deg = min(max(start.elevation_deg + solid * moment.raised_deg, -90.0), 90.0)
        view = View(start.azimuth_deg + solid * moment.turned_deg, raised_deg)
        lit = self.timeline.lit[moment.at]
        seen = seen_from(self.timeline.position[moment.at].astype(float) - self._centre, view)
        dots = self._dots_per_cell(np.radians(raised_deg))
        column = np.rint(seen[:, 0] * dots + self.columns).astype(np.int64)
        row = np.rint(2 * self.rows - seen[:, 1] * dots).astype(np.int64)
        inside = (column >= 0) & (column < 2 * self.columns) & (row >= 0) & (row < 4 * self.rows)
        order = np.flatnonzero(inside)[np.argsort(seen[inside, 2])]  # the nearest comes last
        colours = self._palette.colours(self.timeline.swarm[moment.at], lit).astype(float)
        near = FARTHEST + (1 - FARTHEST) * np.rint(shade(seen[:, 2]) * SHADES) / SHADES
        ink = (colours * near[:, None]).astype(np.uint8)
        grid = np.zeros((self.rows, self.columns), dtype=np.int64)
        np.bitwise_or.at(grid, (row[order] // 4, column[order] // 2), BITS[row[order] % 4, column[order] % 2])
        front = np.zeros((self.rows, self.columns, 3), dtype=np.uint8)
        front[row[order] // 4, column[order] // 2] = ink[order]
        return [self._line(grid[i], front[i]) for i in range(self.rows)]

    def _dots_per_cell(self, raised: float) -> float:
        """As large as it stays within the picture, however far it is turned."""
        upright = self._height * abs(np.cos(raised)) + self._reach * abs(np.sin(raised))
        return float(
            min((2 * self.columns - 1) / (2 * self._reach), (4 * self.rows - 1) / (2 * max(upright, 0.5)))
        )

    def _line(self, bits: NDArray[np.int64], colours: NDArray[np.uint8]) -> str:
        text, last = [], ""
        for dots, rgb in zip(bits.tolist(), colours.tolist(), strict=True):
            code = _code(rgb, self._means.colours) if dots else last
            text.append((code if code != last else "") + self._glyph(dots))
            last = code
        line = "".join(text).rstrip()
        return line + END if last else line

    def _glyph(self, dots: int) -> str:
        if not self._means.braille:
            return " .o#"[min(3, dots.bit_count())]
        return chr(0x2800 + dots) if dots else " "

    def facts(self, at: int) -> str:
        """HD, swarms and how many are lit, as far as the line holds them."""
        timeline = self.timeline
        parts = [
            f"HD {cells(timeline.hd_cells[at]):>7} cells",
            f"{swarms(int(self._swarms[at])):<11}",
            f"{int(timeline.lit[at].sum())}/{len(timeline.truth)} lit",
        ]
        while len(parts) > 1 and len("   ".join(parts)) > self.columns:
            parts.pop()
        return self._plain("   ".join(parts)).rstrip()[: self.columns]

    def bar(self, moment: Moment) -> str:
        """Where in time the moment is."""
        t_s = self.timeline.t_s
        state = ("||" if moment.paused else "> ") + (f" x{moment.speed:g}" if moment.speed != 1 else "")
        now, end = (f"{t_s[at]:.{self._unit.digits}f}" for at in (moment.at, -1))
        tail = f" {self._unit.words.replace('%', f'{now} of {end}')} {state}"
        room = max(0, self.columns - len(tail))
        span = max(float(t_s[-1] - t_s[0]), 1e-9)
        done = round(room * float(t_s[moment.at] - t_s[0]) / span)
        full, empty = "━─" if self._means.braille else "=-"
        return (full * done + empty * (room - done) + tail)[: self.columns]

    def curves(self, at: int) -> list[str]:
        """HD and, where there is room, swarms over all of the run; what lies ahead is dim. CURVE_ROWS lines or none."""
        lines = [""] * self._curve_rows
        for label, drawn, low_s, span_s in self._curves:
            passed = round((float(self.timeline.t_s[at]) - low_s) / span_s * len(drawn[0]))
            for i, line in enumerate(drawn):
                now, ahead = line[:passed], line[passed:]
                if self._means.colours:
                    ahead = f"{DIM}{ahead}{END}"
                lines[i] += f"{label[i]:>{LABEL - 1}} {now}{ahead}"
        return [line.rstrip() for line in lines]

    def _drawn_curves(self) -> list[tuple[list[str], list[str], float, float]]:
        hd = self.timeline.hd_cells
        two = self.columns >= TWO_CURVES
        width = (self.columns - 2) // (1 + two) - LABEL
        drawn = [self._curve("HD", hd, width)]
        if two:
            drawn.append(self._curve("swarms", self._swarms.astype(float), width))
        return [curve for curve in drawn if curve is not None]

    def _curve(
        self, name: str, values: NDArray[np.float64], width: int
    ) -> tuple[list[str], list[str], float, float] | None:
        """A curve on a logarithmic axis: labels, lines, first second and span of its time."""
        known = np.isfinite(values) & (values > 0)
        if not known.any():
            return None
        log = np.where(known, np.log10(np.where(known, values, 1.0)), np.nan)
        low = math.floor(np.nanmin(log))
        high = max(math.ceil(np.nanmax(log)), low + 1)
        t_s = self.timeline.t_s
        begin, span = float(t_s[0]), max(float(t_s[-1] - t_s[0]), 1e-9)
        step = max(1, len(t_s) // CURVE_POINTS)
        lines = braille_curve(
            t_s[::step].tolist(), log[::step].tolist(), width, CURVE_ROWS, (begin, begin + span, low, high)
        )
        labels = [f"{10.0**high:g}", name, f"{10.0**low:g}"]
        return labels, [self._plain(line).ljust(width) for line in lines], begin, span

    def _plain(self, line: str) -> str:
        """Without braille and dashes where the terminal has none."""
        if self._means.braille:
            return line
        line = line.replace("–", "-")
        return "".join(
            self._glyph(ord(letter) - 0x2800) if 0x2800 <= ord(letter) < 0x2900 else letter for letter in line
        )

    def frame(self, moment: Moment, keys: str = "") -> list[str]:
        """All of it: as many lines as the size has rows. keys: the last line."""
        if self.size < (FEWEST[0], 0) or self.size[1] < FEWEST[1]:
            return ["too small"[: self.size[0]], *[""] * (self.size[1] - 1)]
        lines = [*self.picture(moment), self.bar(moment), self.facts(moment.at), *self.curves(moment.at)]
        if self._words:
            bold, dim, end = (BOLD, DIM, END) if self._means.colours else ("", "", "")
            title = self._title if self._means.braille else self._title.encode("ascii", "replace").decode()
            lines = [f"{bold}{title[: self.columns]}{end}", *lines, f"{dim}{keys[: self.columns]}{end}"]
        return lines


def _code(rgb: list[int], colours: int) -> str:
    red, green, blue = rgb
    if colours == TRUE_COLOUR:
        return f"\x1b[38;2;{red};{green};{blue}m"
    if colours == CUBE:
        return f"\x1b[38;5;{16 + 36 * _step(red) + 6 * _step(green) + _step(blue)}m"
    return ""


def _step(value: int) -> int:
    """Of the six steps of the 256 colours' cube, 0, 95, 135, ... 255, the nearest."""
    return 0 if value < 48 else 1 if value < 115 else (value - 35) // 40


def means_of(out: Any) -> Means:
    """What the terminal behind a stream can show."""
    return Means.of(os.environ, getattr(out, "encoding", None))
