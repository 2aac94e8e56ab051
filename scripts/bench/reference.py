"""A loop that never changes, to measure others against: their ratio to it travels from machine to machine."""

from __future__ import annotations

import time
from heapq import heappop, heappush

TURNS = 200_000


class Counter:
    """What the loop calls."""

    __slots__ = ("last", "seen")

    def __init__(self) -> None:
        self.seen: dict[int, float] = {}
        self.last = 0.0

    def take(self, at: float, number: int) -> float:
        self.seen[number & 1023] = self.last = at
        return at * 1.0000001 + (number & 7)


def turns_per_s(turns: int = TURNS) -> float:
    """Turns of the loop per second of this process's time: each takes from a heap, calls a method, puts back."""
    counters = [Counter() for _ in range(256)]
    heap = [(float(number), number, counters[number]) for number in range(256)]
    began = time.process_time()
    for number in range(turns):
        at, _, counter = heappop(heap)
        heappush(heap, (counter.take(at, number), number + 256, counters[number & 255]))
    return turns / (time.process_time() - began)
