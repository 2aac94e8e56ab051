"""summary.json: one flat object, the same names for every engine; what an engine does not have is null."""

from __future__ import annotations

import math
from typing import Any

from swarmer.engines.result import RunResult
from swarmer.observe.progress import Progress

FORMAT = 1

# Counters under the name they have in the summary.
COUNTERS = (
    "localizations",
    "anchorings",
    "leases_granted",
    "leases_expired",
    "thawed_flss",
    "thaws_at_one_swarm",
    "thaws_by_clock",
    "wrong_thaws",
    "datagrams_sent",
    "datagrams_delivered",
    "datagrams_lost",
    "bytes_sent",
    "bytes_delivered",
    "failures",
    "departures",
    "replacements",
    "handled",
    "ignored",
    "rejected",
    "dropped_by_kernel",
)

# What only some engines have; they give it with their result.
OF_SOME_ENGINES = (
    "events",
    "trace_sha256",
    "invariants_checked",
    "invariant_violations",
    "rounds",
    "rounds_to_hd",
    "converged",
    "first_single_swarm_round",
    "formation_rounds",
    "distance_localizing_cells",
    "distance_swarm_cells",
    "fixes_failed",
)

# What an engine without a clock, which counts rounds instead, does not have.
OF_A_CLOCK = ("emulated_s", "time_to_hd_s", "all_lit_s", "first_single_swarm_s", "time_scale")


def make_summary(progress: Progress, result: RunResult, shape: str, points: int, seed: int) -> dict[str, Any]:
    """Every name of summary.json; no value is NaN or infinite.

    `hd_cells` and `hd_absolute_cells` are of the last sample, null where fewer than two FLSs were lit in it; which HDs
    count for `hd_min_cells` and `time_to_hd_s` says `progress`. An engine that counts
    rounds has `rounds_to_hd` instead.
    """
    counters = result.counters
    summary: dict[str, Any] = {
        "format": FORMAT,
        "engine": result.engine,
        "shape": shape,
        "points": points,
        "seed": seed,
        "status": result.status,
        "message": result.message or None,
        "emulated_s": result.emulated_s,
        "wall_s": result.wall_s,
        "launch_s": result.launch_s,
        "hd_cells": progress.hd,
        "hd_min_cells": progress.hd_min,
        "hd_absolute_cells": progress.hd_absolute(),
        "time_to_hd_s": dict(progress.time_to_hd_s),
        "all_lit_s": progress.all_lit_s,
        "first_single_swarm_s": _first_single_swarm(progress, result),
        "single_swarm_count": progress.single_swarms(counters),
        "swarms_last": progress.swarms.number,
        "lit_share": progress.lit_share,
        "thaws": _whole(counters.get("thaws")),
        "distance_cells_mean": _mean(counters.get("distance_cells"), points),
        "localizing_cells_mean": _mean(counters.get("localizing_cells"), points),
        "following_cells_mean": _mean(counters.get("following_cells"), points),
        **{name: _whole(counters.get(name)) for name in COUNTERS},
        "processes": result.processes,
        "memory_mb_per_fls": result.memory_mb_per_fls,
        "timer_late_ms": _lateness(result.timer_late_ms),
        "handled_late_ms": _lateness(result.handled_late_ms),
        "time_scale": result.time_scale,
        "faithful": result.faithful,
        "suggested_time_scale": result.suggested_time_scale,
        **dict.fromkeys(OF_SOME_ENGINES),
    }
    if getattr(result, "in_rounds", False):
        summary |= {"rounds_to_hd": _whole_rounds(progress.time_to_hd_s), **dict.fromkeys(OF_A_CLOCK)}
    summary.update(getattr(result, "extra", None) or {})
    return {name: plain(value) for name, value in summary.items()}


def _first_single_swarm(progress: Progress, result: RunResult) -> float | None:
    """A sample sees few of the moments of one swarm if a thaw ends each at once; an engine may know better."""
    known = (progress.first_single_swarm_s, result.first_single_swarm_s)
    return min((t_s for t_s in known if t_s is not None), default=None)


def _whole_rounds(reached: dict[str, float | None]) -> dict[str, int | None]:
    return {name: _whole(number) for name, number in reached.items()}


def _whole(count: float | None) -> int | None:
    return None if count is None else round(count)


def _mean(total: float | None, points: int) -> float | None:
    return None if total is None else total / points


def _lateness(late: Any) -> dict[str, float] | None:
    return None if late is None else {"p50": late.p50, "p99": late.p99, "max": late.max}


def plain(value: Any) -> Any:
    """The value as JSON takes it: numpy scalars as Python's, whole numbers as int, NaN and infinity as None."""
    if isinstance(value, dict):
        return {name: plain(inner) for name, inner in value.items()}
    if hasattr(value, "item"):
        value = value.item()
    if isinstance(value, float):
        if not math.isfinite(value):
            return None
        return round(value, 9)
    return value
