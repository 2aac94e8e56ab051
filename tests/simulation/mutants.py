"""Rules broken on purpose, one at a time, and the invariant that must notice: the checks are checked.

Each mutant is the rule as a hurried hand may get it wrong. `hunt` plays worlds with it until one is broken.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from random import Random
from typing import Any, NamedTuple

import pytest

from swarmer import state_machine
from swarmer.engines.virtual_fls import VirtualFls
from swarmer.experiments.worlds import World, play
from swarmer.faults import Fault, Schedule
from swarmer.messages import (
    ANCHORING,
    CHALLENGE_ACCEPT,
    CHALLENGE_ACK,
    CHALLENGE_FIN,
    CHALLENGE_INIT,
    FOLLOW_MERGE,
    LEASE_CANCEL,
    MERGE,
    SET_AVAILABLE,
    SET_WAITING,
    SWARM_KINDS,
    TO_FLS,
    Swarm,
)
from swarmer.plugins.signal_strength import SignalStrength
from swarmer.protocol import anchoring, challenging, following, localizing, pairing, race, thawing
from swarmer.protocol.anchor_selection import STRATEGIES
from swarmer.protocol.beliefs import Beliefs
from swarmer.protocol.census import Census
from swarmer.protocol.leases import Leases
from swarmer.protocol.memory import Memory
from swarmer.protocol.records import BA, BL, A, State
from swarmer.protocol.reports import Roll
from swarmer.radio import ReplayWindow
from swarmer.shapes import neighbours
from swarmer.state_machine import Rule, StateMachine

SEEDS = 20  # worlds that a mutant may survive
NO_FAULTS = {"faults": "none"}  # but those of the radio
Patch = pytest.MonkeyPatch
Settings = dict[str, Any]


class Mutant(NamedTuple):
    """A broken rule."""

    name: str
    caught_by: tuple[str, ...]  # invariants, one of which must be the first that is broken
    apply: Callable[[Patch], None]
    settings: Settings


MUTANTS: list[Mutant] = []


def mutant(name: str, *caught_by: str, **settings: Any) -> Callable[[Callable[[Patch], None]], None]:
    def add(apply: Callable[[Patch], None]) -> None:
        MUTANTS.append(Mutant(name, caught_by, apply, settings))

    return add


class Caught(NamedTuple):
    seeds: int  # worlds played, the last of which broke
    invariant: str
    failure: str


def hunt(one: Mutant) -> Caught | None:
    """The first world in which something breaks, with the mutant in place."""
    for seed in range(1, SEEDS + 1):
        outcome = play(world_of(seed, one.settings))
        if outcome.failure is not None:
            return Caught(seed, outcome.invariant, outcome.failure)
    return None


def world_of(seed: int, settings: Settings) -> World:
    """A small world, with a little of everything that goes wrong."""
    rng = Random(f"mutant {seed}")
    count = rng.randint(10, 20)
    settings = {
        "engine": "virtual", "shape": "random", "seed": seed, "points": count, "lambda_ms": 200.0, "thaw.h_s": 2.0,
        "radio.loss": 0.1, "radio.duplicate": 0.1, "radio.reorder": 0.1, "radio.reorder_ms": 60.0,
        "thaw.policy": "timer", "faults": "some",
    } | settings  # fmt: skip
    faults = [
        Fault(rng.uniform(0.5, 2.5), "kill", (1, *rng.sample(range(2, count + 1), 2)), 0.02),
        Fault(rng.uniform(2.0, 3.0), "cut", tuple(rng.sample(range(1, count + 1), count // 2)), 0.5),
    ]
    if settings.pop("faults") == "none":
        return World(seed, settings, Schedule((), 4.0))
    return World(seed, settings, Schedule(tuple(sorted(faults)), 4.0))


# -- ways to break a rule --------------------------------------------------------------------------------------------


def swap(patch: Patch, rule: Callable[..., None], other: Callable[..., None], *states: State) -> None:
    """Another function for a rule of the table, in all states or in some."""
    table = [list(row) for row in state_machine._RULES]
    found = [
        (state, key)
        for state in states or State
        for key, entry in enumerate(table[state])
        if entry is not None and entry.act is rule
    ]
    assert found, f"{rule.__name__} is no rule of the table any more"
    for state, key in found:
        table[state][key] = Rule(other, tuple(State))
    patch.setattr(state_machine, "_RULES", table)


def everywhere(patch: Patch, function: Callable[..., Any], other: Callable[..., Any]) -> None:
    """Another function under that name wherever it was imported."""
    changed = 0
    for name, module in list(sys.modules.items()):
        if name.startswith("swarmer.") and getattr(module, function.__name__, None) is function:
            patch.setattr(module, function.__name__, other)
            changed += 1
    assert changed, f"{function.__name__} is used nowhere any more"


def nothing(*_: Any) -> None:
    pass


def unsaid(patch: Patch, *kinds: int) -> None:
    """Some kinds of message are never said."""
    say = Memory.say
    patch.setattr(
        Memory, "say", lambda me, kind, *more, **named: kind in kinds or say(me, kind, *more, **named)
    )


# -- leases ----------------------------------------------------------------------------------------------------------


@mutant("lease never renewed", "S5", lease_ms=50.0)
def _(patch):
    swap(patch, localizing.renew_lease, nothing)


@mutant("renewal ignored", "S7", lease_ms=50.0)
def _(patch):
    swap(patch, anchoring.renewed, nothing)


@mutant("lease never expires", "S7", **{"radio.loss": 0.3})
def _(patch):
    swap(patch, anchoring.lease_over, nothing)


@mutant("lease expires early", "S7")
def _(patch):
    grant = Leases.grant
    patch.setattr(
        Leases,
        "grant",
        lambda self, fid, challenge, now: grant(self, fid, challenge, now - self.duration_s / 2),
    )


@mutant("lease renewed by a stranger", "S7", lease_ms=50.0)
def _(patch):
    def renew_all(me, message):
        for fid in me.leases.ends():
            me.leases.grant(fid, message.challenge, me.now)
        anchoring.renewed(me, message)

    swap(patch, anchoring.renewed, renew_all)


@mutant("CANCEL ignored", "S7")
def _(patch):
    swap(patch, anchoring.cancel_lease, nothing)


@mutant("FIN ignored", "S7")
def _(patch):
    swap(patch, anchoring.free, nothing)


@mutant("FIN before landing", "S5")
def _(patch):
    def localize(me, event):
        localizing.localize(me, event)
        if me.flying:
            me.say(CHALLENGE_FIN, TO_FLS, Swarm(me.anchor.sender, 0), challenge=me.anchor.challenge)

    swap(patch, localizing.localize, localize)


# -- pairs and races -------------------------------------------------------------------------------------------------


@mutant("ACK race unanswered", "S8")
def _(patch):
    patch.setattr(race, "CANCEL", race.DROP)


@mutant("ACK answered twice", "S8", **{"virtual.handling_ms": 2.0})
def _(patch):
    tell = Memory.tell

    def twice(me, message, kind, *more, **named):
        tell(me, message, kind, *more, **named)
        if message.kind == CHALLENGE_ACK and kind == LEASE_CANCEL:
            tell(me, message, kind, *more, **named)

    patch.setattr(Memory, "tell", twice)


@mutant("late ACCEPT not cancelled", "S4")
def _(patch):
    tell = Memory.tell

    def silent(me, message, kind, *more, **named):
        if not (message.kind == CHALLENGE_ACCEPT and kind == LEASE_CANCEL):
            tell(me, message, kind, *more, **named)

    patch.setattr(Memory, "tell", silent)


@mutant("two ACKs", "S4", **{"sensing.sample_ms": 30.0})
def _(patch):
    def ack_again(me, message):
        if message.kind == CHALLENGE_ACCEPT:
            me.tell(message, CHALLENGE_ACK, other=message.swarm)
        else:
            pairing.refuse(me, message)

    swap(patch, pairing.refuse, ack_again, BL)


@mutant("both anchor", "S4")
def _(patch):
    everywhere(patch, anchoring.anchors, lambda *_: True)


@mutant("both localize", "S4")
def _(patch):
    everywhere(patch, anchoring.anchors, lambda *_: False)


@mutant("higher ξ anchors", "S4")
def _(patch):
    patch.setitem(STRATEGIES, "lowest", lambda me, other, challenge: me.swarm > other.swarm)


@mutant("M ignored", "S3", m=2)
def _(patch):
    everywhere(patch, anchoring.may_anchor, lambda me, message, *mine: anchoring.anchors(me, message, *mine))


@mutant("M off by one", "S3", m=2)
def _(patch):
    may_anchor = anchoring.may_anchor

    def one_more(me, message, *mine):
        lone = len(me.leases) == 1
        return anchoring.anchors(me, message, *mine) if lone else may_anchor(me, message, *mine)

    everywhere(patch, may_anchor, one_more)


@mutant("accepts own swarm", "S3")
def _(patch):
    judge = race.judge

    def queue_own(message, state, *more):
        own = (
            message.kind == CHALLENGE_INIT
            and message.swarm == state.swarm
            and state.awake
            and not state.flying
        )
        return race.QUEUE if own else judge(message, state, *more)

    def accept(me, message):
        pairing.accept(me, message._replace(swarm=Swarm(0, 0)) if message.swarm == me.swarm else message)

    patch.setattr(race, "judge", queue_own)
    swap(patch, pairing.accept, accept)


@mutant("newcomer anchors", "S10", **{"thaw.policy": "off", "failure.rate": 0.1})
def _(patch):
    everywhere(patch, anchoring.anchors, lambda me, message, *_: me.swarm < message.swarm)


# -- localizing and following ----------------------------------------------------------------------------------------


def readdressed(me, message):
    return message._replace(addressee=me.swarm) if message.kind in SWARM_KINDS else message


@mutant("old-ξ check dropped", "S6", lambda_ms=100.0)
def _(patch):
    land = StateMachine._land

    def land_anyhow(me, event):
        me.pending = [readdressed(me, message) for message in me.pending]
        land(me, event)

    patch.setattr(StateMachine, "_land", land_anyhow)


@mutant("judged at sending", "S13", "S16", **{"virtual.latency_max_ms": 80.0, "lambda_ms": 50.0})
def _(patch):
    hear, receive = VirtualFls.hear, StateMachine.receive

    def take_what_was_sent(self, message, stamp):
        there = message.kind in SWARM_KINDS and self.machine.awake
        self.arrive(message, stamp) if there else hear(self, message, stamp)

    patch.setattr(VirtualFls, "hear", take_what_was_sent)
    patch.setattr(
        StateMachine,
        "receive",
        lambda me, message, *more: receive(me, readdressed(me, message), *more),
    )


@mutant("applied twice", "S12")
def _(patch):
    take = VirtualFls.take_message

    def take_twice(self, message, stamp, now, **noted):
        take(self, message, stamp, now, **noted)
        if self.alive and message.kind == FOLLOW_MERGE:
            take(self, message, stamp, now, **noted)

    patch.setattr(VirtualFls, "take_message", take_twice)


@mutant("V reversed", "S5")
def _(patch):
    right = SignalStrength.displacement
    patch.setattr(SignalStrength, "displacement", lambda *given: tuple(-x for x in right(*given)))


@mutant("anchor moves too", "S7")
def _(patch):
    table = [list(row) for row in state_machine._RULES]
    table[BA][FOLLOW_MERGE] = Rule(following.follow_merge, tuple(State))
    patch.setattr(state_machine, "_RULES", table)


@mutant("ξ not taken", "S6")
def _(patch):
    swap(patch, following.follow_merge, following.follow)


@mutant("members not told", "S5")
def _(patch):
    unsaid(patch, MERGE, FOLLOW_MERGE)


@mutant("members not made to wait", "S4")
def _(patch):
    unsaid(patch, SET_WAITING)


@mutant("Waiting unbounded", "S7", **{"radio.loss": 0.3})
def _(patch):
    swap(patch, following.bound_over, nothing)


@mutant("first SET_AVAILABLE frees", "S7")
def _(patch):
    right = following.resume

    def resume(me, message):
        me.holders.clear()
        right(me, message)

    swap(patch, right, resume)


@mutant("waits for a localizer as for an anchor", "S7")
def _(patch):
    right = following.wait
    swap(patch, right, lambda me, message: right(me, message._replace(flags=message.flags | ANCHORING)))


@mutant("SET_AVAILABLE skipped", "S7")
def _(patch):
    unsaid(patch, SET_AVAILABLE)


# -- thaws -----------------------------------------------------------------------------------------------------------


@mutant("thaw twice", "S11")
def _(patch):
    swap(patch, thawing.hear_thaw, lambda me, message: thawing.obey_thaw(me, me.epoch))


def after_thaw(patch: Patch, keep: Callable[[Memory], Callable[[], None]]) -> None:
    """A thaw after which something is as it was: `keep` looks before, what it gives puts back."""
    obey = thawing.obey_thaw

    def obey_thaw(me, *more, **named):
        put_back = keep(me)
        obey(me, *more, **named)
        put_back()

    everywhere(patch, obey, obey_thaw)


@mutant("census counts twice", "S11", **{"thaw.policy": "census"})
def _(patch):
    hear = Roll.hear

    def hear_twice(self, message):
        hear(self, message)
        if message.swarm == self._of:
            self._incarnations[-message.sender] = 0

    patch.setattr(Roll, "hear", hear_twice)


@mutant("census off by one", "S11", **{"thaw.policy": "census"})
def _(patch):
    begin = Census.__init__
    patch.setattr(Census, "__init__", lambda self, count, *more: begin(self, count - 1, *more))


@mutant("keeps range", "S11", **{"radio.loss": 0.3})
def _(patch):
    def keep(me):
        reach = me.reach
        return lambda: setattr(me, "reach", reach)

    after_thaw(patch, keep)


@mutant("keeps leases", "S11", **{"thaw.h_s": 0.5})
def _(patch):
    def keep(me):
        leases = me.leases.ends()
        return lambda: me.leases._until.update(leases)

    after_thaw(patch, keep)


@mutant("ξ without epoch", "S13", **{"thaw.h_s": 0.5})
def _(patch):
    meet = thawing.meet_epoch
    everywhere(patch, meet, lambda me, message: message.epoch < me.epoch or meet(me, message))


@mutant("belief kept over a thaw", "S9")
def _(patch):
    patch.setattr(Beliefs, "clear", nothing)


# -- ids, lives, beliefs ---------------------------------------------------------------------------------------------


@mutant("id check reversed", "L1", **{"thaw.policy": "off"})
def _(patch):
    def older(self, sender, incarnation, number):
        newest = self._seen.setdefault(sender, number)
        return number < newest

    patch.setattr(ReplayWindow, "fresh", older)


@mutant("duplicate accepted", "S12")
def _(patch):
    patch.setattr(ReplayWindow, "fresh", lambda *_: True)


@mutant("incarnation ignored", "S12", **{"radio.reorder": 0.3, "radio.reorder_ms": 1500.0})
def _(patch):
    fresh = ReplayWindow.fresh

    def of_each_life(self, sender, incarnation, number):
        return fresh(self, (sender, incarnation), 0, number)

    patch.setattr(ReplayWindow, "fresh", of_each_life)


@mutant("ξ without incarnation", "L1", **{"thaw.policy": "off"})
def _(patch):
    judge = race.judge

    def by_xi(message, state, *more):
        same = message.kind == CHALLENGE_INIT and message.swarm.xi == state.swarm.xi
        return race.NOTE if same else judge(message, state, *more)

    patch.setattr(race, "judge", by_xi)


@mutant("belief from hearsay", "S9")
def _(patch):
    note = Beliefs.note

    def believe_all(self, message):
        note(self, message)
        if message.kind in (MERGE, FOLLOW_MERGE):
            for fid, swarm in list(self._heard.items()):
                if swarm == message.addressee:
                    self._heard[fid] = message.other

    patch.setattr(Beliefs, "note", believe_all)


@mutant("R-Complete too early", "L5", probe_every=0, **NO_FAULTS)
def _(patch):
    patch.setattr(Beliefs, "complete", lambda self, swarm: True)


@mutant("one-way neighbours", "S9")
def _(patch):
    plan = neighbours.neighbour_plan
    patch.setattr(neighbours, "neighbour_plan", lambda points, eta, mode: plan(points, eta, "nearest"))


@mutant("range never widens", "S2", **{"radio.loss": 0.3})
def _(patch):
    send_challenge = Memory.send_challenge

    def as_far_as_ever(me):
        reach, me.challenge_taken = me.reach, True
        send_challenge(me)
        me.reach = reach

    patch.setattr(Memory, "send_challenge", as_far_as_ever)


@mutant("challenges while busy", "S2")
def _(patch):
    swap(
        patch,
        challenging.skip_tick,
        lambda me, event: (challenging.skip_tick(me, event), me.send_challenge()),
    )


@mutant("lit at launch", "S1")
def _(patch):
    def launch(me, event):
        challenging.launch(me, event)
        me.state = A

    swap(patch, challenging.launch, launch)


@mutant("stopped FLS returns", "S13")
def _(patch):
    end = VirtualFls.end

    def end_in_name_only(self, how):
        due = list(self.due)
        end(self, how)
        self.alive, self.due = True, due

    patch.setattr(VirtualFls, "end", end_in_name_only)


# -- the next shape --------------------------------------------------------------------------------------------------

NEXT = {"transition.shape": "cube", "transition.points": 12, "transition.at_s": 2.0, "lambda_ms": 100.0}


@mutant("next shape begins like a thaw", "S15", **NEXT)
def _(patch):
    """Then a datagram of the old shape, of who has obeyed one thaw more, is not out of date."""
    change_shape = thawing.change_shape

    def in_the_next_epoch(me, event):
        if me.then is not None:
            me.then = me.then._replace(epoch=me.epoch + 1)
        change_shape(me, event)

    swap(patch, change_shape, in_the_next_epoch)
    everywhere(patch, change_shape, in_the_next_epoch)


@mutant("new point not flown to", "S15", **NEXT)
def _(patch):
    def stay(me, event):
        then, me.then = me.then, None
        if then is not None:
            thawing.obey_thaw(me, then.epoch)

    swap(patch, thawing.change_shape, stay)
    everywhere(patch, thawing.change_shape, stay)


@mutant("lands and stays where its old point was", "S15", **NEXT)
def _(patch):
    def forget(me, offset):
        me.onward = None
        return False

    patch.setattr(Memory, "flies_on", forget)


# -- oracles -------------------------------------------------------------------------------------------------------

KNOWING = {"oracle.count": 2, "lambda_ms": 100.0}


@mutant("oracle follows", "S14", **KNOWING)
def _(patch):
    """Two absolute swarms localize against each other, and their members obey."""
    localize = localizing.localize

    def as_if_relative(me, event):
        me.absolute = False
        localize(me, event)

    swap(patch, localize, as_if_relative)


@mutant("Swarm-IDs decide against an oracle", "S14", **KNOWING)
def _(patch):
    patch.setattr(anchoring, "ABSOLUTE", 0)


@mutant("members do not learn that they are absolute", "S14", **KNOWING)
def _(patch):
    patch.setattr(localizing, "ABSOLUTE", 0)


@mutant("absolute after a thaw", "S14", **KNOWING)
def _(patch):
    obey_thaw = thawing.obey_thaw

    def remember(me, *more, **named):
        absolute = me.absolute
        obey_thaw(me, *more, **named)
        me.absolute = absolute

    everywhere(patch, obey_thaw, remember)


# -- the table -------------------------------------------------------------------------------------------------------


def row(name: str, caught: Caught | None) -> str:
    return f"{name:28}" + (f"{caught.invariant:6}{caught.seeds:3} world(s)" if caught else "survived")


def main() -> int:
    """Hunt every mutant and print who caught it, and after how many worlds; the exit status."""
    missed = 0
    for one in MUTANTS:
        with Patch.context() as patch:
            one.apply(patch)
            caught = hunt(one)
        missed += caught is None or caught.invariant not in one.caught_by
        print(row(one.name, caught), flush=True)
    print(f"{len(MUTANTS) - missed} of {len(MUTANTS)} caught by their invariant")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
