"""What faults cost, from the run directories of a sweep, as Markdown.

python scripts/faults_table.py map runs/loss_map [--picture PATH]    HD at the end over loss and λ
python scripts/faults_table.py ends runs/loss_ends                   loss at sender, receiver, both: HD, one swarm
python scripts/faults_table.py failures runs/failures [--picture P]  HD and share lit
python scripts/faults_table.py joins runs/failures                   how soon replacements join; plays the runs again
python scripts/faults_table.py joins_seen runs/failures              the same by the samples, for any engine
python scripts/faults_table.py strikes runs/strikes                  faults of FLSs and sensors: HD, lit
python scripts/faults_table.py partition runs/partition              when the parts, and when all, are one swarm
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from faults_joins import played, seen
from faults_pictures import heat_map, panels

from swarmer.experiments.results import RESULTS, RUN, STATUS, read_results
from swarmer.experiments.tables import Row, bounded
from swarmer.fault_places import longest_axis, slabs
from swarmer.faults import PARTITION
from swarmer.metrics.intervals import NEVER, Interval, mean, median
from swarmer.observe.saved_run import SavedRun, load

ENOUGH, RUNS_LEAST = 500, 3  # joins; runs that have an interval
EVERY_S, LONGEST_S = 0.5, 3600.0  # between two points of a curve; of a run
LOSS, LAMBDA, RATE, POLICY, BURST = "radio.loss", "lambda_ms", "failure.rate", "thaw.policy", "radio.burst"
ENDS = {"radio.loss_sender": "the sender", "radio.loss_receiver": "the receiver", LOSS: "both ends"}
FORMED_S = 2.5  # after which a small shape has formed, without faults
MOMENTS_S = (10, 20, 30, 45, 60)  # of the HD over time


def main(arguments: list[str]) -> int:
    """The exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("what", choices=("map", *TABLES))
    parser.add_argument("sweep", type=Path, help="the directory of a sweep")
    parser.add_argument("--picture", type=Path, help="map, failures: draw it there, too")
    options = parser.parse_args(arguments)
    try:
        cells = cells_of(options.sweep)
        print(
            loss_map(cells) if options.what == "map" else TABLES[options.what](cells, options.sweep), end=""
        )
        if options.picture:
            {"map": draw_map, "failures": draw_failures}[options.what](cells, options.sweep, options.picture)
    except (OSError, ValueError, KeyError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


Cells = dict[tuple[str, ...], list[Row]]


def cells_of(sweep: Path) -> Cells:
    """The finished runs of each cell, in the table's order. Raises OSError, ValueError."""
    settings, rows = read_results(sweep / RESULTS)
    cells: Cells = {}
    for row in rows:
        if row.get(STATUS) == "done":
            cells.setdefault(tuple(row[name] for name in settings), []).append(row)
    if not cells:
        raise ValueError(f"{sweep}: no finished run")
    return cells


def table(titles: list[str], lines: list[list[str]]) -> str:
    """As Markdown."""
    return "".join(f"| {' | '.join(line)} |\n" for line in (titles, ["---"] * len(titles), *lines))


# -- the map of loss and λ -------------------------------------------------------------------------------------------


def last_hd(rows: list[Row]) -> Interval:
    """The median of the HD at the end, cells."""
    return median([_number(row["hd_cells"]) for row in rows])


def mean_hd(rows: list[Row]) -> Interval:
    """The geometric mean of the HD at the end, cells: few runs have an interval of that, and it spans decades."""
    logs = [math.log(_number(row["hd_cells"])) for row in rows]
    found = mean(logs)
    return found._replace(
        estimate=math.exp(found.estimate), low=math.exp(found.low), high=math.exp(found.high)
    )


def loss_map(cells: Cells) -> str:
    """A row for each loss, a column for each λ: the mean HD at the end with its 95 % interval."""
    found = {(row[0][LOSS], row[0][LAMBDA]): row for row in cells.values()}
    losses = sorted({loss for loss, _ in found}, key=float)
    lambdas = sorted({ms for _, ms in found}, key=float)
    lines = [
        [f"{100 * float(loss):g} %", *(_shown(found.get((loss, ms))) for ms in lambdas)] for loss in losses
    ]
    return table(["loss", *(f"λ {ms} ms" for ms in lambdas)], lines)


def _shown(rows: list[Row] | None) -> str:
    if not rows:
        return "–"
    found = mean_hd(rows)
    shown = (
        found if found.n >= RUNS_LEAST else found._replace(low=math.nan, high=math.nan)
    )  # of two it says nothing
    return bounded(shown, lambda hd: f"{hd:.2g}")


def draw_map(cells: Cells, sweep: Path, path: Path) -> None:
    """The map as a picture: colour is the logarithm of the mean HD."""
    losses = sorted({float(rows[0][LOSS]) for rows in cells.values()})
    lambdas = sorted({float(rows[0][LAMBDA]) for rows in cells.values()})
    hd = np.full((len(losses), len(lambdas)), np.nan)
    for rows in cells.values():
        at = losses.index(float(rows[0][LOSS])), lambdas.index(float(rows[0][LAMBDA]))
        value = mean_hd(rows).estimate
        hd[at] = value if value < NEVER else np.nan
    names = [f"{100 * loss:g} %" for loss in losses]
    title = "HD at the end, cells (mean): loss at the sender and again at the receiver, over λ"
    path.write_text(heat_map(hd, names, [f"λ {ms:g} ms" for ms in lambdas], title), "utf-8")


# -- loss at one end or both -----------------------------------------------------------------------------------------


def ends(cells: Cells, sweep: Path) -> str:
    """A row for each kind of loss: how fast HD falls, and how many formations were one swarm when they were thawed."""
    titles = ["loss", "runs", "HD < 1, s", "HD < 0.1, s", "HD at the end", "formations", "not one swarm"]
    lines = [
        [
            _loss(rows[0]), str(len(rows)),
            *(_times([_number(row[f"time_to_hd_s.{hd}"]) for row in rows]) for hd in ("1", "0.1")),
            bounded(last_hd(rows), lambda hd: f"{hd:.2g}"),
            bounded(mean([float(row["thaws"]) for row in rows]), lambda value: f"{value:.1f}"),
            str(sum(int(float(row["wrong_thaws"])) for row in rows)),
        ]
        for rows in cells.values()
    ]  # fmt: skip
    return table(titles, lines)


def _loss(row: Row) -> str:
    for name, where in ENDS.items():
        if share := float(row.get(name) or 0):
            burst = float(row.get(BURST) or 0)
            return f"{100 * share:g} % at {where}" + (f", in bursts of {burst:g}" if burst else "")
    return "none"


def _number(cell: str | None) -> float:
    return float(cell) if cell else NEVER


# -- failures --------------------------------------------------------------------------------------------------------


def failures(cells: Cells, sweep: Path) -> str:
    """A row for each rate: failures, HD at some moments, the mean share lit."""
    found = [(rows, [load(sweep / row[RUN]) for row in rows]) for rows in cells.values()]
    shortest_s = min(float(_timeline(run).t_s[-1]) for _, runs in found for run in runs)
    moments_s = [at for at in MOMENTS_S if at < shortest_s + EVERY_S]
    titles = ["failures per FLS and s", "runs", "failures", *(f"HD at {at} s" for at in moments_s), "lit"]
    lines = []
    for rows, runs in found:
        lines.append([
            f"{100 * float(rows[0][RATE]):g} %", str(len(runs)),
            bounded(median([float(row["failures"]) for row in rows]), lambda value: f"{value:.0f}"),
            *(bounded(median([hd_at(run, at) for run in runs]), lambda hd: f"{hd:.2g}") for at in moments_s),
            f"{100 * float(np.mean([share_lit(run) for run in runs])):.1f} %",
        ])  # fmt: skip
    return table(titles, lines)


def hd_at(run: SavedRun, at_s: float) -> float:
    """HD at the last sample until then, cells; NEVER where there was none."""
    timeline = _timeline(run)
    row = int(np.searchsorted(timeline.t_s, at_s, side="right")) - 1
    value = float(timeline.hd_cells[max(row, 0)])
    return value if np.isfinite(value) else NEVER


def share_lit(run: SavedRun) -> float:
    """Of all points over the whole time from the moment when all were lit first."""
    lit = _timeline(run).lit
    whole = np.flatnonzero(lit.all(axis=1))
    return float(lit[whole[0] :].mean()) if len(whole) else float(lit.mean())


def draw_failures(cells: Cells, sweep: Path, path: Path) -> None:
    """HD and share lit over time, the median of the runs of each rate."""
    hd, lit = {}, {}
    t_s = np.arange(0.0, LONGEST_S, EVERY_S)
    for rows in cells.values():
        lines = [_timeline(load(sweep / row[RUN])) for row in rows]
        t_s = t_s[t_s <= min(float(line.t_s[-1]) for line in lines)]
        at = [np.searchsorted(line.t_s, t_s, side="right") - 1 for line in lines]
        name = f"{100 * float(rows[0][RATE]):g} % per s"
        hd[name] = np.median(
            [line.hd_cells[rows_at] for line, rows_at in zip(lines, at, strict=True)], axis=0
        )
        lit[name] = np.median(
            [line.lit.mean(axis=1)[rows_at] for line, rows_at in zip(lines, at, strict=True)], axis=0
        )
    path.write_text(panels(t_s, hd, lit, "HD and share of points lit, by how often each FLS fails"), "utf-8")


# -- how soon replacements join ----------------------------------------------------------------------------------------


def joins_seen(cells: Cells, sweep: Path) -> str:
    """`joins`, by the samples."""
    return joins(cells, sweep, seen)


def joins(cells: Cells, sweep: Path, look: Callable[[Path], tuple[float, list[float], int]] = played) -> str:
    """A row for each rate: how soon the replacements of its first runs joined, until there are enough of them."""
    titles = [
        "failures per FLS and s",
        "runs",
        "joins",
        "joined within, median, λ",
        "90 %, λ",
        "never joined",
    ]
    lines = []
    for rows in cells.values():
        waits: list[float] = []
        failed = runs = 0
        for row in rows if float(rows[0][RATE]) else ():
            lambda_s, waits_s, never = look(sweep / row[RUN])
            waits += [wait_s / lambda_s for wait_s in waits_s]
            failed, runs = failed + never, runs + 1
            if len(waits) >= ENOUGH:
                break
        if waits:
            middle = bounded(median(waits), lambda value: f"{value:.2f}")
            most = f"{np.percentile(waits, 90):.2f}"
            lines.append(
                [f"{100 * float(rows[0][RATE]):g} %", str(runs), str(len(waits)), middle, most, str(failed)]
            )
    return table(titles, lines)


# -- partitions ------------------------------------------------------------------------------------------------------


def partition(cells: Cells, sweep: Path) -> str:
    """A row for each policy: after how long each part was one swarm, apart from the others; and, healed, all."""
    titles = [POLICY, "runs", "parts apart, each one swarm, after, s", "healed: one swarm after, s"]
    lines = []
    for rows in cells.values():
        times = [parted_and_healed(load(sweep / row[RUN])) for row in rows]
        lines.append(
            [
                f"`{rows[0].get(POLICY, '')}`",
                str(len(rows)),
                *(_times(list(its)) for its in zip(*times, strict=True)),
            ]
        )
    return table(titles, lines)


# -- what strikes FLSs and their sensors -----------------------------------------------------------------------------


def strikes(cells: Cells, sweep: Path) -> str:
    """A row for each schedule: the highest HD, how long after it struck last HD was above 1 and 0.1, the share lit."""
    titles = ["fault", "runs", "highest HD", "HD < 1 again, s", "HD < 0.1 again, s", "lit"]
    lines = []
    for rows in cells.values():
        runs = [load(sweep / row[RUN]) for row in rows]
        found = [[highest_hd(run), *(again_s(run, hd) for hd in (1.0, 0.1)), share_lit(run)] for run in runs]
        highest, one, tenth, lit = (list(its) for its in zip(*found, strict=True))
        lines.append([
            ", ".join(dict.fromkeys(map(partial(_words, runs[0].config), _schedule(runs[0])))), str(len(runs)),
            _range([float(f"{hd:.2g}") for hd in highest], "{:g}"), _range(one, "{:.1f}"), _range(tenth, "{:.1f}"),
            _range([100 * share for share in lit], "{:.1f}") + " %",
        ])  # fmt: skip
    return table(titles, lines)


def _range(values: list[float], form: str) -> str:
    """The median, the least and the greatest."""
    shown = [form.format(value) for value in (float(np.median(values)), min(values), max(values))]
    return shown[0] if len(set(shown)) == 1 else f"{shown[0]} [{shown[1]}, {shown[2]}]"


def _schedule(run: SavedRun) -> list[dict[str, Any]]:
    return list(run.config["faults"]["schedule"])


def _words(config: dict[str, Any], fault: dict[str, Any]) -> str:
    whom = " of a swarm" if "swarm_of" in fault["where"] else ""
    return fault["what"] + (" of an oracle" if config["oracle"]["count"] else whom)


def struck_s(run: SavedRun) -> float:
    """When the last fault struck that does so at once, or ended, or had its FLSs given up."""
    hang_s = run.config["failure"]["hang_s"] or math.inf
    lengths = {"kill": 0.0, **dict.fromkeys(("loss", "delay", "duplicate"), -math.inf)}
    return max(
        fault["at"] + lengths.get(fault["what"], min(fault.get("for", 0.0), hang_s))
        for fault in _schedule(run)
    )


def highest_hd(run: SavedRun) -> float:
    """From when they have formed without any fault, cells."""
    timeline = _timeline(run)
    return float(np.nanmax(timeline.hd_cells[timeline.t_s > FORMED_S]))


def again_s(run: SavedRun, hd: float) -> float:
    """How long after it was struck last the HD was not below `hd`, to a sample; 0 if it was all the time."""
    timeline, struck = _timeline(run), struck_s(run)
    above = timeline.t_s[~(timeline.hd_cells < hd) & (timeline.t_s > struck)]
    return float(above[-1] - struck) if len(above) else 0.0


def _times(times: list[float]) -> str:
    """The median, its interval, and how many ever got there."""
    shown = bounded(median(times), lambda t_s: "never" if t_s == NEVER else f"{t_s:.2f}")
    return f"{shown} ({sum(time < NEVER for time in times)}/{len(times)})"


def parted_and_healed(run: SavedRun) -> tuple[float, float]:
    """Seconds from the beginning of its partition until each part was one swarm and no other part's; and from its end
    until all were one.
    """
    timeline = _timeline(run)
    fault = next(row for row in run.config["faults"]["schedule"] if row["what"] == PARTITION)
    points = timeline.truth.tolist()
    parts = slabs(points, fault.get("parts", 2), fault.get("axis") or longest_axis(points))
    begins, ends = fault["at"], fault["at"] + fault["for"]
    apart = healed = NEVER
    for t_s, swarm, lit in zip(timeline.t_s, timeline.swarm, timeline.lit, strict=True):
        names = [set(swarm[part].tolist()) for part in parts]
        single = bool(lit.all()) and all(len(name) == 1 for name in names)
        if begins <= t_s < ends and single and len(set.union(*names)) == len(parts):
            apart = min(apart, float(t_s - begins))
        if t_s > ends and single and len(set.union(*names)) == 1:
            healed = min(healed, float(t_s - ends))
    return apart, healed


def _timeline(run: SavedRun) -> Any:
    if run.timeline is None:
        raise ValueError(f"{run.path}: no timeline")
    return run.timeline


TABLES = {
    "ends": ends,
    "failures": failures,
    "joins": joins,
    "joins_seen": joins_seen,
    "partition": partition,
    "strikes": strikes,
}

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
