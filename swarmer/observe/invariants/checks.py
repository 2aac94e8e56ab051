"""The witness that asks the invariants: each only at the events it looks at, so that a run takes at most 3 × as long.

What an event may break depends on its kind; a table made once says whom to ask. Of a machine's past only what the
invariants need is copied, after each event.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from swarmer.engines.result import Seen, Witness
from swarmer.errors import RunFailed
from swarmer.faults import NO_FAULTS, Schedule
from swarmer.messages import THAW
from swarmer.observe.invariants.base import NOTED, QUIET, D, Facts, Invariant, Life, Step
from swarmer.observe.invariants.being import Always, Believing, Deploying, Lives, Numbers, Thawing
from swarmer.observe.invariants.changing import Transitions
from swarmer.observe.invariants.knowing import Oracles
from swarmer.observe.invariants.liveness import OneSwarm, Silence
from swarmer.observe.invariants.moving import Following, Localizing, StandingStill
from swarmer.observe.invariants.pairing import Accepts, Challenges, Newcomers, Pairs, Races
from swarmer.observe.invariants.story import story
from swarmer.protocol.events import (
    KEYS,
    THAWS_OBEYED,
    BatteryLow,
    Due,
    Landed,
    Launch,
    Local,
    Measured,
    NewShape,
    Received,
    Send,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from swarmer.messages import Message, Stamp, Swarm, Vec3
    from swarmer.physics.flight import Flight
    from swarmer.plan import Plan
    from swarmer.protocol.events import Action
    from swarmer.protocol.events import Event as Happening

INVARIANTS: tuple[type[Invariant], ...] = (
    Deploying, Challenges, Accepts, Pairs, Localizing, Following, StandingStill, Races, Believing, Newcomers, Thawing,
    Numbers, Lives, Oracles, Transitions, Always, OneSwarm, Silence,
)  # fmt: skip
CAUSES = (Numbers, Lives, Transitions, Thawing)

_KEY = {
    Launch: int(Local.LAUNCH), Landed: int(Local.LANDED), Measured: int(Local.MEASURED),
    BatteryLow: int(Local.BATTERY_LOW), NewShape: int(Local.NEW_SHAPE),
}  # fmt: skip
_TIMERS = int(Local.CHALLENGE_DUE)
_NOTHING: tuple[Any, ...] = ()
_Ask = tuple[Invariant, Callable[..., str | None]]


class Broken(RunFailed):
    """An invariant does not hold."""

    def __init__(self, invariant: Invariant, fid: int, t_s: float, wrong: str) -> None:
        self.invariant, self.fid, self.t_s, self.wrong = invariant, fid, t_s, wrong
        who = f"FLS {fid}" if fid else "all FLSs"
        super().__init__(f"{invariant.name} {invariant.title}: {who} at {t_s:.4f} s: {wrong}")


class Checks(Witness):
    """Every invariant, after every event. The first that is broken ends the run.

    `facts.single_s` tells when, all well, all were first one swarm.
    """

    def __init__(self, plan: Plan, schedule: Schedule | None = None) -> None:
        """schedule: the faults of the run, which say who may be late, and from when on all is well."""
        schedule = schedule or NO_FAULTS
        tau = [schedule.late_s(fid) for fid in range(plan.size + 1)]
        handling_s = plan.config.virtual.handling_ms / 1e3
        self.facts = Facts(
            plan, plan.rules, tau, handling_s, schedule.calm_s, lives=[None] * (plan.size + 1),
            misled=frozenset(fid for fid in range(1, plan.size + 1) if schedule.of_sensors(fid)),
        )  # fmt: skip
        self.invariants = tuple(kind(self.facts) for kind in INVARIANTS)
        self.broken: Broken | None = None
        self.events = 0
        self.now_s = 0.0  # of the latest event
        self._step = Step()
        self._thaws: dict[int, int] = {}  # of each list of counters, as it was seen last
        self._swarms: dict[Swarm, int] = {}  # how many are in each
        self._awake = 0
        self._changed_s = 0.0  # when somebody last was lit, went dark or changed the swarm
        # A datagram that must not be handled at all, or a thaw, breaks others, too: that is asked first.
        after = sorted(_asked("after", self.invariants), key=lambda ask: type(ask[0]) not in CAUSES)
        said = _asked("said", self.invariants)
        self._lit_table = [[ask for ask in after if key in ask[0].on] for key in range(KEYS)]
        self._quiet = [ask for ask in after if type(ask[0]) in (Numbers, Believing)]
        self._dark_table = [[ask for ask in after if key in ask[0].on_dark] for key in range(KEYS)]
        self._said_table = [[ask for ask in said if kind in ask[0].says] for kind in range(_TIMERS)]
        self._stamped = _asked("stamped", self.invariants)
        came = _asked("came", self.invariants)
        self._came = {kind: [ask for ask in came if kind in ask[0].hears] for kind in range(_TIMERS)}
        self._came = {kind: asked for kind, asked in self._came.items() if asked}
        self._flew = _asked("flew", self.invariants)
        self._began = False
        self._takes_time = handling_s > 0

    # -- what a run tells ----------------------------------------------------------------------------------------

    def made(self, fls: Seen, now_s: float) -> None:
        if not self._began:
            self._began = True
            for invariant in self.invariants:
                self._judge(invariant, invariant.begun(), 0, now_s)
        facts, before = self.facts, self.facts.lives[fls.fid]
        if before is not None:
            facts.replaced = True
            if before.alive:
                self._judge(self._named("S13"), "a second one is alive", fls.fid, now_s)
        facts.lives[fls.fid] = Life(fls, now_s)

    def handled(
        self, fls: Seen, event: Happening, actions: Sequence[Action], cause: Stamp | None, now_s: float
    ) -> None:
        machine = fls.machine
        was = self.facts.lives[machine.fid]
        if was is None or was.machine is not machine or not was.alive:
            self._judge(self._named("S13"), "acts, and is no more", machine.fid, now_s)
            return
        self.events += 1
        self.now_s = now_s
        thaws = 0
        if machine.thawed_s == now_s:
            thaws = self._thaws_since(machine.counts)
            if thaws:
                was.thawed()
        step = self._step
        step.m, step.was, step.event, step.actions = machine, was, event, actions
        step.cause, step.now, step.thaws, step.anchors = cause, now_s, thaws, len(machine.leases) > 0
        step.sent = [action.message for action in actions if type(action) is Send] if actions else _NOTHING
        _classify(step)
        if self._takes_time:
            _count_thaws(step)
        was.recent.append((now_s, was.state, machine.state, was.swarm, event, actions))
        if step.key in QUIET and not actions and machine.epoch == was.epoch and was.state is not D:
            self._ask(step, self._quiet)  # nothing else has changed
            return
        self._look(step)
        if machine.swarm is not was.swarm or (was.state is D and machine.state is not D):
            self._count_swarms(was, now_s)
        was.note(step.anchors)

    def _look(self, step: Step) -> None:
        table = self._dark_table if step.was.state is D else self._lit_table
        self._ask(step, table[step.key])
        for message in step.sent:
            for invariant, look in self._said_table[message.kind]:
                wrong = look(step, message)
                if wrong is not None:
                    self._judge(invariant, wrong, step.was.fid, step.now)

    def _ask(self, step: Step, asked: list[_Ask]) -> None:
        for invariant, look in asked:
            wrong = look(step)
            if wrong is not None:
                self._judge(invariant, wrong, step.was.fid, step.now)

    def sent(self, fls: Seen, message: Message, stamp: Stamp, copies: int, now_s: float) -> None:
        life = self.facts.lives[fls.fid]
        if life is None or life.fls is not fls:
            self._judge(self._named("S13"), "speaks, and is no more", fls.fid, now_s)
            return
        for invariant, look in self._stamped:
            self._judge(invariant, look(life, message, stamp), fls.fid, now_s)

    def heard(self, fls: Seen, message: Message, stamp: Stamp, fate: str, now_s: float) -> None:
        asked = self._came.get(message.kind)
        if asked is None:
            return
        life = self.facts.lives[fls.fid]
        assert life is not None
        for invariant, look in asked:
            wrong = look(life, message, fate)
            if wrong is not None:
                self._judge(invariant, wrong, fls.fid, now_s)

    def flew(self, fls: Seen, asked: Vec3, flight: Flight, now_s: float) -> None:
        life = self.facts.lives[fls.fid]
        assert life is not None
        for invariant, look in self._flew:
            self._judge(invariant, look(life, asked, flight), fls.fid, now_s)

    def ended(self, fls: Seen, how: str, now_s: float) -> None:
        life = self.facts.lives[fls.fid]
        assert life is not None
        life.alive = False
        if life.state is not D:
            self._about_to_change(now_s)
            self._awake -= 1
            self._leave(life.swarm)

    def finished(self, now_s: float) -> None:
        self.look_for_one_swarm(now_s)
        for invariant in self.invariants:
            found = invariant.finished(now_s)
            if found is not None:
                life, wrong = found
                self._judge(invariant, wrong, 0 if life is None else life.fid, now_s)

    def summary(self) -> dict[str, Any]:
        added: dict[str, Any] = {
            "invariants_checked": sum(invariant.looked for invariant in self.invariants),
            "invariant_violations": 0 if self.broken is None else 1,
        }
        if self.broken is not None:
            added["violation"] = self._report(self.broken)
        return added

    # -- one swarm -----------------------------------------------------------------------------------------------

    def look_for_one_swarm(self, now_s: float) -> bool:
        """Are all lit and one swarm, or have they been at some moment since `calm_s`?"""
        facts = self.facts
        calm = facts.calm_s is not None and now_s >= facts.calm_s
        if calm and facts.single_s is None and self._awake == facts.lights(now_s) and len(self._swarms) == 1:
            facts.single_s = max(facts.calm_s or 0.0, self._changed_s)
        return facts.single_s is not None

    def _count_swarms(self, was: Life, now_s: float) -> None:
        self._about_to_change(now_s)
        machine = was.machine
        if was.state is not D:
            self._leave(was.swarm)
        else:
            self._awake += 1
        self._swarms[machine.swarm] = self._swarms.get(machine.swarm, 0) + 1

    def _about_to_change(self, now_s: float) -> None:
        """Until now all may have been one swarm."""
        if len(self._swarms) == 1:
            self.look_for_one_swarm(now_s)
        self._changed_s = now_s

    def _leave(self, swarm: Swarm) -> None:
        left = self._swarms[swarm] - 1
        if left:
            self._swarms[swarm] = left
        else:
            del self._swarms[swarm]

    # -- verdicts ------------------------------------------------------------------------------------------------

    def _thaws_since(self, counts: Any) -> int:
        """Thaws obeyed since the last look; FLSs may share their counters."""
        now: int = counts[THAWS_OBEYED]
        before, self._thaws[id(counts)] = self._thaws.get(id(counts), 0), now
        return now - before

    def _named(self, name: str) -> Invariant:
        return next(invariant for invariant in self.invariants if invariant.name == name)

    def _judge(self, invariant: Invariant, wrong: str | None, fid: int, now_s: float) -> None:
        if wrong is not None:
            self.broken = Broken(invariant, fid, now_s, wrong)
            raise self.broken

    def _report(self, broken: Broken) -> dict[str, Any]:
        return {
            "invariant": f"{broken.invariant.name} {broken.invariant.title}",
            "guards": broken.invariant.guards,
            "fid": broken.fid or None,
            "t_s": broken.t_s,
            "event": self.events,
            "wrong": broken.wrong,
            "last": story(self.facts.lives, broken.fid),
        }


def _classify(step: Step) -> None:
    """Which event it is, as the table has it, and whether it is a datagram that a rule judges."""
    event: Any = step.event
    kind = type(event)
    step.message = None
    if kind is Received:
        if event.noted:
            step.key = NOTED
            return
        message = event.message
        step.key = message.kind
        machine = step.m
        judged = message.epoch == machine.epoch or not machine.settings.epochs
        if judged and not step.thaws and step.was.state is not D:
            step.message = message
    elif kind is Due:
        step.key = _TIMERS + event.timer
    else:
        step.key = _KEY[kind]


def _count_thaws(step: Step) -> None:
    """THAWs are taken up before whatever is due, notes take no time."""
    if step.key == THAW:
        step.was.thaws_heard += 1
        step.was.thaws_run += 1
    elif step.key != NOTED:
        step.was.thaws_run = 0


def _asked(check: str, invariants: Sequence[Invariant]) -> list[_Ask]:
    """Whoever has this check, and it."""
    return [
        (invariant, getattr(invariant, check))
        for invariant in invariants
        if getattr(type(invariant), check) is not getattr(Invariant, check)
    ]
