"""What faults cost, from the run directories of a sweep, as Markdown.

python scripts/faults_table.py map runs/loss_map [--picture PATH]    HD at the end over loss and λ
python scripts/faults_table.py failures runs/failures                HD, share lit, how soon replacements join
python scripts/faults_table.py partition runs/partition              when the parts, and when all, are one swarm
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmer.experiments.results import RESULTS, RUN, STATUS, read_results
from swarmer.experiments.tables import Row, bounded
from swarmer.fault_places import longest_axis, slabs
from swarmer.faults import PARTITION
from swarmer.metrics.intervals import NEVER, Interval, median
from swarmer.observe.saved_run import SavedRun, load

LOSS, LAMBDA, RATE, POLICY = "radio.loss", "lambda_ms", "failure.rate", "thaw.policy"
MOMENTS_S = (10, 20, 30, 45, 60)  # of the HD over time
Flags = NDArray[np.bool_]


def main(arguments: list[str]) -> int:
    """The exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("what", choices=("map", "failures", "partition"))
    parser.add_argument("sweep", type=Path, help="the directory of a sweep")
    parser.add_argument("--picture", type=Path, help="map: draw it there, too")
    options = parser.parse_args(arguments)
    try:
        cells = cells_of(options.sweep)
        if options.what == "map":
            print(loss_map(cells), end="")
            if options.picture:
                draw_map(cells, options.picture)
        else:
            print((failures if options.what == "failures" else partition)(cells, options.sweep), end="")
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
    return median([float(row["hd_cells"]) if row["hd_cells"] else NEVER for row in rows])


def loss_map(cells: Cells) -> str:
    """A row for each loss, a column for each λ: the median HD at the end with its 95 % interval."""
    found = {(row[0][LOSS], row[0][LAMBDA]): row for row in cells.values()}
    losses = sorted({loss for loss, _ in found}, key=float)
    lambdas = sorted({ms for _, ms in found}, key=float)
    lines = [
        [f"{100 * float(loss):g} %", *(_shown(found.get((loss, ms))) for ms in lambdas)] for loss in losses
    ]
    return table(["loss", *(f"λ {ms} ms" for ms in lambdas)], lines)


def _shown(rows: list[Row] | None) -> str:
    return "–" if not rows else bounded(last_hd(rows), lambda hd: f"{hd:.2g}")


def draw_map(cells: Cells, path: Path) -> None:
    """The map as a picture: colour is the logarithm of the median HD."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt
    from matplotlib.colors import LogNorm

    losses = sorted({float(rows[0][LOSS]) for rows in cells.values()})
    lambdas = sorted({float(rows[0][LAMBDA]) for rows in cells.values()})
    hd = np.full((len(losses), len(lambdas)), np.nan)
    for rows in cells.values():
        at = losses.index(float(rows[0][LOSS])), lambdas.index(float(rows[0][LAMBDA]))
        hd[at] = last_hd(rows).estimate
    hd[~np.isfinite(hd)] = np.nan
    figure, axes = plt.subplots(figsize=(7, 5), layout="constrained")
    low, high = np.nanmin(hd), np.nanmax(hd)
    image = axes.imshow(
        hd, origin="lower", aspect="auto", cmap="viridis_r", norm=LogNorm(low, max(high, 1.01 * low))
    )
    for (row, column), value in np.ndenumerate(hd):
        text = "–" if np.isnan(value) else f"{value:.2g}"
        dark = not np.isnan(value) and np.log(value / low) > 0.6 * np.log(max(high / low, 1.01))
        axes.text(column, row, text, ha="center", va="center", fontsize=8, color="white" if dark else "black")
    axes.set_xticks(range(len(lambdas)), [f"{ms:g}" for ms in lambdas])
    axes.set_yticks(range(len(losses)), [f"{100 * loss:g} %" for loss in losses])
    axes.set_xlabel("λ, ms")
    axes.set_ylabel("loss, at the sender and again at the receiver")
    figure.colorbar(image, label="HD at the end, cells (median)")
    figure.savefig(path, dpi=120)


# -- failures --------------------------------------------------------------------------------------------------------


def failures(cells: Cells, sweep: Path) -> str:
    """A row for each rate: HD at some moments, the mean share lit, failures, and how soon replacements join."""
    over_time = [f"HD at {at} s" for at in MOMENTS_S]
    titles = ["failures per FLS and s", "runs", "failures", *over_time, "lit", "joined within, λ"]
    lines = []
    for rows in cells.values():
        runs = [load(sweep / row[RUN]) for row in rows]
        joined = [waited for run, row in zip(runs, rows, strict=True) for waited in joins(run, row)]
        lines.append([
            f"{100 * float(rows[0][RATE]):g} %", str(len(runs)),
            bounded(median([float(row["failures"]) for row in rows]), lambda value: f"{value:.0f}"),
            *(bounded(median([hd_at(run, at) for run in runs]), lambda hd: f"{hd:.2g}") for at in MOMENTS_S),
            f"{100 * float(np.mean([share_lit(run) for run in runs])):.1f} %",
            f"{np.median(joined):.1f} (of {len(joined)})" if joined else "–",
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


def joins(run: SavedRun, row: Row) -> list[float]:
    """How long each replacement, once it was lit, was in a swarm of its own, in λ; those that failed before left out.

    As fine as the run's samples.
    """
    timeline, lambda_s = _timeline(run), float(run.config["lambda_ms"]) / 1e3
    crowded = np.stack([_shared(swarm, lit) for swarm, lit in zip(timeline.swarm, timeline.lit, strict=True)])
    found = []
    gone: dict[int, list[float]] = {}
    for event in run.events:
        if event.kind in ("failure", "crash"):
            gone.setdefault(event.fid, []).append(event.t_s)
    for event in run.events:
        if event.kind != "replacement":
            continue
        until = min((t_s for t_s in gone.get(event.fid, ()) if t_s > event.t_s), default=np.inf)
        alive = (timeline.t_s >= event.t_s) & (timeline.t_s < until)
        lit = np.flatnonzero(alive & timeline.lit[:, event.fid - 1])
        joined = np.flatnonzero(alive & crowded[:, event.fid - 1])
        if len(lit) and len(joined):
            found.append(float(timeline.t_s[joined[0]] - timeline.t_s[lit[0]]) / lambda_s)
    return found


def _shared(swarm: NDArray[Any], lit: Flags) -> Flags:
    """Who is lit in a swarm that has another member."""
    names, at, many = np.unique(np.where(lit, swarm, -1), return_inverse=True, return_counts=True)
    shared: Flags = (many[at] > 1) & (names[at] > 0) & lit
    return shared


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


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
