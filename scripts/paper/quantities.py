"""What is read of a run, by its row in results.csv and its directory; infinite where something was never reached."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from swarmer.observe.timeline import NAME as TIMELINE

Row = dict[str, str]
Quantity = Callable[[Row, Path], float]


def _column(name: str, missing: float = math.nan) -> Quantity:
    return lambda row, _: float(row[name]) if row.get(name) else missing


def rounds(row: Row, _: Path) -> float:
    """Until HD was low enough at a single swarm, which is when the paper looks."""
    return float(row["rounds"]) if row["converged"] == "true" else math.inf


def flown_after(row: Row, _: Path) -> float:
    """Cells flown by all FLSs after the deployment."""
    return float(row["distance_localizing_cells"]) + float(row["distance_swarm_cells"])


def _rounds_csv(run: Path) -> list[Row]:
    with (run / "rounds.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def group_mean(_: Row, run: Path) -> float:
    return float(_rounds_csv(run)[1]["group_mean"])


def group_max(_: Row, run: Path) -> float:
    return max(float(row["group_max"]) for row in _rounds_csv(run))


def shift(_: Row, run: Path) -> float:
    """How far the mean of all FLSs ends from the mean of their points, cells."""
    with np.load(run / TIMELINE, allow_pickle=False) as file:
        return float(np.linalg.norm((file["position"][-1] - file["truth"]).mean(axis=0)))


QUANTITIES: dict[str, Quantity] = {
    "hd": _column("hd_cells"),
    "hd_least": _column("hd_min_cells"),
    "flown": flown_after,
    "flown_after": flown_after,
    "first_swarm": _column("first_single_swarm_round", math.inf),
    "rounds": rounds,
    "thaws": _column("thaws"),
    "localizing": _column("distance_localizing_cells"),
    "swarm": _column("distance_swarm_cells"),
    "group_mean": group_mean,
    "group_max": group_max,
    "shift": shift,
    "bytes": _column("bytes_sent"),
    "localizations": _column("localizations"),
    "distance": _column("distance_cells_mean"),
    "hd_median": _column("hd_median_cells"),
    "thaws_per_localization": lambda row, _: float(row["thawed_flss"]) / float(row["localizations"]),
    "leases_expired": lambda row, _: 100 * float(row["leases_expired"]) / float(row["leases_granted"]),
    "to_1": _column("time_to_hd_s.1", math.inf),
    "to_0.1": _column("time_to_hd_s.0.1", math.inf),
    "to_0.01": _column("time_to_hd_s.0.01", math.inf),
}
