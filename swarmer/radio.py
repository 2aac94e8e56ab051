"""The radio's rules, pure: who is addressed, who is in range, what is lost, late, doubled or out of date (section 5).

Every engine asks these rules; `udp_wrapper` lets the kernel's filter apply the first ones early, and asks again.
"""

from __future__ import annotations

from collections.abc import Callable
from math import ceil, dist
from random import Random
from typing import NamedTuple

from swarmer.messages import (
    CHALLENGE_INIT,
    NO_SWARM,
    TO_FLS,
    TO_SWARM,
    Message,
    Stamp,
    Swarm,
    Vec3,
)

WINDOW = 64  # datagrams behind the newest that may still arrive: an FLS listens on two sockets (rule 12)


class Ears(NamedTuple):
    """Who listens: what the rules need to know of a receiver."""

    run: int
    fid: int
    swarm: Swarm  # NO_SWARM while dark
    truth: Vec3
    neighbours: frozenset[int]  # the planned ones


def heard(
    message: Message, stamp: Stamp, ears: Ears, count: int, origin_range: Vec3 | None = None
) -> str | None:
    """Why these ears do not take a datagram (`run`, `sender`, `address`, `range`, `own`), or None if they do.

    `own` is a challenge from the own swarm: it gets no further than the radio (SwarMer, footnote 10), unless it comes
    from a planned neighbour, whose Swarm-ID is worth noting (rule 9).
    count: F, the number of FLSs of the run. origin_range: where the receiver really is, if the range is measured
    between positions and not between points (the authors' code).
    """
    if stamp.run != ears.run:
        return "run"
    if message.sender > count or message.sender == ears.fid:
        return "sender"
    if message.to == TO_FLS:
        if message.addressee.xi != ears.fid:
            return "address"
    elif message.to == TO_SWARM and (message.addressee != ears.swarm or ears.swarm == NO_SWARM):
        return "address"
    if message.kind != CHALLENGE_INIT:  # all others go with the maximum range
        return None
    if ears.swarm == NO_SWARM:
        return "address"  # dark: no challenge is for it
    if message.swarm == ears.swarm and message.sender not in ears.neighbours:
        return "own"
    if origin_range is None:
        far = dist(message.truth, ears.truth) > message.range
    else:
        far = dist(stamp.origin, origin_range) > message.range
    return "range" if far else None


class Grid(NamedTuple):
    """Ground truth in whole steps, as the kernel's filter computes with it: squares of distances fit 32 bits."""

    steps_per_cell: float

    @classmethod
    def for_display(cls, diagonal: float) -> Grid:
        """A grid as fine as 32 bits allow, at most 1/256 of a cell."""
        return cls(min(256.0, 30_000.0 / max(diagonal, 1.0)))

    def of(self, point: Vec3) -> tuple[int, int, int]:
        """The nearest grid point, modulo 2^32: differences come out right whatever the sign."""
        k = self.steps_per_cell
        return (
            round(point[0] * k) & 0xFFFFFFFF,
            round(point[1] * k) & 0xFFFFFFFF,
            round(point[2] * k) & 0xFFFFFFFF,
        )

    def reach2(self, radius: float) -> int:
        """Squared range on the grid, rounded up by more than rounding two points can cost (never too small)."""
        steps = ceil(radius * self.steps_per_cell) + 2
        return min(steps * steps, 0xFFFFFFFF)


class EndRules(NamedTuple):
    """What one end of the radio does to datagrams: probabilities, and emulated seconds."""

    loss: float = 0.0  # of all datagrams in the long run, also where losses come in bursts
    duplicate: float = 0.0
    reorder: float = 0.0  # probability of being held back by `reorder_s`
    reorder_s: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0  # the delay is off by a time uniform in [-jitter, jitter], never below 0
    burst: float = 0.0  # datagrams that a burst of losses spans in the mean; 0: each is lost by itself
    burst_loss: float = 1.0  # probability that a datagram is lost within a burst

    @property
    def perfect(self) -> bool:
        return not (self.loss or self.duplicate or self.reorder or self.delay_s or self.jitter_s)

    @property
    def longest_s(self) -> float:
        """The longest that it may hold a datagram."""
        return self.delay_s + self.jitter_s + (self.reorder_s if self.reorder else 0.0)


LOST: tuple[float, ...] = ()


def fate(rules: EndRules, rng: Random, loss: float | None = None) -> tuple[float, ...]:
    """After how many emulated seconds each copy of a datagram goes on; empty if it is lost.

    loss: the probability of it at this moment, if that is another than the rules' own.
    Every call draws equally often, so one fault turned on does not change another's draws.
    """
    lost, doubled, held, jitter = rng.random(), rng.random(), rng.random(), rng.uniform(-1.0, 1.0)
    if lost < (rules.loss if loss is None else loss):
        return LOST
    delay = max(0.0, rules.delay_s + jitter * rules.jitter_s)
    if held < rules.reorder:
        delay += rules.reorder_s
    return (delay, delay) if doubled < rules.duplicate else (delay,)


class Bursts:
    """Losses that come in bursts: the channel is good or bad, and in the bad state loses most or all of what comes.

    The model of Gilbert (1960) and Elliott (1963): a Markov chain of two states that takes a step with each datagram.
    """

    __slots__ = ("_bad", "_begins", "_ends", "_loss", "_rng")

    def __init__(self, rules: EndRules, rng: Random) -> None:
        """Of every datagram `rules.loss` are lost in the long run, in bursts of `rules.burst` datagrams in the mean.

        Where so much is lost that good states would last less than a datagram, the bursts are longer than asked for.
        """
        share = (
            min(1.0, rules.loss / rules.burst_loss) if rules.burst_loss else 0.0
        )  # of the time that is bad
        good = (1.0 - share) * max(rules.burst, 1.0)
        self._begins = 1.0 if share >= good else share / good
        self._ends = self._begins * (1.0 - share) / share if share else 1.0
        self._loss, self._rng = rules.burst_loss, rng
        self._bad = rng.random() < share

    def step(self) -> float:
        """With what probability the next datagram is lost."""
        draw = self._rng.random()
        self._bad = draw >= self._ends if self._bad else draw < self._begins
        return self._loss if self._bad else 0.0


class End:
    """One end of one FLS's radio: what becomes of one datagram after the other."""

    __slots__ = ("_bursts", "_rng", "_rules")

    def __init__(self, rules: EndRules, stream: Callable[[str], Random], purpose: str) -> None:
        """stream: makes a generator for each purpose. Bursts draw from one of their own."""
        self._rules, self._rng = rules, stream(purpose)
        self._bursts = Bursts(rules, stream(f"{purpose} bursts")) if rules.burst else None

    def copies(self) -> tuple[float, ...]:
        """As `fate`, of the next datagram."""
        bursts = self._bursts
        return fate(self._rules, self._rng, None if bursts is None else bursts.step())


def dead_link(seed: int, sender: int, receiver: int, share: float) -> bool:
    """Nothing that `sender` says ever gets to `receiver`: so it is with `share` of all ordered pairs under a root seed.

    The other way round is another draw, so that some links are one-way.
    """
    mixed = (seed * 0x9E3779B97F4A7C15 + (sender << 24 | receiver) * 0xD1342543DE82EF95) & _64_BITS
    for factor in (0xBF58476D1CE4E5B9, 0x94D049BB133111EB):  # as SplitMix64 ends: every bit depends on all
        mixed = (mixed ^ mixed >> 30) * factor & _64_BITS
    return (mixed ^ mixed >> 31) < share * 2.0**64


_64_BITS = (1 << 64) - 1


class ReplayWindow:
    """Drops what was received before, is too old, or comes from a predecessor (rule 12).

    window: how far behind the newest number a datagram may arrive; 0 is the paper's rule, only newer ones.
    """

    __slots__ = ("_seen", "window")

    def __init__(self, window: int = WINDOW) -> None:
        self.window = window
        # sender -> (incarnation, newest number, bit k: newest - k was received)
        self._seen: dict[int, tuple[int, int, int]] = {}

    def outlived(self, sender: int, incarnation: int) -> bool:
        """True if a successor of this incarnation was heard: what it has said is never handled any more."""
        seen = self._seen.get(sender)
        return seen is not None and incarnation < seen[0]

    def fresh(self, sender: int, incarnation: int, number: int) -> bool:
        """True once for each datagram that is new; then it counts as received."""
        seen = self._seen.get(sender)
        if seen is None or incarnation > seen[0]:
            self._seen[sender] = (incarnation, number, 1)
            return True
        known, newest, bits = seen
        if incarnation < known:
            return False
        ahead = ((number - newest + 0x80000000) & 0xFFFFFFFF) - 0x80000000  # numbers wrap at 32 bits
        if ahead > 0:
            mask = (1 << (self.window + 1)) - 1
            self._seen[sender] = (known, number, ((bits << ahead) | 1) & mask if ahead <= self.window else 1)
            return True
        if -ahead > self.window or bits >> -ahead & 1:
            return False
        self._seen[sender] = (known, newest, bits | 1 << -ahead)
        return True
