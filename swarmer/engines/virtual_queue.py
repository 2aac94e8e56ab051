"""An FLS of the virtual-time engine that takes time for every message (`virtual.handling_ms`), so that others queue.

It takes up what is most urgent, in the order of `fls_process.Fls.work`: thaws, then what was due, then what a swarm
waits for, then the rest. What it takes up acts at once; then it is busy for the handling time.
"""

from __future__ import annotations

from collections import deque
from heapq import heappop, heappush

from swarmer.engines.virtual_fls import Shared, VirtualFls
from swarmer.engines.virtual_time import FREE
from swarmer.fls_process import FAILURE, NEVER, PRIORITY, FlsSpec
from swarmer.messages import Message, Stamp
from swarmer.metrics.lateness import bucket

Waiting = tuple[float, Message, Stamp]  # since which emulated second


class BusyFls(VirtualFls):
    """`virtual_fls.VirtualFls` with a handler that may be busy; the network role never is."""

    __slots__ = ("_busy_until", "_notes", "_overdue", "_queues", "_waking")

    def __init__(self, shared: Shared, spec: FlsSpec) -> None:
        self._queues: tuple[deque[Waiting], ...] = (deque(), deque(), deque())
        self._notes: deque[tuple[Message, Stamp]] = deque(maxlen=1024)
        self._overdue: list[tuple[float, int]] = []  # since when, what
        self._busy_until = 0.0
        self._waking = False
        super().__init__(shared, spec)

    def take_message(self, message: Message, stamp: Stamp) -> None:
        """Queue a message by its priority."""
        self._queues[PRIORITY[message.kind]].append((self._agenda.now, message, stamp))
        self.work()

    def take_note(self, message: Message, stamp: Stamp) -> None:
        """Leave a note for the handler."""
        self._notes.append((message, stamp))
        self.work()

    def take_due(self, what: int) -> None:
        """Queue what is due, unless it is the FLS's own failure, which waits for nobody."""
        if what == FAILURE:
            super().take_due(what)
            return
        # It may be disarmed or armed anew while it waits: then it is due at another moment.
        self.due[what] = self._agenda.now
        heappush(self._overdue, (self._agenda.now, what))
        self.work()

    def wake(self) -> None:
        """The handling time of one message is over."""
        self._waking = False
        self.work()

    def work(self) -> None:
        """Take up one thing after the other until a message makes this FLS busy, or nothing is left."""
        queues = self._queues
        while self.alive and self._busy_until <= self._agenda.now:
            while self._notes:
                super().take_note(*self._notes.popleft())
            if queues[0]:
                self._handle(queues[0])
            elif self._overdue:
                self._take_overdue()
            elif queues[1]:
                self._handle(queues[1])
            elif queues[2]:
                self._handle(queues[2])
            else:
                return
        if self.alive and not self._waking:
            self._waking = True
            self._agenda.put(self._busy_until, FREE, self)

    def _handle(self, queue: deque[Waiting]) -> None:
        since, message, stamp = queue.popleft()
        now = self._agenda.now
        self.shared.handled_late[bucket((now - since) * 1e3)] += 1
        self._busy_until = now + self.shared.handling_s
        super().take_message(message, stamp)

    def _take_overdue(self) -> None:
        since, what = heappop(self._overdue)
        if self.due[what] == since:
            self.due[what] = NEVER
            self.shared.timer_late[bucket((self._agenda.now - since) * 1e3)] += 1
            super().take_due(what)
