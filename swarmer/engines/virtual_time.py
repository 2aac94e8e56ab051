"""Emulated time as a queue of what is to come, and the trace of what came (docs/virtual-time.md)."""

from __future__ import annotations

import hashlib
import struct
from heapq import heapify, heappush
from typing import Any

from swarmer.fls import FAILURE

# What can be due besides what an FLS waits for by itself, which comes before: fls_process counts it up to FAILURE.
DATAGRAM, GROUP, HELD, OUTGOING, FREE, SAMPLE, SLOT, TURN = range(FAILURE + 1, FAILURE + 9)

SLOTS_PER_S = 256.0  # a power of two, so that a moment divides into slots without rounding

Entry = tuple[float, int, int, Any, Any, Any]
"""(emulated second, running number, what, for which FLS, two more as `what` needs). The number decides ties."""


class Agenda:
    """What is to come, in the order of time, and of two at one moment in the order in which they were put down.

    Only what comes in the present slot stands in the heap, with a SLOT at its end, which is never taken off before the
    next one is there; the rest lies in slots, unsorted. Timers that are far away thus make no datagram wait: taking
    from a heap costs the more the more it holds.
    """

    __slots__ = ("_far", "_slot", "heap", "now", "order")

    def __init__(self) -> None:
        self.heap: list[Entry] = [(0.0, -1, SLOT, None, None, None)]
        self.now = 0.0  # emulated seconds
        self.order = 0
        self._slot = 0  # what comes before its end is in the heap
        self._far: dict[int, list[Entry]] = {}

    def put(self, at_s: float, what: int, fls: Any, one: Any = None, two: Any = None) -> None:
        """Put down what is due at an emulated second that is not over. fls: for which, or who stands for it."""
        self.order = order = self.order + 1
        slot = int(at_s * SLOTS_PER_S)
        if slot < self._slot:
            heappush(self.heap, (at_s, order, what, fls, one, two))
        elif (entries := self._far.get(slot)) is not None:
            entries.append((at_s, order, what, fls, one, two))
        else:
            self._far[slot] = [(at_s, order, what, fls, one, two)]

    def next_slot(self) -> None:
        """A SLOT has come up: all before it is over. Put what comes in the next one into the heap."""
        slot, self._slot = self._slot, self._slot + 1
        heap = self.heap
        heap += self._far.pop(slot, ())
        heap.append((self._slot / SLOTS_PER_S, -1, SLOT, None, None, None))
        heapify(heap)


class Trace:
    """Every event in order, as a hash: two runs with the same one had the same events at the same moments.

    An event is four numbers: emulated second, FID, what it was, and from which FID. A landing is followed by the place.
    """

    BATCH = 16_384  # numbers hashed together

    def __init__(self) -> None:
        self.values: list[float] = []
        self.places = 0  # of landings, which are no events
        self._hashed = 0
        self._hash = hashlib.sha256()

    def events(self) -> int:
        """How many there were."""
        return (self._hashed + len(self.values)) // 4 - self.places

    def hash_values(self) -> None:
        """Hash what has gathered in `values`, and empty it."""
        self._hashed += len(self.values)
        self._hash.update(struct.pack(f"{len(self.values)}d", *self.values))
        self.values.clear()

    def sha256(self) -> str:
        """Of all events so far."""
        self.hash_values()
        return self._hash.hexdigest()
