"""Five runs to look at: the commands, what they show, and their pictures, drawn when the docs are built."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from drawn import MARK, Mark, cloud, hd_curve
from small_runs import Drawn, made

from swarmer.observe.saved_timeline import SavedTimeline
from swarmer.observe.words import cells

FAILED = "#d8579f"
STYLE = """<style>
.five { display: grid; gap: .4rem .8rem; grid-template-columns: repeat(auto-fit, minmax(10rem, 1fr)); }
.five figure { margin: 0; max-width: none; width: auto; }
.five figcaption { font-size: .64rem; font-style: normal; margin: 0; max-width: none; }
</style>"""


class Shown(NamedTuple):
    """A run of the page."""

    title: str
    command: str
    notice: str  # Markdown


SHARED = "swarmer-run --engine virtual --shape dragon --points 200 --duration 20"
RUNS = (
    Shown(
        "Step by step",
        SHARED,
        "HD falls by a step with each thaw (orange): all are one swarm, forget it, and localize anew from where they "
        "are. Every flight that corrects an error adds a smaller one, so no step is the last. When nobody has to fly "
        "far any more, the display rests and thaws seldom.",
    ),
    Shown(
        "A thaw by the clock",
        f"{SHARED} --set thaw.policy=timer",
        "The same dragon, but nobody knows when all are one swarm: a thaw comes when the first timer is over. There "
        "are fewer of them, and HD is higher after the same time. [When to thaw](thaw-policies.md) measures all "
        "policies.",
    ),
    Shown(
        "One datagram in ten is lost",
        f"{SHARED} --set radio.loss=0.1",
        "At the sender, and again at each receiver. A lost FIN costs a lease, a lost FOLLOW_MERGE splits a swarm, "
        "whose parts merge again: the steps take longer, and they are there. `--trace` and "
        "[from symptom to cause](explain.md) show each one.",
    ),
    Shown(
        "FLSs that fail",
        f"{SHARED} --set failure.rate=0.001",
        "Each FLS fails about once in 1000 seconds (pink) and another takes its place, by dead reckoning, so it lands "
        "beside it. HD jumps to the newcomer's error, until that has joined its neighbours' swarm.",
    ),
    Shown(
        "In the plane",
        "swarmer-run --engine virtual --shape butterfly --duration 10",
        "A flat shape is the same protocol with one axis less. [Your own](own-shapes.md) is one command away.",
    ),
)  # fmt: skip


def runs_markdown() -> str:
    """All of the page's runs."""
    return STYLE + "\n\n" + "\n\n".join(map(_run, RUNS))


def _run(shown: Shown) -> str:
    return (
        f"## {shown.title}\n\n```sh\n{shown.command}\n```\n\n{picture(made(shown.command))}\n\n{shown.notice}"
    )


def picture(run: Drawn) -> str:
    """Where all have landed, where they are at the end, and HD in between."""
    timeline = run.timeline
    landed = int(np.logical_or.accumulate(timeline.lit, axis=0).all(axis=1).argmax())
    marks = [Mark(event.t_s, FAILED) for event in run.events if event.kind == "failure"]
    marks += [Mark(event.t_s, MARK) for event in run.events if event.kind == "thaw"]
    curve = hd_curve(timeline.t_s, timeline.hd_cells, marks, "HD over time, logarithmic")
    return (
        f'<div class="five">{_figure(timeline, landed, "all have landed")}{_figure(timeline, -1, "at the end")}'
        f"<figure>{curve}<figcaption>HD in cells over emulated time</figcaption></figure></div>"
    )


def _figure(timeline: SavedTimeline, at: int, title: str) -> str:
    swarms = len(np.unique(timeline.swarm[at][timeline.lit[at]]))
    said = (
        f"{title}, {timeline.t_s[at]:.1f} s: {swarms} swarm{'s' * (swarms != 1)}, "
        f"HD {cells(timeline.hd_cells[at])} cells"
    )
    drawing = cloud(
        timeline.truth, timeline.position[at].astype(float), timeline.swarm[at], timeline.lit[at], said
    )
    return f"<figure>{drawing}<figcaption>{said}</figcaption></figure>"
