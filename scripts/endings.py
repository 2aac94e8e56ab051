"""Ends runs in every way at random moments: `endings.py --count N [--seed S]`; needs Linux.

Ctrl-C once and twice, SIGTERM, SIGHUP, SIGKILL, a killed dispatcher, a disk that is full, no shared memory, few files,
a call that fails (tests/processes/endings.py). After each nothing may be left. Exit status 1 if something was.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests" / "processes"))

from endings import draw, play  # noqa: E402

EVERY_S = 5.0  # between two lines of progress


def main(arguments: list[str]) -> int:
    """The exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=30, help="how many runs (default 30)")
    parser.add_argument("--seed", type=int, help="the first seed (default: by the clock)")
    options = parser.parse_args(arguments)
    first = int(time.time()) * 1000 if options.seed is None else options.seed
    bad, spoke = 0, time.monotonic()
    for seed in range(first, first + options.count):
        with tempfile.TemporaryDirectory(prefix="swarmer-") as room:
            wrong = play(draw(seed), Path(room))
        if wrong is not None:
            bad += 1
            print(f"seed {seed}: {draw(seed).words()}: {wrong}", flush=True)
        if time.monotonic() - spoke > EVERY_S:
            spoke = time.monotonic()
            print(f"{seed - first + 1} runs ended, {bad} of them badly", flush=True)
    print(f"{options.count} runs ended, {bad} of them badly")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
