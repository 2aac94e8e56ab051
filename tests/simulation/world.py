"""A display in virtual time: state machines, an in-memory radio and physics, event by event, from one seed.

What the tests of the protocol run on. It makes the same calls in the same order as an FLS process does.
"""

from __future__ import annotations

import heapq
import math
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from swarmer.config import RunConfig
from swarmer.messages import NO_SWARM, Kind, Stamp, To
from swarmer.metrics.hausdorff import hausdorff
from swarmer.physics.dead_reckoning import MODELS
from swarmer.physics.flight import plan_flight, position_at
from swarmer.plan import Plan, make_machine, make_plan, make_sensor, make_velocity
from swarmer.protocol import race
from swarmer.protocol.events import (
    Arm,
    Depart,
    Disarm,
    Due,
    Fly,
    Landed,
    Launch,
    Measure,
    Measured,
    Received,
    Send,
    Timer,
)
from swarmer.radio import Ears, EndRules, ReplayWindow, fate, heard
from swarmer.state_machine import Identity, StateMachine
from swarmer.streams import stream


@dataclass
class Body:
    machine: StateMachine
    window: ReplayWindow
    flight: object
    timers: dict = field(default_factory=dict)
    number: int = 0
    version: int = 0
    measuring: int = 0
    lit: bool = False
    alive: bool = True


class World:
    """Run with `run(until_s)`; look at `bodies`, `log`, `sent`."""

    def __init__(self, config: RunConfig, latency_s: tuple[float, float] = (0.0005, 0.0015)) -> None:
        self.plan: Plan = make_plan(config)
        self.rules = self.plan.rules
        self.points = [tuple(map(float, p)) for p in self.plan.cloud.points]
        self.latency_s = latency_s
        self.now = 0.0
        self.queue: list = []
        self.order = 0
        self.sent: Counter = Counter()
        self.events = 0
        self.handled = 0
        self.dark_until_heal: set[frozenset] = set()
        self.bodies: dict[int, Body] = {}
        self.tap = lambda fid, event, actions: None
        self.velocity = make_velocity(self.rules)
        self.sensor = make_sensor(self.rules)
        self.members: dict = {}
        seed = config.seed
        self.air = stream(seed, "air")
        self.sensing = stream(seed, "sensing")
        self.sender_rules = EndRules(*self.rules.sender)
        self.receiver_rules = EndRules(*self.rules.receiver)
        self.flight_rng = {f: stream(seed, "flight", f) for f in range(1, self.plan.size + 1)}
        for fid in range(1, self.plan.size + 1):
            self.add(fid, 0)

    def add(self, fid: int, incarnation: int) -> None:
        machine = make_machine(
            self.rules,
            Identity(fid, incarnation, self.points[fid - 1]),
            self.plan.neighbours.neighbours[fid - 1],
            float(self.plan.neighbours.reach_cells[fid - 1]),
            stream(self.plan.config.seed, "machine", fid, incarnation),
        )
        origin = (0.0, 0.0, 0.0)
        start = plan_flight(origin, origin, 0.0, self.velocity)
        body = self.bodies[fid] = Body(machine, ReplayWindow(), start)
        self.feed(fid, body, Launch(origin))

    def kill(self, fid: int) -> None:
        self.bodies[fid].alive = False

    def replace(self, fid: int) -> None:
        self.add(fid, self.bodies[fid].machine.incarnation + 1)

    def push(self, at: float, item: tuple) -> None:
        self.order += 1
        heapq.heappush(self.queue, (at, self.order, item))

    def run(self, until_s: float) -> None:
        while self.queue and self.queue[0][0] <= until_s:
            self.now, _, (fid, body, what, token) = heapq.heappop(self.queue)
            if not body.alive or self.bodies[fid] is not body:
                continue
            self.events += 1
            if isinstance(what, Timer):
                if body.timers.get(what) == token:
                    del body.timers[what]
                    self.feed(fid, body, Due(what))
            elif what == "datagram":
                self.receive(fid, body, *token)
            elif what == "measured":
                self.measure(fid, body, *token)
            else:
                self.feed(fid, body, what)
        self.now = until_s

    def measure(self, fid: int, body: Body, number: int, o: tuple[float, float, float]) -> None:
        if number == body.measuring:  # a later measurement takes the place of this one
            x = self.position(body)
            vector = (o[0] - x[0], o[1] - x[1], o[2] - x[2])
            self.feed(fid, body, Measured(self.sensor.measure(vector, self.sensing)))

    def position(self, body: Body) -> tuple[float, float, float]:
        return position_at(body.flight, self.now, self.velocity)

    def ears(self, body: Body) -> Ears:
        m = body.machine
        return Ears(1, m.fid, m.swarm if m.awake else NO_SWARM, m.truth, m.beliefs.neighbours)

    def receive(self, fid: int, body: Body, message, stamp) -> None:
        if not body.window.fresh(message.sender, message.incarnation, stamp.number):
            return
        m = body.machine
        verdict = race.judge(message, m, m.beliefs.neighbours, self.rules.neighbour_reply)
        if verdict.note:
            self.feed(fid, body, Received(message, noted=True))
        if verdict.reply is not None:
            self.perform(
                fid, body, [Send(race.answer(message, verdict.reply, m, fid, m.incarnation, m.truth))], None
            )
        if verdict.queue:
            self.handled += 1
            self.feed(fid, body, Received(message), stamp)

    def feed(self, fid: int, body: Body, event, stamp=None) -> None:
        before = body.machine.swarm if body.machine.awake else None
        actions = body.machine.handle(event, self.now)
        after = body.machine.swarm if body.machine.awake else None
        if before != after:
            if before is not None:
                self.members.get(before, set()).discard(fid)
            if after is not None:
                self.members.setdefault(after, set()).add(fid)
        body.lit = body.machine.awake
        self.tap(fid, event, actions)
        self.perform(fid, body, actions, stamp)

    def perform(self, fid: int, body: Body, actions, stamp) -> None:
        for action in actions:
            kind = type(action)
            if kind is Send:
                self.send(fid, body, action.message)
            elif kind is Arm:
                body.version += 1
                body.timers[action.timer] = body.version
                self.push(max(action.at_s, self.now), (fid, body, action.timer, body.version))
            elif kind is Disarm:
                body.timers.pop(action.timer, None)
            elif kind is Fly:
                flown = MODELS[self.rules.dead_reckoning](
                    action.vector, self.rules.epsilon, self.rules.dim, self.flight_rng[fid]
                )
                body.flight = plan_flight(self.position(body), flown, self.now, self.velocity)
                self.push(self.now + body.flight.duration_s, (fid, body, Landed(), None))
            elif kind is Measure:
                body.measuring += 1
                self.push(
                    self.now + self.sensor.delay_s, (fid, body, "measured", (body.measuring, stamp.origin))
                )
            elif kind is Depart:
                body.alive = False

    def send(self, fid: int, body: Body, message) -> None:
        body.number += 1
        self.sent[Kind(message.kind)] += 1
        stamp = Stamp(1, body.number, self.position(body), self.now)
        if message.to == To.FLS:
            receivers = [message.addressee.xi]
        elif message.to == To.SWARM:
            receivers = sorted(self.members.get(message.addressee, ()))
        elif message.kind == Kind.CHALLENGE_INIT:
            receivers = self.within(fid, math.inf if self.rules.range_estimated else message.range)
        else:
            receivers = range(1, self.plan.size + 1)
        for sender_delay in fate(self.sender_rules, self.air):
            for other in receivers:
                if (
                    other == fid
                    or other not in self.bodies
                    or frozenset((fid, other)) in self.dark_until_heal
                ):
                    continue
                target = self.bodies[other]
                here = self.position(target) if self.rules.range_estimated else None
                if heard(message, stamp, self.ears(target), self.plan.size, here) is not None:
                    continue
                for delay in fate(self.receiver_rules, self.air):
                    at = self.now + self.air.uniform(*self.latency_s) + sender_delay + delay
                    self.push(at, (other, target, "datagram", (message, stamp)))

    def within(self, fid: int, reach: float) -> list[int]:
        if not hasattr(self, "tree"):
            from scipy.spatial import cKDTree

            self.tree = cKDTree(self.plan.cloud.points)
        return [int(i) + 1 for i in self.tree.query_ball_point(self.points[fid - 1], min(reach, 1e9) + 1e-9)]

    # -- reading ------------------------------------------------------------------------------------------------

    def positions(self) -> np.ndarray:
        return np.array([self.position(self.bodies[f]) for f in sorted(self.bodies)])

    def hd(self) -> float:
        lit = [f for f in sorted(self.bodies) if self.bodies[f].lit and self.bodies[f].alive]
        x = np.array([self.position(self.bodies[f]) for f in lit])
        g = self.plan.cloud.points[[f - 1 for f in lit]]
        return hausdorff(x + (g - x).mean(axis=0), g) if len(lit) else math.nan

    def swarms(self) -> int:
        return len({b.machine.swarm for b in self.bodies.values() if b.alive})

    def count(self, index: int) -> int:
        return sum(b.machine.counts[index] for b in self.bodies.values())
