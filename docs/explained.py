"""The figures of the page that explains the protocol, drawn when the docs are built: of a scenario and of two runs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from drawn import CURVE, MARK, TRUTH, Frame, Mark, hd_curve, svg
from sequence_figure import sequence_svg
from small_runs import made

from swarmer.observe.moves import Move

SCENARIO = Path(__file__).resolve().parent.parent / "tests" / "scenarios" / "pair_lower_anchors.txt"
FOLLOWED = "swarmer-run --engine virtual --shape butterfly --duration 5 --trace"
THAWED = "swarmer-run --engine virtual --shape dragon --points 200 --duration 20"
WIDTH = 480  # of the curve
MIDDLE = 0.35  # of the display that a swarm has when its move is shown


def sequence() -> str:
    """A challenge, as a sequence."""
    return _figure(
        sequence_svg(
            SCENARIO, "FLS 2 challenges, FLS 1 accepts and anchors, FLS 2 measures and flies, FLS 3 follows."
        ),
        "FLS 2 and 3 are swarm 2; FLS 1 is a swarm of its own. Time runs down; the bars are states. Played and drawn "
        "from <code>tests/scenarios/pair_lower_anchors.txt</code> when this page was built.",
    )


def follow() -> str:
    """A swarm that localizes as one: whoever localizes, its anchor, and who flies the same vector."""
    run = made(FOLLOWED)
    assert run.log is not None
    move = chosen(list(run.log.moves.values()), len(run.timeline.truth))
    before = max(0, int(np.searchsorted(run.timeline.t_s, move.t_s)) - 1)
    frame = Frame(run.timeline.truth, 420)
    places = frame.places(run.timeline.position[before].astype(float))
    parts = [
        f"<circle cx='{x:.1f}' cy='{y:.1f}' r='3.2' fill='none' stroke='{TRUTH}' stroke-width='.7'/>"
        for x, y in frame.places(run.timeline.truth)
    ]
    flown = set(move.flown_by)
    for fid, (x, y) in enumerate(places, 1):
        fill = CURVE if fid == move.anchor else MARK if fid in flown else "currentColor"
        large = 4.6 if fid in (move.anchor, move.localizer) else 2.6
        parts.append(f"<circle cx='{x:.1f}' cy='{y:.1f}' r='{large}' fill='{fill}'/>")
    dx, dy = (frame.places(np.array([move.vector])) - frame.places(np.zeros((1, 3))))[0]
    parts += [
        f"<line x1='{x:.1f}' y1='{y:.1f}' x2='{x + dx:.1f}' y2='{y + dy:.1f}' stroke='{MARK}' stroke-width='1.6'/>"
        for x, y in (places[fid - 1] for fid in sorted(flown))
    ]
    drawing = svg(frame.width, frame.height, parts, "One vector, flown by a whole swarm")
    return _figure(
        drawing,
        f"At {move.t_s:.2f} s FLS {move.localizer} (large, orange) localizes against FLS {move.anchor} (large, blue), "
        f"and the {len(flown) - 1} others of its swarm (orange) fly the same vector, the lines. Rings are where FLSs "
        f"should be. From <code>{FOLLOWED}</code>, run when this page was built.",
    )


def chosen(moves: list[Move], count: int) -> Move:
    """The move of a swarm that is neither small nor the whole display; the longest of those with the most fliers."""
    some = [move for move in moves if 1 < len(move.flights) <= MIDDLE * count]
    return max(some, key=lambda move: (len(move.flights), float(np.linalg.norm(move.vector))))


def thaw() -> str:
    """HD with every thaw."""
    run = made(THAWED)
    thaws = [event.t_s for event in run.events if event.kind == "thaw"]
    marks = [Mark(t_s, MARK) for t_s in thaws]
    drawing = hd_curve(
        run.timeline.t_s,
        run.timeline.hd_cells,
        marks,
        "HD falls by a step after each thaw",
        end_s=min(20.0, 1.2 * thaws[-1]),
        width=WIDTH,
    )
    return _figure(
        drawing,
        f"HD in cells; the broken lines are the {len(thaws)} thaws. From <code>{THAWED}</code>, run when this page was "
        "built.",
    )


def _figure(drawing: str, caption: str) -> str:
    style = "margin:1em 0;max-width:38rem;width:100%"
    return f"<figure style='{style}'>{drawing}<figcaption>{caption}</figcaption></figure>"
