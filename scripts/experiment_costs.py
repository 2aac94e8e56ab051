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

from paper import storms

from swarmer.config import RunConfig
from swarmer.experiments.experiment import read_experiment
from swarmer.experiments.needs import fls_of
from swarmer.experiments.one_run import perform
from swarmer.experiments.runs import Run, expand

ROOT = Path(__file__).resolve().parent.parent
EXPERIMENTS = (
    "fig27_lambda_chess", "fig28_lambda_skateboard", "fig29_30_shapes", "fig31_loss", "fig32_failures_chess",
    "fig33_failures_skateboard", "speed",
)  # fmt: skip
"""Those that the paper made with its emulator, by the rules of its text; the others are rounds, seconds each."""
MEASURED = ROOT / "scripts" / "paper" / "costs.csv"
PAGE = ROOT / "docs" / "costs.md"
CHECK = ROOT / "scripts" / "paper" / "costs_full_size.csv"  # a few cells with all their FLSs, for the law
SOON_S, LATER_S = 5.0, 20.0
FLSS = 200  # of a measured run, at most
CORES = 448  # of one of the paper's servers
COLUMNS = ("experiment", "cell", "cpu_s_at_5", "cpu_s_at_20")


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--measure", action="store_true", help="make the runs first; half an hour of one core"
    )
    if parser.parse_args(arguments).measure:
        measure()
        storms.measure()
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
                    key = fewer(run, LATER_S).to_yaml()
                    if key not in known:
                        known[key] = [f"{cpu_of(run, length):.3f}" for length in (SOON_S, LATER_S)]
                    table.writerow([key_of(name, small), cell, *known[key]])
                    file.flush()


def cpu_of(run: Run, length: float) -> float:
    """Processor seconds of the first `length` emulated seconds of a run, with few FLSs."""
    config = fewer(run, length)
    with tempfile.TemporaryDirectory() as folder:
        began = time.process_time()
        outcome = perform(config, Path(folder) / "run")
        spent = time.process_time() - began
    if outcome.status != "done":
        raise SystemExit(f"{run.path}: {outcome.message}")
    return spent


def fewer(run: Run, length: float) -> RunConfig:
    """The run with at most FLSS points of its shape, for `length` emulated seconds."""
    points = min(fls_of(run.config), FLSS)
    return run.config.model_copy(update={"duration_s": length, "points": points})


def first_runs(runs: list[Run]) -> dict[str, Run]:
    """One of each cell."""
    found: dict[str, Run] = {}
    for run in runs:
        found.setdefault(run.cell, run)
    return found


def cost_of(run: Run, measured: tuple[float, float], length: float | None = None) -> float:
    """Processor seconds of a run, or of its first `length` emulated seconds.

    measured: those of its first SOON_S and LATER_S, with FLSS of its FLSs. It goes on as between the two, and takes as
    much longer as it has more FLSs.
    """
    soon, later = measured
    rate = max(later - soon, 0.0) / (LATER_S - SOON_S)
    its = soon + rate * ((run.config.duration_s if length is None else length) - SOON_S)
    return its * max(fls_of(run.config) / FLSS, 1.0)


def law_over_measured() -> list[float]:
    """For each cell that was measured with all its FLSs too: what the law has, over that."""
    few = read_measured()
    ratios = []
    with CHECK.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            key = row["experiment"], row["cell"]
            run = first_runs(expand(read_experiment(key[0])))[key[1]]
            ratios.append(cost_of(run, few[key], float(row["length_s"])) / float(row["cpu_s"]))
    return sorted(ratios)


def read_measured() -> dict[tuple[str, str], tuple[float, float]]:
    """By experiment and cell. Raises OSError."""
    with MEASURED.open(newline="", encoding="utf-8") as file:
        return {
            (row["experiment"], row["cell"]): (float(row[COLUMNS[2]]), float(row[COLUMNS[3]]))
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
        wall = max(longest, total / CORES)
        cells = [runs, amount(total), amount(longest), f"{memory:.0f}", amount(wall), few, amount(little / 2)]
        lines.append(f"| `{name}` | {' | '.join(map(str, cells))} |")
        sums = [one + more for one, more in zip(sums, (runs, total, few, little / 2), strict=True)]
    lines.append(f"| all | {sums[0]} | {amount(sums[1])} | | | | {sums[2]} | {amount(sums[3])} |")
    law = law_over_measured()
    below = BELOW.format(cells=len(law), low=law[0], high=law[-1])
    return "\n".join([*lines, below]) + storms.section(CORES, amount)


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
Measured: one run of every cell of both versions with 200 points of its shape, its first 5 and its first 20 emulated
seconds, in processor time of one core (AMD EPYC, Python 3.11). The machine did other things meanwhile, which lengthens
it; `scripts/experiment_costs.py --measure` measures anew, on yours.

Extrapolated:

- **Over FLSs.** A run costs as much more as it has more FLSs: each challenges as often, and hears its neighbours.
  {cells} cells were measured with all of theirs, up to 1,727, too: the law gives {low:.1f} to {high:.1f} times as much.
- **Over time.** A run goes on as between the 5th and the 20th second. Once HD is small a run does no less: thaws and
  challenges go on by the clock.
- **Over seeds.** All seeds of a cell are taken to cost what the first does.
- **Over cores.** Runs share nothing, and what a sweep adds is little (`scripts/bench.py sweep`). So minutes are
  core-minutes over cores, and never less than the longest run.
- **With processes.** With `--set engine=process` a run takes the emulated time itself, 1 to 2 minutes, and a machine of
  its own that keeps up: `swarmer doctor` tells which shapes that is. The paper had 6 to 16 servers of 448 cores in all.

For another shape multiply by its FLSs. Over λ a run costs less than in proportion: a part of it, samples and launch, is
there without a challenge.
"""


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
