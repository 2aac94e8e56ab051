"""Invariants of being an FLS at all: S1 its beginning, S9 what it believes, S11 thaws, S12 ids, S13 its end, S16."""

from __future__ import annotations

from math import isfinite

from swarmer.messages import COUNT, SWARM_KINDS, THAW, TO_SWARM, Message, Stamp, Swarm
from swarmer.observe.invariants.base import BA, EVERY, NOTED, TINY, A, D, Facts, Invariant, Life, Step
from swarmer.observe.protocol_words import addressee_name, datagram_name, swarm_name
from swarmer.plan import thaw_h_of
from swarmer.protocol.events import Arm, Local, ThawBegins, Timer
from swarmer.protocol.records import shape_of
from swarmer.radio import WINDOW

TICK, LANDED = int(Local.CHALLENGE_DUE), int(Local.LANDED)
DATAGRAMS = frozenset(range(int(Local.CHALLENGE_DUE)))


def _datagram(message: Message) -> str:
    """What is wrong with a datagram is in what these words say, or in its signature and its numbers."""
    return (
        f"{datagram_name(message)} to {addressee_name(message)}, signed "
        f"{swarm_name(Swarm(message.sender, message.incarnation))} of epoch {message.epoch}, vector "
        f"{message.vector}, range {message.range:g}"
    )


class Deploying(Invariant):
    name, title = "S1", "deploy"
    guards = (
        "A dark FLS says nothing; its landing makes it lit, Available and a swarm of its own, in one event."
    )
    on_dark = EVERY

    def after(self, step: Step) -> str | None:
        m = step.m
        if m.state is D:
            return f"is dark, and says {', '.join(map(_datagram, step.sent))}" if step.sent else None
        self.looked += 1
        if step.key != LANDED or m.state is not A or m.swarm != (m.fid, m.incarnation):
            return f"lit as {m.state.name} in {m.swarm}"
        return None


class Believing(Invariant):
    name, title = "S9", "R-Complete"
    guards = (
        "What an FLS believes of a planned neighbour is a Swarm-ID that this neighbour itself sent in this epoch; with "
        "`neighbours: connected` the planned graph is symmetric and connected, so that one end of every link between "
        "two swarms knows that it is not complete."
    )
    on = DATAGRAMS | {TICK}
    on_dark = DATAGRAMS

    def __init__(self, facts: Facts) -> None:
        super().__init__(facts)
        self._said: set[tuple[int, int, Swarm]] = set()  # who, in which epoch, which Swarm-ID

    def begun(self) -> str | None:
        plan = self.facts.plan
        if plan.config.neighbours != "connected":
            return None
        self.looked += 1
        links = [set(neighbours) for neighbours in plan.neighbours.neighbours]
        for row, neighbours in enumerate(links):
            for other in neighbours:
                if row + 1 not in links[other - 1]:
                    return f"FLS {row + 1} has the neighbour {other}, which does not have it"
        reached, ways = {1}, [1]
        while ways:
            new = links[ways.pop() - 1] - reached
            reached |= new
            ways += new
        return (
            None
            if len(reached) == len(links)
            else f"{len(links) - len(reached)} FLSs are not joined to FLS 1"
        )

    def stamped(self, life: Life, message: Message, stamp: Stamp) -> str | None:
        self._said.add((message.sender, message.epoch, message.swarm))
        return None

    def after(self, step: Step) -> str | None:
        beliefs = step.m.beliefs
        asked = beliefs.neighbours if step.key == TICK or step.thaws else (step.event.message.sender,)
        epoch = step.m.epoch
        for fid in asked:
            believed = beliefs.of(fid)
            if believed is None:
                continue
            self.looked += 1
            if (fid, epoch, believed) not in self._said:
                return f"believes that {fid} is in {believed}, which it never said in epoch {epoch}"
        return None


class Thawing(Invariant):
    name, title = "S11", "thaw"
    guards = (
        "Each thaw is obeyed once; after it an FLS is a swarm of its own, owes nothing, waits for nobody, is at the "
        "start of its range and where it was; policy `timer` arms between H and spread times H, `census` thaws on the "
        "reports of all F FLSs."
    )
    on = EVERY
    on_dark = EVERY

    def __init__(self, facts: Facts) -> None:
        super().__init__(facts)
        rules = facts.rules
        self._rules, self._timer, self._census = (
            rules,
            rules.thaw_policy == "timer",
            rules.thaw_policy == "census",
        )

    def after(self, step: Step) -> str | None:
        m, was = step.m, step.was
        if (
            m.settings.epochs
            and m.epoch != was.epoch
            and (m.epoch < was.epoch or step.thaws != (was.state is not D))
        ):
            return f"epoch {was.epoch} -> {m.epoch} by {step.thaws} thaws"
        if self._timer:
            for action in step.actions:
                if type(action) is Arm and action.timer is Timer.THAW:
                    lowest = thaw_h_of(self._rules, shape_of(m.epoch))
                    highest = lowest * self._rules.thaw_spread
                    delay = action.at_s - step.now
                    if not lowest - TINY <= delay <= highest + TINY:
                        return f"means to thaw in {delay:.3f} s; {lowest:.3f} to {highest:.3f} s are allowed"
        if self._census:
            wrong = self._counted(step)
            if wrong:
                return wrong
        return self._obeyed(step) if step.thaws else None

    def _counted(self, step: Step) -> str | None:
        """Policy `census`: who begins a thaw by its list has the reports of all others."""
        was, event = step.was, step.event
        if step.key == COUNT and (event.message.epoch, event.message.swarm) == (was.epoch, was.swarm):
            was.reporters.add(event.message.sender)
        begins = [action for action in step.actions if type(action) is ThawBegins and action.known]
        others = self._rules.counts[min(shape_of(was.epoch), len(self._rules.counts) - 1)] - 1
        if begins and len(was.reporters) < others:
            return f"thaws, with reports of {len(was.reporters)} FLSs; there are {others} others"
        if step.m.swarm != was.swarm or step.thaws:
            was.reporters.clear()
        return None

    def _obeyed(self, step: Step) -> str | None:
        self.looked += 1
        m, was = step.m, step.was
        before, was.thawed_s = was.thawed_s, step.now
        if step.thaws > 1 or (m.settings.epochs and m.epoch == was.epoch):
            return f"{step.thaws} thaws in one event, epoch {was.epoch} -> {m.epoch}"
        heard = step.key < TICK
        if not m.settings.epochs and heard and step.now - before < m.settings.lambda_s:
            return f"thaws again after {step.now - before:.3f} s"
        # A message of the new epoch is handled in the same event, and may begin anew what the thaw ended.
        if heard and step.key != THAW:
            return None
        kept = (m.leases, m.holders, m.accepts, m.pending, m.anchor)
        if m.swarm != (m.fid, m.incarnation) or any(kept) or m.size != 1:
            return f"thawed, and keeps {m.swarm}, size {m.size}, {kept}"
        if m.reach != m.settings.range_start:
            return f"thawed, and keeps its range {m.reach:.3f}"
        return None


class Numbers(Invariant):
    name, title = "S12", "ids"
    guards = (
        "The datagrams of a life are numbered in rising order; none is handled twice, from beyond the window of 64, "
        "or of an incarnation that has a successor known to the receiver."
    )
    on = DATAGRAMS
    on_dark = DATAGRAMS

    def stamped(self, life: Life, message: Message, stamp: Stamp) -> str | None:
        number, life.number = life.number, stamp.number
        return None if stamp.number > number else f"sends number {stamp.number} after {number}"

    def after(self, step: Step) -> str | None:
        message, cause = step.event.message, step.cause
        if cause is None:
            return None
        self.looked += 1
        newest = step.was.newest
        known = newest.get(message.sender)
        if known is None or message.incarnation > known[0]:
            newest[message.sender] = [message.incarnation, cause.number, 1]
            return None
        if message.incarnation < known[0]:
            return f"handles incarnation {message.incarnation} of {message.sender} after {known[0]}"
        behind = known[1] - cause.number
        if behind < 0:
            known[1], known[2] = cause.number, (known[2] << -behind | 1) & (1 << WINDOW + 1) - 1
            return None
        if known[2] >> behind & 1:
            return f"handles number {cause.number} of {message.sender} twice"
        known[2] |= 1 << behind
        return None


class Lives(Invariant):
    name, title = "S13", "failure"
    guards = (
        "A FID has at most one life at a time, and the dead do nothing; a swarm is its Swarm-ID with incarnation and "
        "epoch: nothing of another incarnation's swarm or of an old epoch has an effect."
    )
    on = DATAGRAMS - {NOTED}

    def after(self, step: Step) -> str | None:
        message, m, was = step.event.message, step.m, step.was
        changed = m.state is not was.state or m.swarm != was.swarm
        if step.thaws or not (changed or step.sent):
            return None
        self.looked += 1
        old = m.settings.epochs and message.epoch != m.epoch
        if old and (changed or any(sent.kind != THAW for sent in step.sent)):
            return f"obeys {message.sender} of epoch {message.epoch}; its own is {m.epoch}"
        if not changed:
            return None
        if message.kind in SWARM_KINDS and message.addressee != was.swarm:
            return f"in {was.swarm}, obeys what {message.sender} told {message.addressee}"
        return None

    def stamped(self, life: Life, message: Message, stamp: Stamp) -> str | None:
        if not life.alive:
            return "the dead speak"
        now = self.facts.lives[life.fid]
        return None if now is life else f"incarnation {life.incarnation} speaks, and has a successor"


class Always(Invariant):
    name, title = "S16", "always"
    guards = (
        "Where the lower Swarm-ID anchors, no Swarm-ID rises within an epoch, except by newcomers; every number is "
        "finite, every message signed by its sender, and no table outgrows F."
    )
    on = EVERY
    says = frozenset(range(max(DATAGRAMS) + 1))

    def __init__(self, facts: Facts) -> None:
        super().__init__(facts)
        self._fall = facts.ids_decide and facts.rules.epochs

    def _falls(self) -> bool:
        return self._fall and (not self.facts.replaced or self.facts.rules.busy_join == "off")

    def after(self, step: Step) -> str | None:
        m, was = step.m, step.was
        if m.flying and (m.state is A or m.state is BA):
            return f"{m.state.name} in flight"
        if m.swarm is not was.swarm and m.swarm > was.swarm and m.epoch == was.epoch and self._falls():
            return f"its Swarm-ID rises from {was.swarm} to {m.swarm}"
        if step.anchors or m.holders or m.accepts:
            self.looked += 1
            if max(len(m.leases), len(m.holders), len(m.accepts)) > self.facts.rules.count:
                return "a table has outgrown F"
        return None

    def said(self, step: Step, message: Message) -> str | None:
        self.looked += 1
        m = step.m
        epochs = (
            (m.epoch, step.was.epoch) if step.thaws else (m.epoch,)
        )  # what came before the thaw is of the old one
        if (message.sender, message.incarnation) != (m.fid, m.incarnation) or message.epoch not in epochs:
            return f"signs as another: {_datagram(message)}"
        if message.to == TO_SWARM and (message.kind not in SWARM_KINDS or message.addressee.xi == 0):
            return f"speaks to the wrong ones: {_datagram(message)}"
        x, y, z = message.vector
        return (
            None if isfinite(x + y + z + message.range) else f"a message is not finite: {_datagram(message)}"
        )
