"""How an FLS of a scenario comes into the state in which it begins: by events that a real one could have had."""

from __future__ import annotations

from collections.abc import Callable

from swarmer.messages import (
    ANCHORING,
    CHALLENGE_ACK,
    CHALLENGE_INIT,
    MERGE,
    SET_WAITING,
    TO_FLS,
    TO_SWARM,
    ZERO,
    Message,
    Swarm,
    Vec3,
)
from swarmer.protocol.events import Event, Landed, Launch, Measured, Received
from swarmer.state_machine import StateMachine

APART = 10.0  # cells between the points of two FLSs whose FIDs follow each other

Entrance = Callable[[StateMachine, int, list[int]], list[Event]]
"""(a new machine, the Swarm-ID it is to have, FIDs of those it owes its state to) -> events"""


def measured(machine: StateMachine, cells: float) -> Measured:
    """A measurement after which V is so many cells long, along the first axis."""
    assert machine.anchor is not None
    a, g = machine.anchor.truth, machine.truth
    return Measured((a[0] - g[0] + cells, a[1] - g[1], a[2] - g[2]))


def _from(m: StateMachine, kind: int, sender: int, **more: object) -> Received:
    """A datagram to `m`, from an FLS that is a swarm of its own unless `more` says otherwise."""
    truth: Vec3 = (APART * sender, 0.0, 0.0)
    message = Message(
        kind,
        sender,
        0,
        m.epoch,
        Swarm(sender, 0),
        1,
        truth,
        TO_FLS,
        Swarm(m.fid, 0),
        challenge=sender,
        other=m.swarm,
    )
    return Received(message._replace(**more))  # type: ignore[arg-type]


def _lit(m: StateMachine, xi: int, partners: list[int]) -> list[Event]:
    events: list[Event] = [Launch(ZERO), Landed()]
    if xi != m.fid:
        swarm = Swarm(m.fid, m.incarnation)
        events.append(_from(m, MERGE, xi, to=TO_SWARM, addressee=swarm, other=Swarm(xi, 0)))
    return events


def _paired(m: StateMachine, xi: int, partners: list[int]) -> list[Event]:
    events = _lit(m, xi, partners)
    for partner in partners:
        own = Swarm(xi, 0) if xi != m.fid else m.swarm
        events += [_from(m, CHALLENGE_INIT, partner), _from(m, CHALLENGE_ACK, partner, other=own)]
    return events


def _waiting(flags: int) -> Entrance:
    def events(m: StateMachine, xi: int, partners: list[int]) -> list[Event]:
        swarm = Swarm(xi, 0) if xi != m.fid else m.swarm
        told = [
            _from(m, SET_WAITING, p, to=TO_SWARM, swarm=swarm, addressee=swarm, flags=flags) for p in partners
        ]
        return [*_lit(m, xi, partners), *told]

    return events


OWING = {
    "BusyAnchor",
    "BusyLocalizing",
    "Waiting(a)",
    "Waiting(l)",
}  # states that FLSs have because of others
ENTRANCES: dict[str, Entrance] = {
    "Deploying": lambda m, xi, partners: [Launch(ZERO)],
    "Available": _lit,
    "BusyAnchor": _paired,
    "BusyLocalizing": _paired,
    "Waiting(a)": _waiting(ANCHORING),
    "Waiting(l)": _waiting(0),
}
