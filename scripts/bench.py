"""Print the speed tables, measured here and now: `bench.py TABLE`, or `all`; `--help` has their names.

Everything is measured by real runs of the real pieces; where two things are compared they are measured in one go and
given as a ratio, for the ratio travels from machine to machine better than the figure.
"""

from __future__ import annotations

import argparse
import importlib
import subprocess
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

# Where each table is made, and how often it is measured if nobody says so: whole runs take minutes.
TABLES = {
    "micro": ("bench.micro:run", 3),
    "datagrams": ("bench.datagrams:run", 3),
    "clouds": ("bench.shapes:run", 1),
    "virtual": ("bench.virtual:run", 1),
    "recording": ("bench.recording:run", 1),
    "rounds": ("bench.rounds:run", 1),
    "hausdorff": ("bench.hausdorff:run", 3),
    "launch": ("bench.launch:run", 1),
    "sweep": ("bench.sweep:run", 1),
    "loops": ("bench.loops:run", 1),
    "cluster": ("bench.cluster:run", 1),
    "shapes": ("bench.full_runs:shapes", 1),
    "authors": ("bench.full_runs:authors", 1),
    "cores": ("bench.cores:pinned", 1),
    "large": ("bench.cores:large", 1),
}


def main(arguments: list[str]) -> int:
    """The exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("table", nargs="?", choices=[*TABLES, "all"], default="all", help="default: all")
    parser.add_argument(
        "--repeat", type=int, metavar="N", help="measure so often, and give medians (default 3, whole runs 1)"
    )
    parser.add_argument("--bare", action="store_true", help=argparse.SUPPRESS)  # without the machine's line
    options = parser.parse_args(arguments)
    if not options.bare:
        from bench.tables import machine_line

        print(machine_line(), flush=True)
    if options.table == "all":
        return max(alone(name, options.repeat) for name in TABLES)
    began = time.monotonic()
    place, usual = TABLES[options.table]
    module, _, function = place.partition(":")
    getattr(importlib.import_module(module), function)(max(1, options.repeat or usual))
    print(f"  ({options.table}: {time.monotonic() - began:.0f} s)", flush=True)
    return 0


def alone(name: str, repeat: int | None) -> int:
    """A table in a process of its own: some fork, and what an earlier table imported would weigh on them."""
    often = [] if repeat is None else ["--repeat", str(repeat)]
    return subprocess.run([sys.executable, __file__, name, "--bare", *often], check=False).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
