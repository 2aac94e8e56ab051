"""Emulated time as a queue of what is to come, and the trace of what came (docs/virtual-time.md)."""

from __future__ import annotations

import hashlib
from array import array
from heapq import heappush
from typing import TYPE_CHECKING, Any

from swarmer.fls_process import FAILURE

if TYPE_CHECKING:
    from swarmer.engines.virtual_fls import VirtualFls

# What can be due besides what an FLS waits for by itself, which comes before: fls_process counts it up to FAILURE.
DATAGRAM, GROUP, HELD, OUTGOING, FREE, SAMPLE = range(FAILURE + 1, FAILURE + 7)

Entry = tuple[float, int, int, Any, Any, Any]
"""(emulated second, running number, what, for which FLS, two more as `what` needs). The number decides ties."""


class Agenda:
    """What is to come, in the order of time, and of two at one moment in the order in which they were put down."""

    __slots__ = ("heap", "now", "order")

    def __init__(self) -> None:
        self.heap: list[Entry] = []
        self.now = 0.0  # emulated seconds
        self.order = 0

    def put(self, at_s: float, what: int, fls: VirtualFls | None, one: Any = None, two: Any = None) -> None:
        """Put down what is due at an emulated second that is not over."""
        self.order = order = self.order + 1
        heappush(self.heap, (at_s, order, what, fls, one, two))


class Trace:
    """Every event in order, as a hash: two runs with the same one had the same events at the same moments.

    An event is four numbers: emulated second, FID, what it was, and from which FID. A landing is followed by the place.
    """

    BATCH = 16_384  # numbers hashed together

    def __init__(self) -> None:
        self.values: list[float] = []
        self._hash = hashlib.sha256()

    def hash_values(self) -> None:
        """Hash what has gathered in `values`, and empty it."""
        self._hash.update(array("d", self.values).tobytes())
        self.values.clear()

    def sha256(self) -> str:
        """Of all events so far."""
        self.hash_values()
        return self._hash.hexdigest()
