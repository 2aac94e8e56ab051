"""What happens to an FLS (events) and what it decides (actions): small immutable records.

An engine supplies the events and performs the actions, in order. Times are emulated seconds, vectors display cells.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

from swarmer.messages import ZERO, Message, Swarm, Vec3


class Timer(IntEnum):
    """The purposes an FLS has a timer for; at most one of each is armed."""

    CHALLENGE = 0  # the free-running tick, about every lambda
    BOUND = 1  # a Waiting FLS that hears nothing becomes Available
    LEASE = 2  # the anchor's next lease is over
    RENEW = 3  # half a lease: the localizer renews
    THAW = 4  # this FLS thaws the display
    REPORT = 5  # its thaw policy has something to say, or to ask


# The same by plain names, here and below for what is counted: an attribute of an enum class costs a slow look-up.
CHALLENGE_TIMER, BOUND_TIMER, LEASE_TIMER, RENEW_TIMER, THAW_TIMER, REPORT_TIMER = Timer


class Local(IntEnum):
    """Keys of the table for what is no message; beyond every Kind, so one table holds both. Timers come first."""

    CHALLENGE_DUE = 32
    BOUND_OVER = 33
    LEASE_OVER = 34
    RENEW_DUE = 35
    THAW_DUE = 36
    REPORT_DUE = 37
    LAUNCH = 38
    LANDED = 39
    MEASURED = 40
    BATTERY_LOW = 41
    NEW_SHAPE = 42


KEYS = 43  # one more than the largest key


class Received(NamedTuple):
    """A datagram reached this FLS. `noted` ones only tell the sender's Swarm-ID (rule 8)."""

    message: Message
    noted: bool = False


class Due(NamedTuple):
    """An armed timer is over."""

    timer: Timer


class Launch(NamedTuple):
    """The dispatcher lets go; the FLS is at `origin`."""

    origin: Vec3


class Landed(NamedTuple):
    """The flight that `Fly` asked for has ended. To an oracle alone the engine tells how far it is from its point."""

    offset: Vec3 = ZERO  # from where it is to its point


class Measured(NamedTuple):
    """The sensor's answer to `Measure`: the vector from this FLS to the anchor."""

    vector: Vec3


class BatteryLow(NamedTuple):
    """The FLS must go and charge (rule 13)."""


class NewShape(NamedTuple):
    """The moment has come when the display becomes the next shape (rule 15)."""


Event = Received | Due | Launch | Landed | Measured | BatteryLow | NewShape


class Send(NamedTuple):
    message: Message


class Fly(NamedTuple):
    """Fly by dead reckoning along `vector`. The engine answers with `Landed`; until then the FLS is busy.

    legs: parts that add up to it, flown one after the other, each with an error of its own; none: it flies straight.
    """

    vector: Vec3
    legs: tuple[Vec3, ...] = ()


class Measure(NamedTuple):
    """Measure the vector to the sender of `message`, which is at hand.

    The engine answers with `Measured`. A new one takes the place of one that is not answered yet.
    """

    message: Message


class Arm(NamedTuple):
    """Set a timer, in place of the one of the same purpose."""

    timer: Timer
    at_s: float


class Disarm(NamedTuple):
    timer: Timer


class Depart(NamedTuple):
    """Go dark and fly home: the FLS's life ends."""


class ThawBegins(NamedTuple):
    """This FLS has begun a thaw: for who watches, an engine need not do anything."""

    swarm: Swarm  # it was in this one until now
    epoch: int  # that ends with it
    known: bool  # its policy claims that this was the only swarm; False: the clock said so


Action = Send | Fly | Measure | Arm | Disarm | Depart | ThawBegins


class Count(IntEnum):
    """What the machine counts, in the list it was handed."""

    LOCALIZATIONS = 0  # times it localized relative to an anchor
    ANCHORINGS = 1  # times it became Busy Anchor
    LEASES_GRANTED = 2
    LEASES_EXPIRED = 3
    THAWS_STARTED = 4  # THAWs it began itself
    THAWS_OBEYED = 5
    HANDLED = 6  # messages that had a rule
    IGNORED = 7  # messages without a rule in the present state, or no longer addressed to it
    STALE = 8  # datagrams of an earlier epoch
    JOINS = 9  # pairings with a newcomer (rule 10)


LOCALIZATIONS, ANCHORINGS, LEASES_GRANTED, LEASES_EXPIRED, THAWS_STARTED = map(int, tuple(Count)[:5])
THAWS_OBEYED, HANDLED, IGNORED, STALE, JOINS = map(int, tuple(Count)[5:])
