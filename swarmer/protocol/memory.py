"""What one FLS knows, owes and waits for, and the few things that every rule does with it.

The rules are plain functions of a `Memory`, in the files beside this one; the table in `state_machine` says which rule
answers which event. A rule changes the memory and adds to its actions, and does nothing else.
"""

from __future__ import annotations

from math import hypot
from random import Random
from typing import TYPE_CHECKING

from swarmer.messages import (
    ABSOLUTE,
    CHALLENGE_INIT,
    JOIN,
    NO_SWARM,
    THAW,
    TO_ALL,
    TO_FLS,
    TO_SWARM,
    ZERO,
    Message,
    Swarm,
    Vec3,
)
from swarmer.protocol.beliefs import Beliefs
from swarmer.protocol.challenge_policy import ChallengePolicy
from swarmer.protocol.events import (
    BOUND_TIMER,
    CHALLENGE_TIMER,
    LEASE_TIMER,
    RENEW_TIMER,
    THAW_TIMER,
    Action,
    Arm,
    Count,
    Disarm,
    Fly,
    Send,
    Timer,
)
from swarmer.protocol.leases import Leases
from swarmer.protocol.records import (
    BA,
    A,
    Accept,
    Counters,
    D,
    Identity,
    MachineSettings,
    NextPoint,
    View,
    W,
)  # fmt: skip

if TYPE_CHECKING:
    from swarmer.protocol.thaw import ThawPolicy

_new = tuple.__new__  # a named tuple's own costs twice the time, and these are made all the time
_DISARM = tuple(map(Disarm, Timer))
_ON_OTHERS = 1 << BOUND_TIMER | 1 << LEASE_TIMER | 1 << RENEW_TIMER  # timers of who waits for other FLSs
EXACT = 1e-9  # cells: no flight of an oracle is shorter
UINT32_MAX = 0xFFFFFFFF  # what a datagram has room for


def sum_of_sizes(mine: int, theirs: int) -> int:
    """The estimated size of two merged swarms. Races count members twice, so the sum may run away; never too far."""
    return min(mine + theirs, UINT32_MAX)


def _first_challenge(fid: int, incarnation: int) -> int:
    # Ids must differ between FLSs too, for two may pair in two challenges at once: each counts from a place far from
    # the others' (multiples of an odd constant near 2^32 / golden ratio spread evenly modulo 2^32).
    return (fid + (incarnation << 20)) * 2654435761 & UINT32_MAX


class Memory:
    """One FLS, as it sees itself. Slots, because there are more names than a dictionary shares between objects."""

    __slots__ = (
        "_armed",
        "_last_challenge",
        "absolute",
        "accepts",
        "actions",
        "anchor",
        "beliefs",
        "brought",
        "challenge",
        "challenge_open",
        "challenge_taken",
        "counts",
        "departed",
        "epoch",
        "fid",
        "flying",
        "holders",
        "incarnation",
        "last_accept_s",
        "leases",
        "leaving",
        "longest",
        "merged",
        "now",
        "onward",
        "oracle",
        "pending",
        "policy",
        "reach",
        "reminded",
        "rng",
        "settings",
        "size",
        "state",
        "swarm",
        "thaw_policy",
        "thawed_s",
        "then",
        "tick_s",
        "truth",
    )

    def __init__(
        self,
        identity: Identity,
        neighbours: tuple[int, ...],
        settings: MachineSettings,
        challenge_policy: ChallengePolicy,
        thaw_policy: ThawPolicy,
        rng: Random,
        counts: Counters | None = None,
        epoch: int = 0,
        then: NextPoint | None = None,
        oracle: bool = False,
    ) -> None:
        """`neighbours`: the planned ones. `counts`: one place per Count, kept elsewhere if the engine likes.

        `then`: what it is to be in the next shape; None: there is none to come. `oracle`: it knows where it is.
        """
        self.fid, self.incarnation, self.truth = identity
        self.settings = settings
        self.policy, self.thaw_policy, self.rng = challenge_policy, thaw_policy, rng
        self.counts: Counters = [0] * len(Count) if counts is None else counts
        self.state = D
        self.flying = False
        self.epoch = epoch
        self.swarm = Swarm(self.fid, self.incarnation)
        self.size = 1
        self.merged = False  # since its landing: a newcomer that has not joins (rule 10)
        self.reach = settings.range_start
        self.beliefs = Beliefs(neighbours)
        self.leases = Leases(settings.lease_s + settings.lease_margin_s)
        self.holders: dict[int, bool] = {}  # who keeps this FLS Waiting, and whether as anchor
        self.anchor: Message | None = None  # the datagram of the pairing in which this FLS localizes
        self.challenge = 0  # id of the challenge that acceptances may still refer to; 0: none
        self.challenge_open = False  # it has not taken one yet
        self.challenge_taken = True  # the last one found a taker, so the range need not grow
        self._last_challenge = _first_challenge(self.fid, self.incarnation)
        self.accepts: dict[int, Accept] = {}
        self.last_accept_s = -1e9
        self.brought = 1  # the size of the swarm that localizes with this FLS
        self.pending: list[Message] = []
        self.reminded: dict[int, float] = {}
        self.thawed_s = -1e9
        self.tick_s = 0.0
        self.longest = 0.0  # the longest V that it was told to fly in this epoch, cells
        self._armed = 0  # one bit for each Timer
        self.leaving = self.departed = False
        self.then = then
        self.oracle = self.absolute = (
            oracle  # absolute: its swarm has an oracle, or has localized against such a one
        )
        self.onward: Vec3 | None = None  # where it flies once it has landed: its point moved while it flew
        self.now = 0.0
        self.actions: list[Action] = []

    @property
    def awake(self) -> bool:
        return self.state is not D

    @property
    def available(self) -> bool:
        return self.state is A

    @property
    def anchoring(self) -> bool:
        """Busy Anchor, or Waiting only because the swarm anchors (Wa)."""
        if self.state is W:
            return bool(self.holders) and all(self.holders.values())
        return self.state is BA

    @property
    def joins(self) -> bool:
        """A newcomer that has not merged since its landing (rule 10)."""
        newcomer = self.incarnation > 0 and not self.merged and not self.oracle
        return newcomer and self.settings.busy_join == "newcomer"

    def is_void(self, message: Message, since_s: float) -> bool:
        """A THAW that came, at `since_s`, while this FLS obeys none: without epochs one a λ (rule 11).

        It must not wait in the queue until one is obeyed again. Half of all FLSs repeat a THAW, and F/2 copies may take
        longer than λ to handle: the last ones would be obeyed and repeated, and so on for ever.
        """
        return (
            message.kind == THAW
            and not self.settings.epochs
            and since_s < self.thawed_s + self.settings.lambda_s
        )

    @property
    def complete(self) -> bool:
        """R-Complete (rule 9)."""
        return self.beliefs.complete(self.swarm)

    def view(self) -> View:
        """An immutable copy of what the network thread may know."""
        return View(
            self.awake, self.epoch, self.flying, self.available, self.anchoring, self.swarm, self.size
        )

    def arm(self, timer: Timer, at_s: float) -> None:
        self._armed |= 1 << timer
        self.actions.append(_new(Arm, (timer, at_s)))

    def is_armed(self, timer: Timer) -> bool:
        return bool(self._armed >> timer & 1)

    def disarm(self, *timers: Timer) -> None:
        for timer in timers:
            if self._armed >> timer & 1:
                self._armed &= ~(1 << timer)
                self.actions.append(_DISARM[timer])

    def say(
        self,
        kind: int,
        to: int,
        addressee: Swarm = NO_SWARM,
        flags: int = 0,
        challenge: int = 0,
        other: Swarm = NO_SWARM,
        vector: Vec3 = ZERO,
        size: int | None = None,
        reach: float | None = None,
    ) -> None:
        message = _new(
            Message,
            (kind, self.fid, self.incarnation, self.epoch, self.swarm, self.size if size is None else size,
             self.truth, to, addressee, flags, challenge, self.settings.range_max if reach is None else reach,
             other, vector),
        )  # fmt: skip
        self.actions.append(_new(Send, (message,)))

    def tell(self, message: Message, kind: int, flags: int = 0, other: Swarm = NO_SWARM) -> None:
        """Answer the sender of `message`, about the same challenge."""
        self.say(kind, TO_FLS, _new(Swarm, (message.sender, 0)), flags, message.challenge, other)

    def tell_swarm(self, kind: int, swarm: Swarm | None = None, flags: int = 0) -> None:
        self.say(kind, TO_SWARM, self.swarm if swarm is None else swarm, flags)

    def become_available(self) -> None:
        if self._armed & _ON_OTHERS:
            self.disarm(BOUND_TIMER, LEASE_TIMER, RENEW_TIMER)
        self.holders.clear()
        self.anchor = None
        self.state = A
        self.enter_available()

    def enter_available(self) -> None:
        """The authors' program challenges at once, if its policy would at a tick."""
        if self.settings.challenge_on_available and self.policy.challenges(self.complete, self.rng):
            self.send_challenge()

    def fly(self, vector: Vec3, legs: tuple[Vec3, ...] = ()) -> None:
        self.disarm(BOUND_TIMER)
        self.holders.clear()
        self.flying = True
        self.longest = max(self.longest, hypot(*vector))
        self.actions.append(Fly(vector, legs))

    def flies_on(self, offset: Vec3) -> bool:
        """Just landed: is there a way still to fly? To a point that it was given meanwhile; or, for an oracle, the rest
        of the way to its own: offset (rule 14).
        """
        onward, self.onward = self.onward, None
        if self.oracle and hypot(*offset) >= max(self.settings.flight_threshold, EXACT):
            onward = offset
        if onward is None:
            return False
        self.fly(onward)
        return True

    def take_swarm(self, swarm: Swarm, size: int, flags: int) -> None:
        """flags: of the message that says so."""
        self.swarm, self.size, self.absolute = swarm, size, bool(flags & ABSOLUTE)
        self.merged = True
        self.policy.merged()

    def start_timers(self) -> None:
        """The challenge tick within λ of a landing or thaw, this FLS's own thaw, and what its policy waits for."""
        self.tick_s = self.now + self.rng.uniform(0.0, self.settings.lambda_s)
        self.arm(CHALLENGE_TIMER, self.tick_s)
        self.longest = 0.0
        self.arm_thaw()
        self.thaw_policy.begins(self)

    def arm_thaw(self) -> None:
        delay = self.thaw_policy.delay_s(self.rng)
        if delay is not None:
            self.arm(THAW_TIMER, self.now + delay)

    def send_challenge(self) -> None:
        s = self.settings
        if not self.challenge_taken:
            self.reach = min(self.reach + s.range_step, s.range_max)
        self.challenge = self._last_challenge = self._last_challenge % UINT32_MAX + 1
        self.challenge_open, self.challenge_taken = True, False
        self.say(CHALLENGE_INIT, TO_ALL, flags=self.own_flags(), challenge=self.challenge, reach=self.reach)

    def close_challenge(self) -> None:
        """No acceptance of it pairs any more."""
        self.challenge, self.challenge_open = 0, False

    def own_flags(self) -> int:
        """What a pairing must know of this FLS."""
        return (JOIN if self.joins else 0) | (ABSOLUTE if self.absolute else 0)
