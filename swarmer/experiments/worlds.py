"""Seeded worlds full of faults on the virtual-time engine: what `swarmer simulate` plays (docs/simulate.md).

`draw(seed)` makes a world as data: a cloud, settings, and a schedule of faults, each kind only in some worlds and at a
rate of its own. `play` runs it with every invariant checked: faults until `calm_s`, then one swarm must form.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from random import Random
from typing import Any, NamedTuple

from swarmer.config import load_config, setting_facts
from swarmer.engines.virtual import VirtualEngine
from swarmer.errors import RunFailed
from swarmer.experiments.world_extras import draw_extras, draw_more_faults
from swarmer.experiments.world_watch import Nearer
from swarmer.faults import Fault, Schedule
from swarmer.observe.invariants import Checks, one_swarm_is_promised, one_swarm_within_s
from swarmer.observe.invariants.liveness import OneSwarm
from swarmer.plan import Plan, make_plan

CALM_SHARE = 0.1  # worlds without any fault
EVENTS_MAX = 500_000
DEFAULTS = {fact.name: fact.default for fact in setting_facts()}
THAW_POLICIES = next(fact.words for fact in setting_facts() if fact.name == "thaw.policy")


class World(NamedTuple):
    """Everything that `play` needs, as data."""

    seed: int
    settings: dict[str, Any]
    schedule: Schedule

    def words(self) -> str:
        """One line about it."""
        s = DEFAULTS | self.settings
        kinds = sorted({fault.what for fault in self.schedule.faults})
        radio = [name.removeprefix("radio.") for name in self.settings if name.startswith("radio.")]
        return (
            f"F {s['points']}, λ {s['lambda_ms']:g}, δ {s['lease_ms']:g} ms, M {s['m']}, ε {s['epsilon_deg']:g}°, "
            f"{s['anchor']}, {s['challenge_policy']}, thaw {s['thaw.policy']}, join {s['busy_join']}, "
            f"faults: {', '.join(kinds + radio) or 'none'}"
        )


@dataclass
class Outcome:
    """How a world went; `failure` is None if all held."""

    failure: str | None = None
    invariant: str = ""  # the broken one's name
    at_s: float = 0.0
    events: int = 0
    digest: str = ""  # over every event in order
    took_s: float | None = None  # emulated seconds from the calm to one swarm
    bound_s: float = 0.0
    stands: str = ""  # how it stood at the end, in words
    last: list[str] = field(default_factory=list)
    seen: Counter[str] = field(default_factory=Counter)  # how often an invariant had something to look at


# -- drawing ---------------------------------------------------------------------------------------------------------


def draw(seed: int, given: Mapping[str, Any] | None = None) -> World:
    """The world of a seed. given: settings by name that every world has, in place of what is drawn."""
    fixed = dict(given or {})
    rng = Random(f"soak {seed}")
    settings = draw_settings(rng, seed) | fixed
    calm_s = rng.uniform(2.0, 8.0)
    faults: list[Fault] = []
    faulty = rng.random() >= CALM_SHARE
    if faulty:
        settings |= draw_radio(rng, settings["lease_ms"])
        settings |= draw_failures(rng)
        faults = draw_faults(rng, settings["points"], settings["lambda_ms"] / 1e3, calm_s)
    settings |= draw_oracles(Random(f"soak oracle {seed}"), settings["points"])
    settings |= draw_transition(Random(f"soak shape {seed}"), settings, calm_s)
    settings |= draw_battery(Random(f"soak battery {seed}"), settings)
    settings |= draw_extras(seed, settings, calm_s, faulty) | fixed
    if faulty:
        more = Random(f"soak air {seed}")
        faults += draw_more_faults(more, settings["points"], settings["lambda_ms"] / 1e3, calm_s)
        faults.sort(key=lambda fault: fault.at_s)
    return World(seed, settings | fixed, Schedule(tuple(faults), calm_s))


def draw_battery(rng: Random, settings: dict[str, Any]) -> dict[str, Any]:
    """In some of the worlds the FLSs must charge, with or without standbys."""
    if rng.random() > 0.15:
        return {}
    battery = {"battery.light_s": rng.uniform(1.0, 6.0), "battery.charge_s": rng.uniform(0.1, 1.0)}
    if rng.random() < 0.5:
        battery["battery.flight_s"] = rng.uniform(2.0, 6.0)
    battery["battery.standby_group"] = rng.choice([0, 1, 3, 5])
    return battery


def draw_oracles(rng: Random, points: int) -> dict[str, Any]:
    """In some of the worlds a few FLSs know where they are."""
    return {"oracle.count": min(points, rng.choice([1, 1, 2, 3]))} if rng.random() < 0.2 else {}


def draw_transition(rng: Random, settings: dict[str, Any], calm_s: float) -> dict[str, Any]:
    """In some of the worlds with epochs the display becomes another shape before the calm, of any count near."""
    if rng.random() > 0.2 or not settings["epochs"]:
        return {}
    points = max(2, round(settings["points"] * rng.uniform(0.6, 1.6)))
    at_s = rng.uniform(0.1, calm_s)
    return {"transition.shape": "cube", "transition.points": points, "transition.at_s": at_s}


def draw_settings(rng: Random, seed: int) -> dict[str, Any]:
    lambda_ms = rng.choice([50.0, 200.0, 500.0, 500.0, 1000.0])
    low, high = rng.choice([(0.0, 0.0), (0.5, 1.5), (0.5, 1.5), (0.0, 4.0), (10.0, 50.0)])
    most = 6 if lambda_ms >= 200 else 4.5  # a power of two: many who challenge often are a lot of work
    settings = {
        "engine": "virtual", "shape": "random", "seed": seed, "points": round(2 ** rng.uniform(1, most)),
        "virtual.latency_min_ms": low, "virtual.latency_max_ms": high, "lambda_ms": lambda_ms,
        "virtual.handling_ms": rng.choice([0.0, 0.0, 0.2, 2.0]),
        "lease_ms": rng.choice([1.0, 20.0, 50.0, 250.0, 250.0, 250.0, 1000.0]),
        "lease_margin_ms": rng.choice([0.0, 0.0, 100.0]),
        "m": rng.choice(["inf", "inf", 2]),
        "epsilon_deg": rng.choice([0.0, 1.0, 5.0, 5.0, 30.0]),
        "anchor": rng.choice(["lowest"] * 4 + ["largest", "smallest", "challenger", "random"]),
        "busy_join": rng.choice(["newcomer", "newcomer", "off", "all"]),
        "challenge_policy": rng.choice(["r_complete"] * 7 + ["decay"]),
        "probe_every": rng.choice([8, 8, 8, 1, 0]),
        "neighbours": rng.choice(["connected"] * 7 + ["nearest"]),
        "epochs": rng.random() < 0.9,
        "neighbour_reply": rng.random() < 0.85,
        "thaw.policy": rng.choice(THAW_POLICIES),
        "thaw.h_s": rng.uniform(0.5, 5.0),
        "thaw.spread": rng.choice([1.5, 2.0]),
        "thaw.repeat": rng.choice([0.0, 0.5]),
        "waiting_ends": rng.choice(["bound"] * 7 + ["tick"]),
        "deploy.start": rng.choice(["dispatcher", "dispatcher", "random"]),
        "sensing.sample_ms": rng.choice([0.0, 0.0, 20.0]),
    }  # fmt: skip
    if settings["thaw.policy"] not in ("timer", "centralized", "off"):  # all others count by epochs
        settings["epochs"] = True
    if rng.random() < 0.2:
        settings["waiting_bound_ms"] = 10 * lambda_ms
    if rng.random() < 0.2:
        settings |= {"accept_gap_ms": 20.0, "challenge_on_available": rng.random() < 0.5}
    if rng.random() < 0.3:
        settings |= {"sensing.model": rng.choice(["uniform", "mixed"]), "sensing.error_percent": 10.0}
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


def draw_failures(rng: Random) -> dict[str, float]:
    failures: dict[str, float] = {}
    if rng.random() < 0.15:
        failures["failure.rate"] = rng.uniform(0.01, 0.2)
    if rng.random() < 0.1:
        failures["failure.battery_s"] = rng.uniform(1.0, 6.0)
    return failures


def draw_faults(rng: Random, count: int, lambda_s: float, calm_s: float) -> list[Fault]:
    """The schedule, in order of time."""
    faults: list[Fault] = []
    everyone = range(1, count + 1)

    def some(share: int) -> tuple[int, ...]:
        return tuple(sorted(rng.sample(everyone, rng.randint(1, max(1, count // share)))))

    if rng.random() < 0.5:
        faults += [
            Fault(rng.uniform(0.0, calm_s), "kill", (fid,), rng.choice([0.01, 0.3, 2.0])) for fid in some(3)
        ]
    if rng.random() < 0.2:
        fids = tuple(sorted(rng.sample(everyone, max(1, round(0.3 * count)))))
        faults.append(Fault(rng.uniform(0.0, calm_s), "kill", fids))
    if rng.random() < 0.4:
        for _ in range(rng.randint(1, 5)):
            length_s = lambda_s * 10 ** rng.uniform(-1.0, 1.0)
            faults.append(Fault(rng.uniform(0.0, calm_s), "hang", some(4), length_s))
    if rng.random() < 0.3:
        faults.append(Fault(rng.uniform(0.0, calm_s), "slow", some(4), calm_s, rng.uniform(0.01, 0.5)))
    if rng.random() < 0.5:
        for _ in range(rng.randint(1, 3)):
            part = tuple(sorted(rng.sample(everyone, rng.choice([1, max(1, count // 2)]))))
            way = rng.choice(["both", "both", "out", "in"])
            faults.append(Fault(rng.uniform(0.0, calm_s), "cut", part, rng.uniform(0.0, calm_s), way=way))
    return sorted(faults)


# -- playing ---------------------------------------------------------------------------------------------------------


class Onlooker:
    """The observer of a world: ends it once all are one swarm, or where messages breed messages."""

    def __init__(self, checks: Checks | None = None) -> None:
        self.checks = checks
        self.last: Any = None  # the latest sample
        self.events: list[Any] = []

    def planned(self, plan: Plan) -> None:
        pass

    def launching(self, ready: int, total: int) -> None:
        pass

    def go(self, launch_s: float) -> None:
        pass

    def beat(self, t_s: float) -> None:
        pass

    def sample(self, snapshot: Any) -> bool:
        self.last = snapshot
        if self.checks is None:
            return False
        if self.checks.events > EVENTS_MAX:
            raise RunFailed(f"more than {EVENTS_MAX} events: a storm of messages")
        return self.checks.look_for_one_swarm(snapshot.t_s)

    def event(self, event: Any) -> None:
        self.events.append(event)


def plan_of(world: World) -> Plan:
    """The world's plan: it lasts until one swarm must have formed."""
    plan = make_plan(load_config(None, [], **world.settings))
    calm_s = world.schedule.calm_s or 0.0
    rest_s = one_swarm_within_s(plan) if one_swarm_is_promised(plan) else 1.0
    return make_plan(plan.config.changed(duration_s=calm_s + rest_s + 1e-3))


def play(world: World, until_s: float | None = None) -> Outcome:
    """Run a world to its end, or to what first goes wrong, or to `until_s`, emulated. Raises BadInput."""
    plan = plan_of(world)
    if until_s is not None:
        plan = make_plan(plan.config.changed(duration_s=min(until_s, plan.config.duration_s)))
    checks = Checks(plan, world.schedule)
    outcome = Outcome(bound_s=one_swarm_within_s(plan))
    onlooker, nearer = Onlooker(checks), Nearer()
    foreign = not plan.rules.technique.startswith("swarmer.")
    try:
        with VirtualEngine(plan, (checks, nearer) if foreign else (checks,), world.schedule) as engine:
            result = engine.run(onlooker)
    except Exception as error:  # whatever it is, it is a finding
        outcome.invariant = type(error).__name__
        outcome.failure = str(error) if isinstance(error, RunFailed) else f"{outcome.invariant}: {error}"
        outcome.events, outcome.at_s = checks.events, checks.now_s
        return outcome
    if result.status == "interrupted":
        raise KeyboardInterrupt
    if onlooker.last is not None:
        lit = onlooker.last.swarm[onlooker.last.lit].tolist()
        outcome.stands = f"{len(lit)} lit, {len(set(lit))} swarms"
    if result.status != "done":
        outcome.failure = result.message or result.status
        outcome.invariant, outcome.at_s = outcome.failure.partition(":")[0], checks.now_s
    if checks.broken is not None:
        outcome.invariant, outcome.last = checks.broken.invariant.name, result.extra["violation"]["last"]
        outcome.at_s = checks.broken.t_s
    wrong = nearer.wrong()
    if wrong and outcome.invariant in ("", OneSwarm.name):  # that none forms comes of it
        outcome.failure, outcome.invariant, outcome.at_s = wrong, "technique", checks.now_s
    outcome.events, outcome.digest = checks.events, result.extra["trace_sha256"]
    if one_swarm_is_promised(plan) and checks.facts.single_s is not None:
        outcome.took_s = checks.facts.single_s - (world.schedule.calm_s or 0.0)
    outcome.seen = Counter({invariant.name: invariant.looked for invariant in checks.invariants})
    return outcome
