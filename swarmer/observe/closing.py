"""The last words of a run, for stderr: what happened, whether to trust it, what to do next."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

from swarmer.observe.words import cells, count, seconds

ENDED = {"done": "done", "interrupted": "interrupted", "failed": "failed"}


def closing_lines(summary: dict[str, Any], run_dir: Path, program: str = "swarmer") -> list[str]:
    """Lines of at most some 80 columns. summary: as written. program: how this machine's shell finds us."""
    lines = [_head(summary)]
    if summary.get("message"):
        lines.append(f"  {summary['message']}")
    lines.append(
        f"  HD {cells(summary.get('hd_cells'))} cells at the end, lowest {cells(summary.get('hd_min_cells'))}; "
        f"{_swarms(summary)}"
    )
    lines += _table(summary)
    lines += _trust(summary)
    where = shlex.quote(str(run_dir))
    lines.append(f"  watch  {program} replay {where}")
    lines.append(f"  read   {program} report {where}")
    return lines


def _head(summary: dict[str, Any]) -> str:
    status = ENDED.get(str(summary.get("status")), str(summary.get("status")))
    emulated, wall = summary.get("emulated_s") or 0.0, summary.get("wall_s") or 0.0
    return f"{status}: {summary.get('shape')}, {summary.get('points')} FLSs, {emulated:.1f} s emulated in {wall:.1f} s"


def _swarms(summary: dict[str, Any]) -> str:
    first = summary.get("first_single_swarm_s")
    if first is None:
        return f"never one swarm ({count(summary.get('swarms_last'))} at the end)"
    number = summary.get("single_swarm_count") or 1
    return f"one swarm at {seconds(first)}" + (f", {number} ×" if number > 1 else "")


def _table(summary: dict[str, Any]) -> list[str]:
    """When HD fell below each threshold."""
    reached = summary.get("time_to_hd_s") or {}
    if not reached:
        return []
    above = "".join(f"{'< ' + name:>10}" for name in reached)
    below = "".join(f"{seconds(value):>10}" for value in reached.values())
    return [f"  HD {above}", f"  at {below}"]


def _trust(summary: dict[str, Any]) -> list[str]:
    if summary.get("faithful") is None:
        return (
            [] if summary.get("handled_late_ms") else ["  not known to be faithful: no message was handled"]
        )
    timers, handled = summary.get("timer_late_ms") or {}, summary.get("handled_late_ms") or {}
    late = f"p99 late: timers {_ms(timers)}, messages {_ms(handled)}"
    if summary["faithful"]:
        return [f"  faithful: {late}"]
    if summary.get("engine") == "virtual":
        return [f"  NOT FAITHFUL: the FLSs could not keep up with what they had to handle ({late})"]
    scale = summary.get("suggested_time_scale")
    advice = "" if scale is None else f"; --time-scale {scale:.2g} would do"
    return [f"  NOT FAITHFUL: this machine was too slow for this run ({late}){advice}"]


def _ms(late: dict[str, float]) -> str:
    value = late.get("p99")
    return "–" if value is None else f"{value:.0f} ms"
