"""Invariants of what the display becomes: S15 the next shape."""

from __future__ import annotations

from math import dist

from swarmer.observe.invariants.base import EVERY, TINY, D, Facts, Invariant, Life, Step
from swarmer.protocol.events import Fly
from swarmer.protocol.records import shape_of


class Transitions(Invariant):
    name, title = "S15", "transition"
    guards = (
        "FLSs and points of the next shape are one to one, those who join or leave are the difference in count; an FLS "
        "takes its new point with the first epoch of that shape, not before it begins, and flies there once; no "
        "datagram of the old shape moves anyone."
    )
    on = on_dark = EVERY

    def __init__(self, facts: Facts) -> None:
        super().__init__(facts)
        plan = facts.plan
        self._begins_s = 0.0 if plan.next is None else plan.next.at_s
        self._truths = [
            {
                int(row) + 1: tuple(standing.truth[row].tolist())
                for row in range(len(standing.truth))
                if standing.member[row]
            }
            for standing in (plan.standings() if plan.next is not None else ())
        ]

    def begun(self) -> str | None:
        shape = self.facts.plan.next
        if shape is None:
            return None
        self.looked += 1
        before, after = len(self.facts.plan.cloud), len(shape.cloud)
        if len(set(shape.fids.tolist())) != after:
            return f"{after} points of the next shape for {len(set(shape.fids.tolist()))} FLSs"
        if len(shape.joiners) != max(0, after - before) or len(shape.leavers) != max(0, before - after):
            return (
                f"{len(shape.joiners)} join and {len(shape.leavers)} leave, from {before} points to {after}"
            )
        return None

    def after(self, step: Step) -> str | None:
        if not self._truths:
            return None
        m, was = step.m, step.was
        shape, before = shape_of(m.epoch), shape_of(was.epoch)
        if shape >= len(self._truths):
            return f"is in epoch {m.epoch}, of no shape"
        if shape and step.now < self._begins_s and (m.awake or m.flying):
            return f"is in the air in epoch {m.epoch}, before that shape begins"
        flights = [action.vector for action in step.actions if type(action) is Fly]
        message = step.message
        if message is not None and shape_of(message.epoch) < shape and (flights or m.swarm != was.swarm):
            return f"obeys {message.sender}, which is of the shape before"
        if shape != before:
            return self._changes(step, flights)
        if was.onward is not None and m.onward is None and not m.oracle:  # whose flights are S14's
            self.looked += 1
            if len(flights) != 1 or dist(flights[0], was.onward) > TINY:
                return f"landed where its old point was, flies {flights}; its new one is {was.onward} away"
            return None
        return None if m.truth == was.truth else f"its point is {m.truth} and was {was.truth}, in one shape"

    def _changes(self, step: Step, flights: list[tuple[float, float, float]]) -> str | None:
        """The event in which an FLS becomes part of the next shape."""
        self.looked += 1
        m, was = step.m, step.was
        point = self._truths[shape_of(m.epoch)].get(m.fid)
        if point is None:
            return None if m.leaving or m.departed else "has no point any more, and stays"
        if m.truth != point:
            return f"its point is {m.truth}, planned {point}"
        way = tuple(there - here for there, here in zip(point, was.truth, strict=True))
        if was.state is D and not was.flying:
            return f"flies {flights} before its launch" if flights else None
        asked = m.onward if was.flying else flights[0] if len(flights) == 1 else None
        if asked is None or dist(asked, way) > TINY:
            return f"flies {flights}, then {m.onward}; its new point is {way} away"
        return None

    def finished(self, now_s: float) -> tuple[Life | None, str] | None:
        shape = self.facts.plan.next
        if shape is None or now_s < shape.at_s:
            return None
        for life in self.facts.lives:
            if life is None or not life.alive or shape_of(life.epoch) > 0:
                continue
            if now_s > shape.at_s + self.facts.late_s(life):
                return life, f"at the end it is still in epoch {life.epoch}, of the first shape"
        return None
