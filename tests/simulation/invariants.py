"""What must hold after every event of a world, rule by rule (S1 to S16, tau = 0). `Watch(world)` and run the world.

A rule that is broken raises `Broken`, which names rule, FLS and moment. A rule looks at one event: the machine as it
was before and is now, and the actions it gave.
"""

from __future__ import annotations

from collections import Counter
from math import dist, hypot, inf, isclose, isfinite, sin
from typing import Any, NamedTuple

from world import Body, World

from swarmer.messages import JOIN, SWARM_KINDS, Kind, Message, Swarm, To
from swarmer.protocol.anchor_selection import lowest
from swarmer.protocol.events import Arm, Count, Fly, Landed, Launch, Measured, Received, Send, Timer
from swarmer.protocol.thaw import FALLBACK
from swarmer.state_machine import State, StateMachine

D, A, BA, BL, W = State
TINY = 1e-9


class Broken(AssertionError):
    """Something that must hold did not."""


class Before(NamedTuple):
    """What the rules need of a machine's past."""

    state: State
    epoch: int
    swarm: Swarm
    flying: bool
    leases: dict[int, float]
    pending: tuple[Message, ...]
    anchor: Message | None
    joins: bool
    thaws: int
    reach: float
    merged: bool


class Step(NamedTuple):
    """One event of one FLS."""

    fid: int
    m: StateMachine
    body: Body
    event: Any
    actions: list[Any]
    sent: list[Message]
    was: Before


class Watch:
    """Checks a world after every event. `seen` counts how often a rule had something to say."""

    def __init__(self, world: World) -> None:
        self.world, self.rules = world, world.rules
        self.seen: Counter[str] = Counter()
        self.past: dict[StateMachine, Before] = {}
        self.handled: dict[StateMachine, dict[int, Message]] = {}
        self.newest: dict[tuple[StateMachine, int], int] = {}
        self.said: set[tuple[int, int, int, Swarm]] = set()
        self.acks: Counter[tuple[int, int, int]] = Counter()
        self.roles: dict[tuple[int, int, int, int], dict[int, str]] = {}
        self.joined: dict[StateMachine, set[int]] = {}
        self.localizes_since: dict[StateMachine, float] = {}
        self.waits_since: dict[StateMachine, float] = {}
        self.challenges: set[tuple[int, int, int]] = set()
        self.asked: Message | None = None  # what the FLS was told to fly
        for body in world.bodies.values():
            self.past[body.machine] = _before(body.machine)
        self._perform, self._send, self._add = world.perform, world.send, world.add
        world.tap, world.perform, world.send = self.tap, self.perform, self.send  # type: ignore[method-assign]

    # -- where the world is watched ------------------------------------------------------------------------------

    def tap(self, fid: int, event: Any, actions: list[Any]) -> None:
        body = self.world.bodies[fid]
        m = body.machine
        was = self.past.get(m) or Before(D, m.epoch, m.swarm, False, {}, (), None, m.joins, 0, m.reach, False)
        sent = [action.message for action in actions if type(action) is Send]
        step = Step(fid, m, body, event, actions, sent, was)
        for rule in RULES:
            wrong = rule(self, step)
            if wrong:
                raise Broken(f"{rule.__name__}: FLS {fid} at {self.world.now:.4f} s: {wrong}; {event}")
        self.past[m] = _before(m)

    def perform(self, fid: int, body: Body, actions: list[Any], stamp: Any) -> None:
        start = self.world.position(body)
        self._perform(fid, body, actions, stamp)
        for action in actions:
            if type(action) is Fly:
                wrong = s6_flight(self, body, start, action.vector)
                if wrong:
                    raise Broken(f"s6_flight: FLS {fid} at {self.world.now:.4f} s: {wrong}")

    def send(self, fid: int, body: Body, message: Message) -> None:
        m = body.machine
        self.said.add((fid, m.incarnation, message.epoch, message.swarm))
        number = body.number
        self._send(fid, body, message)
        if body.number != number + 1 or not body.alive:
            raise Broken(f"s12_ids: FLS {fid} sent number {body.number} after {number}, alive: {body.alive}")


def _before(m: StateMachine) -> Before:
    return Before(
        m.state, m.epoch, m.swarm, m.flying, dict(m.leases._until), tuple(m.pending), m.anchor, m.joins,
        m.counts[Count.THAWS_OBEYED], m.reach, m.merged,
    )  # fmt: skip


def _thawed(step: Step) -> bool:
    return step.m.counts[Count.THAWS_OBEYED] > step.was.thaws


def _message(step: Step) -> Message | None:
    """The message that a machine handled by a rule, of its own epoch and in no flight."""
    event, was = step.event, step.was
    if not isinstance(event, Received) or event.noted or _thawed(step) or was.state is D:
        return None
    if step.m.settings.epochs and event.message.epoch != step.m.epoch:
        return None
    return event.message


def s1_deploy(watch: Watch, step: Step) -> str | None:
    m, was = step.m, step.was
    if m.state is D and step.sent:
        return "a dark FLS speaks"
    if was.state is D and m.state is not D:
        watch.seen["s1"] += 1
        if not isinstance(step.event, Landed) or m.state is not A or m.swarm != (m.fid, m.incarnation):
            return f"lit as {m.state.name} in {m.swarm}"
    return None


def s2_challenge(watch: Watch, step: Step) -> str | None:
    m = step.m
    for init in (message for message in step.sent if message.kind == Kind.CHALLENGE_INIT):
        watch.seen["s2"] += 1
        key = (step.fid, m.incarnation, init.challenge)
        if key in watch.challenges:
            return "a challenge id comes again"
        watch.challenges.add(key)
        if not m.settings.range_start <= init.range <= m.settings.range_max:
            return f"range {init.range}"
        if init.range < step.was.reach and not _thawed(step):
            return "the range shrinks within an epoch"
    return None


def s3_accept(watch: Watch, step: Step) -> str | None:
    m, was = step.m, step.was
    joined = watch.joined.setdefault(m, set())
    message = _message(step)
    if _thawed(step):
        joined.clear()
        message = step.event.message if isinstance(step.event, Received) else None
    if any(sent.kind == Kind.CHALLENGE_ACCEPT for sent in step.sent):
        watch.seen["s3"] += 1
        assert message is not None
        if message.kind != Kind.CHALLENGE_INIT or message.swarm == m.swarm or was.flying:
            return "accepts what it may not"
        if m.state is BL:
            return "accepts while localizing"
        if m.state is not A and not message.flags & JOIN:
            if not m.anchoring:
                return "is busy and does not anchor"
            if m.settings.anchors is lowest and m.settings.busy_join != "all" and m.swarm > message.swarm:
                return "is busy, and its Swarm-ID is higher"
            if len(was.leases) >= m.settings.m - 1 and message.sender not in was.leases:
                return "M allows no more"
    if message is not None and message.flags & JOIN and message.sender in m.leases:
        joined.add(message.sender)
    joined &= set(m.leases._until)
    if len(m.leases) - len(joined) > m.settings.m - 1:
        return f"{len(m.leases)} leases, {len(joined)} of them joined"
    return None


def s4_pair(watch: Watch, step: Step) -> str | None:
    """Of two ends that pair one anchors and one localizes; every ACCEPT and every ACK has one outcome (S8)."""
    m, message = step.m, _message(step)
    if message is None or message.kind not in (Kind.CHALLENGE_ACCEPT, Kind.CHALLENGE_ACK):
        return None
    answers = [sent.kind for sent in step.sent if sent.to == To.FLS and sent.addressee.xi == message.sender]
    role = None
    if m.state is BL and m.anchor is message:
        role = "localizes"
    elif message.sender in m.leases and Kind.LEASE_CANCEL not in answers:
        role = "anchors"
    asked = message.kind == Kind.CHALLENGE_ACCEPT
    watch.seen["s4" if asked else "s8"] += 1
    if answers != [Kind.LEASE_CANCEL] and (
        role is None or answers != ([Kind.CHALLENGE_ACK] if asked else [])
    ):
        return f"{role} and answers {answers}"
    if role is None:
        return None
    joins = bool(message.flags & JOIN)
    by_id = m.settings.anchors is lowest and not (joins or step.was.joins) and m.settings.busy_join != "all"
    if by_id and (role == "anchors") != (step.was.swarm < message.swarm):
        return f"{role} against the Swarm-IDs"
    if asked:
        key = (step.fid, m.incarnation, message.challenge)
        watch.acks[key] += not joins
        if watch.acks[key] > (1 if role == "localizes" else m.settings.m - 1):
            return f"{watch.acks[key]} ACKs to one challenge"
    ends = (step.fid, message.sender) if asked else (message.sender, step.fid)
    roles = watch.roles.setdefault((*ends, message.challenge, m.epoch), {})
    roles[step.fid] = role
    if len(roles) == 2:
        watch.seen["pairs"] += 1
        if len(set(roles.values())) == 1:
            return f"both ends: {role}"
    return None


def s5_localize(watch: Watch, step: Step) -> str | None:
    m, was, now = step.m, step.was, watch.world.now
    if was.state is not BL and m.state is BL:
        watch.localizes_since[m] = now
        if Arm(Timer.RENEW, now + m.settings.lease_s / 2) not in step.actions:
            return "does not mean to renew its lease"
    if was.state is BL and m.state is not BL:
        lasted = now - watch.localizes_since[m]
        flight = step.body.flight.duration_s if was.flying else 0.0
        if lasted > watch.world.sensor.delay_s + flight + TINY:
            return f"took {lasted:.3f} s"
        fin = [sent for sent in step.sent if sent.kind == Kind.CHALLENGE_FIN]
        if isinstance(step.event, Landed) and (
            len(fin) != 1 or was.anchor is None or fin[0].addressee.xi != was.anchor.sender
        ):
            return f"landed, and says {fin}"
    for sent in step.sent:
        if sent.kind not in (Kind.FOLLOW_MERGE, Kind.MERGE):
            continue
        watch.seen["s5"] += 1
        assert was.anchor is not None
        if not isinstance(step.event, Measured) or sent.addressee == sent.other:
            return "merges with itself, or unasked"
        if sent.addressee != was.swarm or sent.other != was.anchor.swarm:
            return f"merges {sent.addressee} into {sent.other}, paired with {was.anchor.swarm}"
        v = [d - (a - g) for d, a, g in zip(step.event.vector, was.anchor.truth, m.truth, strict=True)]
        if sent.kind == Kind.FOLLOW_MERGE and not all(map(isclose, v, sent.vector)):
            return f"V is {sent.vector}, not {v}"
    return None


def s6_follow(watch: Watch, step: Step) -> str | None:
    m, was, event = step.m, step.was, step.event
    flights = [action.vector for action in step.actions if type(action) is Fly]
    if not flights or isinstance(event, (Launch, Measured)):
        return None
    watch.seen["s6"] += 1
    asked = was.pending if isinstance(event, Landed) else (event.message,)
    # While messages that waited are worked off, a MERGE among them may change the Swarm-ID for the next.
    swarms = {was.swarm} | {message.other for message in asked if message.kind == Kind.MERGE}
    fits = [
        message for message in asked
        if message.kind in (Kind.FOLLOW, Kind.FOLLOW_MERGE) and message.vector == flights[0]
        and message.addressee in swarms and (message.epoch == m.epoch or not m.settings.epochs)
    ]  # fmt: skip
    if len(flights) != 1 or not fits:
        return f"flies {flights}, asked by {asked}"
    return None


def s6_flight(watch: Watch, body: Body, start: Any, v: Any) -> str | None:
    """‖Δx‖ = ‖V‖ and ‖Δx - V‖ <= 2‖V‖ sin(ε/2), from where it is."""
    flight, length = body.flight, hypot(*v)
    if not all(map(isfinite, flight.displacement)):
        return "a flight is not finite"
    if not isclose(hypot(*flight.displacement), length, rel_tol=1e-9):
        return f"flies {hypot(*flight.displacement)} for {length}"
    if dist(flight.displacement, v) > 2 * length * sin(watch.rules.epsilon / 2) * (1 + 1e-9) + TINY * length:
        return f"flies {flight.displacement} for {v}"
    return None if flight.start == start else "begins where it was not"


def s7_leases(watch: Watch, step: Step) -> str | None:
    m, was, event, now = step.m, step.was, step.event, watch.world.now
    if (m.state is BA) != (len(m.leases) > 0):
        return f"{m.state.name} with {len(m.leases)} leases"
    longest = m.settings.lease_s + m.settings.lease_margin_s
    for fid, until in m.leases._until.items():
        watch.seen["s7"] += 1
        if until < now - TINY or until > now + longest + TINY:
            return f"the lease of {fid} ends at {until:.4f}"
        if until != was.leases.get(fid) and not (isinstance(event, Received) and event.message.sender == fid):
            return f"{fid} did not ask for the lease it got"
    freed = was.state is BA and m.state is not BA and not _thawed(step)
    if freed and not any(s.kind == Kind.SET_AVAILABLE and s.addressee == m.swarm for s in step.sent):
        return "its swarm is not told that it is free"
    if m.state is not W or m.flying:
        return None
    message = _message(step)
    waiting = [m_ for m_ in (*was.pending, message) if m_ is not None and m_.kind == Kind.SET_WAITING]
    if waiting:
        watch.waits_since[m] = now
    bound = inf if m.settings.waiting_ends_at_tick else m.settings.waiting_bound_s
    waited = now - watch.waits_since.get(m, -inf)
    return f"waits for {waited:.3f} s" if waited > bound + TINY else None


def s9_beliefs(watch: Watch, step: Step) -> str | None:
    if not isinstance(step.event, Received):
        return None
    m, sender = step.m, step.event.message.sender
    believed = m.beliefs.of(sender)
    if believed is None:
        return None
    watch.seen["s9"] += 1
    if not any((sender, i, m.epoch, believed) in watch.said for i in range(9)):
        return f"believes {believed} of {sender}, who never said so in epoch {m.epoch}"
    return None


def s10_newcomer(watch: Watch, step: Step) -> str | None:
    m, was = step.m, step.was
    if not was.joins or _thawed(step):
        return None
    if m.state is BL or m.merged:
        watch.seen["s10"] += 1
    message = _message(step)
    if was.state is not BA and m.state is BA and not (message and message.flags & JOIN):
        return "a newcomer anchors"
    return None


def s11_thaw(watch: Watch, step: Step) -> str | None:
    m, was = step.m, step.was
    thaws = m.counts[Count.THAWS_OBEYED] - was.thaws
    if m.settings.epochs and (m.epoch < was.epoch or thaws != (was.state is not D and m.epoch > was.epoch)):
        return f"epoch {was.epoch} -> {m.epoch}, {thaws} thaws"
    for action in step.actions:
        if type(action) is Arm and action.timer is Timer.THAW:
            h, spread = watch.rules.thaw_h_s, watch.rules.thaw_spread
            least, most = (h, h) if watch.rules.thaw_policy == "timer" else (0.0, FALLBACK * h)
            if not least - TINY <= action.at_s - watch.world.now <= most * spread + TINY:
                return f"means to thaw in {action.at_s - watch.world.now:.3f} s"
    if not thaws:
        return None
    watch.seen["s11"] += 1
    if thaws > 1:
        return f"{thaws} thaws in one event"
    if not isinstance(step.event, Received) or step.event.message.kind == Kind.THAW:
        kept = (m.leases, m.holders, m.accepts, m.pending, m.anchor)
        if m.swarm != (m.fid, m.incarnation) or any(kept) or m.size != 1:
            return f"thawed, and keeps {m.swarm}, {kept}"
        if m.reach != m.settings.range_start:
            return f"thawed, and keeps its range {m.reach}"
    return None


def s12_ids(watch: Watch, step: Step) -> str | None:
    if not isinstance(step.event, Received):
        return None
    m, message = step.m, step.event.message
    watch.seen["s12"] += 1
    handled = watch.handled.setdefault(m, {})
    if id(message) in handled:
        return "handled twice"
    handled[id(message)] = message
    newest = watch.newest.get((m, message.sender), 0)
    if message.incarnation < newest:
        return f"handles incarnation {message.incarnation} of {message.sender} after {newest}"
    watch.newest[m, message.sender] = message.incarnation
    effect = m.state is not step.was.state or any(sent.kind != Kind.THAW for sent in step.sent)
    old = m.settings.epochs and message.epoch < step.was.epoch
    return "an old epoch has an effect" if old and effect else None


def s16_always(watch: Watch, step: Step) -> str | None:
    m, was = step.m, step.was
    calm = all(body.machine.incarnation == 0 for body in watch.world.bodies.values())
    ids_fall = m.settings.anchors is lowest and m.settings.epochs and m.settings.busy_join != "all"
    if ids_fall and (calm or m.settings.busy_join == "off") and m.epoch == was.epoch and m.swarm > was.swarm:
        return f"ξ rises from {was.swarm} to {m.swarm}"
    for sent in step.sent:
        # An announcement may be what an FLS says last in an epoch: its own copy counts, too.
        epoch = was.epoch if sent.kind == Kind.THAW_ANNOUNCE else m.epoch
        if (sent.sender, sent.incarnation, sent.epoch) != (m.fid, m.incarnation, epoch):
            return f"signs as another: {sent}"
        if sent.to == To.SWARM and (sent.kind not in SWARM_KINDS or sent.addressee.xi == 0):
            return f"speaks to the wrong ones: {sent}"
        if not all(map(isfinite, (*sent.vector, sent.range))):
            return "a message is not finite"
    most = watch.rules.count
    if max(len(m.leases), len(m.holders), len(m.accepts), len(m.beliefs._heard)) > most:
        return "a table has outgrown F"
    if m.flying and m.state in (A, BA):
        return f"{m.state.name} in flight"
    return None


RULES = (
    s1_deploy, s2_challenge, s3_accept, s4_pair, s5_localize, s6_follow, s7_leases, s9_beliefs, s10_newcomer,
    s11_thaw, s12_ids, s16_always,
)  # fmt: skip
