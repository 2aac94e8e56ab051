"""What the paper's Table 2 costs under the rules of its authors' program, whose challenges become storms.

A run of it takes hours, so pieces are measured: the first seconds, with some of the FLSs and with all, each cut off
after some minutes of processor time. Deployment and the first merges are cheap; from FROM_S on a second costs what the
next does.
"""

from __future__ import annotations

import csv
import time
from pathlib import Path
from typing import Any, NamedTuple

from swarmer.engines.result import Event, Snapshot
from swarmer.engines.virtual import VirtualEngine
from swarmer.experiments.experiment import read_experiment
from swarmer.experiments.runs import Run, expand
from swarmer.plan import make_plan

EXPERIMENT = "table2_metrics"
MEASURED = Path(__file__).with_name("costs_storms.csv")
FROM_S = 3.0
FEW, SLOWEST_MS = 200, 1000  # FLSs with which every λ is measured; the λ that is measured with all of them
CPU_S_MAX = 200.0
SMALL_S = 20  # processor seconds of the small version, all of it, as measured
PIECES = (  # λ in ms, FLSs, emulated seconds
    (50, 200, 12), (200, 200, 20), (300, 200, 12), (450, 200, 20), (700, 200, 12), (1000, 200, 20), (50, 400, 6),
    (200, 400, 6), (450, 400, 6), (1000, 400, 10), (50, 800, 5), (1000, 800, 8), (1000, 1727, 7),
)  # fmt: skip


class Piece(NamedTuple):
    """A line of the file: processor seconds at two emulated ones, and all events up to the second."""

    shape: str
    lambda_ms: int
    flss: int
    from_s: float
    cpu_s_at_from: float
    to_s: float
    cpu_s_at_to: float
    events: int

    @property
    def rate(self) -> float:
        """Processor seconds for an emulated one, in the storm."""
        return (self.cpu_s_at_to - self.cpu_s_at_from) / (self.to_s - self.from_s)


class Stopwatch:
    """An observer that notes the processor time at each sample, and stops the run when it has taken too much."""

    def __init__(self) -> None:
        self.readings: list[tuple[float, float]] = []
        self._began = 0.0

    def planned(self, _: Any) -> None:
        """Not timed."""

    def launching(self, *_: int) -> None:
        """Not timed."""

    def go(self, _: float) -> None:
        self._began = time.process_time()

    def sample(self, snapshot: Snapshot) -> bool:
        self.readings.append((snapshot.t_s, time.process_time() - self._began))
        return self.readings[-1][1] > CPU_S_MAX

    def event(self, _: Event) -> None:
        """Not timed."""

    def beat(self, _: float) -> None:
        """A sample comes."""


def measure() -> None:
    """Make the pieces, a quarter of an hour of one core, and write them down."""
    runs = {run.config.lambda_ms: run for run in expand(read_experiment(EXPERIMENT))}
    with MEASURED.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(Piece._fields)
        for lambda_ms, flss, length in PIECES:
            table.writerow(piece_of(runs[lambda_ms], flss, length))
            file.flush()


def piece_of(run: Run, flss: int, length: float) -> Piece:
    """The beginning of a run, with so many points of its shape."""
    watch = Stopwatch()
    config = run.config.model_copy(update={"duration_s": length, "points": flss})
    with VirtualEngine(make_plan(config)) as engine:
        events = engine.run(watch).extra["events"]
    begins = next(reading for reading in watch.readings if reading[0] >= FROM_S)
    values = (round(value, 2) for value in (*begins, *watch.readings[-1]))
    return Piece(config.shape, round(config.lambda_ms), flss, *values, events)


def read_pieces() -> list[Piece]:
    """Raises OSError, ValueError."""
    with MEASURED.open(newline="", encoding="utf-8") as file:
        return [
            Piece(row[0], int(row[1]), int(row[2]), *map(float, row[3:7]), int(row[7]))
            for row in list(csv.reader(file))[1:]
        ]


class Storms:
    """The law: every λ costs in proportion to what it costs with few FLSs; how it grows with them λ 1000 ms says."""

    def __init__(self, pieces: list[Piece]) -> None:
        self.pieces = {(piece.lambda_ms, piece.flss): piece for piece in pieces}
        self.all = max(piece.flss for piece in pieces)

    def rate(self, lambda_ms: int, flss: int) -> float:
        """Processor seconds for an emulated one. flss: as many as λ 1000 ms was measured with."""
        few = self.pieces[lambda_ms, FEW].rate / self.pieces[SLOWEST_MS, FEW].rate
        return few * self.pieces[SLOWEST_MS, flss].rate

    def minutes(self, lambda_ms: int, flss: int, length_s: float) -> float:
        """Of one core, for a run."""
        before = self.pieces[SLOWEST_MS, flss].cpu_s_at_from
        return (before + self.rate(lambda_ms, flss) * (length_s - FROM_S)) / 60

    def over_measured(self) -> list[float]:
        """For the pieces that the law does not stand on: what it has, over what was measured."""
        others = [key for key in self.pieces if key[0] != SLOWEST_MS and key[1] != FEW]
        return sorted(self.rate(*key) / self.pieces[key].rate for key in others)


def section(cores: int, amount: Any) -> str:
    """The part of the page. amount: how a number is written."""
    storms, runs = Storms(read_pieces()), expand(read_experiment(EXPERIMENT))
    lambdas = sorted({round(run.config.lambda_ms) for run in runs})
    seeds, length_s = len(runs) // len(lambdas), runs[0].config.duration_s
    lines, hours = [], {FEW: 0.0, storms.all: 0.0}
    for lambda_ms in lambdas:
        each = {flss: storms.minutes(lambda_ms, flss, length_s) for flss in hours}
        for flss, minutes in each.items():
            hours[flss] += minutes * seeds / 60
        few = storms.pieces[lambda_ms, FEW]
        here, there = (few.rate, few.events / few.to_s / 1e3), storms.rate(lambda_ms, storms.all)
        cells = (*here, each[FEW], there, each[storms.all])
        lines.append(f"| {lambda_ms} | {' | '.join(map(amount, cells))} |")
    longest = max(storms.minutes(lambda_ms, storms.all, length_s) for lambda_ms in lambdas) / 60
    law, whole = storms.over_measured(), storms.pieces[SLOWEST_MS, storms.all]
    return SECTION.format(
        all=f"{storms.all:,}", few=FEW, lines="\n".join(lines), runs=len(runs), hours=amount(hours[storms.all]),
        longest=amount(longest), wall=amount(max(longest, hours[storms.all] / cores)), cores=cores,
        hours_few=amount(hours[FEW]), minutes_few=amount(hours[FEW] * 30), low=law[0], high=law[-1],
        small=SMALL_S, events=whole.events / whole.to_s / 1e6, memory=round(max(run.needs.memory_mb for run in runs)),
    )  # fmt: skip


SECTION = """
## Table 2

`table2_metrics` is not in the table above. It stands on the rules of the authors' program (`authors_code`): an FLS
challenges whenever it becomes Available, and the more FLSs there are in range, the more hear it and answer. With twice
the FLSs a second costs nearly four times as much, and from 800 to {all} more than that. Measured from the third
emulated second on, and extrapolated to a run of two minutes:

| λ, ms | {few} FLSs: core-s for a second | thousand events in it | a run, min | {all} FLSs: core-s | a run, min |
|---:|---:|---:|---:|---:|---:|
{lines}

- **In full:** {runs} runs of {all} FLSs, {hours} core-hours, {memory} MB a run. On {cores} cores {wall} h, as long as
  the longest run, for a run has one core. With λ 1000 ms an emulated second has {events:.1f} million events.
- **What can be run:** `swarmer sweep table2_metrics --set points={few}`, all {runs} runs, takes {hours_few} core-hours,
  {minutes_few} minutes on two cores. `--small` makes three runs of 94 FLSs, in some {small} seconds of a core.
- **The law:** with {all} FLSs only λ 1000 ms was measured, its first 7 s. The others are taken to cost as many times
  as much as that as they do with {few} FLSs. Four such pieces were measured with 400 and 800, too: the law gives
  {low:.1f} to {high:.1f} times as much.
"""
