"""What the terminal panel shows, as lines of rich text: for one `width` always the same number, none of them wider.

Where the lines of a wide terminal do not fit, each says less or becomes two, and the curve of HD goes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from swarmer.engines.result import Lateness, Live
from swarmer.observe.palette import STATE_COLOURS, STATES
from swarmer.observe.words import braille_curve, cells, clock, count, memory, swarms

if TYPE_CHECKING:
    from rich.text import Text

BAR = 16  # characters of the longest bar of states
WIDE = 74  # columns that the long lines take
COUNT = 23  # columns of a state's name and its count
LABELS = 6  # columns of the curve's scale
CURVE_MIN = 8
LABEL = "bold"
DIM = "bright_black"
GOOD, BAD, HD_COLOUR = "green", "bold red", "#4c9be8"
CURVE_LINES = len(STATES)
UNKNOWN = Live(None, None, None, None, None, None)


@dataclass(slots=True)
class View:
    """Everything the panel knows at a moment."""

    title: str = ""
    size: int = 0  # F
    duration_s: float = 0.0
    until_hd_cells: float | None = None
    late_bound_ms: float = math.inf  # half a lease
    t_s: float = 0.0
    wall_s: float = 0.0
    lit: int = 0
    states: tuple[int, ...] = (0,) * len(STATES)
    swarms: int = 0
    largest_swarm: int = 0
    single_swarms: int = 0
    thaws: float | None = None
    hd: float = math.nan
    hd_min: float | None = None
    sent_per_s: float | None = None
    handled_per_s: float | None = None
    live: Live = UNKNOWN
    curve: list[tuple[float, float]] = field(default_factory=list)  # (t_s, HD)
    unit: str = "s"  # or "rounds"

    @property
    def eta_s(self) -> float | None:
        """Wall seconds to the end of the run at the speed so far."""
        if self.t_s <= 0 or self.wall_s < 1:
            return None
        return max(0.0, self.duration_s - self.t_s) * self.wall_s / self.t_s


def plain_line(view: View) -> str:
    """The same on one line without colours."""
    parts = [
        f"{_now(view)} of {view.duration_s:g} {view.unit}",
        f"HD {cells(view.hd)} cells",
        swarms(view.swarms),
        f"{view.lit}/{view.size} lit",
    ]
    if view.live.time_scale is not None:
        parts.append(f"time scale {view.live.time_scale:.2f}")
    if view.live.timer_late_ms and view.live.handled_late_ms:
        parts.append(f"late p99 {view.live.timer_late_ms.p99:.0f}/{view.live.handled_late_ms.p99:.0f} ms")
    if view.live.faithful is False:
        parts.append("not faithful")
    if view.eta_s is not None:
        parts.append(f"ETA {clock(view.eta_s)}")
    return ", ".join(parts)


def panel_lines(view: View, width: int) -> list[Text]:
    """The panel's inside."""
    if width < WIDE:
        return _narrow_lines(view, width)
    return [
        _time_line(view, width),
        _text(),
        _swarm_line(view),
        _text(),
        *_middle(view, width),
        _text(),
        _traffic_line(view),
        _late_line(view),
        _machine_line(view),
    ]


def _narrow_lines(view: View, width: int) -> list[Text]:
    """The same for a narrow terminal."""
    share, eta = _share(view), "–" if view.eta_s is None else clock(view.eta_s)
    head = f"{_now(view)} of {view.duration_s:g} {view.unit} "
    tail = f" {100 * share:.0f} %"
    single = f", one {view.single_swarms} ×" if view.single_swarms else ""
    live = view.live
    thaws = "" if view.thaws is None else f", thaws {view.thaws:.0f}"
    return [
        _text((head, LABEL), *_progress_bar(share, width - len(head) - len(tail)), tail),
        _text(f"wall {clock(view.wall_s)}, ETA {eta}"),
        _text(),
        _text(
            ("HD ", LABEL),
            (cells(view.hd), f"bold {HD_COLOUR}"),
            (f" cells, lowest {cells(view.hd_min)}", DIM),
        ),
        _text(("swarms ", LABEL), f"{view.swarms}", (f", largest {view.largest_swarm}{single}", DIM)),
        _text(),
        *_middle(view, width),
        _text(),
        _text(f"sent {_rate(view.sent_per_s)}, handled {_rate(view.handled_per_s)}"),
        _text(f"p99 {_p99(live.timer_late_ms)}, {_p99(live.handled_late_ms)}  ", *_faithful(view)),
        _text(f"scale {_scale(view)}{thaws}"),
        _text(f"{_processes(view)} processes, {memory(live.memory_mb)}"),
    ]


def _text(*parts: tuple[str, str] | str) -> Text:
    from rich.text import Text

    line = Text(no_wrap=True, overflow="crop")
    for part in parts:
        line.append(part) if isinstance(part, str) else line.append(part[0], part[1])
    return line


def _time_line(view: View, width: int) -> Text:
    share = _share(view)
    head = f"{_now(view):>7} {view.unit} of {view.duration_s:g}  "
    eta = "–" if view.eta_s is None else clock(view.eta_s)
    tail = f"  {100 * share:3.0f} %   wall {clock(view.wall_s)}   ETA {eta:<7}"
    return _text((head, LABEL), *_progress_bar(share, width - len(head) - len(tail)), tail)


def _now(view: View) -> str:
    return f"{view.t_s:.1f}" if view.unit == "s" else f"{view.t_s:.0f}"


def _share(view: View) -> float:
    return min(1.0, view.t_s / view.duration_s) if view.duration_s else 0.0


def _progress_bar(share: float, room: int) -> list[tuple[str, str]]:
    room = max(4, room)
    done = round(share * room)
    return [("━" * done, HD_COLOUR), ("─" * (room - done), DIM)]


def _swarm_line(view: View) -> Text:
    lowest = "" if view.hd_min is None else f"lowest {cells(view.hd_min)}"
    single = f"one swarm {view.single_swarms} ×" if view.single_swarms else ""
    return _text(
        ("HD ", LABEL), (f"{cells(view.hd):>7}", f"bold {HD_COLOUR}"), (f" cells  {lowest:<14}", DIM),
        ("  swarms ", LABEL), f"{view.swarms:<5}", (f"largest {view.largest_swarm:<5}{single}", DIM),
    )  # fmt: skip


def _middle(view: View, width: int) -> list[Text]:
    """Bars of the states on the left, the curve of HD on the right if there is room for it."""
    beside = width - COUNT - BAR - LABELS
    curve = _curve(view, beside) if beside >= CURVE_MIN else []
    bar_width = BAR if curve else max(4, min(BAR, width - COUNT))
    lines = []
    for i, (state, colour) in enumerate(zip(STATES, STATE_COLOURS, strict=True)):
        share = view.states[i] / view.size if view.size else 0.0
        bar = _bar(share, bar_width)
        parts: list[tuple[str, str] | str] = [
            f"{state:<15}",
            (f"{view.states[i]:>7} ", LABEL),
            (f"{bar:<{bar_width}}", colour),
        ]
        if curve:
            label, curve_line = curve[i]
            parts += [(f"{label:>5}", DIM), ("│", DIM), (curve_line, HD_COLOUR)]
        lines.append(_text(*parts))
    return lines


def _bar(share: float, width: int) -> str:
    eighths = round(share * width * 8)
    bar = "█" * (eighths // 8) + ("", "▏", "▎", "▍", "▌", "▋", "▊", "▉")[eighths % 8]
    return bar or ("▏" if share > 0 else "")


def _curve(view: View, width: int) -> list[tuple[str, str]]:
    """Label and line of each row of the curve, log10 of HD over the whole run."""
    points = [(t, math.log10(hd)) for t, hd in view.curve if hd > 0 and math.isfinite(hd)]
    if not points:
        return [("", "")] * CURVE_LINES
    low = math.floor(min(y for _, y in points))
    high = max(math.ceil(max(y for _, y in points)), low + 2)
    end = max(view.duration_s, points[-1][0]) or 1.0
    xs, ys = [t for t, _ in points], [y for _, y in points]
    lines = braille_curve(xs, ys, width, CURVE_LINES, (0.0, end, low, high))
    labels = [f"{10.0**high:g}", "", "HD", "", f"{10.0**low:g}"]
    return list(zip(labels, lines, strict=True))


def _traffic_line(view: View) -> Text:
    thaws = "" if view.thaws is None else f", thaws {view.thaws:.0f}"
    return _text(
        ("messages  ", LABEL), f"sent {_rate(view.sent_per_s)}, handled {_rate(view.handled_per_s)}{thaws}"
    )


def _late_line(view: View) -> Text:
    live = view.live
    timers, handled = _p99(live.timer_late_ms), _p99(live.handled_late_ms)
    bound = f" (bound {view.late_bound_ms:.0f})" if math.isfinite(view.late_bound_ms) else ""
    return _text(("late p99  ", LABEL), f"timers {timers}, messages {handled}{bound}   ", *_faithful(view))


def _machine_line(view: View) -> Text:
    return _text(
        ("machine   ", LABEL),
        f"{_processes(view)} processes, {memory(view.live.memory_mb)}, time scale {_scale(view)}",
    )


def _rate(value: float | None) -> str:
    return "–" if value is None else f"{count(value)}/s"


def _p99(late: Lateness | None) -> str:
    return "–" if late is None else f"{late.p99:.0f} ms"


def _faithful(view: View) -> list[tuple[str, str]]:
    if view.live.faithful is None:
        return []
    return [("faithful", GOOD) if view.live.faithful else ("not faithful", BAD)]


def _processes(view: View) -> str:
    return "–" if view.live.processes is None else count(view.live.processes)


def _scale(view: View) -> str:
    return "–" if view.live.time_scale is None else f"{view.live.time_scale:.2f}"
