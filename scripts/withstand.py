"""What CI runs beside the suite: so many worlds, fault schedules and hostile inputs, of fixed seeds and of fresh ones.

`withstand.py`: worlds of `swarmer simulate` (fixed seeds from 1 on, then fresh ones by the clock), schedules of twelve
drawn faults of every kind after which one swarm must form, and the inputs of `fuzz.py`. A line for each, with its count
and cost; what fails is told with the command that plays it alone. The exit status is 1 if a fixed seed fails: a fresh
one tells of a fault that may be old, and would blame whoever comes along (`--strict` does).
`withstand.py --schedule N` plays the schedule of one seed.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterable, Iterator
from random import Random
from typing import NamedTuple

from fuzz import PARTS

from swarmer.config import load_config
from swarmer.errors import BadInput
from swarmer.experiments.worlds import Outcome, World, draw, play
from swarmer.fault_settings import draw_fault
from swarmer.faults import from_data, to_yaml
from swarmer.plan import make_plan
from swarmer.streams import stream

WORLDS, FRESH, SCHEDULES = 1500, 50, 1000
FAULTS, FAULTS_UNTIL_S, CALM_S, POINTS = 12, 6.0, 7.0, 30
POLICIES = ("timer", "roster", "census", "off")
EVERY_S = 60.0  # between two lines that say where it stands


class Played(NamedTuple):
    """One that was played, and how it can be played again."""

    command: str
    outcome: Outcome


def worlds(seeds: Iterable[int]) -> Iterator[Played]:
    """The worlds of these seeds."""
    for seed in seeds:
        try:
            outcome = play(draw(seed))
        except BadInput as error:
            outcome = Outcome(failure=f"a world that no engine takes: {error}")
        yield Played(f"swarmer simulate --seed {seed}", outcome)


def schedule(seed: int) -> World:
    """A display and twelve faults of any kind, then the calm."""
    settings = {
        "engine": "virtual", "shape": "dragon", "points": POINTS, "seed": seed, "thaw.h_s": 3.0,
        "thaw.policy": POLICIES[seed % len(POLICIES)],
    }  # fmt: skip
    points = make_plan(load_config(None, [], **settings)).cloud.points.tolist()
    rng = stream(seed, "faults")
    rows = [draw_fault(rng, FAULTS_UNTIL_S, 0.5) for _ in range(FAULTS)]
    return World(seed, settings, from_data({"faults": rows, "calm": CALM_S}, POINTS, points, seed))


def schedules(seeds: Iterable[int]) -> Iterator[Played]:
    """The schedules of these seeds; every one of them must end in one swarm."""
    for seed in seeds:
        outcome = play(schedule(seed))
        if outcome.failure is None and outcome.took_s is None:
            outcome.failure = "no single swarm in time"
        yield Played(f"python scripts/withstand.py --schedule {seed}", outcome)


def count(name: str, played: Iterable[Played]) -> int:
    """Play them all; how many failed. Prints each that did, and a line at the end."""
    began, spoke, number, events, slowest, failed = time.process_time(), time.monotonic(), 0, 0, 0.0, 0

    def line() -> str:
        return (
            f"{name}: {number:,} played, {failed} failed, {events:,} events, one swarm at most {slowest:.1f} s after "
            f"the calm; {time.process_time() - began:.0f} s of processor time"
        )

    for one in played:
        number += 1
        events += one.outcome.events
        slowest = max(slowest, one.outcome.took_s or 0.0)
        if one.outcome.failure is not None:
            failed += 1
            print(f"FAILED {one.outcome.failure}\n  play it: {one.command}", flush=True)
        if time.monotonic() - spoke >= EVERY_S:
            spoke = time.monotonic()
            print(line(), file=sys.stderr, flush=True)
    print(line(), flush=True)
    return failed


def inputs(seed: int, share: float) -> int:
    """The hostile inputs of `fuzz.py`, a share of its counts; how many parts failed."""
    failed = 0
    for name, (part, whole) in PARTS.items():
        number, began = round(share * whole), time.process_time()
        try:
            found = part(Random(f"{name} {seed}"), number)
        except Exception as error:
            failed += 1
            alone = " ".join(f"--{other} {number if other == name else 0}" for other in PARTS)
            print(f"FAILED {name}: {type(error).__name__}: {error}")
            print(f"  play it: python scripts/fuzz.py --seed {seed} {alone}", flush=True)
            continue
        print(
            f"{name}: {number:,} inputs, {time.process_time() - began:.0f} s of processor time: {found}",
            flush=True,
        )
    return failed


def play_schedule(seed: int) -> int:
    """Tell how the schedule of one seed goes; the exit status."""
    world = schedule(seed)
    print(to_yaml(world.schedule), end="")
    (one,) = schedules([seed])
    for line in one.outcome.last:
        print(f"  {line}")
    print(f"FAILED {one.outcome.failure}" if one.outcome.failure else f"held: {one.outcome.stands}")
    return 1 if one.outcome.failure else 0


def main(arguments: list[str]) -> int:
    """The exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--worlds", type=int, default=WORLDS, help=f"of fixed seeds (default {WORLDS:,})")
    parser.add_argument("--fresh", type=int, default=FRESH, help=f"worlds of fresh seeds (default {FRESH})")
    parser.add_argument(
        "--schedules", type=int, default=SCHEDULES, help=f"of fixed seeds (default {SCHEDULES:,})"
    )
    parser.add_argument(
        "--inputs", type=float, default=1.0, help="share of the counts of fuzz.py (default 1)"
    )
    parser.add_argument("--strict", action="store_true", help="what a fresh seed finds is a failure, too")
    parser.add_argument("--schedule", type=int, metavar="SEED", help="play this one alone")
    options = parser.parse_args(arguments)
    if options.schedule is not None:
        return play_schedule(options.schedule)
    fresh = int(time.time()) * 100_003 % 2**30  # as `swarmer simulate` begins
    failed = count("worlds", worlds(range(1, options.worlds + 1)))
    found = count(f"fresh worlds from {fresh} on", worlds(range(fresh, fresh + options.fresh)))
    failed += count("schedules", schedules(range(1, options.schedules + 1)))
    failed += inputs(1, options.inputs)
    found += inputs(fresh, options.inputs / 10)
    if found:
        print(
            f"FRESH SEEDS HAVE FOUND {found} THAT FAIL, AS TOLD ABOVE; what was changed last need not be why"
        )
    return 1 if failed or (found and options.strict) else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
