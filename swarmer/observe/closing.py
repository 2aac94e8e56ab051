"""The last words of a run, for stderr: what happened, whether to trust it, what to do next."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarmer.observe.run_directory import RECORDING, TIMELINE
from swarmer.observe.saved_run import existing
from swarmer.observe.summary import has_swarms
from swarmer.observe.viewer import display_available
from swarmer.observe.words import cells, count, seconds, wrapped

if TYPE_CHECKING:
    from swarmer.config import RunConfig

ENDED = {"done": "done", "interrupted": "interrupted", "failed": "failed"}
COLUMN = 10  # characters of a threshold in the table


def closing_lines(
    summary: dict[str, Any], run_dir: Path, program: str = "swarmer", width: int = 80, missed: bool = False
) -> list[str]:
    """Lines of at most `width` columns, but for the commands. summary: as written; program: how the shell finds us.

    missed: see `missed_hd`.
    """
    lines = [_head(summary)]
    if summary.get("message"):
        lines.append(f"  {summary['message']}")
    if summary.get("hosts_lost"):
        lines.append(
            f"  {summary['hosts_lost']} of {summary['hosts']} hosts lost, {summary['replacements']} FLSs replaced: "
            "see events.csv"
        )
    lines.append(
        f"  HD {cells(summary.get('hd_cells'))} cells at the end, lowest {cells(summary.get('hd_min_cells'))}"
        f"{_swarms(summary)}"
    )
    lines += _lit(summary)
    in_rounds = summary.get("rounds_to_hd")
    lines += _table(in_rounds or summary.get("time_to_hd_s") or {}, width, in_rounds=bool(in_rounds))
    if summary.get("next_time_to_hd_s"):
        lines.append(
            f"  then {summary.get('next_shape')}, from {seconds(summary.get('next_at_s'))} on; HD after that"
        )
        lines += _table(summary["next_time_to_hd_s"], width)
    lines += _missed(summary) if missed else []
    lines += _trust(summary)
    return [part for line in lines for part in wrapped(line, width)] + _next(run_dir, program)


def _head(summary: dict[str, Any]) -> str:
    status = ENDED.get(str(summary.get("status")), str(summary.get("status")))
    wall = summary.get("wall_s") or 0.0
    if summary.get("rounds") is not None:
        went = f"{summary['rounds']} round{'s' * (summary['rounds'] != 1)}"
    else:
        went = f"{summary.get('emulated_s') or 0.0:.1f} s emulated"
    return f"{status}: {summary.get('shape')}, {summary.get('points')} FLSs, {went} in {wall:.1f} s"


def _swarms(summary: dict[str, Any]) -> str:
    if not has_swarms(summary):
        return ""
    first, first_round = summary.get("first_single_swarm_s"), summary.get("first_single_swarm_round")
    if first is None and first_round is None:
        return f"; never all one swarm ({count(summary.get('swarms_last'))} at the end)"
    number = summary.get("single_swarm_count") or 1
    when = seconds(first) if first_round is None else f"round {first_round}"
    return f"; one swarm at {when}" + (f", {number} ×" if number > 1 else "")


def _lit(summary: dict[str, Any]) -> list[str]:
    """How many are lit, where that is not all."""
    share, points = summary.get("lit_share"), summary.get("points")
    if summary.get("next_time_to_hd_s"):  # it has become the next shape
        points = summary.get("next_points")
    if share is None or not points or share >= 1:
        return []
    lit = round(share * points)
    of_them = "no HD of so few" if summary.get("hd_cells") is None else "HD is theirs alone"
    return [f"  {count(lit)} of {count(points)} FLSs lit at the end: {of_them}"]


def _table(reached: dict[str, Any], width: int, in_rounds: bool = False) -> list[str]:
    """When HD fell below each threshold: a column each, or a line where the columns are too many."""
    if not reached:
        return []
    when = _round if in_rounds else seconds
    if COLUMN * len(reached) + 5 > width:
        return [f"  HD {'< ' + name:{COLUMN}}{when(value):>8}" for name, value in reached.items()]
    above = "".join(f"{'< ' + name:>{COLUMN}}" for name in reached)
    below = "".join(f"{when(value):>{COLUMN}}" for value in reached.values())
    return [f"  HD {above}", f"  {'round' if in_rounds else 'at'} {below[3:] if in_rounds else below}"]


def _round(value: float | None) -> str:
    return "never" if value is None else f"{value:.0f}"


def missed_hd(summary: dict[str, Any], config: RunConfig) -> bool:
    """Was a run in rounds to go on until an HD that it has not got?"""
    if summary.get("rounds") is None or summary.get("converged") or config.rounds.stop != "hd":
        return False
    last, until = summary.get("hd_cells"), config.until_hd_cells
    return last is None or until is None or last >= until


def _missed(summary: dict[str, Any]) -> list[str]:
    where = " at a single swarm" if summary.get("formation_rounds") else ""
    return [f"  not converged: the HD asked for was not reached{where}"]


def _trust(summary: dict[str, Any]) -> list[str]:
    if summary.get("rounds") is not None:
        return []
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
    who = "its hosts were" if summary.get("engine") == "cluster" else "this machine was"
    return [f"  NOT FAITHFUL: {who} too slow for this run ({late}){advice}"]


def _ms(late: dict[str, float]) -> str:
    value = late.get("p99")
    return "–" if value is None else f"{value:.0f} ms"


def _next(run_dir: Path, program: str) -> list[str]:
    """The commands that work for what the run left on this machine; never broken, so that they can be copied."""
    where = shlex.quote(str(run_dir))
    lines = [f"  read   {program} report {where}"]
    if existing(run_dir, RECORDING) is not None:
        way = "" if display_available() else "--web "
        lines.insert(0, f"  watch  {program} replay {way}{where}")
    elif existing(run_dir, TIMELINE) is not None:
        lines.insert(0, f"  watch  {program} replay --terminal {where}")
    return lines
