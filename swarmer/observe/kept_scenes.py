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
UNSAID, DARK = (
    -1,
    -2,
)  # of a row, instead of a state: the log does not repeat it here; no FLS is there, or not yet
Span = tuple[float, float]  # emulated seconds


class Moment(NamedTuple):
    """Some FLSs in some emulated seconds."""

    cast: tuple[int, ...]
    from_s: float
    to_s: float


class Row(NamedTuple):
    """A scene as the page has it."""

    number: int  # in the order of the log
    t_s: float
    fid: int
    line: str  # as `swarmer explain` tells it
    text: str  # all of it, as JSON


class KeptScenes:
    """Takes scenes in order. What was kept is told by `rows` and `whole`."""

    def __init__(
        self,
        points: int,
        spans: Sequence[Span],
        first: Iterable[int],
        fids: Iterable[int] | None = None,
        room: int = ROOM,
    ) -> None:
        """points: F. spans: in which everything is kept. first: FIDs whose lives are kept before those of others.

        fids: whose records the log has; None: everybody's. room: characters that lives may take.
        """
        self.points, self._spans, self._room = points, spans, room
        logged = dict.fromkeys(range(1, points + 1) if fids is None else sorted(fids))
        order = dict.fromkeys(fid for fid in first if fid in logged)
        self._dropped_next = [*order, *(fid for fid in logged if fid not in order)]
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

    def around(self, span: int, moment: Moment) -> list[Row]:
        """Scenes of a moment, which lies in one of the spans; the last ones where there are too many."""
        cast = set(moment.cast)
        return [
            row for row in self._around[span] if row.fid in cast and moment.from_s <= row.t_s <= moment.to_s
        ][-MOST_OF_A_MOMENT:]

    def rows(self, moments: Sequence[Moment]) -> list[Row]:
        """Everything that is kept, in order: whole lives, and the scenes of one moment in each span."""
        kept = {row.number: row for life in self._lives.values() for row in life}
        for span, moment in enumerate(moments):
            kept |= {row.number: row for row in self.around(span, moment)}
        return [kept[number] for number in sorted(kept)]


def row_of(scene: Scene, number: int, points: int) -> Row:
    """A scene as a row: [second, FID, line, state, leases, sent, got, flight], see report_assets/cause.js."""
    line = scene.line(points)
    after: list[Any] = scene.after or scene.before or []
    state = STATES.index(after[0]) if after and after[0] in STATES else UNSAID
    if scene.first["is"] in ("made", "ended"):
        state = DARK
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
