"""Invariants of localizing, following and standing still: S5, S6, S7."""

from __future__ import annotations

from math import dist, hypot, inf, isclose, isfinite, sin

from swarmer.messages import (
    ANCHORING,
    CHALLENGE_ACCEPT,
    CHALLENGE_ACK,
    CHALLENGE_FIN,
    FOLLOW,
    FOLLOW_MERGE,
    LEASE_CANCEL,
    LEASE_RENEW,
    MERGE,
    SET_AVAILABLE,
    SET_WAITING,
    Kind,
    Message,
    Vec3,
)
from swarmer.observe.invariants.base import ACTIVE, BA, BL, TINY, A, Facts, Invariant, Life, Step, W
from swarmer.physics.flight import Flight
from swarmer.plan import make_sensor
from swarmer.protocol.events import Arm, Fly, Local, Timer

MEASURED, LANDED, RENEW_DUE = int(Local.MEASURED), int(Local.LANDED), int(Local.RENEW_DUE)
GRANTS = frozenset({CHALLENGE_ACCEPT, CHALLENGE_ACK, LEASE_RENEW})  # where the answer is no CANCEL
LAUNCH, LEASE_OVER = int(Local.LAUNCH), int(Local.LEASE_OVER)
PLAIN = {
    "swarmer.plugins.signal_strength:SignalStrength", "swarmer.plugins.physical_movement:PhysicalMovement",
}  # fmt: skip
"""Techniques that fly V = d - D."""


class Localizing(Invariant):
    name, title = "S5", "localize"
    guards = (
        "A localizer tells its old swarm one FOLLOW_MERGE with V = d - D, takes its anchor's Swarm-ID, renews its "
        "lease every half lease, says CHALLENGE_FIN after its landing, and takes no longer than sampling and flight."
    )
    on = ACTIVE
    says = frozenset({CHALLENGE_FIN, MERGE, FOLLOW_MERGE})

    def __init__(self, facts: Facts) -> None:
        super().__init__(facts)
        self._sensing_s = make_sensor(facts.rules).delay_s
        off = facts.rules.sensing_error
        bounds = {"none": 0.0, "uniform": off, "mixed": off}  # of a plugin's errors nobody knows
        self._sensor_bound = bounds.get(facts.rules.sensing_model, inf)
        self._plain = facts.rules.technique in PLAIN

    def after(self, step: Step) -> str | None:
        m, was = step.m, step.was
        if was.state is not BL:
            return self._begins(step) if m.state is BL else None
        if step.key == MEASURED and not step.thaws:
            return self._merges(step)
        if step.key == RENEW_DUE:
            renewals = [sent.addressee.xi for sent in step.sent if sent.kind == LEASE_RENEW]
            assert was.anchor is not None
            if renewals != [was.anchor.sender] or not self._means_to_renew(step):
                return f"renews its lease with {renewals}, its anchor is {was.anchor.sender}"
        return self._ends(step) if m.state is not BL else None

    def _begins(self, step: Step) -> str | None:
        self.looked += 1
        step.was.localizes_since, step.was.thaws_at = step.now, step.was.thaws_heard
        step.was.flight_s, step.was.flights = 0.0, 0
        step.was.origin = None if step.cause is None else step.cause.origin
        return None if self._means_to_renew(step) else "does not mean to renew its lease"

    def _means_to_renew(self, step: Step) -> bool:
        return Arm(Timer.RENEW, step.now + step.m.settings.lease_s / 2) in step.actions

    def _merges(self, step: Step) -> str | None:
        m, was, anchor = step.m, step.was, step.was.anchor
        if was.flying or anchor is None:
            return None
        self.looked += 1
        merges = [sent.kind for sent in step.sent if sent.kind in (MERGE, FOLLOW_MERGE)]
        flies = [action for action in step.actions if type(action) is Fly]
        if merges != ([FOLLOW_MERGE] if flies else [MERGE]) or len(flies) > 1:
            return f"flies {len(flies)} times and tells its swarm {[Kind(kind).name for kind in merges]}"
        if m.swarm != anchor.swarm:
            return f"is in {m.swarm}, and its anchor was in {anchor.swarm}"
        if was.origin is None or not self._plain or was.fid in self.facts.misled:
            return None
        x, off = was.fls.position(), self._sensor_bound
        true = [there - here for there, here in zip(was.origin, x, strict=True)]
        if dist(step.event.vector, true) > hypot(*true) * off + 1e-6:
            return f"senses {step.event.vector} where {true} is true"
        return None

    def _ends(self, step: Step) -> str | None:
        was = step.was
        thaws = was.thaws_heard - was.thaws_at
        longest = self._sensing_s + (was.flight_s if was.flying else 0.0)
        longest += (1 + max(1, was.flights)) * self.facts.late_s(was) + thaws * self.facts.handling_s
        lasted = step.now - was.localizes_since
        if lasted > longest:
            return f"took {lasted:.3f} s, at most {longest:.3f} s"
        if step.key == LANDED and was.anchor is not None and not step.thaws:
            fins = [sent.addressee.xi for sent in step.sent if sent.kind == CHALLENGE_FIN]
            if fins != [was.anchor.sender]:
                return f"landed, and says FIN to {fins}; its anchor was {was.anchor.sender}"
        return None

    def said(self, step: Step, message: Message) -> str | None:
        was, anchor = step.was, step.was.anchor
        if message.kind == CHALLENGE_FIN:
            return None if step.key == LANDED or not step.m.flying else "says FIN before its landing"
        if step.key != MEASURED or anchor is None:
            return "merges unasked"
        if message.addressee == message.other:
            return f"merges {message.addressee} with itself"
        if (message.addressee, message.other) != (was.swarm, anchor.swarm):
            pair = f"it was in {was.swarm}, its anchor in {anchor.swarm}"
            return f"merges {message.addressee} into {message.other}; {pair}"
        if message.kind == FOLLOW_MERGE and self._plain:
            v = [d - (a - g) for d, a, g in zip(step.event.vector, anchor.truth, step.m.truth, strict=True)]
            if not all(
                isclose(a, b, rel_tol=1e-9, abs_tol=1e-9) for a, b in zip(v, message.vector, strict=True)
            ):
                return f"V is {message.vector}, not {v}"
        return None


class Following(Invariant):
    name, title = "S6", "follow"
    guards = (
        "Who flies V was in the swarm that the message names, at its landing and in this epoch, and takes the new "
        "Swarm-ID; every flight begins where the FLS is, is as long as V and off by at most the angle ε; nothing else "
        "moves anyone."
    )
    on = ACTIVE

    def __init__(self, facts: Facts) -> None:
        super().__init__(facts)
        self._off = 2 * sin(facts.rules.epsilon / 2) * (1 + 1e-9) + TINY

    def after(self, step: Step) -> str | None:
        m, was = step.m, step.was
        message = step.message
        if message is not None and message.kind in (FOLLOW_MERGE, MERGE) and m.swarm != was.swarm:
            self.looked += 1
            if m.swarm != message.other or message.addressee != was.swarm:
                return f"in {was.swarm}, told {message.addressee} -> {message.other}, and is in {m.swarm}"
        flights = [action.vector for action in step.actions if type(action) is Fly]
        if (
            not flights
            or step.key in (LAUNCH, MEASURED)
            or was.onward
            or m.truth is not was.truth
            or m.oracle
        ):
            return None  # (to the next shape: S15; an oracle's: S14)
        self.looked += 1
        asked = was.pending if step.key == LANDED else (message,) if message is not None else ()
        # While messages that waited are worked off, a MERGE among them may change the Swarm-ID for the next.
        swarms = {was.swarm} | {waited.other for waited in asked if waited.kind == MERGE}
        fits = [
            waited for waited in asked
            if waited.kind in (FOLLOW, FOLLOW_MERGE) and waited.vector == flights[0] and waited.addressee in swarms
            and (waited.epoch == m.epoch or not m.settings.epochs)
        ]  # fmt: skip
        if len(flights) != 1 or not fits:
            return f"in {was.swarm} it flies {flights}, asked by {list(asked)}"
        if fits[0].kind == FOLLOW_MERGE and m.swarm not in [waited.other for waited in fits]:
            return f"follows into {fits[0].other}, and is in {m.swarm}"
        return None

    def flew(self, life: Life, asked: Vec3, flight: Flight) -> str | None:
        self.looked += 1
        way, length = flight.displacement, hypot(*asked)
        before = life.place
        life.flight_s += flight.duration_s
        life.flights += 1
        life.place = (flight.start[0] + way[0], flight.start[1] + way[1], flight.start[2] + way[2])
        if not all(map(isfinite, way)):
            return f"flies {way}"
        if dist(before, flight.start) > TINY * (1 + hypot(*before)):
            return f"begins a flight at {flight.start}; it was at {before}"
        if not isclose(hypot(*way), length, rel_tol=1e-9, abs_tol=TINY):
            return f"flies {hypot(*way)} cells, told {length}"
        if dist(way, asked) > self._off * length:
            return f"flies {way}, told {asked}: more than ε off"
        return None


class StandingStill(Invariant):
    name, title = "S7", "un-anchor"
    guards = (
        "Busy Anchor means a live lease; a lease lasts δ from its grant or its own localizer's renewal, FIN or CANCEL "
        "ends it, and in the event that ends the last one the swarm is told; who waits is held by those who said so, "
        "and no longer than the bound."
    )
    on = ACTIVE

    def __init__(self, facts: Facts) -> None:
        super().__init__(facts)
        rules = facts.rules
        self._lease_s = rules.lease_s + rules.lease_margin_s
        self._bound_s = inf if rules.waiting_ends_at_tick else rules.waiting_bound_s

    def after(self, step: Step) -> str | None:
        m, was = step.m, step.was
        state, leases = m.state, was.leases
        if (state is BA) != step.anchors:
            return f"{state.name} with {len(m.leases)} leases"
        if state is BA or leases:
            wrong = self._leases(step)
            if wrong:
                return wrong
            told = any(sent.kind == SET_WAITING and sent.flags & ANCHORING for sent in step.sent)
            if state is BA and was.state is not BA and not step.thaws and not told:
                return "anchors, and does not tell its swarm"
        wrong = self._held(step)
        return wrong or (self._waits(step) if state is W else None)

    def _held(self, step: Step) -> str | None:
        """Those who keep it waiting are those who said so, each as what it said, and no more than these."""
        m, was, message = step.m, step.was, step.message
        if message is None or message.kind not in (SET_WAITING, SET_AVAILABLE) or step.thaws:
            return None
        if was.state not in (A, W) or was.flying or message.addressee != was.swarm:
            return None  # (in flight it waits for the landing)
        self.looked += 1
        held = {fid: anchors for fid, anchors in was.holders.items() if fid != message.sender}
        if message.kind == SET_WAITING:
            held[message.sender] = bool(message.flags & ANCHORING)
        elif was.state is A:
            return None
        if m.state is not (W if held else A) or (held and m.holders != held):
            return f"is {m.state.name}, held by {m.holders}, and should be by {held}"
        return None

    def _leases(self, step: Step) -> str | None:
        self.looked += 1
        m, was, now = step.m, step.was, step.now
        before, after = was.leases, m.leases.ends()
        message = step.message
        sender = -1 if message is None else message.sender
        slack = self.facts.late_s(was)
        for fid, until in after.items():
            if until < now - slack:
                return f"the lease of {fid} ended at {until:.4f} s"
            if until != before.get(fid):
                if not isclose(until, now + self._lease_s, abs_tol=TINY):
                    return f"the lease of {fid} ends at {until:.4f} s; it lasts {self._lease_s:g} s"
                if fid != sender and not step.thaws:
                    return f"{fid} did not ask for the lease it got"
        if step.thaws:
            was.grants.clear()
            return None
        if message is not None and sender in after:
            _note_grant(step, message)
        for fid, until in before.items():
            if fid not in after and fid != sender and not (step.key == LEASE_OVER and until <= now + TINY):
                return f"the lease of {fid} ends before {until:.4f} s"
        if message is not None and sender in before:
            wrong = self._one_lease(was, message, after)
            if wrong:
                return wrong
        was.grants = {fid: challenges for fid, challenges in was.grants.items() if fid in after}
        freed = was.state is BA and m.state is not BA
        return "its swarm is not told that it is free" if freed and not _tells_free(step) else None

    def _one_lease(self, was: Life, message: Message, after: dict[int, float]) -> str | None:
        """What a message of the one who holds a lease did to it."""
        fid, kind = message.sender, message.kind
        grants = was.grants.setdefault(fid, set())
        if kind == CHALLENGE_FIN and fid in after:
            return f"keeps the lease of {fid} after its FIN"
        if kind == LEASE_RENEW and after.get(fid, 0.0) <= was.leases[fid] and not self._same(after, was, fid):
            return f"the lease of {fid} is not renewed"
        if kind == LEASE_CANCEL and message.challenge in grants:
            grants.discard(message.challenge)
            if (fid in after) != bool(grants):
                return f"the lease of {fid} after CANCEL: {fid in after}, other challenges {grants}"
        elif fid not in after and kind != CHALLENGE_FIN:
            return f"the lease of {fid} ends without FIN or CANCEL"
        return None

    def _same(self, after: dict[int, float], was: Life, fid: int) -> bool:
        """Renewed in the very moment of the grant."""
        return isclose(after.get(fid, 0.0), was.machine.now + self._lease_s, abs_tol=TINY)

    def _waits(self, step: Step) -> str | None:
        m, was, message = step.m, step.was, step.message
        if m.flying:
            return None
        told = message is not None and message.kind == SET_WAITING
        if was.flying and not told:
            told = any(waited.kind == SET_WAITING for waited in was.pending)
        if told:
            self.looked += 1
            was.waits_since = step.now
        waited = step.now - was.waits_since
        if waited > self._bound_s + self.facts.late_s(was):
            return f"waits for {waited:.3f} s, at most {self._bound_s:.3f} s"
        return None

    def finished(self, now_s: float) -> tuple[Life | None, str] | None:
        """L2 of what no event would tell: a lease, a wait, or a flight that nothing ends."""
        for life in self.facts.lives:
            if life is None or not life.alive or not life.machine.awake:
                continue
            slack = self.facts.late_s(life)
            overdue = [fid for fid, until in life.machine.leases.ends().items() if until < now_s - slack]
            if overdue:
                return life, f"at the end the leases of {overdue} are overdue"
            if life.state is W and not life.flying and now_s - life.waits_since > self._bound_s + slack:
                return life, f"at the end it has waited for {now_s - life.waits_since:.3f} s"
        return None


def _note_grant(step: Step, message: Message) -> None:
    """The sender has a lease: is it (also) for the challenge that its message is about?"""
    refused = any(sent.kind == LEASE_CANCEL and sent.addressee.xi == message.sender for sent in step.sent)
    if message.kind in GRANTS and not refused:
        step.was.grants.setdefault(message.sender, set()).add(message.challenge)


def _tells_free(step: Step) -> bool:
    return any(sent.kind == SET_AVAILABLE and sent.addressee == step.m.swarm for sent in step.sent)
