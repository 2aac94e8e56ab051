"""The event log summed up: the life of one FLS, the life of one datagram, all datagrams by kind."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from swarmer.observe.story import EVENT_WORDS, Scene, fate_words, scenes, sender, sent_words
from swarmer.observe.trace_file import Record, TraceFile

MESSAGE_ID = re.compile(r"\d{1,10}\.\d{1,5}#\d{1,10}", re.ASCII)
EPOCH_COLUMNS = ("epoch", "from", "swarms joined", "last xi", "localized", "anchored", "flights", "cells")
OVERVIEW = ("handled", "answered", "noted", "own", "address", "lost", "replayed", "dropped", "queued")


@dataclass(slots=True)
class Epoch:
    """What an FLS did between two thaws."""

    number: int
    from_s: float
    merges: int = 0
    last_xi: str = ""
    localized: int = 0
    anchored: int = 0
    flights: int = 0
    cells: float = 0.0


@dataclass(slots=True)
class Life:
    """All that a log says of one FLS, in numbers."""

    fid: int
    landmarks: list[str] = field(default_factory=list)
    epochs: list[Epoch] = field(default_factory=list)
    sent: Counter[str] = field(default_factory=Counter)
    heard: Counter[str] = field(default_factory=Counter)
    lost: int = 0
    expired: int = 0
    last: list[object] | None = None
    last_s: float = 0.0

    def add(self, record: Record) -> None:
        """Take one more record of this FLS."""
        kind, t_s = record["is"], record["t"]
        self.last_s = t_s
        if kind == "sent":
            self.sent[record["kind"].partition("(")[0]] += 1
            self.lost += record.get("copies", 1) == 0
        elif kind == "heard":
            self.heard[fate_words(record["fate"])] += 1
        elif kind == "flew":
            epoch = self._epoch(t_s)
            epoch.flights += 1
            epoch.cells += record["cells"]
        elif kind == "handled":
            self._handled(record, t_s)
        else:
            self._mark(t_s, next(scenes([record])).words[0])

    def _handled(self, record: Record, t_s: float) -> None:
        if "xi" in record:
            self.heard["handled"] += 1
        before: list[Any] = record["before"]
        after: list[Any] = record.get("after", before)
        self.last = after
        self.expired += record["event"] == "lease over"
        if before[0] == "Deploying" != after[0]:
            self._mark(t_s, "landed and lit")
        if after[2] != before[2]:
            self.epochs.append(Epoch(after[2], t_s, last_xi=after[1]))
            return
        epoch = self._epoch(t_s)
        epoch.number, epoch.last_xi = after[2], after[1]
        epoch.merges += before[1] != after[1]
        epoch.localized += record["event"] == "measured" and before[1] != after[1]
        epoch.anchored += before[0] != "BusyAnchor" == after[0]

    def _epoch(self, t_s: float) -> Epoch:
        if not self.epochs:
            self.epochs.append(Epoch(0, t_s))
        return self.epochs[-1]

    def _mark(self, t_s: float, words: str) -> None:
        self.landmarks.append(f"{t_s:10.4f} s  {words}")

    def lines(self) -> Iterator[str]:
        """The life on some lines."""
        yield f"FLS {self.fid}"
        yield from self.landmarks
        if self.last is not None:
            flying = ", flying" if self.last[3] else ""
            yield f"{self.last_s:10.4f} s  last: {self.last[0]}{flying}, xi {self.last[1]}, epoch {self.last[2]}"
        rows: list[tuple[str, ...]] = [
            ("epoch", "from", "swarms joined", "last xi", "localized", "anchored", "flights", "cells")
        ]
        rows += [
            (
                str(e.number), f"{e.from_s:.4f} s", str(e.merges), e.last_xi, str(e.localized), str(e.anchored),
                str(e.flights), f"{e.cells:.2f}",
            )
            for e in self.epochs
        ]  # fmt: skip
        yield from table(rows)
        yield f"  sent   {counts(self.sent)}" + (f"; {self.lost} lost at the sender" if self.lost else "")
        yield f"  heard  {counts(self.heard)}"
        if self.expired:
            yield f"  leases ran out {self.expired} times"


def table(rows: list[tuple[str, ...]]) -> list[str]:
    """Columns below each other, two spaces in front, all to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  " + "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows
    ]


def counts(numbers: Counter[str]) -> str:
    """Most frequent first.

    >>> counts(Counter(ACK=2, INIT=5))
    '5 INIT, 2 ACK'
    """
    return ", ".join(f"{number:,} {name}" for name, number in numbers.most_common()) or "nothing"


def message_life(records: Iterable[Record], name: str) -> tuple[Record | None, list[Scene]]:
    """How the datagram `name` was sent, if the log has it, and what came of it wherever it was heard."""
    sent: Record | None = None
    others: list[Record] = []
    for record in records:
        if record["is"] == "sent" and record["message"] == name:
            sent = record
        elif name in (record.get("message"), record.get("cause"), *record.get("judged", ())):
            others.append(record)
    return sent, list(scenes(others))


def message_lines(sent: Record | None, came: list[Scene], name: str, points: int) -> Iterator[str]:
    """The life of a datagram: by whom, when and why; what became of it."""
    if sent is None:
        yield f"{name}  sent by {'the engine' if name.startswith('0.') else 'an FLS whose records were not kept'}"
    else:
        yield f"{sent['t']:10.4f} s  {sent['fid']} (xi {sent['xi']}) sent {sent_words(sent)}"
        yield from (f"              {reason}" for reason in [because(sent)] if reason)
    fates: Counter[str] = Counter()
    for scene in came:
        first = scene.first
        if first["is"] == "heard":
            fates[fate_words(first["fate"])] += 1
        elif first["is"] == "handled" and "xi" in first and first["cause"] == name:
            fates["handled"] += 1
    yield f"              heard: {counts(fates)}"
    yield from (scene.line(points) for scene in came)


def because(sent: Record) -> str:
    """What a datagram was sent for, and the id of the datagram that led to it."""
    event, cause = str(sent.get("event", "")), str(sent.get("cause", ""))
    if not event:
        return ""
    if event.isupper():  # a kind of datagram
        return f"because of {event} {sender(cause)}"
    return f"because: {EVENT_WORDS.get(event, event)}" + (f", after [{cause}]" if cause else "")


def overview(trace: TraceFile) -> Iterator[str]:
    """All datagrams of a log by kind, and what became of them at their receivers."""
    sent: Counter[str] = Counter()
    fates: dict[str, Counter[str]] = {}
    for record in trace.records():
        named = record["kind"] if "kind" in record else record.get("event")
        kind = str(named).partition("(")[0]
        if record["is"] == "sent":
            sent[kind] += 1
            if record.get("copies", 1) == 0:
                fates.setdefault(kind, Counter())["lost"] += 1
        elif record["is"] == "heard":
            fates.setdefault(kind, Counter())[record["fate"]] += 1
        elif record["is"] == "handled" and "xi" in record:
            fates.setdefault(kind, Counter())["handled"] += 1
    kinds = sorted({*sent, *fates})
    used = [fate for fate in OVERVIEW if any(kind in fates and fates[kind][fate] for kind in kinds)]
    titles = {"handled": "handled", "own": "own swarm", "address": "not for it", "answered": "at once"}
    rows = [("", "sent", *(titles.get(fate, fate) for fate in used))]
    rows += [
        (kind.ljust(13), f"{sent[kind]:,}", *(f"{fates.get(kind, Counter())[fate]:,}" for fate in used))
        for kind in kinds
    ]
    yield from table(rows)
