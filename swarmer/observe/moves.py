"""Who flew whose vector, from the event log: each localization with its anchor, its followers, and who missed it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from swarmer.observe.story import fate_words
from swarmer.observe.trace_file import Record

MOVING = ("FOLLOW", "FOLLOW_MERGE")  # kinds of datagrams that hold a vector
WAITS = "waits for the landing"
UNHEARD = "never reached it"


@dataclass(slots=True)
class Flight:
    """A flight of one FLS."""

    fid: int
    from_s: float
    until_s: float
    cells: float
    move: Move | None = None  # whose vector; None: the flight to its point, by dead reckoning


@dataclass(slots=True)
class Move:
    """An FLS has localized, and tells its swarm the vector that it flies itself."""

    t_s: float
    message: str  # id of the datagram that holds the vector
    kind: str  # and its kind
    localizer: int
    anchor: int  # 0 where the log does not say
    swarm: str  # that is told
    lost_at_sender: bool
    members: set[int]  # of that swarm, besides the localizer
    vector: tuple[float, float, float]  # cells
    flights: list[Flight] = field(default_factory=list)
    said: dict[int, str] = field(default_factory=dict)  # FID -> what became of the datagram there, in words

    @property
    def flown_by(self) -> list[int]:
        """FIDs, the localizer's first."""
        return [flight.fid for flight in self.flights]

    def missed(self) -> dict[int, str]:
        """Members that did not fly it, and why."""
        left = sorted(self.members - set(self.flown_by))
        otherwise = "lost at the sender" if self.lost_at_sender else UNHEARD
        return {fid: self.said.get(fid, otherwise) for fid in left}


@dataclass(slots=True)
class Change:
    """Something else that moves HD: an FLS that lights up, goes dark, or thaws."""

    t_s: float
    fid: int
    what: str  # lit | dark | thawed
    words: str


class Moves:
    """Takes the records of a log in order; then `moves`, `flights` and `changes` are there, in order, too."""

    def __init__(self, spans: Sequence[tuple[float, float]] | None = None) -> None:
        """spans: emulated seconds of which moves and flights are kept; None: of all. A long log has too many."""
        self._spans = spans
        self.moves: dict[str, Move] = {}  # by the id of the datagram
        self.flights: dict[int, list[Flight]] = {}  # by FID
        self.changes: list[Change] = []
        self._swarm: dict[int, str] = {}  # FID -> Swarm-ID while lit
        self._members: dict[str, set[int]] = {}
        self._told: dict[int, tuple[float, Move]] = {}  # FID -> the move that it takes up at this moment
        self._incarnation: dict[int, int] = {}

    def add(self, record: Record) -> None:
        """Take one more record."""
        what = record["is"]
        if what == "handled":
            self._handled(record)
        elif what == "sent":
            self._sent(record)
        elif what == "flew":
            self._flew(record)
        elif what == "heard":
            if record["message"] in self.moves:
                self.moves[record["message"]].said[record["fid"]] = fate_words(record["fate"])
        elif what == "ended":
            self._belong(record["fid"], "")
            words = "failed" if record["how"] == "failed" else "left to charge"
            self.changes.append(Change(record["t"], record["fid"], "dark", words))
        elif what == "made":
            self._incarnation[record["fid"]] = record["incarnation"]

    def _handled(self, record: Record) -> None:
        fid, t_s = record["fid"], record["t"]
        before: list[Any] = record["before"]
        after: list[Any] = record.get("after", before)
        self._belong(fid, "" if after[0] == "Deploying" else after[1])
        if before[0] == "Deploying" != after[0]:
            replaced = self._incarnation.get(fid, 0)
            words = f"replaced, and its incarnation {replaced} landed" if replaced else "landed"
            self.changes.append(Change(t_s, fid, "lit", words))
        if after[2] != before[2]:
            self.changes.append(Change(t_s, fid, "thawed", f"epoch {before[2]}->{after[2]}"))
        for name in (record.get("cause", ""), *record.get("judged", ())):
            if (move := self.moves.get(name)) is not None and fid != move.localizer:
                self._take_up(move, record)

    def _take_up(self, move: Move, record: Record) -> None:
        """A member has the datagram: what it makes of it shows in its flight, or in these words."""
        fid, why = record["fid"], record.get("why", "")
        if why != WAITS:
            self._told[fid] = (record["t"], move)
        if why == "ignored":
            why = f"ignored in {record['before'][0]}"
        move.said[fid] = why or "no flight came of it"

    def _sent(self, record: Record) -> None:
        kind = record["kind"].partition("(")[0]
        if kind not in MOVING or not self._keeps(record["t"]):
            return
        fid, swarm = record["fid"], record["to"].removeprefix("swarm ")
        cause = str(record.get("cause", ""))
        anchor = int(cause.partition(".")[0]) if cause.partition(".")[0].isdecimal() else 0
        members = set(self._members.get(swarm, ())) - {fid}
        lost = record.get("copies", 1) == 0
        move = Move(record["t"], record["message"], kind, fid, anchor, swarm, lost, members, _vector(record))
        self.moves[move.message] = move
        self._told[fid] = (move.t_s, move)

    def _flew(self, record: Record) -> None:
        fid, t_s = record["fid"], record["t"]
        if not self._keeps(t_s):
            return
        told_s, move = self._told.get(fid, (-1.0, None))
        flight = Flight(fid, t_s, record["until"], record["cells"], move if told_s == t_s else None)
        self.flights.setdefault(fid, []).append(flight)
        if flight.move is not None:
            flight.move.flights.append(flight)

    def _keeps(self, t_s: float) -> bool:
        return self._spans is None or any(low <= t_s <= high for low, high in self._spans)

    def _belong(self, fid: int, swarm: str) -> None:
        old = self._swarm.get(fid, "")
        if old == swarm:
            return
        if old:
            self._members[old].discard(fid)
        if swarm:
            self._members.setdefault(swarm, set()).add(fid)
        self._swarm[fid] = swarm


def _vector(record: Record) -> tuple[float, float, float]:
    """What a datagram tells its swarm to fly; nowhere, where the log does not say."""
    vector = record.get("vector")
    if (
        not isinstance(vector, list)
        or len(vector) != 3
        or not all(isinstance(v, (int, float)) for v in vector)
    ):
        return (0.0, 0.0, 0.0)
    x, y, z = map(float, vector)
    return (x, y, z)
