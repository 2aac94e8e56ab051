"""Seeded worlds full of faults, in virtual time: what `make soak` and test_soak.py run.

`draw(seed)` makes a scenario: a cloud, settings, and a schedule of faults as plain data, each kind only in some worlds
and at a rate of its own. `play` runs it: faults until `heal_s`, checks at every event, then one swarm must form.
"""

from __future__ import annotations

import heapq
import math
from collections import Counter
from dataclasses import dataclass, field
from random import Random
from typing import Any, NamedTuple

from checks import Recorder
from invariants import Broken
from world import World

from swarmer.config import load_config
from swarmer.protocol.events import Timer
from swarmer.protocol.thaw import Never
from swarmer.radio import EndRules

CALM_SHARE = 0.1  # worlds without any fault
EVENTS_MAX = 500_000


class Fault(NamedTuple):
    """Something that happens at `at_s`; `fids` are those concerned, `amount` seconds or what the kind says."""

    at_s: float
    kind: str  # kill | replace | hang | slow | cut | join
    fids: tuple[int, ...]
    amount: float = 0.0


@dataclass(frozen=True)
class Scenario:
    """A world and its weather; everything that `play` needs, as data."""

    seed: int
    settings: dict[str, Any]
    latency_s: tuple[float, float]
    faults: tuple[Fault, ...]
    heal_s: float
    live: bool  # the rules of this world promise that one swarm forms

    def words(self) -> str:
        """One line about it."""
        s = self.settings
        kinds = sorted({fault.kind for fault in self.faults} - {"join", "replace"})
        radio = [name.removeprefix("radio.") for name in s if name.startswith("radio.")]
        return (
            f"F {s['points']}, λ {s['lambda_ms']:g}, δ {s['lease_ms']:g} ms, M {s['m']}, ε {s['epsilon_deg']:g}°, "
            f"{s['anchor']}, {s['challenge_policy']}, thaw {s['thaw.policy']}, join {s['busy_join']}, "
            f"faults: {', '.join(kinds + radio) or 'none'}"
        )


@dataclass
class Outcome:
    """How a world went; `failure` is None if all held."""

    failure: str | None = None
    at_s: float = 0.0
    events: int = 0
    digest: str = ""  # over every event in order
    took_s: float | None = None  # emulated seconds from healing to one swarm
    bound_s: float = 0.0
    last: list[str] = field(default_factory=list)
    seen: Counter[str] = field(default_factory=Counter)  # how often a rule had something to say


# -- drawing ---------------------------------------------------------------------------------------------------------


def draw(seed: int) -> Scenario:
    """The world of a seed."""
    rng = Random(f"soak {seed}")
    settings = draw_settings(rng, seed)
    if (
        settings["epochs"] and settings["thaw.policy"] == "timer"
    ):  # by a draw of its own: all else stays as it was
        settings["thaw.policy"] = Random(f"thaws {seed}").choice(["timer", "roster", "census", "corner"])
    live = (
        settings["challenge_policy"] == "r_complete"
        and settings["neighbours"] == "connected"
        and settings["epochs"]
        and settings["lease_ms"] >= 20
    )
    heal_s = rng.uniform(2.0, 10.0)
    faults: list[Fault] = []
    if rng.random() >= CALM_SHARE:
        settings |= draw_radio(rng, settings["lease_ms"])
        faults = draw_faults(rng, settings["points"], settings["lambda_ms"] / 1e3, heal_s)
    latency = rng.choice([(0.0, 0.0), (0.0005, 0.0015), (0.0, 0.004)])
    return Scenario(seed, settings, latency, tuple(faults), heal_s, live)


def draw_settings(rng: Random, seed: int) -> dict[str, Any]:
    lambda_ms = rng.choice([50.0, 200.0, 500.0, 500.0, 1000.0])
    settings = {
        "shape": "random", "seed": seed, "points": round(2 ** rng.uniform(1, 6)), "lambda_ms": lambda_ms,
        "lease_ms": rng.choice([1.0, 20.0, 50.0, 250.0, 250.0, 250.0, 1000.0]),
        "m": rng.choice(["inf", "inf", 2]),
        "epsilon_deg": rng.choice([0.0, 1.0, 5.0, 5.0, 30.0]),
        "anchor": rng.choice(["lowest"] * 4 + ["largest", "smallest", "challenger", "random"]),
        "busy_join": rng.choice(["newcomer", "newcomer", "off", "all"]),
        "challenge_policy": rng.choice(["r_complete"] * 7 + ["decay"]),
        "neighbours": rng.choice(["connected"] * 7 + ["nearest"]),
        "epochs": rng.random() < 0.9,
        "neighbour_reply": rng.random() < 0.85,
        "thaw.policy": rng.choice(["timer", "timer", "off"]),
        "thaw.h_s": rng.uniform(0.5, 5.0),
        "thaw.spread": rng.choice([1.5, 2.0]),
        "deploy.start": rng.choice(["dispatcher", "dispatcher", "random"]),
    }  # fmt: skip
    if rng.random() < 0.2:
        settings["waiting_bound_ms"] = 10 * lambda_ms
    if rng.random() < 0.2:
        settings["accept_gap_ms"] = 20.0
    return settings


def draw_radio(rng: Random, lease_ms: float) -> dict[str, float]:
    """A random part of the radio's faults."""
    end = rng.choice(["", "_sender", "_receiver"])
    radio: dict[str, float] = {}
    if rng.random() < 0.6:
        radio[f"radio.loss{end}"] = rng.choice([0.02, 0.1, 0.3, 0.5])
    if rng.random() < 0.4:
        radio[f"radio.duplicate{end}"] = rng.uniform(0.02, 0.5)
    if rng.random() < 0.4:
        radio[f"radio.reorder{end}"] = rng.uniform(0.02, 0.5)
        radio["radio.reorder_ms"] = rng.uniform(1.0, 2 * lease_ms)
    if rng.random() < 0.3:
        radio["radio.delay_ms"] = rng.uniform(0.0, 4 * min(lease_ms, 500.0))
        radio["radio.jitter_ms"] = rng.uniform(0.0, radio["radio.delay_ms"])
    return radio


def draw_faults(rng: Random, count: int, lambda_s: float, heal_s: float) -> list[Fault]:
    """The schedule, in order of time; whoever is killed comes back before the healing is over."""
    faults: list[Fault] = []
    everyone = range(1, count + 1)
    if rng.random() < 0.5:
        for fid in rng.sample(everyone, rng.randint(1, max(1, count // 3))):
            died = rng.uniform(0.0, heal_s)
            back = min(died + rng.choice([0.01, 0.3, 2.0]), heal_s)
            faults += [Fault(died, "kill", (fid,)), Fault(back, "replace", (fid,))]
    if rng.random() < 0.2:
        moment = rng.uniform(0.0, heal_s)
        for fid in rng.sample(everyone, max(1, round(0.3 * count))):
            faults += [Fault(moment, "kill", (fid,)), Fault(heal_s, "replace", (fid,))]
    if rng.random() < 0.4:
        for _ in range(rng.randint(1, 5)):
            fids = tuple(rng.sample(everyone, rng.randint(1, max(1, count // 4))))
            faults.append(
                Fault(rng.uniform(0.0, heal_s), "hang", fids, lambda_s * 10 ** rng.uniform(-1.0, 1.0))
            )
    if rng.random() < 0.3:
        fids = tuple(rng.sample(everyone, rng.randint(1, max(1, count // 4))))
        faults.append(Fault(rng.uniform(0.0, heal_s), "slow", fids, rng.uniform(0.01, 0.5)))
    if rng.random() < 0.5:
        for _ in range(rng.randint(1, 3)):
            faults += draw_partition(rng, count, heal_s)
    return sorted(faults)


def draw_partition(rng: Random, count: int, heal_s: float) -> list[Fault]:
    """Halves, or one alone; amount 1: nothing gets out of the part either, 0: it hears but is not heard."""
    size = rng.choice([1, max(1, count // 2)])
    fids = tuple(rng.sample(range(1, count + 1), size))
    begins = rng.uniform(0.0, heal_s)
    amount = float(rng.random() < 0.7)
    return [
        Fault(begins, "cut", fids, amount),
        Fault(rng.uniform(begins, heal_s), "join", fids, amount),
    ]


# -- playing ---------------------------------------------------------------------------------------------------------


class Storm(World):
    """A world whose FLSs may hang, be slow, die, or be cut off."""

    def __init__(self, scenario: Scenario) -> None:
        self.frozen: dict[int, float] = {}  # FID -> until when nothing reaches its process
        self.slow: dict[int, float] = {}  # FID -> how late it may be
        self.cuts: list[tuple[frozenset[int], bool]] = []
        self.mood = Random(f"mood {scenario.seed}")
        self.deaf = False
        super().__init__(load_config(None, [], **scenario.settings), scenario.latency_s)

    def push(self, at: float, item: tuple) -> None:
        if self.order > EVENTS_MAX:
            raise Broken(f"more than {EVENTS_MAX} events: a storm of messages")
        late = self.slow.get(item[0], 0.0)
        super().push(
            max(at, self.frozen.get(item[0], 0.0)) + (self.mood.uniform(0.0, late) if late else 0.0), item
        )

    def hang(self, fid: int, until_s: float) -> None:
        """Whatever waits for this FLS waits until then."""
        self.frozen[fid] = max(until_s, self.frozen.get(fid, 0.0))
        mine = sorted(entry for entry in self.queue if entry[2][0] == fid)
        self.queue = [entry for entry in self.queue if entry[2][0] != fid]
        heapq.heapify(self.queue)
        for at, _, item in mine:
            self.push(at, item)

    def receive(self, fid: int, body: Any, message: Any, stamp: Any) -> None:
        for part, both in self.cuts:
            if message.sender in part and fid not in part:
                return
            if both and fid in part and message.sender not in part:
                return
        super().receive(fid, body, message, stamp)

    def strike(self, fault: Fault) -> None:
        """One fault happens now."""
        for fid in fault.fids:
            if fault.kind == "kill" and self.bodies[fid].alive:
                self.kill(fid)
                self.members.get(self.bodies[fid].machine.swarm, set()).discard(fid)
            elif fault.kind == "replace" and not self.bodies[fid].alive:
                self.frozen.pop(fid, None)
                self.replace(fid)
            elif fault.kind == "hang":
                self.hang(fid, self.now + fault.amount)
            elif fault.kind == "slow":
                self.slow[fid] = fault.amount
        part = (frozenset(fault.fids), bool(fault.amount))
        if fault.kind == "cut":
            self.cuts.append(part)
        elif fault.kind == "join" and part in self.cuts:
            self.cuts.remove(part)

    def heal(self) -> None:
        """Good weather from now on, and no thaw any more."""
        self.cuts.clear()
        self.slow.clear()
        for fid, body in self.bodies.items():
            if not body.alive:
                self.replace(fid)
        self.sender_rules = self.receiver_rules = EndRules()
        for body in self.bodies.values():
            body.machine.thaw_policy = Never()
            body.timers.pop(Timer.THAW, None)


def play(scenario: Scenario) -> Outcome:
    """Run a scenario to its end, or to what first goes wrong."""
    outcome = Outcome()
    world = watch = None
    try:
        world = Storm(scenario)
        watch = Recorder(world, not any(fault.kind in ("hang", "slow") for fault in scenario.faults))
        weather(world, scenario)
        if scenario.live:
            outcome.bound_s = liveness_bound_s(world)
            outcome.took_s = await_one_swarm(world, outcome.bound_s)
    except Exception as error:  # whatever it is, it is a finding
        outcome.failure = str(error) if isinstance(error, Broken) else f"{type(error).__name__}: {error}"
    if world is not None:
        outcome.at_s, outcome.events = world.now, world.events
    if watch is not None:
        outcome.last, outcome.digest, outcome.seen = list(watch.last), watch.digest, watch.seen
    return outcome


def weather(world: Storm, scenario: Scenario) -> None:
    """All faults at their time, then the healing."""
    for fault in scenario.faults:
        world.run(fault.at_s)
        world.strike(fault)
    world.run(scenario.heal_s)
    world.heal()


def liveness_bound_s(world: Storm) -> float:
    """L1: one swarm within 10 + 2 log2 F challenges' time, each with a flight as long as any (soaks took a third)."""
    rules = world.rules
    longest = world.plan.diagonal_cells + math.dist((0, 0, 0), max(world.points))
    speed, up, down = rules.velocity
    flight_s = min(math.sqrt(2 * longest * (1 / up + 1 / down)), longest / speed + speed / up)
    waiting = rules.waiting_bound_s if rules.waiting_bound_s < 1e6 else 2 * rules.lambda_s
    turns = 10 + 2 * math.log2(max(2, rules.count))
    hung = max(world.frozen.values(), default=0.0) - world.now
    return turns * (rules.lambda_s + flight_s) + 2 * waiting + 2 * rules.lease_s + max(0.0, hung)


def await_one_swarm(world: Storm, bound_s: float) -> float:
    """Emulated seconds until all are lit and one swarm. Raises Broken if that takes longer than `bound_s`."""
    healed = world.now
    step = max(world.rules.lambda_s / 4, 0.02)
    while world.now < healed + bound_s:
        if world.swarms() == 1 and all(body.lit for body in world.bodies.values()):
            return world.now - healed
        world.run(world.now + step)
    groups: dict[Any, list[int]] = {}
    for fid, body in world.bodies.items():
        groups.setdefault(tuple(body.machine.swarm), []).append(fid)
    states = {
        fid: body.machine.state.name for fid, body in world.bodies.items() if not body.machine.available
    }
    raise Broken(f"no single swarm {bound_s:.1f} s after the healing: {groups}, not Available: {states}")
