"""The invariants, for worlds in which an FLS may be late; and a line for every event."""

from __future__ import annotations

import hashlib
from collections import deque
from typing import TYPE_CHECKING, Any

from invariants import Broken, Watch, _before

if TYPE_CHECKING:
    from world import World

SHOWN = 20  # events before a failure that its report lists
OF_TIME = ("took ", "waits for ", "the lease of ")  # complaints that hold for punctual FLSs only


class Recorder(Watch):
    """Watches a world; `last` are its last events in words, `digest` is over all of them in order."""

    def __init__(self, world: World, punctual: bool) -> None:
        """punctual: timers come at their time; else what is only late is no failure (invariants have no tau)."""
        super().__init__(world)
        self.punctual = punctual
        self.last: deque[str] = deque(maxlen=SHOWN)
        self._trace = hashlib.sha256()

    @property
    def digest(self) -> str:
        return self._trace.hexdigest()

    def tap(self, fid: int, event: Any, actions: list[Any]) -> None:
        m = self.world.bodies[fid].machine
        line = f"{self.world.now:.4f} {fid} {m.state.name} {tuple(m.swarm)} {event} -> {actions}"
        self._trace.update(line.encode())
        self.last.append(line)
        try:
            super().tap(fid, event, actions)
        except Broken as broken:
            if self.punctual or not any(f" s: {words}" in str(broken) for words in OF_TIME):
                raise
            self.past[m] = _before(m)
