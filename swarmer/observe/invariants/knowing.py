"""Invariants of FLSs that know where they are: S14 oracles."""

from __future__ import annotations

from math import dist

from swarmer.messages import ABSOLUTE, CHALLENGE_ACCEPT, CHALLENGE_ACK
from swarmer.observe.invariants.base import EVERY, D, Facts, Invariant, Step
from swarmer.observe.invariants.pairing import role_of
from swarmer.protocol.events import Fly, Local
from swarmer.protocol.records import shape_of

LAUNCH, LANDED, MEASURED = int(Local.LAUNCH), int(Local.LANDED), int(Local.MEASURED)
NEAR = 1e-6  # cells


class Oracles(Invariant):
    name, title = "S14", "oracle"
    guards = (
        "An oracle flies to its own point alone and never because another FLS says so; a swarm is absolute, as long as "
        "its Swarm-ID is an oracle's; of an absolute swarm and one that is not the other one localizes, whatever the "
        "Swarm-IDs; two absolute swarms merge without a flight."
    )
    on = on_dark = EVERY

    def __init__(self, facts: Facts) -> None:
        super().__init__(facts)
        self._oracles = frozenset(facts.rules.oracles)

    def after(self, step: Step) -> str | None:
        if not self._oracles:
            return None
        m, was, message = step.m, step.was, step.message
        if m.state is not D and m.absolute != (m.swarm.xi in self._oracles):
            return (
                f"is in {m.swarm}, and takes that for {'an absolute' if m.absolute else 'a relative'} swarm"
            )
        flights = [action.vector for action in step.actions if type(action) is Fly]
        if flights and m.oracle:
            return self._moves(step, flights)
        if flights and step.key == MEASURED and was.swarm.xi in self._oracles:
            return f"its swarm {was.swarm} is absolute, and flies"
        if message is None or message.kind not in (CHALLENGE_ACCEPT, CHALLENGE_ACK):
            return None
        role, theirs = role_of(step, message), bool(message.flags & ABSOLUTE)
        mine = was.swarm.xi in self._oracles
        if role is None or mine == theirs:
            return None
        self.looked += 1
        if (role == "anchors") != mine:
            return f"in {was.swarm} it {role}, against {message.swarm}; {'its own' if mine else 'that'} is absolute"
        return None

    def _moves(self, step: Step, flights: list[tuple[float, float, float]]) -> str | None:
        """An oracle flies: on its way in, to its next point, or what is left of such a way."""
        self.looked += 1
        m, was = step.m, step.was
        if step.key == LAUNCH or shape_of(m.epoch) != shape_of(was.epoch):
            return None
        left = [there - here for there, here in zip(m.truth, was.fls.position(), strict=True)]
        if step.key == LANDED and len(flights) == 1 and dist(flights[0], left) <= NEAR:
            return None
        return f"flies {flights}; its point is {left} away"
