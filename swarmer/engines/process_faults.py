"""A fault schedule carried out on processes: FLSs are killed, stopped and let go on, as the dispatcher's clock tells.

`kill` is SIGKILL. `hang` is SIGSTOP, and SIGCONT when it is over. `slow` is a duty cycle of both: a process stands
still for `late` seconds at a time, three quarters of the time, so that whatever comes may be so late. The dispatcher
learns of a death as of any other, from the kernel. What happens on the air and to sensors every FLS knows by itself.
"""

from __future__ import annotations

import heapq
import math
import os
import signal
import time
from collections import Counter
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from swarmer.faults import Fault, Schedule, Turn
from swarmer.streams import stream

if TYPE_CHECKING:
    from array import array

GOES_SHARE = 1 / 3  # of the time that a slow process stands still
BEATS_EVERY_S = 0.25  # wall seconds between two looks at who lives
PATIENCE_S = 2.5  # wall seconds: who has nothing to do wakes once in a second only, and a machine may be busy
SHORTEST_S = 0.002  # wall seconds between two signals to a slow process: more would only cost


class Hand:
    """Does to processes what a schedule says. All times are emulated seconds."""

    def __init__(
        self, schedule: Schedule, seed: int, pids: Mapping[int, int], listens: memoryview[int] | array[int],
        tell: Callable[[Turn], None],
    ) -> None:  # fmt: skip
        """pids: FID -> process id of those that live, kept by the dispatcher. listens: `SharedMemory.directory`.
        tell: called at every turn.
        """
        self.dark: set[int] = set()  # FIDs that nothing but the schedule may replace
        self.struck: set[int] = set()  # process ids that the schedule has killed
        self.calm = False
        self._pids, self._listens, self._seed = pids, listens, seed
        self._tell = tell
        self._turns: list[Turn] = schedule.turns()[::-1]
        self._holds: Counter[int] = Counter()  # process id -> how many faults hold it still
        self._slow: dict[int, list[Fault]] = {}  # FID -> the faults that make it slow
        self._steps: list[tuple[float, int, int, bool]] = []  # of duty cycles: when, FID, process id, stop
        self._members: dict[Fault, tuple[int, ...]] = {}
        self._stopped: dict[Fault, list[int]] = {}  # process ids that hang by a fault

    def due_s(self) -> float:
        """When there is something to do next; infinity if never again."""
        turn = self._turns[-1].at_s if self._turns else math.inf
        return min(turn, self._steps[0][0] if self._steps else math.inf)

    def act(self, now: float, scale: float) -> list[int]:
        """Do what is due. scale: emulated seconds per wall second. Gives the FIDs that are to be replaced now."""
        back: list[int] = []
        while self._turns and self._turns[-1].at_s <= now:
            turn = self._turns.pop()
            self._tell(turn)
            if turn.fault is None:
                self.calm = True
                back += range(1, len(self._listens) + 1)  # whoever is gone
                self.dark.clear()
                self.let_go()
            else:
                back += self._turn(turn.fault, turn.begins)
        while self._steps and self._steps[0][0] <= now:
            self._step(now, scale)
        return [fid for fid in dict.fromkeys(back) if fid not in self._pids]

    def let_go(self) -> None:
        """Let every process go on, for the end of the run or the calm."""
        for pid in list(self._holds):
            if pid in self._pids.values():
                _signal(pid, signal.SIGCONT)
        self._holds.clear()
        self._slow.clear()
        self._steps.clear()

    def _turn(self, fault: Fault, begins: bool) -> list[int]:
        if fault.what == "kill":
            return self._kill(fault, begins)
        if fault.what == "hang" and begins:
            pids = [self._pids[fid] for fid in self._struck(fault) if fid in self._pids]
            self._stopped[fault] = pids
            for pid in pids:
                self._hold(pid)
        elif fault.what == "hang":
            for pid in self._stopped.pop(fault, ()):
                self._release(pid)
        elif fault.what == "slow":
            for fid in self._struck(fault) if begins else self._members.pop(fault, ()):
                faults = self._slow.setdefault(fid, [])
                faults.append(fault) if begins else faults.remove(fault)
                if begins and len(faults) == 1:
                    # Not all in step: each begins somewhere in its own cycle.
                    at_s = fault.at_s + fault.late_s * stream(self._seed, "duty cycle", fid).random()
                    heapq.heappush(self._steps, (at_s, fid, 0, True))
        return []

    def _kill(self, fault: Fault, begins: bool) -> list[int]:
        if not begins:
            fids = self._members.pop(fault, ())
            self.dark.difference_update(fids)
            return list(fids)
        for fid in self._struck(fault):
            self.dark.add(fid)
            if pid := self._pids.get(fid):
                self.kill(pid)
        return []

    def kill(self, pid: int) -> None:
        """End a process at once: that is a failure, and no crash."""
        self.struck.add(pid)
        _signal(pid, signal.SIGKILL)

    def _struck(self, fault: Fault) -> tuple[int, ...]:
        """Whom a fault strikes that begins now; noted until it ends."""
        fids = fault.where
        if fault.swarm_of:
            xi = self._listens[fault.swarm_of - 1]
            fids = tuple(at + 1 for at, listens in enumerate(self._listens) if xi and listens == xi)
        self._members[fault] = fids
        return fids

    def _step(self, now: float, scale: float) -> None:
        """A slow process stops, or goes on for a while."""
        at_s, fid, held, stop = heapq.heappop(self._steps)
        late_s = max((fault.late_s for fault in self._slow.get(fid, ())), default=0.0)
        if not stop:
            self._release(held)
        if late_s <= 0.0:
            self._slow.pop(fid, None)
            return
        pid = self._pids.get(fid, 0)
        if stop and pid:
            self._hold(pid)
        pause_s = late_s if stop else late_s * GOES_SHARE
        # By the plan, but never a burst to make up for what the dispatcher itself was late.
        next_s = max(at_s + pause_s, now + SHORTEST_S * scale)
        heapq.heappush(self._steps, (next_s, fid, pid if stop else 0, not stop))

    def _hold(self, pid: int) -> None:
        self._holds[pid] += 1
        _signal(pid, signal.SIGSTOP)

    def _release(self, pid: int) -> None:
        if not self._holds[pid]:
            return
        self._holds[pid] -= 1
        if not self._holds[pid]:
            del self._holds[pid]
            if pid in self._pids.values():
                _signal(pid, signal.SIGCONT)


class Watch:
    """Who shows no sign of life any more: an FLS counts in its slot whenever it wakes, once a second at least."""

    def __init__(self, hang_s: float, pids: Mapping[int, int]) -> None:
        """hang_s: emulated seconds of patience; 0: nobody is given up. pids: FID -> process id of those that live."""
        self.hang_s, self._pids = hang_s, pids
        self._looked = -math.inf  # wall
        self._seen: dict[
            int, tuple[int, int, float, float]
        ] = {}  # FID -> pid, beats, since when: emulated, wall

    def given_up(self, now: float, scale: float, beats: Callable[[int], int]) -> list[int]:
        """Process ids of those that hang, each once. now: emulated. beats: how often an FLS has shown life."""
        wall = time.monotonic()
        if not self.hang_s or wall - self._looked < BEATS_EVERY_S:
            return []
        self._looked = wall
        hang: list[int] = []
        for fid, pid in self._pids.items():
            shown = beats(fid)
            before = self._seen.get(fid)
            if before is None or before[:2] != (pid, shown):
                self._seen[fid] = (pid, shown, now, wall)
            elif now - before[2] >= self.hang_s and wall - before[3] >= PATIENCE_S:
                self._seen[fid] = (pid, shown, math.inf, wall)  # not a second time
                hang.append(pid)
        return hang


def _signal(pid: int, number: int) -> None:
    """To a child of the dispatcher, which has not waited for it yet: so the id is still its own."""
    try:
        os.kill(pid, number)
    except ProcessLookupError:
        pass
