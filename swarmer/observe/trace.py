"""The event log of a run: what each FLS heard, when, in which state, and what it did because of it (docs/explain.md).

`trace.jsonl.gz` holds one JSON object a line. The first is a header; each other one is a record with `t` (emulated
second), `fid` and `is`:

made      a new FLS: `incarnation`
handled   the machine took an event: `event`, `before` and, if it changed, `after` ([state, ξ, epoch, flying, leases]);
          `cause`, the id of the datagram that it was or came of; of a datagram also `xi`, its sender's; `timers`;
          `why` if nothing came of it; `judged`, ids of swarm messages that had waited for this landing
heard     a datagram that came no further than this FLS's end of the radio: `message`, `kind`, `fate` (result.FATES)
sent      a datagram was stamped: `message`, its id, `kind`, `to`, `xi`, `event` and `cause` that it is sent for,
          `copies` if not one
flew      a flight began: `cells`, `asked`, `until`, `cause`
ended     `how`: failed, departed

The id of a datagram is FID.incarnation#number, the number being the sender's stamp: `17.0#203`. The engine is FID 0.
"""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import swarmer
from swarmer.engines.result import RunResult, Seen, Witness
from swarmer.errors import BadInput, RunFailed
from swarmer.messages import (
    FOLLOW,
    FOLLOW_MERGE,
    JOIN,
    SWARM_KINDS,
    TO_SWARM,
    Message,
    Stamp,
    Vec3,
)
from swarmer.observe.protocol_words import (
    KIND_NAMES,
    STATE_NAMES,
    addressee_name,
    datagram_name,
    event_name,
    swarm_name,
    timer_words,
)
from swarmer.protocol.events import (
    IGNORED,
    STALE,
    Action,
    Arm,
    Disarm,
    Event,
    Fly,
    Landed,
    Measure,
    Measured,
    Received,
    Send,
)

if TYPE_CHECKING:
    from swarmer.observe.files import Stream
    from swarmer.physics.flight import Flight
    from swarmer.plan import Plan

FORMAT = 1
LEVEL = 1  # of zlib: a higher one takes several times as long for a fifth less
GATHERED = 2000  # records compressed together


class Tracer(Witness):
    """Writes the event log. Hand it to the engine, `open` it before the run and `close` it after."""

    def __init__(self, plan: Plan, fids: frozenset[int] | None = None) -> None:
        """fids: whose records are kept; None: everybody's."""
        self._fids = fids
        self._header = {
            "swarmer_trace": FORMAT,
            "swarmer": swarmer.__version__,
            "shape": plan.cloud.name,
            "points": plan.size,
            "seed": plan.config.seed,
            "fids": None if fids is None else sorted(fids),
        }
        self._stream: Stream | None = None
        self._zip = zlib.compressobj(LEVEL, zlib.DEFLATED, 31)
        self._lines: list[str] = []
        self._known: dict[int, tuple[Any, ...]] = {}  # FID -> what its state was made of
        self._state: dict[int, str] = {}  # FID -> its state as JSON
        self._door: tuple[int, Message, Stamp, str, float] | None = None  # heard and queued, not yet written
        self._why: dict[int, str] = {}  # id() of a message that will be sent -> what it is sent for, as JSON
        self._answering: dict[int, str] = {}  # FID -> what it answers at once
        self._cause: dict[
            tuple[int, type], str
        ] = {}  # (FID, Landed or Measured) -> what that will have come of
        self._waiting: dict[
            int, list[tuple[Message, str]]
        ] = {}  # FID -> swarm messages that wait for its landing
        self._ignored = self._stale = 0

    def open(self, stream: Stream) -> None:
        """Write to this stream from now on."""
        self._stream = stream
        self._lines.append(json.dumps(self._header) + "\n")

    def close(self, result: RunResult) -> None:
        """Write the rest; a disk that refuses makes a failed run of it."""
        try:
            self._settle()
            end = {"is": "end", "t": round(result.emulated_s, 6), "status": result.status}
            self._write("".join(self._lines) + json.dumps(end) + "\n", zlib.Z_FINISH)
        except RunFailed as failure:
            if result.status != "failed":
                result.status, result.message = "failed", str(failure)

    # -- what the engine tells -----------------------------------------------------------------------------------

    def made(self, fls: Seen, now_s: float) -> None:
        """A new FLS."""
        self._settle()
        fid = fls.fid
        self._waiting.pop(fid, None)
        if self._keeps(fid):
            self._look(fls)
            self._add(
                f'{{"t":{now_s:.6f},"fid":{fid},"is":"made","incarnation":{fls.machine.incarnation}}}\n'
            )

    def handled(
        self, fls: Seen, event: Event, actions: Sequence[Action], cause: Stamp | None, now_s: float
    ) -> None:
        """The machine took an event."""
        machine, fid = fls.machine, fls.fid
        counts = machine.counts
        idle, self._ignored = counts[IGNORED] > self._ignored, counts[IGNORED]
        stale, self._stale = counts[STALE] > self._stale, counts[STALE]
        if not self._keeps(fid):
            self._settle()
            return
        if cause is None:
            self._settle()
        elif not self._enters(fid, event, actions, cause):
            return
        name, judged = self._cause_of(fid, event, cause), self._judged(fls)
        told = event_name(event)
        why = f'"event":"{told}"' + (f',"cause":"{name}"' if name else "")
        epoch, before = self._known[fid][2], self._state[fid]
        after = f',"after":{self._state[fid]}' if self._look(fls) else ""
        more = ""
        if type(event) is Received:
            idle = idle and not actions
            more = _about(event.message, epoch) + self._nothing_came(fls, event.message, name, idle, stale)
        if judged:
            more += f',"judged":{json.dumps(judged)}'
        if timers := self._remember(fid, actions, why, judged[-1] if judged else name):
            more += ',"timers":["' + '","'.join(timers) + '"]'
        self._add(f'{{"t":{now_s:.6f},"fid":{fid},"is":"handled",{why},"before":{before}{after}{more}}}\n')

    def sent(self, fls: Seen, message: Message, stamp: Stamp, copies: int, now_s: float) -> None:
        """A datagram is on its way."""
        self._settle()
        fid = fls.fid
        if not self._keeps(fid):
            return
        why = self._why.pop(id(message), "") or self._answering.get(fid, "")
        vector = ""
        if message.kind in (FOLLOW, FOLLOW_MERGE):
            vector = ',"vector":[{:.4f},{:.4f},{:.4f}]'.format(*message.vector)
        self._add(
            f'{{"t":{now_s:.6f},"fid":{fid},"is":"sent","message":"{datagram_id(message, stamp)}",'
            f'"kind":"{datagram_name(message)}","to":"{addressee_name(message)}","xi":"{swarm_name(message.swarm)}"'
            + (f",{why}" if why else "")
            + vector
            + (f',"copies":{copies}' if copies != 1 else "")
            + "}\n"
        )

    def heard(self, fls: Seen, message: Message, stamp: Stamp, fate: str, now_s: float) -> None:
        """A datagram came to an FLS."""
        self._settle()
        if not self._keeps(fls.fid):
            return
        if fate == "queued":
            self._door = (fls.fid, message, stamp, fate, now_s)  # most are handled at once, and that says all
            return
        if fate == "answered":
            self._answering[fls.fid] = (
                f'"event":"{KIND_NAMES[message.kind]}","cause":"{datagram_id(message, stamp)}"'
            )
        self._note_heard(fls.fid, message, stamp, fate, now_s)

    def flew(self, fls: Seen, asked: Vec3, flight: Flight, now_s: float) -> None:
        """A flight begins."""
        self._settle()
        fid = fls.fid
        if self._keeps(fid):
            name = self._cause.get((fid, Landed), "")
            self._add(
                f'{{"t":{now_s:.6f},"fid":{fid},"is":"flew","cells":{flight.length:.4f},'
                f'"asked":[{asked[0]:.4f},{asked[1]:.4f},{asked[2]:.4f}],"until":{now_s + flight.duration_s:.6f}'
                + (f',"cause":"{name}"' if name else "")
                + "}\n"
            )

    def ended(self, fls: Seen, how: str, now_s: float) -> None:
        """An FLS has gone dark."""
        self._settle()
        if self._keeps(fls.fid):
            self._add(f'{{"t":{now_s:.6f},"fid":{fls.fid},"is":"ended","how":"{how}"}}\n')

    # -- what goes with an event ---------------------------------------------------------------------------------

    def _look(self, fls: Seen) -> bool:
        """Keep the state of an FLS; whether it has changed."""
        m = fls.machine
        key = (m.state, m.swarm, m.epoch, m.flying, len(m.leases))
        if key == self._known.get(fls.fid):
            return False
        self._known[fls.fid] = key
        flying = "true" if m.flying else "false"
        self._state[fls.fid] = (
            f'["{STATE_NAMES[m.state]}","{swarm_name(m.swarm)}",{m.epoch},{flying},{len(m.leases)}]'
        )
        return True

    def _enters(self, fid: int, event: Event, actions: Sequence[Action], cause: Stamp) -> bool:
        """A datagram has come to the machine: is there more to say than that it was heard?"""
        door, self._door = self._door, None
        if door is not None and (door[0] != fid or door[2] is not cause):
            self._note_heard(*door)
        return bool(actions) or not event.noted  # type: ignore[union-attr]

    def _cause_of(self, fid: int, event: Event, cause: Stamp | None) -> str:
        """The id of the datagram that an event is, or came of; empty where there is none."""
        if cause is not None:
            return datagram_id(event.message, cause)  # type: ignore[union-attr]
        if type(event) is Landed or type(event) is Measured:
            return self._cause.pop((fid, type(event)), "")
        return ""

    def _judged(self, fls: Seen) -> list[str]:
        """Ids of the swarm messages that do not wait for this FLS's landing any more."""
        waiting = self._waiting.get(fls.fid)
        if not waiting:
            return []
        there = set(map(id, fls.machine.pending))
        self._waiting[fls.fid] = [entry for entry in waiting if id(entry[0]) in there]
        return [name for message, name in waiting if id(message) not in there]

    def _nothing_came(self, fls: Seen, message: Message, name: str, idle: bool, stale: bool) -> str:
        """Why a datagram has no effect, or none yet."""
        machine = fls.machine
        if message.kind in SWARM_KINDS and machine.pending and machine.pending[-1] is message:
            self._waiting.setdefault(fls.fid, []).append((message, name))
            return ',"why":"waits for the landing"'
        if stale:
            return ',"why":"of an earlier epoch"'
        if not idle:
            return ""
        other = message.to == TO_SWARM and message.addressee != machine.swarm
        return ',"why":"for a swarm that it is not in any more"' if other else ',"why":"ignored"'

    def _remember(self, fid: int, actions: Sequence[Action], why: str, name: str) -> list[str]:
        """What the actions will be done for; what they do to timers."""
        timers = False
        for action in actions:
            kind = type(action)
            if kind is Send:
                self._why[id(action.message)] = why  # type: ignore[union-attr]
            elif kind is Arm or kind is Disarm:
                timers = True
            elif name and (kind is Fly or kind is Measure):
                self._cause[(fid, Landed if kind is Fly else Measured)] = name
        return timer_words(actions) if timers else []

    def _note_heard(self, fid: int, message: Message, stamp: Stamp, fate: str, now_s: float) -> None:
        self._add(
            f'{{"t":{now_s:.6f},"fid":{fid},"is":"heard","message":"{datagram_id(message, stamp)}",'
            f'"kind":"{datagram_name(message)}","fate":"{fate}"}}\n'
        )

    # -- writing -------------------------------------------------------------------------------------------------

    def _keeps(self, fid: int) -> bool:
        return self._fids is None or fid in self._fids

    def _settle(self) -> None:
        """Write down a datagram that was queued and has not been handled at once."""
        if self._door is not None:
            door, self._door = self._door, None
            self._note_heard(*door)

    def _add(self, line: str) -> None:
        lines = self._lines
        lines.append(line)
        if len(lines) >= GATHERED:
            self._write("".join(lines))
            lines.clear()

    def _write(self, text: str, flush: int = zlib.Z_NO_FLUSH) -> None:
        data = self._zip.compress(text.encode())
        if flush != zlib.Z_NO_FLUSH:
            data += self._zip.flush(flush)
        if data and self._stream is not None:
            self._stream.write(data)


def datagram_id(message: Message, stamp: Stamp) -> str:
    """FID.incarnation#number of a datagram."""
    return f"{message.sender}.{message.incarnation}#{stamp.number}"


def _about(message: Message, epoch: int) -> str:
    """What of a datagram explains what came of it. epoch: of the FLS before it."""
    more = f',"xi":"{swarm_name(message.swarm)}"'
    if message.flags & JOIN:
        more += ',"joins":true'
    if message.to == TO_SWARM:
        more += f',"kind":"{datagram_name(message)}","for":"{swarm_name(message.addressee)}"'
    return more + f',"epoch":{message.epoch}' if message.epoch != epoch else more


def fids_named(text: str, count: int, option: str = "trace-fids") -> frozenset[int]:
    """FIDs as `17,40-60` names them, in a display of `count` FLSs. Raises BadInput.

    >>> sorted(fids_named("3, 8-10", 12))
    [3, 8, 9, 10]
    """
    found: set[int] = set()
    for part in text.split(","):
        ends = re.fullmatch(r"\s*(\d{1,9})\s*(?:-\s*(\d{1,9})\s*)?", part, re.ASCII)
        low, high = (int(ends[1]), int(ends[2] or ends[1])) if ends else (0, 0)
        if not 1 <= low <= high <= count:
            raise BadInput(option, text, f"FIDs of this run, 1 to {count}, as 17,40-60")
        found.update(range(low, high + 1))
    return frozenset(found)
