"""What happens to an FLS and what it does, in the short words of traces and scenarios."""

from __future__ import annotations

from collections.abc import Iterable

from swarmer.messages import (
    ANCHORING,
    FOLLOW_MERGE,
    MERGE,
    SET_WAITING,
    TO_FLS,
    TO_SWARM,
    Kind,
    Message,
    Swarm,
)
from swarmer.protocol.events import (
    Action,
    Arm,
    Depart,
    Disarm,
    Due,
    Event,
    Fly,
    Measure,
    Received,
    Send,
    Timer,
)
from swarmer.protocol.records import State

# Of each kind of datagram, by its number; the long names of pairing are shortened as the specification's table has it.
KIND_NAMES = {int(kind): kind.name.removeprefix("CHALLENGE_").removeprefix("LEASE_") for kind in Kind}
KIND_NUMBERS = {name: number for number, name in KIND_NAMES.items()}
STATE_NAMES = {state: "".join(part.title() for part in state.name.split("_")) for state in State}
_OVER = (Timer.BOUND, Timer.LEASE)  # a time that is over; the others are due
TIMER_NAMES = {timer: f"{timer.name.lower()} {'over' if timer in _OVER else 'due'}" for timer in Timer}
LOCAL_NAMES = {
    "Launch": "launch", "Landed": "landed", "Measured": "measured", "BatteryLow": "battery low",
    "NewShape": "new shape",
}  # fmt: skip


def swarm_name(swarm: Swarm) -> str:
    """A Swarm-ID; the incarnation of its owner only where it was replaced.

    >>> swarm_name(Swarm(4, 0)), swarm_name(Swarm(4, 2))
    ('4', '4.2')
    """
    return str(swarm.xi) if not swarm.incarnation else f"{swarm.xi}.{swarm.incarnation}"


def event_name(event: Event) -> str:
    """A datagram by its kind, everything else by what it is."""
    if isinstance(event, Received):
        return KIND_NAMES[event.message.kind]
    if isinstance(event, Due):
        return TIMER_NAMES[event.timer]
    return LOCAL_NAMES[type(event).__name__]


def datagram_name(message: Message) -> str:
    """Its kind, and what tells it from others of that kind: `SET_WAITING(a)`, `MERGE(4)`."""
    name = KIND_NAMES[message.kind]
    if message.kind == SET_WAITING:
        return name + ("(a)" if message.flags & ANCHORING else "(l)")
    if message.kind in (MERGE, FOLLOW_MERGE):
        return f"{name}({swarm_name(message.other)})"
    return name


def addressee_name(message: Message) -> str:
    """Whom it is for: `4`, `swarm 4`, `all`."""
    if message.to == TO_FLS:
        return str(message.addressee.xi)
    return f"swarm {swarm_name(message.addressee)}" if message.to == TO_SWARM else "all"


def action_words(actions: Iterable[Action]) -> list[str]:
    """What others can notice of actions; timers are left out."""
    return [words for action in actions if (words := _noticed(action))]


def _noticed(action: Action) -> str:
    if isinstance(action, Send):
        return f"{datagram_name(action.message)} {addressee_name(action.message)}"
    return {Fly: "fly", Measure: "measure", Depart: "depart"}.get(type(action), "")


def timer_words(actions: Iterable[Action]) -> list[str]:
    """What actions do to timers: `challenge due 0.4127` is armed for that emulated second, `no lease over` disarmed."""
    words = []
    for action in actions:
        if type(action) is Arm:
            words.append(f"{TIMER_NAMES[action.timer]} {action.at_s:.4f}")
        elif type(action) is Disarm:
            words.append(f"no {TIMER_NAMES[action.timer]}")
    return words
