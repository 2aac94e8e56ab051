"""When faults began and ended and hosts were lost, marked in the report's figures over time."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, NamedTuple

from swarmer.engines.result import BEGINS, CALM, GONE, OVER
from swarmer.observe.report_drawing import SOFT, Clock, over_time

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from swarmer.engines.result import Event

MARKS_MAX = 12  # of more the longest are marked
LETTER, ROWS = 0.016, (0.985, 0.92)  # of the axis: a letter of a name; where names stand, if there is room
ASIDE = 0.007  # of the axis: a name from its line
HEADROOM = 0.14  # of the axis, for names
SUDDEN = ("kill", "host")


class Mark(NamedTuple):
    """From when to when something lasted, in the unit of the run's clock; a moment ends as it begins."""

    begin: float
    end: float
    name: str


def marks_of(events: Sequence[Event], last: float) -> list[Mark]:
    """In order. Faults that do one thing at one time are one mark. last: the end of the run."""
    marks: dict[Mark, None] = {}
    begun: dict[str, deque[float]] = {}
    for event in events:
        if event.kind == "host":
            marks[Mark(event.t_s, event.t_s, f"{event.text.partition(GONE)[0]} lost")] = None
        elif event.kind == "fault" and event.text.startswith(BEGINS):
            begun.setdefault(event.text.removeprefix(BEGINS), deque()).append(event.t_s)
        elif event.kind == "fault" and event.text.startswith(OVER):
            what = event.text.removeprefix(OVER)
            if begun.get(what):
                marks[_mark(begun[what].popleft(), event.t_s, what)] = None
        elif event.kind == "fault" and event.text == CALM:
            last = min(last, event.t_s)
    for what, moments in begun.items():
        marks |= {_mark(begin, last, what): None for begin in moments}
    return sorted(marks)


def _mark(begin: float, end: float, what: str) -> Mark:
    """what: the words of a fault, as `cut: 30 FLSs`."""
    name = what.partition(":")[0]
    return Mark(begin, begin if name in SUDDEN else max(begin, end), name)


def most_marked(marks: Sequence[Mark]) -> list[Mark]:
    """Those that are drawn: lost hosts, and the faults that last longest."""
    if len(marks) <= MARKS_MAX:
        return list(marks)
    order = sorted(marks, key=lambda mark: (not mark.name.endswith(" lost"), mark.begin - mark.end))
    return sorted(order[:MARKS_MAX])


def said_of(marks: Sequence[Mark], clock: Clock) -> str:
    """A sentence for a caption; empty where nothing is marked."""
    if not marks:
        return ""
    shown = len(most_marked(marks))
    which = "" if shown == len(marks) else f", {shown} of {len(marks)}"
    first = ", ".join(
        f"{mark.name} {clock.say(mark.begin)}"
        + ("" if mark.end == mark.begin else f" to {clock.say(mark.end)}")
        for mark in most_marked(marks)[:3]
    )
    more = ", ..." if shown > 3 else ""
    return (
        f" Grey bands and dashed lines: faults and lost hosts{which} ({first}{more}); Events, below, has all."
    )


def over_run(axes: Axes, clock: Clock, marks: Sequence[Mark], columns: int = 0, named: bool = False) -> None:
    """What every figure over the time of a run has in common. columns: of its legend. named: the marks have names."""
    draw_marks(axes, marks)
    over_time(axes, clock, columns)
    if named:
        _name(axes, most_marked(marks))


def draw_marks(axes: Axes, marks: Sequence[Mark]) -> None:
    """Bands and lines, above what is drawn, and so pale that it is seen; where faults overlap no band is darker."""
    shown = most_marked(marks)
    for begin, end in spans(shown):
        axes.axvspan(begin, end, color=SOFT, alpha=0.13, linewidth=0, zorder=2.5)
    for at in sorted({at for mark in shown for at in (mark.begin, mark.end)}):
        axes.axvline(at, color=SOFT, linewidth=0.8, linestyle=(0, (3, 2)), zorder=2.6)


def spans(marks: Sequence[Mark]) -> list[tuple[float, float]]:
    """When anything lasts. marks: in order.

    >>> spans([Mark(1, 4, "cut"), Mark(2, 2, "kill"), Mark(3, 6, "loss"), Mark(8, 9, "slow")])
    [(1, 6), (8, 9)]
    """
    found: list[tuple[float, float]] = []
    for mark in marks:
        if found and mark.begin <= found[-1][1]:
            found[-1] = found[-1][0], max(found[-1][1], mark.end)
        elif mark.end > mark.begin:
            found.append((mark.begin, mark.end))
    return found


def _name(axes: Axes, marks: Sequence[Mark]) -> None:
    """Names above the curves of a logarithmic axis; one for which there is no room is left out."""
    if not marks:
        return
    lowest, highest = axes.get_ylim()
    axes.set_ylim(top=highest * (highest / lowest) ** HEADROOM)
    low, high = axes.get_xlim()
    free_from = dict.fromkeys(ROWS, low)
    for mark in marks:
        row = next((row for row in ROWS if free_from[row] <= mark.begin < high), None)
        if row is not None:
            axes.text(
                mark.begin + ASIDE * (high - low), row, mark.name, transform=axes.get_xaxis_transform(), color=SOFT,
                fontsize=7.5, va="top", ha="left", zorder=2.7, clip_on=True,
            )  # fmt: skip
            free_from[row] = mark.begin + LETTER * (len(mark.name) + 1) * (high - low)
