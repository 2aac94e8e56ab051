"""A scenario of `tests/scenarios/` as a picture: a lane for each FLS, its state, and every datagram as it arrives."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import drawn

from swarmer.observe.palette import STATE_COLOURS
from swarmer.observe.protocol_words import STATE_NAMES
from swarmer.observe.scenario import first_difference, read
from swarmer.observe.stage import play

GOT = re.compile(r"(\d+) <= (\d+) (\S+)\s+(.*)")
SENT = re.compile(r"(\d+) => .*")
DID = re.compile(r"(\d+) ([a-z].*?)(?:\s{2,}(.*))?")
STATE = re.compile(
    r"([A-Z][A-Za-z]+)(?:\([al]\))?(?: flying)?(?: -> ([A-Z][A-Za-z]+)(?:\([al]\))?)?(?: flying)?"
)
GIVEN = re.compile(r"given (.+?) ([A-Z][A-Za-z]+)(?:\([al]\))?(.*)")
LANE, ROW, TOP, BAR = 190, 34, 44, 12
COLOURS = dict(zip(STATE_NAMES.values(), STATE_COLOURS, strict=True))


class Step(NamedTuple):
    """A line of what a scenario gives: an FLS, what it got or did, its state after it."""

    fid: int
    sender: int  # 0: nobody, it happened to it
    words: str
    state: str  # "" if the line says nothing of it


def sequence_svg(path: Path, said: str) -> str:
    """The picture. said: for somebody who does not see it. Raises ValueError if something else comes of the file."""
    scenario = read(path)
    given = play(scenario)
    if difference := first_difference(scenario, given):
        raise ValueError(f"{path}, {difference}")
    shown = [step for lines in given for line in lines if (step := step_of(line)) is not None]
    state = first_states(scenario.lines)
    lanes = {fid: LANE * (i + 0.5) for i, fid in enumerate(sorted(state))}
    height = TOP + ROW * len(shown) + 12
    bars, parts = [], [_head(fid, x, state[fid]) for fid, x in lanes.items()]
    since = dict.fromkeys(lanes, float(TOP - 8))
    for number, step in enumerate(shown):
        y, x = TOP + ROW * (number + 0.5), lanes[step.fid]
        if step.state and step.state != state[step.fid]:
            bars.append(_bar(x, since[step.fid], y, state[step.fid]))
            parts.append(_note(x, y, step.state))
            state[step.fid], since[step.fid] = step.state, y
        parts.append(
            _arrow(lanes[step.sender], x, y, step.words) if step.sender else _happened(x, y, step.words)
        )
    bars += [_bar(x, since[fid], height - 8, state[fid]) for fid, x in lanes.items()]
    return drawn.svg(LANE * len(lanes), height, [_tip(), *bars, *parts], said)


def first_states(lines: tuple[str, ...]) -> dict[int, str]:
    """The state of every FLS before anything happens."""
    found = {}
    for line in lines:
        if given := GIVEN.fullmatch(line):
            found |= {int(fid): given[2] for fid in given[1].split()}
    return found


def step_of(line: str) -> Step | None:
    """What a line of a scenario shows; what is sent shows when it arrives."""
    if got := GOT.fullmatch(line):
        return Step(int(got[1]), int(got[2]), got[3], _after(got[4]))
    if SENT.fullmatch(line) or not (did := DID.fullmatch(line)):
        return None
    return Step(int(did[1]), 0, did[2], _after(did[3] or ""))


def _after(words: str) -> str:
    found = STATE.match(words)
    return (found[2] or found[1]) if found else ""


def _tip() -> str:
    return (
        "<defs><marker id='sequence-tip' viewBox='0 0 10 10' refX='9' refY='5' markerWidth='8' markerHeight='8' "
        "orient='auto'><path d='M0 0 10 5 0 10z' fill='currentColor'/></marker></defs>"
    )


def _head(fid: int, x: float, state: str) -> str:
    return (
        f"<text x='{x}' y='14' text-anchor='middle' font-weight='bold'>FLS {fid}</text>"
        f"<text x='{x}' y='29' text-anchor='middle' font-size='11'>{state}</text>"
    )


def _bar(x: float, top: float, bottom: float, state: str) -> str:
    return (
        f"<rect x='{x - BAR / 2}' y='{top:.1f}' width='{BAR}' height='{max(0.0, bottom - top):.1f}' "
        f"fill='{COLOURS[state]}'/>"
    )


def _note(x: float, y: float, state: str) -> str:
    return f"<text x='{x + BAR}' y='{y + 18:.1f}' font-size='11' font-style='italic'>{state}</text>"


def _arrow(start: float, end: float, y: float, words: str) -> str:
    side = 1 if end > start else -1
    first, last = start + side * BAR / 2, end - side * (BAR / 2 + 1)
    return (
        f"<line x1='{first}' x2='{last}' y1='{y:.1f}' y2='{y:.1f}' stroke='currentColor' stroke-width='1.3' "
        f"marker-end='url(#sequence-tip)'/><text x='{(start + end) / 2}' y='{y - 4:.1f}' text-anchor='middle' "
        f"font-size='11'>{words}</text>"
    )


def _happened(x: float, y: float, words: str) -> str:
    return (
        f"<circle cx='{x}' cy='{y:.1f}' r='4' fill='currentColor'/>"
        f"<text x='{x + BAR}' y='{y + 4:.1f}' font-size='11'>{words}</text>"
    )
