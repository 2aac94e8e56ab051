"""Seeded worlds full of faults, in virtual time, for as long as told: `soak.py --seconds N [--seed S]`.

Every seed is a world (tests/simulation/worlds.py), played with every invariant checked. A failing one is printed
with the command that replays it and with the faults that it needs to fail; exit status 1 if there was any.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests" / "simulation"))

from worlds import Outcome, World, draw, play  # noqa: E402

from swarmer.faults import Schedule, shrink, to_yaml  # noqa: E402

EVERY_S = 5.0  # between two lines of progress
SHRINK_S = 60.0  # wall seconds, at most, to find what a failing world needs


def main(arguments: list[str]) -> int:
    """The exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="how long, wall seconds (default 60)")
    parser.add_argument("--seed", type=int, help="the first seed (default: by the clock)")
    parser.add_argument("--once", action="store_true", help="only that one seed, told in full")
    options = parser.parse_args(arguments)
    # By the clock, far apart for two that begin a second apart, and within what a run takes for its seed.
    seed = int(time.time()) * 100_003 % 2**31 if options.seed is None else options.seed
    return once(seed) if options.once else soak(seed, options.seconds)


def once(seed: int) -> int:
    """Replay one world and tell how it went."""
    world = draw(seed)
    print(f"seed {seed}: {world.words()}")
    print(f"settings: {world.settings}")
    print(to_yaml(world.schedule), end="")
    outcome = play(world)
    if outcome.failure:
        print("the last events of those concerned:", *outcome.last, sep="\n  ")
        print(f"FAILED at {outcome.at_s:.4f} s, event {outcome.events}: {outcome.failure}")
    else:
        print(f"held: {outcome.events} events, {told(outcome)}, sha256 {outcome.digest[:16]}")
    return 1 if outcome.failure else 0


def told(outcome: Outcome) -> str:
    """How long one swarm took."""
    if outcome.took_s is None:
        return "no promise of one swarm"
    return f"one swarm {outcome.took_s:.2f} s after the healing (at most {outcome.bound_s:.1f} s)"


def soak(seed: int, seconds: float) -> int:
    """World after world; a line every 5 s."""
    began = spoke = time.monotonic()
    first, events, failed, slowest = seed, 0, 0, 0.0
    print(f"soak: seeds from {first}, {seconds:g} s", flush=True)
    while time.monotonic() - began < seconds:
        world = draw(seed)
        outcome = play(world)
        events += outcome.events
        if outcome.failure:
            failed += 1
            report(world, outcome)
        elif outcome.took_s is not None:
            slowest = max(slowest, outcome.took_s / outcome.bound_s)
        seed += 1
        if time.monotonic() - spoke >= EVERY_S:
            spoke = time.monotonic()
            print(line(seed - first, failed, events, spoke - began, slowest), flush=True)
    print(line(seed - first, failed, events, time.monotonic() - began, slowest))
    return 1 if failed else 0


def report(world: World, outcome: Outcome) -> None:
    """A failing world, what it needs to fail, and how to see it again."""
    print(f"FAILED seed {world.seed} at {outcome.at_s:.3f} s: {outcome.failure}")
    print(f"  {world.words()}")
    print(f"  replay: python scripts/soak.py --seed {world.seed} --once", flush=True)

    def fails(schedule: Schedule) -> bool:
        again = play(world._replace(schedule=schedule))
        return again.failure is not None and again.invariant == outcome.invariant

    small = shrink(world.schedule, fails, SHRINK_S)
    print(f"  fails with {len(small.faults)} of its {len(world.schedule.faults)} faults:")
    print("  " + to_yaml(small).replace("\n", "\n  ").rstrip(), flush=True)


def line(worlds: int, failed: int, events: int, seconds: float, slowest: float) -> str:
    """Where the soak stands."""
    return (
        f"{seconds:6.0f} s  {worlds} worlds, {failed} failed, {events} events, "
        f"one swarm after at most {100 * slowest:.0f} % of its bound"
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
