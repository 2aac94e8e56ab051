"""The turns of a fault schedule as lines of events.csv, in every engine."""

from __future__ import annotations

from swarmer.engines.result import BEGINS, CALM, OVER, Event
from swarmer.faults import Turn, words


def event_of(turn: Turn) -> Event:
    """A fault begins or is over, or the calm begins."""
    fault = turn.fault
    if fault is None:
        return Event(turn.at_s, "fault", 0, CALM)
    fid = fault.where[0] if len(fault.where) == 1 else 0
    return Event(turn.at_s, "fault", fid, f"{BEGINS if turn.begins else OVER}{words(fault)}")
