"""Seeded worlds full of faults, in virtual time, for as long as told: `soak.py --seconds N [--seed S]`.

Every seed is a world (tests/simulation/chaos.py). A failing one is printed with the command that replays it; exit
status 1 if there was any.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests" / "simulation"))

from chaos import Outcome, draw, play  # noqa: E402

EVERY_S = 5.0  # between two lines of progress


def main(arguments: list[str]) -> int:
    """The exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="how long, wall seconds (default 60)")
    parser.add_argument("--seed", type=int, help="the first seed (default: by the clock)")
    parser.add_argument("--once", action="store_true", help="only that one seed, told in full")
    options = parser.parse_args(arguments)
    seed = int(time.time()) * 1000 if options.seed is None else options.seed
    return once(seed) if options.once else soak(seed, options.seconds)


def once(seed: int) -> int:
    """Replay one world and tell how it went."""
    scenario = draw(seed)
    print(f"seed {seed}: {scenario.words()}")
    print(f"settings: {scenario.settings}")
    for fault in scenario.faults:
        print(f"  {fault.at_s:8.4f} s  {fault.kind:8} {list(fault.fids)} {fault.amount:.3g}")
    print(f"  {scenario.heal_s:8.4f} s  healed")
    outcome = play(scenario)
    if outcome.failure:
        print("the last events:", *outcome.last, sep="\n  ")
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
        scenario = draw(seed)
        outcome = play(scenario)
        events += outcome.events
        if outcome.failure:
            failed += 1
            report(seed, scenario.words(), outcome)
        elif outcome.took_s is not None:
            slowest = max(slowest, outcome.took_s / outcome.bound_s)
        seed += 1
        if time.monotonic() - spoke >= EVERY_S:
            spoke = time.monotonic()
            print(line(seed - first, failed, events, spoke - began, slowest), flush=True)
    print(line(seed - first, failed, events, time.monotonic() - began, slowest))
    return 1 if failed else 0


def report(seed: int, words: str, outcome: Outcome) -> None:
    """A failing seed, and how to see it again."""
    print(f"FAILED seed {seed} at {outcome.at_s:.3f} s: {outcome.failure}")
    print(f"  {words}")
    print(f"  replay: python scripts/soak.py --seed {seed} --once", flush=True)


def line(worlds: int, failed: int, events: int, seconds: float, slowest: float) -> str:
    """Where the soak stands."""
    return (
        f"{seconds:6.0f} s  {worlds} worlds, {failed} failed, {events} events, "
        f"one swarm after at most {100 * slowest:.0f} % of its bound"
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
