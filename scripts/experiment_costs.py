"""What the paper's emulation experiments cost, in core-minutes, small and in full: docs/costs.md.

`scripts/experiment_costs.py` writes the page from scripts/paper/costs.csv; with `--measure` it first makes the
beginning of one run of every cell, and writes down its processor time.
"""

from __future__ import annotations

import argparse
import csv
import sys
import tempfile
import time
from pathlib import Path

from swarmer.experiments.experiment import read_experiment
from swarmer.experiments.one_run import perform
from swarmer.experiments.runs import Run, expand

ROOT = Path(__file__).resolve().parent.parent
EXPERIMENTS = (
    "fig27_lambda_chess", "fig28_lambda_skateboard", "fig29_30_shapes", "fig31_loss", "fig32_failures_chess",
    "fig33_failures_skateboard", "speed", "table2_metrics",
)  # fmt: skip
"""Those of the paper's experiments that its emulator made; the others are rounds, seconds each."""
MEASURED = ROOT / "scripts" / "paper" / "costs.csv"
PAGE = ROOT / "docs" / "costs.md"
HALF_S, TWICE_S = 3.0, 6.0
COLUMNS = ("experiment", "cell", "half_cpu_s", "twice_cpu_s")


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--measure", action="store_true", help="make the runs first; a quarter of an hour of one core"
    )
    if parser.parse_args(arguments).measure:
        measure()
    PAGE.write_text(page(), encoding="utf-8")
    print(PAGE.relative_to(ROOT))
    return 0


def measure() -> None:
    with MEASURED.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(COLUMNS)
        known: dict[str, list[str]] = {}  # a small version may begin as the full one does
        for name in EXPERIMENTS:
            for small in (False, True):
                for cell, run in first_runs(expand(read_experiment(name, small=small))).items():
                    key = run.config.model_copy(update={"duration_s": TWICE_S}).to_yaml()
                    if key not in known:
                        known[key] = [f"{cpu_of(run, length):.2f}" for length in (HALF_S, TWICE_S)]
                    table.writerow([key_of(name, small), cell, *known[key]])
                    file.flush()


def cpu_of(run: Run, length: float) -> float:
    """Processor seconds of a run of `length` emulated seconds."""
    config = run.config.model_copy(update={"duration_s": length})
    with tempfile.TemporaryDirectory() as folder:
        began = time.process_time()
        outcome = perform(config, Path(folder) / "run")
        spent = time.process_time() - began
    if outcome.status != "done":
        raise SystemExit(f"{run.path}: {outcome.message}")
    return spent


def first_runs(runs: list[Run]) -> dict[str, Run]:
    """One of each cell."""
    found: dict[str, Run] = {}
    for run in runs:
        found.setdefault(run.cell, run)
    return found


def cost_of(run: Run, measured: tuple[float, float]) -> float:
    """Processor seconds of the whole run.

    measured: those of its first HALF_S and TWICE_S emulated seconds. It goes on as in the second half of these.
    """
    half, twice = measured
    rate = max(twice - half, 0.0) / (TWICE_S - HALF_S)
    return twice + rate * (run.config.duration_s - TWICE_S)


def read_measured() -> dict[tuple[str, str], tuple[float, float]]:
    """By experiment and cell. Raises OSError."""
    with MEASURED.open(newline="", encoding="utf-8") as file:
        return {
            (row["experiment"], row["cell"]): (float(row["half_cpu_s"]), float(row["twice_cpu_s"]))
            for row in csv.DictReader(file)
        }


def totals(name: str, small: bool) -> tuple[int, float, float, float]:
    """Runs, core-minutes in all, minutes and MB of the largest run."""
    measured, runs = read_measured(), expand(read_experiment(name, small=small))
    known = {cell: pair for (experiment, cell), pair in measured.items() if experiment == key_of(name, small)}
    each = [cost_of(run, known[run.cell]) / 60 for run in runs]
    return len(runs), sum(each), max(each), max(run.needs.memory_mb for run in runs)


def key_of(name: str, small: bool) -> str:
    return f"{name}-small" if small else name


def page() -> str:
    """The page: a row for each experiment, and what it stands on."""
    lines = [
        TOP,
        "| experiment | runs | core-minutes | longest, min | MB a run | 448 cores, min | small: runs | 2 cores, min |",
    ]
    lines.append("|---|---:|---:|---:|---:|---:|---:|---:|")
    sums = [0, 0.0, 0, 0.0]
    for name in EXPERIMENTS:
        runs, total, longest, memory = totals(name, small=False)
        few, little, _, _ = totals(name, small=True)
        wall = max(longest, total / 448)
        cells = [runs, amount(total), amount(longest), f"{memory:.0f}", amount(wall), few, amount(little / 2)]
        lines.append(f"| `{name}` | {' | '.join(map(str, cells))} |")
        sums = [one + more for one, more in zip(sums, (runs, total, few, little / 2), strict=True)]
    lines.append(f"| all | {sums[0]} | {amount(sums[1])} | | | | {sums[2]} | {amount(sums[3])} |")
    return "\n".join([*lines, BELOW])


def amount(value: float) -> str:
    """With two digits that count.

    >>> amount(0.123), amount(12.3), amount(1234.0)
    ('0.1', '12', '1,200')
    """
    if value < 10:
        return f"{value:.1f}"
    return f"{value:,.0f}" if value < 100 else f"{round(value, -2 if value >= 1000 else -1):,.0f}"


TOP = """<!-- made by scripts/experiment_costs.py; do not edit -->
# What the paper's experiments cost

The experiments that the paper made with its emulator, in virtual time. `swarmer sweep NAME` makes all runs of one,
`--ray` on a cluster ([sweeps](sweeps.md#on-ray)); `swarmer sweep NAME --small` makes the version for a laptop. The
paper's other experiments count rounds, and take seconds each; [`make paper`](paper.md) makes those.
"""
BELOW = """
Measured: one run of every cell of both versions, its first 3 and its first 6 emulated seconds, in processor time of one
core (AMD EPYC, Python 3.11). The machine did other things meanwhile, which lengthens it by up to a third.
`scripts/experiment_costs.py --measure` measures anew, on your machine.

Extrapolated:

- **Over time.** A run goes on as between the third and the sixth second. Once HD is small a run does no less: thaws and
  challenges go on by the clock.
- **Over seeds.** All seeds of a cell cost what the first does. They differ by a few percent.
- **Over cores.** Runs share nothing, and a sweep adds under 3 % to them (`scripts/bench.py sweep`). So minutes are
  core-minutes over cores, and never less than the longest run.
- **With processes.** With `--set engine=process` a run takes the emulated time itself, 1 to 2 minutes, and a machine of
  its own that keeps up: `swarmer doctor` tells which shapes that is. The paper had 6 to 16 servers of 448 cores in all.

A run's cost goes with the datagrams that FLSs send, and these with the number of FLSs over λ. For another shape or
another λ multiply by both; failures add replacements, which the measured rates have.
"""


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
