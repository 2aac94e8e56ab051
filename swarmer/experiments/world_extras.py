"""What a world has besides: every other setting that the virtual-time engine heeds, and every other kind of fault.

Each group is drawn from a stream of its own, in some of the worlds only; so what is added here moves no draw of another
group. Worlds that have shown a fault are kept whole (tests/simulation/found), and not drawn again.
"""

from __future__ import annotations

from collections.abc import Callable
from random import Random
from typing import Any

from swarmer.faults import Fault
from swarmer.messages import CHALLENGE_ACCEPT, CHALLENGE_ACK, CHALLENGE_FIN, CHALLENGE_INIT, Kind

Drawn = dict[str, Any]
SHAPES = ("sphere", "cube", "butterfly", "cat", "chess")  # besides a random cloud; two of them are flat
FAST = ("speed_m_s", "acceleration_m_s2", "braking_m_s2")
KINDS = tuple(int(kind) for kind in Kind if kind is not Kind.CONTROL)
PAIRING = (CHALLENGE_INIT, CHALLENGE_ACCEPT, CHALLENGE_ACK, CHALLENGE_FIN)


def draw_extras(seed: int, settings: Drawn, calm_s: float, faulty: bool) -> Drawn:
    """More settings of the world that has these ones. faulty: it is one in which something goes wrong."""

    def rng(what: str) -> Random:
        return Random(f"soak {what} {seed}")

    extras = draw_place(rng("place"), settings["points"], calm_s)
    if "transition.shape" in settings:
        extras["transition.shape"] = rng("next shape").choice(["cube", "sphere", "cat", "chess"])
    extras |= draw_rules(
        rng("rules"), min(settings["points"], settings.get("transition.points", settings["points"]))
    )
    extras |= draw_range(rng("range"))
    extras |= draw_body(rng("body"), settings)
    if faulty:
        extras |= draw_noise(rng("noise"), settings)
        extras |= draw_dispatcher(rng("dispatcher"))
    return extras


def draw_place(rng: Random, points: int, calm_s: float) -> Drawn:
    """The shape, and how it is launched. By the calm all are in the air."""
    place: Drawn = {}
    if rng.random() < 0.3:
        place["shape"] = rng.choice(SHAPES)
    if rng.random() < 0.2:
        count = rng.choice([2, 3])
        place["deploy.dispatchers"] = [
            [round(rng.uniform(-5.0, 25.0), 3) for _ in range(3)] for _ in range(count)
        ]
    if rng.random() < 0.2:
        place["deploy.rate_per_s"] = points / (calm_s * rng.uniform(0.05, 0.8))
    if rng.random() < 0.15:
        place["deploy.error"] = "shared"
    return place


def draw_rules(rng: Random, points: int) -> Drawn:
    """Rules of the protocol. points: of the smallest shape."""
    rules: Drawn = {}
    if rng.random() < 0.2:
        rules["technique"] = "physical_movement"
    if rng.random() < 0.1:
        rules["challenge_policy"] = "always"
    if rng.random() < 0.3:
        rules["challenge_decay"] = rng.uniform(1.0, 2.0)
    if rng.random() < 0.15:
        rules["eta"] = min(points - 1, rng.choice([1, 2, 3, 8]))
    if rng.random() < 0.15:
        rules["flight_threshold_cells"] = rng.choice([0.0, 0.1, 1.0])
    if rng.random() < 0.15:
        rules["thaw.rest_below_cells"] = rng.choice([0.0, 0.1, 2.0])
    return rules


def draw_range(rng: Random) -> Drawn:
    """How far challenges reach."""
    reach: Drawn = {}
    if rng.random() < 0.15:
        reach["range.start_cells"] = rng.choice([0.1, 1.0, 5.0, 50.0])
    if rng.random() < 0.15:
        reach["range.step_cells"] = rng.choice([0.0, 1.0, 20.0])
    if rng.random() < 0.1:
        reach["range.max_cells"] = rng.choice([60.0, 200.0])
    if rng.random() < 0.15:
        reach["range.measured"] = "estimated"
    return reach


def draw_body(rng: Random, settings: Drawn) -> Drawn:
    """How an FLS senses, flies and uses its battery."""
    body: Drawn = {}
    if rng.random() < 0.15:
        body |= {"sensing.samples": rng.choice([2, 5]), "sensing.average": rng.choice(["mean", "median"])}
    if "sensing.model" in settings and rng.random() < 0.5:
        body["sensing.accurate_probability"] = rng.choice([0.0, 0.5, 1.0])
    if rng.random() < 0.2:
        body |= {f"flight.{name}": rng.choice([2.0, 10.0, 100.0, 1000.0]) for name in FAST}
    if rng.random() < 0.1:
        body["flight.cell_m"] = rng.choice([0.01, 0.2])
    if rng.random() < 0.15:
        body["flight.dead_reckoning"] = rng.choice(["one_sided", "one_sided_random"])
    if "battery.light_s" in settings:
        body["battery.reserve"] = rng.choice([0.0, 0.2, 0.5])
        body["battery.stagger"] = rng.random() < 0.7
    return body


def draw_noise(rng: Random, settings: Drawn) -> Drawn:
    """What else the radio does."""
    noise: Drawn = {}
    if rng.random() < 0.25:
        loss = max(settings.get(f"radio.loss{end}", 0.0) for end in ("", "_sender", "_receiver"))
        noise |= {"radio.burst": rng.choice([3, 20]), "radio.burst_loss": rng.uniform(max(0.5, loss), 1.0)}
    if rng.random() < 0.2:
        noise["radio.dead_links"] = rng.choice([0.02, 0.1, 0.3])
    if rng.random() < 0.1:
        noise["radio.mac"] = True
    return noise


def draw_dispatcher(rng: Random) -> Drawn:
    """What the dispatcher does about the dead and those who hang."""
    dispatcher: Drawn = {}
    if rng.random() < 0.1:
        dispatcher["failure.replace"] = False
    if rng.random() < 0.2:
        dispatcher["failure.hang_s"] = rng.choice([0.05, 0.3, 2.0])
    return dispatcher


def draw_more_faults(rng: Random, count: int, lambda_s: float, calm_s: float) -> list[Fault]:
    """On the air, of sensors, and of whole swarms; each kind in some worlds only, at most three of a kind."""
    faults: list[Fault] = []

    def some(share: int = 1) -> tuple[int, ...]:
        return tuple(sorted(rng.sample(range(1, count + 1), rng.randint(1, max(1, count // share)))))

    def when() -> tuple[float, float]:
        return rng.uniform(0.0, calm_s), lambda_s * 10 ** rng.uniform(-1.0, 1.0)

    def on_the_air(what: str, **more: Any) -> Fault:
        at_s, for_s = when()
        way = rng.choice(["both", "out", "in"])
        kinds = rng.choice([(), (), tuple(rng.sample(KINDS, 2)), (rng.choice(PAIRING),)])
        source = some() if way == "in" and rng.random() < 0.5 else ()
        return Fault(at_s, what, some(), for_s, way=way, kinds=tuple(sorted(kinds)), source=source, **more)

    air: dict[str, Callable[[], Drawn]] = {
        "loss": lambda: {"p": rng.choice([0.3, 0.9, 1.0]), "burst": rng.choice([0.0, 0.0, 5.0])},
        "delay": lambda: {"delay_s": rng.uniform(0.0, 1.0), "jitter_s": rng.uniform(0.0, 0.5)},
        "duplicate": lambda: {"p": rng.uniform(0.1, 1.0)},
        "reorder": lambda: {"p": rng.uniform(0.1, 1.0), "delay_s": rng.uniform(0.0, 0.5)},
    }
    sensors: dict[str, Callable[[], Drawn]] = {
        "bias": lambda: {"by": rng.uniform(-5.0, 5.0)},
        "outliers": lambda: {"p": rng.uniform(0.1, 1.0), "by": rng.choice([-2.0, 0.0, 10.0])},
        "dead_sensor": dict,
    }
    for what, drawn in air.items():
        if rng.random() < 0.2:
            faults += [on_the_air(what, **drawn()) for _ in range(rng.randint(1, 3))]
    for what, drawn in sensors.items():
        if rng.random() < 0.15:
            at_s, for_s = when()
            faults.append(Fault(at_s, what, some(), for_s, **drawn()))
    if rng.random() < 0.25:
        at_s, for_s = when()
        what = rng.choice(["kill", "kill", "hang", "slow"])
        late_s = rng.uniform(0.01, 0.5) if what == "slow" else 0.0
        faults.append(Fault(at_s, what, (), for_s, late_s, swarm_of=rng.randint(1, count)))
    return faults
