"""A fault schedule carried out in virtual time (`swarmer.faults`): who is dark, hangs or is late.

What happens on the air and to sensors every FLS knows by itself, in every engine (`radio_faults`). Only a run with a
schedule has any of this: its FLSs are of a class that asks their mood first. Where a schedule begins nothing else
changes, so a run is the same until its first fault.
"""

from __future__ import annotations

from random import Random
from typing import TYPE_CHECKING, NamedTuple, Protocol

from swarmer.engines.fault_events import event_of
from swarmer.engines.virtual_fls import FAILED, Shared, VirtualFls
from swarmer.engines.virtual_time import DATAGRAM, FREE, HELD, TURN, Agenda
from swarmer.fls import FAILURE, NEVER, BaseFls
from swarmer.fls_calm import calm_down
from swarmer.fls_spec import FlsSpec
from swarmer.messages import Message, Stamp
from swarmer.streams import stream

if TYPE_CHECKING:
    from swarmer.engines.result import Observer
    from swarmer.engines.thaws import ThawWatch
    from swarmer.faults import Fault, Schedule, Turn


class Sky(Protocol):
    """What the weather needs of a run."""

    agenda: Agenda
    flss: list[VirtualFls]
    thaws: ThawWatch
    observer: Observer

    def replace(self, fid: int) -> None: ...


class NoLife(NamedTuple):
    """The dispatcher has had no sign of life of these since they began to hang."""

    flss: tuple[VirtualFls, ...]


class Weather:
    """The faults of one run: which hold now, and what begins and ends when."""

    def __init__(self, run: Sky, schedule: Schedule, hang_s: float = 0.0, replace: bool = True) -> None:
        """hang_s: after so many emulated seconds without a sign of life the dispatcher ends an FLS; 0: never.

        replace: it launches a replacement for who has failed; from the calm on it does in any case.
        """
        self.dark: set[int] = set()  # FIDs that nothing but the schedule may replace
        self.calm = False
        self._run, self._schedule = run, schedule
        self._hung: dict[int, float] = {}  # FID -> until when
        self._slow: dict[int, list[float]] = {}  # FID -> how late, of each fault that holds
        self._hang_s, self._replaces = hang_s, replace
        self._struck: dict[Fault, tuple[int, ...]] = {}  # whom a fault struck that names a swarm

    def begin(self) -> None:
        """Put down every beginning and end."""
        for turn in self._schedule.turns():
            self._run.agenda.put(turn.at_s, TURN, _ALWAYS, turn)

    def make(self, shared: Shared, spec: FlsSpec) -> VirtualFls:
        """A new FLS of this run."""
        self._hung.pop(spec.fid, None)  # a new process hangs no more
        fls = StormyFls(shared, spec, Mood(self, shared.seed, spec))
        if self.calm:
            calm_down(fls)
        return fls

    def turn(self, turn: Turn | NoLife) -> None:
        """A fault begins or ends, or the calm begins; or the dispatcher has waited long enough for who hangs."""
        if isinstance(turn, NoLife):
            self._give_up(turn.flss)
            return
        self._run.observer.event(event_of(turn))
        if turn.fault is None:
            self._calm_down()
            return
        fault, begins = self._located(turn.fault, turn.begins), turn.begins
        if fault.what == "kill":
            self._kill(fault) if begins else self._replace(fault)
        elif fault.what == "hang" and begins:
            self._hang(fault)
        elif fault.what == "slow":
            for fid in fault.where:
                held = self._slow.setdefault(fid, [])
                held.append(fault.late_s) if begins else held.remove(fault.late_s)

    def _located(self, fault: Fault, begins: bool) -> Fault:
        """With the FIDs of the swarm that it names, as they are when it begins."""
        if not fault.swarm_of:
            return fault
        if begins:
            flss = self._run.flss
            swarm = flss[fault.swarm_of - 1].ears.swarm
            members = [fls.fid for fls in flss if fls.lit and fls.ears.swarm == swarm]
            self._struck[fault] = tuple(members)
            return fault._replace(where=tuple(members))
        return fault._replace(where=self._struck.pop(fault, ()))

    def _kill(self, fault: Fault) -> None:
        for fid in fault.where:
            self.dark.add(fid)
            fls = self._run.flss[fid - 1]
            if fls.alive:
                assert isinstance(fls, StormyFls)
                fls.die()

    def _replace(self, fault: Fault) -> None:
        for fid in fault.where:
            self.dark.discard(fid)
            if not self._run.flss[fid - 1].alive:
                self._run.replace(fid)

    def _hang(self, fault: Fault) -> None:
        end = fault.at_s + self._schedule.length_s(fault)
        for fid in fault.where:
            self._hung[fid] = max(end, self._hung.get(fid, 0.0))
        if 0.0 < self._hang_s < end - fault.at_s:
            flss = tuple(self._run.flss[fid - 1] for fid in fault.where)
            self._run.agenda.put(fault.at_s + self._hang_s, TURN, _ALWAYS, NoLife(flss))

    def _give_up(self, flss: tuple[VirtualFls, ...]) -> None:
        """End who hangs, and still does; the successor does not."""
        for fls in flss:
            if fls.alive and self._hung.get(fls.fid, 0.0) > self._run.agenda.now:
                assert isinstance(fls, StormyFls)
                del self._hung[fls.fid]
                fls.die()

    def _calm_down(self) -> None:
        """Every fault has ended by now; here the radio heals, and nobody fails or thaws any more."""
        self.calm = True
        self._run.thaws.stop()
        self.dark.clear()
        for fls in list(self._run.flss):
            if fls.alive:
                calm_down(fls)
            else:
                self._run.replace(fls.fid)

    def replaces(self, fid: int) -> bool:
        """Whether an FLS that has just gone dark gets a successor at once."""
        return self.calm or (self._replaces and fid not in self.dark)

    # -- what an FLS asks ----------------------------------------------------------------------------------------

    def hung_until(self, fid: int) -> float:
        """When this FLS hangs no more; a moment that is over if it does not."""
        return self._hung.get(fid, 0.0)

    def late_s(self, fid: int) -> float:
        """How late this FLS may be now."""
        return sum(self._slow.get(fid, ()))


class Mood:
    """What a schedule does to one FLS."""

    __slots__ = ("due_s", "fid", "late", "rng", "weather")

    def __init__(self, weather: Weather, seed: int, spec: FlsSpec) -> None:
        self.weather, self.fid = weather, spec.fid
        self.rng: Random = stream(seed, "mood", spec.fid, spec.incarnation)
        self.due_s = [-1.0] * (FAILURE + 1)  # when what was put off comes late enough
        self.late: Late | None = None


class Late:
    """An FLS for a datagram that has been late already."""

    __slots__ = ("_fls", "fid", "tuned_at")

    def __init__(self, fls: StormyFls) -> None:
        self.tuned_at = NEVER
        self._fls, self.fid = fls, fls.fid

    @property
    def alive(self) -> bool:
        return self._fls.alive

    def hear(self, message: Message, stamp: Stamp) -> None:
        self._fls.hear_late(message, stamp)


class _Always:
    """Stands where the agenda names an FLS, for what concerns none."""

    alive, fid = True, 0


_ALWAYS = _Always()


class StormyFls(VirtualFls):
    """`virtual_fls.VirtualFls` under a fault schedule."""

    __slots__ = ("mood",)

    def __init__(self, shared: Shared, spec: FlsSpec, mood: Mood) -> None:
        self.mood = mood
        super().__init__(shared, spec)
        mood.late = Late(self)
        self.tuned_at = NEVER

    def hear(self, message: Message, stamp: Stamp) -> None:
        """A datagram comes to a process that may hang or be slow."""
        mood = self.mood
        late = mood.weather.late_s(self.fid)
        if late > 0.0:
            self._agenda.put(
                self._agenda.now + mood.rng.uniform(0.0, late), DATAGRAM, mood.late, message, stamp
            )
        else:
            self.hear_late(message, stamp)

    def hear_late(self, message: Message, stamp: Stamp) -> None:
        """It has been late; now it may still find the process hanging."""
        until = self.mood.weather.hung_until(self.fid)
        if until > self._agenda.now:
            self._agenda.put(until, DATAGRAM, self.mood.late, message, stamp)
        else:
            super().hear(message, stamp)

    def fresh(self, message: Message, stamp: Stamp) -> bool:
        """Whatever was put off may come too late for the window, so that is always asked."""
        return BaseFls.fresh(self, message, stamp)

    def arrive(self, message: Message, stamp: Stamp) -> None:
        """What the radio held back may come while the process hangs."""
        until = self.mood.weather.hung_until(self.fid)
        if until > self._agenda.now:
            self._agenda.put(until, HELD, self, message, stamp)
        else:
            super().arrive(message, stamp)

    def look(self, what: int, at_s: float) -> bool:
        """A timer may be late; to fail takes no process."""
        mood = self.mood
        if what == FAILURE or self._noted[what] != at_s or self.due[what] > at_s:
            return super().look(what, at_s)
        until = mood.weather.hung_until(self.fid)
        if until <= at_s:
            late = mood.weather.late_s(self.fid)
            if late == 0.0 or mood.due_s[what] == at_s:
                return super().look(what, at_s)
            if (
                mood.due_s[what] < at_s
            ):  # else it was put off before, and armed anew meanwhile: that is late enough
                mood.due_s[what] = at_s + mood.rng.uniform(0.0, late)
            until = mood.due_s[what]
        self._noted[what] = until
        self._agenda.put(until, what, self)
        return False

    def die(self) -> None:
        """Fail, as a schedule has it."""
        self.end(FAILED)

    def wake(self) -> None:
        """A handler that hangs goes on later."""
        until = self.mood.weather.hung_until(self.fid)
        if until > self._agenda.now:
            self._agenda.put(until, FREE, self)
        else:
            super().wake()
