"""summary.json: one flat object, the same names for every engine; what an engine does not have is null."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from swarmer.engines.result import Lateness, RunResult
from swarmer.observe.progress import THRESHOLDS, Progress

if TYPE_CHECKING:
    from collections.abc import Mapping

    from swarmer.plan import Plan

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
    "rounds_to_hd_absolute",
    "converged",
    "first_single_swarm_round",
    "formation_rounds",
    "distance_localizing_cells",
    "distance_swarm_cells",
    "fixes_failed",
    "hosts",
    "hosts_lost",
    "relayed_datagrams",
    "relay_packets",
    "relay_bytes",
    "relay_lost",
    "relay_rejected",
    "relay_late_ms",
    "clock_bound_ms",
    "clock_drift_ms",
    "telemetry_bytes",
)

# What an engine without a clock, which counts rounds instead, does not have.
OF_A_CLOCK = (
    "emulated_s",
    "time_to_hd_s",
    "time_to_hd_absolute_s",
    "all_lit_s",
    "first_single_swarm_s",
    "time_scale",
)

# What only a run with a next shape has; `next_time_to_hd_s` counts from its beginning.
OF_A_TRANSITION = (
    "next_shape", "next_points", "next_at_s", "next_time_to_hd_s", "joins", "leaves", "assigned_cells_mean",
    "assigned_optimally",
)  # fmt: skip


# Names that hold no number, and those that hold several, by the names within.
WORDS = (
    "engine", "shape", "status", "message", "faithful", "trace_sha256", "invariant_violations", "converged",
    "formation_rounds", "fixes_failed", "next_shape", "assigned_optimally",
)  # fmt: skip
OF_SWARMS = ("single_swarm_count", "swarms_last")  # besides `thaws_at_one_swarm`
HD_TIMES = (
    "time_to_hd_s",
    "time_to_hd_absolute_s",
    "next_time_to_hd_s",
    "rounds_to_hd",
    "rounds_to_hd_absolute",
)
WITHIN = {
    **dict.fromkeys(HD_TIMES, THRESHOLDS),
    **dict.fromkeys(("timer_late_ms", "handled_late_ms"), Lateness._fields),
}


def has_swarms(summary: Mapping[str, Any]) -> bool:
    """False for a yardstick: the rounds engine counts thaws for techniques of swarms alone."""
    return summary.get("engine") != "rounds" or summary.get("thaws_at_one_swarm", 0) is not None


def number_names() -> list[str]:
    """Every name of the summary of some run that can be a number, those within another as `time_to_hd_s.0.1`."""
    import numpy as np

    one = make_summary(Progress.of(np.zeros((2, 3))), RunResult("", "", 0.0, 0.0), "", 2, 0)
    names: list[str] = []
    for name in one:
        if name in WITHIN:
            names += [f"{name}.{inner}" for inner in WITHIN[name]]
        elif name not in WORDS:
            names.append(name)
    return names


def transition_facts(plan: Plan) -> dict[str, Any]:
    """What the plan knows of the next shape, by name in the summary; empty without one."""
    shape = plan.next
    if shape is None:
        return {}
    return {
        "next_shape": shape.cloud.name,
        "next_points": len(shape.cloud),
        "next_at_s": shape.at_s,
        "joins": len(shape.joiners),
        "leaves": len(shape.leavers),
        "assigned_cells_mean": shape.way_cells,
        "assigned_optimally": shape.optimal,
    }


def make_summary(
    progress: Progress, result: RunResult, shape: str, points: int, seed: int | None, flss: int | None = None
) -> dict[str, Any]:
    """Every name of summary.json; no value is NaN or infinite.

    flss: how many FLSs there are in all; None: as many as points.

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
        **progress.illumination(),
        "thaws": _whole(counters.get("thaws")),
        "distance_cells_mean": _mean(counters.get("distance_cells"), flss or points),
        "localizing_cells_mean": _mean(counters.get("localizing_cells"), flss or points),
        "following_cells_mean": _mean(counters.get("following_cells"), flss or points),
        **{name: _whole(counters.get(name)) for name in COUNTERS},
        "processes": result.processes,
        "memory_mb_per_fls": result.memory_mb_per_fls,
        "timer_late_ms": _lateness(result.timer_late_ms),
        "handled_late_ms": _lateness(result.handled_late_ms),
        "time_scale": result.time_scale,
        "faithful": result.faithful,
        "suggested_time_scale": result.suggested_time_scale,
        **dict.fromkeys(OF_SOME_ENGINES),
        "time_to_hd_absolute_s": None
        if progress.time_to_hd_absolute_s is None
        else dict(progress.time_to_hd_absolute_s),
        **dict.fromkeys(OF_A_TRANSITION),
        "next_time_to_hd_s": None if progress.next_time_to_hd_s is None else dict(progress.next_time_to_hd_s),
    }
    if getattr(result, "in_rounds", False):
        absolute = progress.time_to_hd_absolute_s
        summary |= {
            "rounds_to_hd": _whole_rounds(progress.time_to_hd_s),
            "rounds_to_hd_absolute": None if absolute is None else _whole_rounds(absolute),
            **dict.fromkeys(OF_A_CLOCK),
        }
    if not has_swarms(summary):
        summary |= dict.fromkeys(OF_SWARMS)
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
