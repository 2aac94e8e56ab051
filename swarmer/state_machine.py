"""The SwarMer state machine: event + now -> actions (SwarMer, section 4; the house's rules are in docs/protocol.md).

Two rules hold here. The machine performs nothing: it returns actions, and the engine reports back with events. And it
knows no other time or chance than the `now` and the `rng` it is handed, so the same code runs as a real process and in
virtual time.

TABLE is the protocol: for each state, which event it has a rule for and which states that rule may lead to. What is not
listed is ignored and counted, for a late datagram is normal; an event that only our own engine can send raises instead.
Three things come before the table, in `_receive`: epochs (rule 12), beliefs (rule 9), and flights, during which swarm
messages wait for the landing and pairings are refused.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from random import Random
from typing import TYPE_CHECKING, NamedTuple

from swarmer.messages import (
    ANCHORING,
    BUSY,
    CHALLENGE_ACCEPT,
    CHALLENGE_ACK,
    CHALLENGE_FIN,
    CHALLENGE_INIT,
    FOLLOW_MERGE,
    JOIN,
    LEASE_CANCEL,
    LEASE_RENEW,
    LEAVE,
    MERGE,
    NEIGHBOUR,
    NO_SWARM,
    SET_AVAILABLE,
    SET_WAITING,
    SWARM_KINDS,
    THAW,
    TO_ALL,
    TO_FLS,
    TO_SWARM,
    ZERO,
    Kind,
    Message,
    Swarm,
    To,
    Vec3,
)
from swarmer.protocol.anchor_selection import AnchorSelection, Party
from swarmer.protocol.beliefs import Beliefs
from swarmer.protocol.challenge_policy import ChallengePolicy
from swarmer.protocol.events import (
    KEYS,
    Action,
    Arm,
    BatteryLow,
    Count,
    Depart,
    Disarm,
    Due,
    Event,
    Fly,
    Landed,
    Launch,
    Local,
    Measure,
    Measured,
    Received,
    Send,
    Timer,
)
from swarmer.protocol.leases import Leases
from swarmer.protocol.thaw import ThawPolicy

if TYPE_CHECKING:
    from collections.abc import Mapping, MutableSequence

    from swarmer.plugins import Localizer

PENDING_MAX = 64  # swarm messages that may wait for a landing; more are dropped and counted as ignored


class State(IntEnum):
    """The paper's five states (figure 4)."""

    DEPLOYING = 0
    AVAILABLE = 1
    BUSY_ANCHOR = 2
    BUSY_LOCALIZING = 3
    WAITING = 4


D, A, BA, BL, W = State
CHALLENGE_TIMER, BOUND_TIMER, LEASE_TIMER, RENEW_TIMER, THAW_TIMER = Timer
_LAUNCH, _LANDED, _MEASURED, _BATTERY_LOW = map(
    int, (Local.LAUNCH, Local.LANDED, Local.MEASURED, Local.BATTERY_LOW)
)


class Identity(NamedTuple):
    """Who an FLS is: its FID, how often that FID has been replaced, its point in display cells."""

    fid: int
    incarnation: int
    truth: Vec3


class MachineSettings(NamedTuple):
    """The rules a machine plays by. Times are emulated seconds, lengths display cells."""

    lambda_s: float
    lease_s: float  # δ
    lease_margin_s: float  # an anchor's lease is δ and this
    m: float  # most swarms merged at one anchor at a time; math.inf
    waiting_bound_s: float
    waiting_ends_at_tick: bool
    flight_threshold: float
    range_start: float
    range_step: float
    range_max: float
    challenge_on_available: bool
    accept_gap_s: float
    neighbour_reply: bool
    busy_join: str  # newcomer | all | off
    epochs: bool
    thaw_repeat: float  # probability of repeating a THAW that was obeyed
    anchors: AnchorSelection
    localizer: Localizer


class Accept(NamedTuple):
    """An acceptance that was sent; it reserves nothing and is remembered for a lease."""

    challenge: int
    size: int
    until_s: float


class View(NamedTuple):
    """What the network thread may know (`protocol.race.Published`)."""

    awake: bool
    epoch: int
    flying: bool
    available: bool
    anchoring: bool
    swarm: Swarm
    size: int


(
    _LOCALIZATIONS,
    _ANCHORINGS,
    _LEASES_GRANTED,
    _LEASES_EXPIRED,
    _THAWS_STARTED,
    _THAWS_OBEYED,
    _HANDLED,
    _IGNORED,
    _STALE,
    _JOINS,
) = map(int, Count)  # plain numbers: these are counted at every event


class ProtocolBug(RuntimeError):
    """An engine fed an event that cannot happen in this state."""


class StateMachine:
    """One FLS. `handle` is its only way in; everything else is for reading."""

    def __init__(
        self,
        identity: Identity,
        neighbours: tuple[int, ...],
        settings: MachineSettings,
        challenge_policy: ChallengePolicy,
        thaw_policy: ThawPolicy,
        rng: Random,
        counts: MutableSequence[int] | None = None,
        epoch: int = 0,
    ) -> None:
        """`neighbours`: the planned ones. `counts`: one place per Count, kept elsewhere if the engine likes."""
        self.fid, self.incarnation, self.truth = identity
        self.settings = settings
        self.policy, self.thaw_policy, self.rng = challenge_policy, thaw_policy, rng
        self.counts: MutableSequence[int] = [0] * len(Count) if counts is None else counts
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
        self.challenge = 0  # id of the last challenge
        self._open = False  # that challenge still takes an acceptance
        self._taken = True  # that challenge found a taker, so the range need not grow
        self._accepts: dict[int, Accept] = {}
        self._last_accept_s = -1e9
        self._brought = 1  # the size of the swarm that localizes with this FLS
        self._pending: list[Message] = []
        self._reminded: dict[int, float] = {}
        self._thawed_s = -1e9
        self._tick_s = 0.0
        self._armed = 0  # one bit for each Timer
        self._leaving = self.departed = False
        self._now = 0.0
        self._actions: list[Action] = []

    # -- what others may read ------------------------------------------------------------------------------------

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
        return self.incarnation > 0 and not self.merged and self.settings.busy_join == "newcomer"

    @property
    def complete(self) -> bool:
        """R-Complete (rule 9)."""
        return self.beliefs.complete(self.swarm)

    def view(self) -> View:
        """An immutable copy of what the network thread may know."""
        return View(
            self.awake, self.epoch, self.flying, self.available, self.anchoring, self.swarm, self.size
        )

    # -- the way in ----------------------------------------------------------------------------------------------

    def handle(self, event: Event, now: float) -> list[Action]:
        """Take one event at emulated second `now`; what the engine must do, in this order.

        Raises ProtocolBug for an event that the present state cannot get from a right engine.
        """
        self._now = now
        self._actions = actions = []
        if self.departed:
            return actions
        if type(event) is Received:
            self._receive(event)
        elif type(event) is Due:
            self._armed &= ~(1 << event.timer)
            self._apply(_TIMERS + event.timer, None)
        elif type(event) is Landed:
            self._land()
        elif type(event) is Measured:
            if self.state is BL and not self.flying:
                self._apply(_MEASURED, event)
        elif type(event) is Launch:
            self._apply(_LAUNCH, event)
        elif type(event) is BatteryLow:
            self._leaving = True
            if not self.flying:
                self._apply(_BATTERY_LOW, None)
        return actions

    def _receive(self, event: Received) -> None:
        message = event.message
        if message.sender == self.fid:
            return
        if self.settings.epochs and message.epoch != self.epoch and not self._meet_epoch(message):
            return
        self.beliefs.note(message)
        kind = message.kind
        if event.noted or kind == NEIGHBOUR:
            self.counts[_HANDLED] += 1
        elif self.flying and kind in _NOT_IN_FLIGHT:
            self._receive_in_flight(message)
        elif kind in SWARM_KINDS and message.addressee != self.swarm:
            self.counts[_IGNORED] += 1
        else:
            self._apply(kind, message)

    def _meet_epoch(self, message: Message) -> bool:
        """Rule 12: a newer epoch is obeyed first, an older one is told. Handle the message then?"""
        if message.epoch > self.epoch:
            self._obey_thaw(message.epoch)
            return message.kind != THAW
        self.counts[_STALE] += 1
        due = self._reminded.get(message.sender, -1e9) + self.settings.lambda_s
        if self.awake and message.sender and message.kind != THAW and due <= self._now:
            self._reminded[message.sender] = self._now
            self._tell(message, THAW)
        return False

    def _receive_in_flight(self, message: Message) -> None:
        if message.kind in SWARM_KINDS and self.awake and len(self._pending) < PENDING_MAX:
            self._pending.append(message)
            return
        self.counts[_IGNORED] += 1
        if message.kind in (CHALLENGE_ACCEPT, CHALLENGE_ACK) and self.awake:
            self._tell(message, LEASE_CANCEL)

    def _land(self) -> None:
        self.flying = False
        self._apply(_LANDED, None)
        pending, self._pending = self._pending, []
        for message in pending:
            if self.flying:  # one of them asked for a flight: the rest waits for its landing
                self._pending.append(message)
            elif message.addressee == self.swarm:
                self._apply(message.kind, message)
            else:
                self.counts[_IGNORED] += 1
        if self._leaving and not self.flying:
            self._apply(_BATTERY_LOW, None)

    def _apply(self, key: int, body: object) -> None:
        state = self.state
        rule = _RULES[state][key]
        if rule is None:
            if key >= _TIMERS:
                raise ProtocolBug(f"FLS {self.fid}: {Local(key).name} in {state.name}")
            self.counts[_IGNORED] += 1
            return
        if key < _TIMERS:
            self.counts[_HANDLED] += 1
        rule.act(self, body)
        if self.state not in rule.leads_to:
            raise ProtocolBug(f"FLS {self.fid}: {key} in {state.name} led to {self.state.name}")

    # -- timers and messages -------------------------------------------------------------------------------------

    def _arm(self, timer: Timer, at_s: float) -> None:
        self._armed |= 1 << timer
        self._actions.append(Arm(timer, at_s))

    def _disarm(self, *timers: Timer) -> None:
        for timer in timers:
            if self._armed >> timer & 1:
                self._armed &= ~(1 << timer)
                self._actions.append(Disarm(timer))

    def _say(
        self,
        kind: Kind,
        to: To,
        addressee: Swarm = NO_SWARM,
        flags: int = 0,
        challenge: int = 0,
        other: Swarm = NO_SWARM,
        vector: Vec3 = ZERO,
        size: int | None = None,
        reach: float | None = None,
    ) -> None:
        self._actions.append(
            Send(
                Message(
                    kind, self.fid, self.incarnation, self.epoch, self.swarm, self.size if size is None else size,
                    self.truth, to, addressee, flags, challenge,
                    self.settings.range_max if reach is None else reach, other, vector,
                )
            )
        )  # fmt: skip

    def _tell(self, message: Message, kind: Kind, flags: int = 0, other: Swarm = NO_SWARM) -> None:
        """Answer the sender of `message`, about the same challenge."""
        self._say(kind, TO_FLS, Swarm(message.sender, 0), flags, message.challenge, other)

    def _tell_swarm(self, kind: Kind, swarm: Swarm | None = None, flags: int = 0) -> None:
        self._say(kind, TO_SWARM, self.swarm if swarm is None else swarm, flags)

    # -- states --------------------------------------------------------------------------------------------------

    def _become_available(self) -> None:
        self._disarm(BOUND_TIMER, LEASE_TIMER, RENEW_TIMER)
        self.holders.clear()
        self.anchor = None
        self.state = A
        if self.settings.challenge_on_available:
            self._challenge()

    def _fly(self, vector: Vec3) -> None:
        self._disarm(BOUND_TIMER)
        self.holders.clear()
        self.flying = True
        self._actions.append(Fly(vector))

    def _take_swarm(self, swarm: Swarm, size: int) -> None:
        self.swarm, self.size = swarm, size
        self.merged = True
        self.policy.merged()

    def _start_timers(self) -> None:
        """The challenge tick within λ of a landing or thaw, and this FLS's own thaw."""
        self._tick_s = self._now + self.rng.uniform(0.0, self.settings.lambda_s)
        self._arm(CHALLENGE_TIMER, self._tick_s)
        self._arm_thaw()

    def _arm_thaw(self) -> None:
        delay = self.thaw_policy.delay_s(self.rng)
        if delay is not None:
            self._arm(THAW_TIMER, self._now + delay)

    def _obey_thaw(self, epoch: int) -> None:
        """Start again from here: ξ = FID, nothing owed, nothing believed (rule 11)."""
        self.epoch = epoch
        self._reminded.clear()
        if self.state is D:
            return
        self.counts[_THAWS_OBEYED] += 1
        self._thawed_s = self._now
        self.swarm, self.size = Swarm(self.fid, self.incarnation), 1
        self.reach, self._open, self._taken = self.settings.range_start, False, True
        self.anchor = None
        for table in (self.leases, self.holders, self._accepts, self._pending, self.beliefs):
            table.clear()
        self.policy.thawed()
        self._disarm(BOUND_TIMER, LEASE_TIMER, RENEW_TIMER)
        # A flight that has begun goes on; a Waiting FLS that lands is Available and tells nobody.
        self.state = W if self.flying else A
        self._start_timers()

    # -- rules: deploying, challenging ---------------------------------------------------------------------------

    def launch(self, event: Launch) -> None:
        g, o = self.truth, event.origin
        self._arm_thaw()
        self._fly((g[0] - o[0], g[1] - o[1], g[2] - o[2]))

    def light_up(self, _: object) -> None:
        self.swarm, self.size = Swarm(self.fid, self.incarnation), 1
        self._become_available()
        self._start_timers()

    def challenge_due(self, _: object) -> None:
        self._rearm_tick()
        if self.policy.challenges(self.complete, self.rng):
            self._challenge()

    def skip_tick(self, _: object) -> None:
        self._rearm_tick()
        if self.settings.waiting_ends_at_tick and self.state is W and not self.flying:
            self._become_available()

    def _rearm_tick(self) -> None:
        # From the tick's own time, not from now: a late process must not challenge less often.
        self._tick_s = max(self._now, self._tick_s + self.settings.lambda_s * self.rng.uniform(0.5, 1.5))
        self._arm(CHALLENGE_TIMER, self._tick_s)

    def _challenge(self) -> None:
        s = self.settings
        if not self._taken:
            self.reach = min(self.reach + s.range_step, s.range_max)
        self.challenge = self.challenge % 0xFFFFFFFF + 1
        self._open, self._taken = True, False
        self._say(CHALLENGE_INIT, TO_ALL, flags=self._join_flag(), challenge=self.challenge, reach=self.reach)

    def _join_flag(self) -> int:
        return JOIN if self.joins else 0

    # -- rules: accepting and pairing ----------------------------------------------------------------------------

    def accept(self, message: Message) -> None:
        """INIT: an Available FLS of another swarm always accepts; an anchoring one if rule 3 allows it."""
        if message.swarm == self.swarm:
            if self.settings.neighbour_reply and message.sender in self.beliefs.neighbours:
                self._tell(message, NEIGHBOUR)
            return
        busy = self.state is not A
        if busy and not (self.anchoring and self._may_anchor(message, challenged=False)):
            return
        if self._now - self._last_accept_s < self.settings.accept_gap_s:
            return
        self._last_accept_s = self._now
        self._accepts[message.sender] = Accept(
            message.challenge, self.size, self._now + self.settings.lease_s
        )
        self._tell(message, CHALLENGE_ACCEPT, self._join_flag() | (BUSY if busy else 0))

    def note_init(self, message: Message) -> None:
        """INIT while localizing: only a neighbour's question of the own swarm has an answer."""
        if message.swarm == self.swarm:
            self.accept(message)

    def take_acceptance(self, message: Message) -> None:
        """ACCEPT at a challenger that is still Available: the first one pairs."""
        if not self._open or message.challenge != self.challenge or message.swarm == self.swarm:
            self._tell(message, LEASE_CANCEL)
            return
        self._open, self._taken = False, True
        self._tell(message, CHALLENGE_ACK, self._join_flag(), other=message.swarm)
        self._pair(message, challenged=True, other_size=message.size)

    def take_more(self, message: Message) -> None:
        """ACCEPT at a challenger that became anchor: later ones pair too while M allows."""
        if message.challenge == self.challenge and self._may_anchor(message, challenged=True):
            self._tell(message, CHALLENGE_ACK, self._join_flag(), other=message.swarm)
            self._grant(message.sender)
        else:
            self._tell(message, LEASE_CANCEL)

    def take_ack(self, message: Message) -> None:
        """ACK: the acceptance still stands if it is remembered and the Swarm-ID it named is still ours."""
        accept = self._accepts.pop(message.sender, None)
        stands = (
            accept is not None
            and accept.challenge == message.challenge
            and accept.until_s >= self._now
            and message.other == self.swarm != message.swarm
        )
        if not stands:
            self._tell(message, LEASE_CANCEL)
        elif self.state is A:
            assert accept is not None
            self._pair(message, challenged=False, my_size=accept.size)
        elif self.anchoring and self._may_anchor(message, challenged=False):
            self._anchor(message)
        else:
            self._tell(message, LEASE_CANCEL)

    def refuse(self, message: Message) -> None:
        self._tell(message, LEASE_CANCEL)

    def _pair(
        self, message: Message, challenged: bool, other_size: int | None = None, my_size: int | None = None
    ) -> None:
        """Both ends decide alone, from the two datagrams' Swarm-IDs, sizes and flags (rules 4 and 10)."""
        if self._anchors(message, challenged, other_size, my_size):
            self._anchor(message)
        else:
            self._localize(message)

    def _anchors(
        self, message: Message, challenged: bool, other_size: int | None = None, my_size: int | None = None
    ) -> bool:
        other_joins = bool(message.flags & JOIN)
        if other_joins or self.joins:
            if other_joins != self.joins:
                return other_joins
            return self.swarm < message.swarm
        if message.flags & BUSY and challenged:
            return False
        me = Party(self.swarm, self.size if my_size is None else my_size, challenged)
        other = Party(message.swarm, message.size if other_size is None else other_size, not challenged)
        return self.settings.anchors(me, other, message.challenge)

    def _may_anchor(self, message: Message, challenged: bool) -> bool:
        """OK of the table: this FLS would be the anchor of the sender, and M allows one more."""
        joiner = bool(message.flags & JOIN) and not self.joins
        if joiner:
            return True
        if len(self.leases) >= self.settings.m - 1 and message.sender not in self.leases:
            return False
        if self.settings.busy_join == "all" and not challenged:
            return True
        return self._anchors(message, challenged)

    def _anchor(self, message: Message) -> None:
        if self.state is not BA:
            self.counts[_ANCHORINGS] += 1
            self._disarm(BOUND_TIMER)
            self.holders.clear()
            self.state = BA
            self._tell_swarm(SET_WAITING, flags=ANCHORING)
        if message.flags & JOIN:
            self.counts[_JOINS] += 1
        self._grant(message.sender)

    def _grant(self, fid: int) -> None:
        if fid not in self.leases:
            self.counts[_LEASES_GRANTED] += 1
        self.leases.grant(fid, self._now)
        self._arm_lease()

    def _arm_lease(self) -> None:
        expiry = self.leases.next_expiry()
        if expiry is not None:
            self._arm(LEASE_TIMER, expiry)

    # -- rules: localizing ---------------------------------------------------------------------------------------

    def _localize(self, message: Message) -> None:
        self._open = False
        self.anchor = message
        self.state = BL
        self._tell_swarm(SET_WAITING)
        self._arm(RENEW_TIMER, self._now + self.settings.lease_s / 2)
        self._actions.append(Measure(message))

    def localize(self, event: Measured) -> None:
        """The sensor has answered: take the anchor's swarm and tell the old one (rule 5)."""
        anchor = self.anchor
        assert anchor is not None
        g, a = self.truth, anchor.truth
        vector = self.settings.localizer.displacement(event.vector, (a[0] - g[0], a[1] - g[1], a[2] - g[2]))
        self.counts[_LOCALIZATIONS] += 1
        old, self._brought = self.swarm, self.size
        self._take_swarm(anchor.swarm, self.size + anchor.size)
        length2 = vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2
        if length2 >= self.settings.flight_threshold**2:
            self._say(FOLLOW_MERGE, TO_SWARM, old, other=self.swarm, vector=vector)
            self._fly(vector)
        else:
            self._say(MERGE, TO_SWARM, old, other=self.swarm)
            self.finish(None)

    def finish(self, _: object) -> None:
        """Landed where the localization led: the anchor may go."""
        if self.anchor is not None:
            self._say(
                CHALLENGE_FIN, TO_FLS, Swarm(self.anchor.sender, 0), challenge=self.anchor.challenge,
                size=self._brought,
            )  # fmt: skip
        self._become_available()

    def renew_lease(self, _: object) -> None:
        assert self.anchor is not None
        self._tell(self.anchor, LEASE_RENEW)
        self._arm(RENEW_TIMER, self._now + self.settings.lease_s / 2)

    def cancelled(self, message: Message) -> None:
        """LEASE_CANCEL at a localizer: from its anchor and on the ground it gives up; flying it finishes."""
        if self.anchor is not None and message.sender == self.anchor.sender and not self.flying:
            self._become_available()
            self._tell_swarm(SET_AVAILABLE)

    def forget_accept(self, message: Message) -> None:
        self._accepts.pop(message.sender, None)

    # -- rules: anchoring ----------------------------------------------------------------------------------------

    def free(self, message: Message) -> None:
        """FIN or CANCEL: that lease is over; after the last one the anchor and its swarm are free (rule 7)."""
        if self.leases.release(message.sender):
            if message.kind == CHALLENGE_FIN:
                self.size += message.size
                self.merged = True
                self.policy.merged()
            self._after_lease()

    def lease_over(self, _: object) -> None:
        self.counts[_LEASES_EXPIRED] += len(self.leases.expire(self._now))
        self._after_lease()

    def _after_lease(self) -> None:
        if self.leases:
            self._arm_lease()
        else:
            self._become_available()
            self._tell_swarm(SET_AVAILABLE)

    def renewed(self, message: Message) -> None:
        if message.sender in self.leases or self._may_anchor(message, challenged=False):
            self._grant(message.sender)
        else:
            self._tell(message, LEASE_CANCEL)

    # -- rules: following ----------------------------------------------------------------------------------------

    def wait(self, message: Message) -> None:
        """SET_WAITING: stand still until the sender, or the bound, says otherwise."""
        self.state = W
        self._open = False
        self.holders[message.sender] = bool(message.flags & ANCHORING)
        self._arm(BOUND_TIMER, self._now + self.settings.waiting_bound_s)

    def resume(self, message: Message) -> None:
        """SET_AVAILABLE: the sender no longer holds this FLS."""
        self.size = message.size
        self.holders.pop(message.sender, None)
        if not self.holders:
            self._become_available()

    def note_size(self, message: Message) -> None:
        self.size = message.size

    def follow(self, message: Message) -> None:
        self._open = False
        self.state = W
        self._fly(message.vector)

    def merge(self, message: Message) -> None:
        self._take_swarm(message.other, message.size)
        if self.state is not BA:
            self._become_available()

    def follow_merge(self, message: Message) -> None:
        self._take_swarm(message.other, message.size)
        self.follow(message)

    def become_available(self, _: object) -> None:
        self._become_available()

    def bound_over(self, _: object) -> None:
        if not self.flying:
            self._become_available()

    # -- rules: thaw, leaving ------------------------------------------------------------------------------------

    def thaw_due(self, _: object) -> None:
        """This FLS's own timer: begin the next epoch for everybody."""
        self.counts[_THAWS_STARTED] += 1
        epoch = self.epoch + 1 if self.settings.epochs else self.epoch
        self.epoch = epoch
        self._say(THAW, TO_ALL)
        self._obey_thaw(epoch)

    def rearm_thaw(self, _: object) -> None:
        self._arm_thaw()

    def hear_thaw(self, message: Message) -> None:
        """Without epochs a thaw is obeyed at most once per λ, and repeated by chance (the paper)."""
        if self.settings.epochs or self._now - self._thawed_s < self.settings.lambda_s:
            return
        self._obey_thaw(self.epoch)
        if self.rng.random() < self.settings.thaw_repeat:
            self._say(THAW, TO_ALL)

    def hear_leave(self, message: Message) -> None:
        self.beliefs.forget(message.sender)

    def leave(self, _: object) -> None:
        """Battery low, and on the ground: say so, free those who wait, go (rule 13)."""
        for neighbour in sorted(self.beliefs.neighbours):
            self._say(LEAVE, TO_FLS, Swarm(neighbour, 0))
        if self.state in (BA, BL):
            self._tell_swarm(SET_AVAILABLE)
        self._disarm(*Timer)
        self._actions.append(Depart())
        self.departed = True

    def nothing(self, _: object) -> None:
        """Listed, so that it is handled and not ignored: there is just nothing to do."""


class Rule(NamedTuple):
    """What a state does with an event, and every state that may follow."""

    act: Callable[[StateMachine, object], None]
    leads_to: tuple[State, ...]


def _rule(act: Callable[..., None], *leads_to: State) -> Rule:
    return Rule(act, leads_to)


_M = StateMachine
TABLE: Mapping[State, Mapping[Kind | Local, Rule]] = {
    D: {
        Local.LAUNCH: _rule(_M.launch, D),
        Local.LANDED: _rule(_M.light_up, A),
        Local.THAW_DUE: _rule(_M.rearm_thaw, D),
        Local.BATTERY_LOW: _rule(_M.leave, D),
    },
    A: {
        Kind.CHALLENGE_INIT: _rule(_M.accept, A),
        Kind.CHALLENGE_ACCEPT: _rule(_M.take_acceptance, A, BA, BL),
        Kind.CHALLENGE_ACK: _rule(_M.take_ack, A, BA, BL),
        Kind.SET_WAITING: _rule(_M.wait, W),
        Kind.SET_AVAILABLE: _rule(_M.note_size, A),
        Kind.FOLLOW: _rule(_M.follow, W),
        Kind.MERGE: _rule(_M.merge, A),
        Kind.FOLLOW_MERGE: _rule(_M.follow_merge, W),
        Kind.LEASE_RENEW: _rule(_M.refuse, A),
        Kind.LEASE_CANCEL: _rule(_M.forget_accept, A),
        Kind.THAW: _rule(_M.hear_thaw, A),
        Kind.LEAVE: _rule(_M.hear_leave, A),
        Local.CHALLENGE_DUE: _rule(_M.challenge_due, A),
        Local.THAW_DUE: _rule(_M.thaw_due, A),
        Local.BATTERY_LOW: _rule(_M.leave, A),
    },
    BA: {
        Kind.CHALLENGE_INIT: _rule(_M.accept, BA),
        Kind.CHALLENGE_ACCEPT: _rule(_M.take_more, BA),
        Kind.CHALLENGE_ACK: _rule(_M.take_ack, BA),
        Kind.CHALLENGE_FIN: _rule(_M.free, BA, A),
        Kind.MERGE: _rule(_M.merge, BA),
        Kind.LEASE_RENEW: _rule(_M.renewed, BA),
        Kind.LEASE_CANCEL: _rule(_M.free, BA, A),
        Kind.THAW: _rule(_M.hear_thaw, BA, A),
        Kind.LEAVE: _rule(_M.hear_leave, BA),
        Local.CHALLENGE_DUE: _rule(_M.skip_tick, BA),
        Local.LEASE_OVER: _rule(_M.lease_over, BA, A),
        Local.THAW_DUE: _rule(_M.thaw_due, A),
        Local.BATTERY_LOW: _rule(_M.leave, BA),
    },
    BL: {
        Kind.CHALLENGE_INIT: _rule(_M.note_init, BL),
        Kind.CHALLENGE_ACCEPT: _rule(_M.refuse, BL),
        Kind.CHALLENGE_ACK: _rule(_M.refuse, BL),
        Kind.LEASE_RENEW: _rule(_M.refuse, BL),
        Kind.LEASE_CANCEL: _rule(_M.cancelled, BL, A),
        Kind.THAW: _rule(_M.hear_thaw, BL, A, W),
        Kind.LEAVE: _rule(_M.hear_leave, BL),
        Local.MEASURED: _rule(_M.localize, BL, A),
        Local.LANDED: _rule(_M.finish, A),
        Local.RENEW_DUE: _rule(_M.renew_lease, BL),
        Local.CHALLENGE_DUE: _rule(_M.skip_tick, BL),
        Local.THAW_DUE: _rule(_M.thaw_due, A, W),
        Local.BATTERY_LOW: _rule(_M.leave, BL),
    },
    W: {
        Kind.CHALLENGE_INIT: _rule(_M.accept, W),
        Kind.CHALLENGE_ACCEPT: _rule(_M.refuse, W),
        Kind.CHALLENGE_ACK: _rule(_M.take_ack, W, BA),
        Kind.SET_WAITING: _rule(_M.wait, W),
        Kind.SET_AVAILABLE: _rule(_M.resume, W, A),
        Kind.FOLLOW: _rule(_M.follow, W),
        Kind.MERGE: _rule(_M.merge, A),
        Kind.FOLLOW_MERGE: _rule(_M.follow_merge, W),
        Kind.LEASE_RENEW: _rule(_M.refuse, W),
        Kind.LEASE_CANCEL: _rule(_M.forget_accept, W),
        Kind.THAW: _rule(_M.hear_thaw, W, A),
        Kind.LEAVE: _rule(_M.hear_leave, W),
        Local.CHALLENGE_DUE: _rule(_M.skip_tick, W, A),
        Local.BOUND_OVER: _rule(_M.bound_over, W, A),
        Local.LANDED: _rule(_M.become_available, A),
        Local.THAW_DUE: _rule(_M.thaw_due, W, A),
        Local.BATTERY_LOW: _rule(_M.leave, W),
    },
}


def _key(number: int) -> Kind | Local | None:
    if number >= Local.CHALLENGE_DUE:
        return Local(number)
    return Kind(number) if number in Kind._value2member_map_ else None


# The table as the machine looks it up: by plain numbers, because hashing an enum is a call.
_RULES = [[TABLE[state].get(_key(key)) for key in range(KEYS)] for state in State]  # type: ignore[call-overload]
_TIMERS = int(Local.CHALLENGE_DUE)
_NOT_IN_FLIGHT = SWARM_KINDS | {Kind.CHALLENGE_INIT, Kind.CHALLENGE_ACCEPT, Kind.CHALLENGE_ACK}
