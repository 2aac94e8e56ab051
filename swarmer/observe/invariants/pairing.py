"""Invariants of challenges and pairs: S2, S3, S4, S8, S10."""

from __future__ import annotations

from swarmer.messages import (
    ABSOLUTE,
    CHALLENGE_ACCEPT,
    CHALLENGE_ACK,
    CHALLENGE_INIT,
    JOIN,
    LEASE_CANCEL,
    LEASE_RENEW,
    SET_WAITING,
    TO_FLS,
    Kind,
    Message,
)
from swarmer.observe.invariants.base import BA, BL, A, Facts, Invariant, Life, Step
from swarmer.protocol.anchor_selection import STRATEGIES, Party
from swarmer.protocol.events import Local
from swarmer.state_machine import StateMachine

TICK = int(Local.CHALLENGE_DUE)


class Challenges(Invariant):
    name, title = "S2", "challenge"
    guards = (
        "An FLS challenges only while Available, and R-Complete only to probe; ids are fresh; the range lies between "
        "start and diagonal, widens when nobody took the last challenge, and never shrinks within an epoch."
    )
    on = frozenset({TICK})
    says = frozenset({CHALLENGE_INIT})

    def after(self, step: Step) -> str | None:
        if step.m.available:
            step.was.complete_ticks = step.was.complete_ticks + 1 if step.m.complete else 1 << 30
        return None

    def said(self, step: Step, message: Message) -> str | None:
        self.looked += 1
        m, was = step.m, step.was
        if m.state is not A and not self._passing(step):
            return f"challenges while {m.state.name}"
        return self._wrong_id(was, message) or self._wrong_range(step, message) or self._needless(step)

    def _passing(self, step: Step) -> bool:
        """It was Available within this event, and challenged at once; then a message that had waited was handled."""
        return self.facts.rules.challenge_on_available and step.key != TICK

    def _wrong_id(self, was: Life, message: Message) -> str | None:
        if was.first_challenge is None:
            was.first_challenge = message.challenge
        # Ids are counted modulo 2^32, without 0.
        at = (message.challenge - was.first_challenge) % 0xFFFFFFFF
        fresh, was.challenge_at = at > was.challenge_at, at
        return None if fresh else f"challenge id {message.challenge} comes again"

    def _wrong_range(self, step: Step, message: Message) -> str | None:
        m, was, s = step.m, step.was, step.m.settings
        before, taken = was.reach, was.taken
        was.taken = False
        if not s.range_start <= message.range <= s.range_max:
            return f"range {message.range:.3f}, from {s.range_start:.3f} to {s.range_max:.3f} are allowed"
        if step.thaws:
            return None
        if message.range < before:
            return f"the range shrinks from {before:.3f} to {message.range:.3f} within an epoch"
        if (
            not taken
            and message.range <= before < min(s.range_max, before + s.range_step)
            and m.epoch == was.epoch
        ):
            return f"the range stays {before:.3f}, though nobody took the last challenge"
        return None

    def _needless(self, step: Step) -> str | None:
        rules, was = self.facts.rules, step.was
        if rules.challenge_policy != "r_complete" or rules.challenge_on_available or not step.m.complete:
            return None
        ticks, was.complete_ticks = was.complete_ticks, 0
        if not rules.probe_every:
            return "challenges though it is R-Complete"
        return f"probes after {ticks} ticks" if ticks < rules.probe_every else None


class Accepts(Invariant):
    name, title = "S3", "accept"
    guards = (
        "Nobody accepts a challenge of its own swarm; who is busy accepts only while it or its swarm anchors, if the "
        "anchor selection picks it (by default, with the lower Swarm-ID), and while it holds fewer than M-1 leases; "
        "newcomers join M and Swarm-ID aside."
    )
    on = frozenset({CHALLENGE_ACCEPT, CHALLENGE_ACK, LEASE_RENEW})  # nothing else grants a lease
    says = frozenset({CHALLENGE_ACCEPT})

    def after(self, step: Step) -> str | None:
        m, was = step.m, step.was
        if not step.anchors:
            was.joined.clear()
            return None
        message = step.message
        if message is not None and message.flags & JOIN and message.sender in m.leases:
            was.joined.add(message.sender)
        if self.facts.rules.m is None:
            return None
        self.looked += 1
        was.joined &= m.leases.ends().keys()
        if len(m.leases) - len(was.joined) > m.settings.m - 1:
            return f"{len(m.leases)} leases, {len(was.joined)} of them of newcomers; M is {m.settings.m:g}"
        return None

    def said(self, step: Step, message: Message) -> str | None:
        self.looked += 1
        m, was, asked = step.m, step.was, step.message
        if step.thaws:
            asked = step.event.message
        if asked is None or asked.kind != CHALLENGE_INIT or asked.sender != message.addressee.xi:
            return "accepts what nobody asked"
        if asked.swarm == m.swarm:
            return "accepts a challenge of its own swarm"
        if was.flying and not step.thaws:
            return "accepts in flight"
        if m.state is A or (asked.flags & JOIN and m.anchoring):
            return None
        if not m.anchoring:
            return f"accepts while {m.state.name}, and does not anchor"
        if self.facts.ids_decide and m.swarm > asked.swarm:
            return f"is busy and accepts {asked.swarm}, lower than its own {m.swarm}"
        if self.facts.rules.busy_join != "all" and not self._picked(m, asked):
            return f"is busy and accepts {asked.swarm} of size {asked.size}, which would anchor it"
        if len(was.leases) >= m.settings.m - 1 and asked.sender not in was.leases:
            return f"accepts with {len(was.leases)} leases; M is {m.settings.m:g}"
        return None

    def _picked(self, m: StateMachine, asked: Message) -> bool:
        """Would the strategy of the run, or an oracle, have this FLS anchor the challenger?"""
        if bool(asked.flags & ABSOLUTE) != m.absolute:
            return m.absolute
        rule = STRATEGIES[self.facts.rules.anchor]
        return rule(Party(m.swarm, m.size, False), Party(asked.swarm, asked.size, True), asked.challenge)


class Pairs(Invariant):
    name, title = "S4", "pair"
    guards = (
        "Of two ends that pair one anchors and one localizes, by Swarm-ID the lower one anchors; a challenger that "
        "localizes sends one ACK, one that anchors up to M-1, and whoever else accepts gets LEASE_CANCEL."
    )
    on = frozenset({CHALLENGE_ACCEPT, CHALLENGE_ACK})

    def __init__(self, facts: Facts) -> None:
        super().__init__(facts)
        # (challenger, acceptor, challenge, epoch) -> (who paired first, as what); gone when both have.
        self._roles: dict[tuple[int, int, int, int], tuple[int, str]] = {}

    def after(self, step: Step) -> str | None:
        message = step.message
        if message is None:
            return None
        was = step.was
        self.looked += 1
        role = role_of(step, message)
        asked = message.kind == CHALLENGE_ACCEPT
        if asked:
            answers = answers_to(step, message)
            if answers != ([CHALLENGE_ACK] if role else [LEASE_CANCEL]):
                return f"{role or 'does not pair'}, and answers {_names(answers)} to {message.sender}"
        if role is None:
            return None
        was.taken = was.taken or asked
        joins = bool(message.flags & JOIN) or was.joins
        if self.facts.ids_decide and not joins and (role == "anchors") != (was.swarm < message.swarm):
            return f"{role} with {was.swarm} against {message.swarm}"
        if role == "localizes" and not any(sent.kind == SET_WAITING for sent in step.sent):
            return "localizes, and does not tell its swarm"
        return (self._count_acks(step, message, role) if asked else None) or self._both(step, message, role)

    def _count_acks(self, step: Step, message: Message, role: str) -> str | None:
        acks = step.was.acks
        acks[message.challenge] = acks.get(message.challenge, 0) + (not message.flags & JOIN)
        most = 1 if role == "localizes" else step.m.settings.m - 1
        if acks[message.challenge] > most:
            return f"{acks[message.challenge]} ACKs to one challenge, and it {role}"
        for old in list(acks)[:-4]:
            del acks[old]
        return None

    def _both(self, step: Step, message: Message, role: str) -> str | None:
        asked = message.kind == CHALLENGE_ACCEPT
        ends = (step.m.fid, message.sender) if asked else (message.sender, step.m.fid)
        pairing = (*ends, message.challenge, step.m.epoch)
        first = self._roles.pop(pairing, None)
        if first is None:
            self._roles[pairing] = (step.m.fid, role)
        elif first[0] != step.m.fid and first[1] == role:
            return f"both ends of challenge {message.challenge} of {ends[0]}: {role}"
        return None


class Races(Invariant):
    name, title = "S8", "races"
    guards = (
        "Every ACK has one outcome: a pair, or LEASE_CANCEL in the same event; never both, never silence, neither at "
        "the network's door nor in the handler."
    )
    on = hears = frozenset({CHALLENGE_ACK})

    def after(self, step: Step) -> str | None:
        message = step.message
        if message is None:
            return None
        self.looked += 1
        role, answers = role_of(step, message), answers_to(step, message)
        if answers == [LEASE_CANCEL] or (role is not None and not answers):
            return None
        return f"{role or 'does not pair'}, and answers {_names(answers)} to the ACK of {message.sender}"

    def came(self, life: Life, message: Message, fate: str) -> str | None:
        if fate not in ("dropped", "noted"):
            return None
        self.looked += 1
        return f"the ACK of {message.sender} is {fate} at the door"


class Newcomers(Invariant):
    name, title = "S10", "busy neighbours"
    guards = (
        "A newcomer localizes in its first pair and never anchors, unless its partner is a newcomer, too."
    )
    on = frozenset({CHALLENGE_ACCEPT, CHALLENGE_ACK})

    def after(self, step: Step) -> str | None:
        was, message = step.was, step.message
        if not was.joins:
            return None
        self.looked += 1
        if was.state is not BA and step.m.state is BA and not (message and message.flags & JOIN):
            return "a newcomer anchors"
        return None


def answers_to(step: Step, message: Message) -> list[int]:
    """Kinds of what the event says to the sender of a message alone."""
    return [sent.kind for sent in step.sent if sent.to == TO_FLS and sent.addressee.xi == message.sender]


def role_of(step: Step, message: Message) -> str | None:
    """What an ACCEPT or ACK has made of the FLS that got it."""
    m = step.m
    if m.state is BL and m.anchor is message:
        return "localizes"
    if message.sender in m.leases and LEASE_CANCEL not in answers_to(step, message):
        return "anchors"
    return None


def _names(kinds: list[int]) -> str:
    return ", ".join(Kind(kind).name for kind in kinds) or "nothing"
