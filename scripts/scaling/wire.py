"""What goes over the air in one formation, and how much of it would cross from one host to another.

The virtual engine runs as it is, on an `Air` that counts: datagrams, deliveries, and for several ways to share the FLSs
among hosts the copies that hosts would send each other, one for each other host with a receiver, as relays do.
"""

from __future__ import annotations

from collections import defaultdict
from random import Random

import numpy as np
from numpy.typing import NDArray

from swarmer.engines import virtual
from swarmer.engines.result import Event, RunResult, Snapshot
from swarmer.engines.virtual import VirtualEngine
from swarmer.engines.virtual_fls import VirtualFls
from swarmer.engines.virtual_radio import Air
from swarmer.messages import TO_FLS, Message, Stamp
from swarmer.plan import Plan

BIN_S = 0.1  # emulated: how long the busiest moment is that is looked for
FEW = 32  # addressees that a radio serves one by one (radio.unicast_max); for more it broadcasts


class Count:
    """Of one kind of message, in one formation."""

    def __init__(self, shares: int) -> None:
        self.sent = self.delivered = self.largest = 0
        self.broadcasts = 0  # those for more than FEW
        self.crossings = [0] * shares  # by share: copies between hosts
        self.airings = [0] * shares  # by share: hosts on which a broadcast is made, its own too


class Wire:
    """Counts from `begin` to `end`."""

    def __init__(self, size: int, hosts: list[NDArray[np.int32]]) -> None:
        """hosts: for each share, (F + 1,): the host of each FID; row 0 is nobody's."""
        self.hosts = hosts
        self.lists = [share.tolist() for share in hosts]
        self.on = False
        self.size = size
        self.begin()
        self.on = False

    def begin(self) -> None:
        """From now on, and from nothing."""
        self.on = True
        self.counts: dict[int, Count] = defaultdict(lambda: Count(len(self.hosts)))
        self.received = np.zeros(self.size + 1, np.int64)
        self.bins: dict[int, int] = defaultdict(int)  # deliveries
        self.crossed: list[dict[int, int]] = [defaultdict(int) for _ in self.hosts]

    def note(self, kind: int, sender: int, receivers: list[int], now: float) -> None:
        """One datagram, and whom it goes to."""
        count, slot = self.counts[kind], int(now / BIN_S)
        count.sent += 1
        count.delivered += len(receivers)
        count.largest = max(count.largest, len(receivers))
        self.bins[slot] += len(receivers)
        self.received[receivers] += 1
        many = len(receivers) > FEW
        count.broadcasts += many
        for number, of in enumerate(self.lists):
            reached = set(
                np.unique(self.hosts[number][receivers]).tolist() if many else map(of.__getitem__, receivers)
            )
            count.airings[number] += many * len(reached)
            reached.discard(of[sender])
            count.crossings[number] += len(reached)
            self.crossed[number][slot] += len(reached)


class CountingAir(Air):
    """An `Air` that tells a wire; which one, its class knows, for the engine makes it."""

    wire: Wire

    def transmit(self, message: Message, stamp: Stamp, latency: Random, sender: VirtualFls | None) -> None:
        """As it is, and counted if it is for one."""
        if message.to == TO_FLS and self.wire.on:
            self.wire.note(message.kind, message.sender, [message.addressee.xi], self.agenda.now)
        super().transmit(message, stamp, latency, sender)

    def _send_to(self, receivers: list[VirtualFls], message: Message, stamp: Stamp, latency: Random) -> None:
        if self.wire.on:
            self.wire.note(message.kind, message.sender, [fls.fid for fls in receivers], self.agenda.now)
        super()._send_to(receivers, message, stamp, latency)


class Formation:
    """An observer that has the wire count from the first thaw to the second, and stops the run there."""

    def __init__(self, wire: Wire) -> None:
        self.wire = wire
        self.thaws_s: list[float] = []

    def planned(self, plan: Plan) -> None:
        """Nothing to do."""

    def launching(self, ready: int, total: int) -> None:
        """Nothing to do."""

    def go(self, launch_s: float) -> None:
        """Nothing to do."""

    def sample(self, snapshot: Snapshot) -> bool:
        """True: it is enough."""
        return len(self.thaws_s) >= 2

    def event(self, event: Event) -> None:
        """The wire counts one formation."""
        if event.kind == "thaw":
            self.thaws_s.append(event.t_s)
            if len(self.thaws_s) == 1:
                self.wire.begin()
            else:
                self.wire.on = False

    def beat(self, t_s: float) -> None:
        """Nothing to do."""


def formation(plan: Plan, wire: Wire) -> tuple[Formation, RunResult]:
    """Run a plan of the virtual engine to its second thaw; `wire` has what was sent between the two."""
    CountingAir.wire = wire
    observer = Formation(wire)
    plain, virtual.Air = virtual.Air, CountingAir  # type: ignore[misc]
    try:
        with VirtualEngine(plan) as engine:
            result = engine.run(observer)
    finally:
        virtual.Air = plain  # type: ignore[misc]
    return observer, result
