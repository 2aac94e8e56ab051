"""Both ends of one FLS's radio: the rules that the settings give, and the faults that a schedule adds for a time; pure.

A fault on the air hits what is sent while it lasts, whenever that is heard: so it is the same whether a datagram takes
microseconds or waits for a process that hangs. Each fault draws from a stream of its own, and only while it lasts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from random import Random
from typing import TYPE_CHECKING

from swarmer.messages import ENGINE_FID, Message
from swarmer.radio import LOST, End, EndRules, dead_link

if TYPE_CHECKING:
    from swarmer.faults import Fault, Schedule
    from swarmer.rules import Rules

NOW: tuple[float, ...] = (0.0,)  # one copy, at once


class Ends:
    """What becomes of the datagrams that one FLS sends and hears."""

    __slots__ = (
        "_calm_s", "_dead_links", "_fid", "_in", "_out", "_seed", "_storm_in", "_storm_out", "plain_in", "plain_out",
    )  # fmt: skip

    def __init__(
        self, rules: Rules, schedule: Schedule, seed: int, fid: int, stream: Callable[[str], Random]
    ) -> None:
        """stream: makes this FLS's generator for each purpose."""
        self._seed, self._fid, self._dead_links = seed, fid, rules.dead_links
        self._out = _end(EndRules(*rules.sender), stream, "sender")
        self._in = _end(EndRules(*rules.receiver), stream, "receiver")
        self._calm_s = math.inf if schedule.calm_s is None else schedule.calm_s
        self._storm_out: list[_Storm] = []
        self._storm_in: list[_Storm] = []
        air = schedule.of_the_air()
        for number, fault in enumerate(air):
            if fault.what == "cut":
                self._storm_in.append(_Cut(fault, fid))
            elif fid in part_of(fault.where):
                # The same fault draws the same whatever else a schedule has; two alike would else draw alike.
                alike = sum(other[:2] == fault[:2] for other in air[:number])
                purpose = f"fault {fault.what} {fault.at_s!r} {alike}"
                if fault.way != "in":
                    self._storm_out.append(_Noise(fault, stream, f"{purpose} out"))
                if fault.way != "out":
                    self._storm_in.append(_Noise(fault, stream, f"{purpose} in"))
        self.plain_out = self._out is None and not self._storm_out
        self.plain_in = self._in is None and not self._storm_in and not self._dead_links

    def sent(self, message: Message, now: float) -> tuple[float, ...]:
        """After how many emulated seconds each copy of what it sends leaves; none if it is lost."""
        if now >= self._calm_s:
            return NOW
        copies = NOW if self._out is None else self._out.copies()
        return _through(self._storm_out, message, now, copies)

    def heard(self, message: Message, sent_at: float) -> tuple[float, ...]:
        """After how many emulated seconds each copy of what has come to it goes on; none if it is lost."""
        if message.sender == ENGINE_FID or sent_at >= self._calm_s:
            return NOW
        if self._dead_links and dead_link(self._seed, message.sender, self._fid, self._dead_links):
            return LOST
        copies = NOW if self._in is None else self._in.copies()
        return _through(self._storm_in, message, sent_at, copies)


def _through(
    storm: list[_Storm], message: Message, at_s: float, copies: tuple[float, ...]
) -> tuple[float, ...]:
    """Copies, after each fault that hits this message has had its turn."""
    for fault in storm:
        if fault.begins_s <= at_s < fault.ends_s and fault.hits(message):
            copies = tuple(delay + more for delay in copies for more in fault.copies())
    return copies


def _end(rules: EndRules, stream: Callable[[str], Random], purpose: str) -> End | None:
    """None where there is nothing to draw."""
    return None if rules.perfect else End(rules, stream, purpose)


@cache
def part_of(where: tuple[int, ...]) -> frozenset[int]:
    """FIDs to look up in: one set for all FLSs of a process, and of those that are forked from it."""
    return frozenset(where)


class _Storm:
    """A fault on the air, as one FLS meets it."""

    __slots__ = ("begins_s", "ends_s", "kinds")

    def __init__(self, fault: Fault) -> None:
        self.begins_s, self.ends_s = fault.at_s, fault.ends_s
        self.kinds = frozenset(fault.kinds)

    def hits(self, message: Message) -> bool:
        """True if it is one of the datagrams that this fault is about."""
        raise NotImplementedError

    def copies(self) -> tuple[float, ...]:
        """As `radio.fate`."""
        return LOST


class _Cut(_Storm):
    """The border of a part of the display, at whoever is to hear across it."""

    __slots__ = ("_inside", "_part", "_shut")

    def __init__(self, fault: Fault, fid: int) -> None:
        super().__init__(fault)
        self._part = part_of(fault.where)
        self._inside = fid in self._part
        self._shut = fault.way != ("out" if self._inside else "in")  # for what comes to this FLS

    def hits(self, message: Message) -> bool:
        crosses = self._shut and (message.sender in self._part) != self._inside
        return crosses and (not self.kinds or message.kind in self.kinds)


class _Noise(_Storm):
    """Loss, delay, doubling or holding back at one end."""

    __slots__ = ("_end", "_source")

    def __init__(self, fault: Fault, stream: Callable[[str], Random], purpose: str) -> None:
        super().__init__(fault)
        self._source = part_of(fault.source)
        self._end = End(_rules_of(fault), stream, purpose)

    def hits(self, message: Message) -> bool:
        ours = not self._source or message.sender in self._source
        return ours and (not self.kinds or message.kind in self.kinds)

    def copies(self) -> tuple[float, ...]:
        return self._end.copies()


def _rules_of(fault: Fault) -> EndRules:
    """The fault as the radio's rules have it."""
    if fault.what == "loss":
        return EndRules(loss=fault.p, burst=fault.burst)
    if fault.what == "duplicate":
        return EndRules(duplicate=fault.p)
    if fault.what == "reorder":
        return EndRules(reorder=fault.p, reorder_s=fault.delay_s)
    return EndRules(delay_s=fault.delay_s, jitter_s=fault.jitter_s)
