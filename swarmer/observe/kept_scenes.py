"""Which scenes of an event log a page can hold: those around some moments, and as many whole lives as there is room."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from swarmer.observe.protocol_words import STATE_NAMES
from swarmer.observe.story import Scene, fate_words
from swarmer.observe.trace_file import Record

ROOM = 3_000_000  # characters of whole lives
MOST_OF_A_MOMENT = 200  # scenes around one moment that are kept
STATES = list(STATE_NAMES.values())
Span = tuple[float, float]  # emulated seconds


class Row(NamedTuple):
    """A scene as the page has it."""

    number: int  # in the order of the log
    t_s: float
    fid: int
    line: str  # as `swarmer explain` tells it
    text: str  # all of it, as JSON


class KeptScenes:
    """Takes scenes in order. What was kept is told by `rows` and `whole`."""

    def __init__(self, points: int, spans: Sequence[Span], first: Iterable[int], room: int = ROOM) -> None:
        """points: F; spans: in which everything is kept; first: FIDs whose lives are kept before those of others."""
        self.points, self._spans, self._room = points, spans, room
        order = dict.fromkeys(first)
        self._dropped_next = [*order, *(fid for fid in range(1, points + 1) if fid not in order)]
        self._lives: dict[int, list[Row]] = {fid: [] for fid in self._dropped_next}
        self._around: list[list[Row]] = [[] for _ in spans]
        self._number = 0

    def add(self, scene: Scene) -> None:
        """Take one more scene; one without effect is left out."""
        if scene.quiet:
            return
        self._number += 1
        near = [
            rows
            for rows, (low, high) in zip(self._around, self._spans, strict=True)
            if low <= scene.t_s <= high
        ]
        life = self._lives.get(scene.fid)
        if life is None and not near:
            return
        row = row_of(scene, self._number, self.points)
        for rows in near:
            rows.append(row)
        if life is not None:
            life.append(row)
            self._room -= len(row.text)
            while self._room < 0 and self._dropped_next:
                for dropped in self._lives.pop(self._dropped_next.pop()):
                    self._room += len(dropped.text)

    @property
    def whole(self) -> list[int]:
        """FIDs of whom everything with an effect is there."""
        return sorted(self._lives)

    def around(self, span: int, cast: Iterable[int]) -> list[Row]:
        """Scenes of these FLSs in one of the spans."""
        members = set(cast)
        return [row for row in self._around[span] if row.fid in members][:MOST_OF_A_MOMENT]

    def rows(self, casts: Sequence[Iterable[int]]) -> list[Row]:
        """Everything that is kept, in order: whole lives, and of each span the scenes of its cast."""
        kept = {row.number: row for life in self._lives.values() for row in life}
        for span, cast in enumerate(casts):
            kept |= {row.number: row for row in self.around(span, cast)}
        return [kept[number] for number in sorted(kept)]


def row_of(scene: Scene, number: int, points: int) -> Row:
    """A scene as a row: [second, FID, line, state, leases, sent, got, flight], see `cause_page.js`."""
    line = scene.line(points)
    after: list[Any] = scene.after or scene.before or []
    state = STATES.index(after[0]) if after and after[0] in STATES else -1
    leases = after[4] if after else 0
    records = [scene.first, *scene.more]
    sent = [[r["message"], r.get("copies", 1)] for r in records if r["is"] == "sent"]
    flown = [[r["until"], r["cells"]] for r in records if r["is"] == "flew"]
    row = [round(scene.t_s, 6), scene.fid, line, state, leases, sent, _got(scene.first), flown[:1]]
    return Row(number, scene.t_s, scene.fid, line, json.dumps(row, ensure_ascii=False, separators=(",", ":")))


def _got(first: Record) -> list[str]:
    """The id of the datagram that a scene begins with, and why nothing came of it; empty if it is none."""
    if first["is"] == "heard":
        return [first["message"], fate_words(first["fate"])]
    if first["is"] == "handled" and "xi" in first:
        return [first["cause"], first.get("why", "")]
    return []
