"""The last events of those whom a broken invariant concerns, a line each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from swarmer.messages import Kind as MessageKind
from swarmer.messages import To
from swarmer.observe.invariants.base import RECENT, Life, Past
from swarmer.protocol.events import Due, Fly, Launch, Measured, Received, Send

PARTNERS = 3  # FLSs besides the one concerned whose events are told


def story(lives: Sequence[Life | None], fid: int) -> list[str]:
    """The last events of an FLS and of those it dealt with, in order, a line each. fid 0: of all."""
    concerned = [life for life in lives if life is not None]
    if fid:
        life = lives[fid]
        assert life is not None
        fids = {fid, *_partners(life)}
        concerned = [life for life in concerned if life.fid in fids]
    events = [
        (life.fid, number, Past._make(past)) for life in concerned for number, past in enumerate(life.recent)
    ]
    # The present event is the last one of the FLS concerned, whatever else came at that moment.
    events.sort(key=lambda event: (event[2].t_s, event[0] == fid, event[1]))
    return [line(who, past) for who, _, past in events[-RECENT:]]


def _partners(life: Life) -> list[int]:
    """Whom it last heard."""
    partners: list[int] = []
    for past in map(Past._make, reversed(life.recent)):
        if type(past.event) is Received and not past.event.noted:
            sender = past.event.message.sender
            if sender not in partners:
                partners.append(sender)
    return partners[:PARTNERS]


def line(fid: int, past: Past) -> str:
    """One event in words."""
    states = past.before.name if past.before is past.after else f"{past.before.name} -> {past.after.name}"
    done = ", ".join(words for action in past.actions if (words := _done(action)))
    return f"{past.t_s:.4f} s  FLS {fid} (ξ {_swarm(past.swarm)})  {states}: {_happened(past.event)}" + (
        f" => {done}" if done else ""
    )


def _happened(event: Any) -> str:
    if type(event) is Received:
        message = event.message
        words = (
            f"{_kind(message.kind)} from {message.sender} (ξ {_swarm(message.swarm)}, epoch {message.epoch})"
        )
        return f"{words}, noted" if event.noted else words
    if type(event) is Due:
        return f"{event.timer.name.lower()} timer"
    if type(event) is Measured:
        return f"measured {math.hypot(*event.vector):.3f} cells"
    return "launched" if type(event) is Launch else type(event).__name__.lower()


def _done(action: Any) -> str:
    if type(action) is Send:
        message = action.message
        to = {
            To.FLS: f"{message.addressee.xi}",
            To.SWARM: f"swarm {_swarm(message.addressee)}",
            To.ALL: "all",
        }
        return f"{_kind(message.kind)} to {to[To(message.to)]}"
    if type(action) is Fly:
        return f"flies {math.hypot(*action.vector):.3f} cells"
    return {"Measure": "measures", "Depart": "departs"}.get(type(action).__name__, "")


def _kind(number: int) -> str:
    return MessageKind(number).name


def _swarm(swarm: Any) -> str:
    return f"{swarm.xi}" if not swarm.incarnation else f"{swarm.xi}.{swarm.incarnation}"
