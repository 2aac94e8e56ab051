"""What the report says in words: the verdict, the figures of a summary, what was run, and how to run it again."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from swarmer.config import load_config, setting_facts
from swarmer.errors import SwarmerError
from swarmer.observe.progress import LIT_MIN
from swarmer.observe.report_drawing import ROUNDS, SECONDS, Clock, clock_of
from swarmer.observe.report_page import Part, esc, scrolling, table
from swarmer.observe.report_values import html_of, text_of
from swarmer.observe.saved_run import SavedRun
from swarmer.observe.summary import has_swarms
from swarmer.observe.words import cells, count
from swarmer.settings_file import preset_names

EVENTS_SHOWN = 200
CODE = re.compile("`([^`]+)`")
UNFINISHED = "unfinished"  # the status of a run that left no summary


class Setting(NamedTuple):
    """A row of the table of settings."""

    name: str
    value: Any
    usual: Any  # the preset's
    unit: str
    help: str

    @property
    def changed(self) -> bool:
        """True if it is not as in the preset."""
        return bool(text_of(self.value) != text_of(self.usual))


# -- the verdict -----------------------------------------------------------------------------------------------------


def verdict(run: SavedRun) -> str:
    """The run in one sentence: what became of the shape, and whether to believe it."""
    summary, clock = run.summary, clock_of(run)
    if not summary:
        return "Nothing is left of this run that could be judged."
    return f"{_ending(summary, clock)}{_shape(summary, clock)}{_next(summary)}{_failures(summary)}{_trust(summary)}."


CUT = {
    "failed": "failed at",
    "interrupted": "was interrupted at",
    UNFINISHED: "did not end, its last sample is of",
}


def _ending(summary: dict[str, Any], clock: Clock) -> str:
    count_of = f"the {count(summary['points'])} FLSs" if summary.get("points") else "the FLSs"
    if (how := CUT.get(str(summary.get("status")))) is not None:
        return f"The run {how} {clock.say(length_of(summary))}; by then {count_of} "
    return count_of[0].upper() + count_of[1:] + " "


def _shape(summary: dict[str, Any], clock: Clock) -> str:
    cut = str(summary.get("status")) in CUT
    well, ill = _one_swarm(summary, clock, cut)
    lowest = summary.get("hd_min_cells")
    if lowest is None:
        unlit = "had not all been lit" if cut else "were never all lit"
        return f"{ill}{unlit}, so no distance from the shape counts"
    reached = {name: t for name, t in reached_of(summary).items() if t is not None}
    if not reached:
        formed = "had not formed" if cut else "did not form"
        return f"{ill}{formed} the shape: HD was never below 1 cell, {cells(lowest)} at best"
    name = min(reached, key=float)
    came = "had come" if cut else "came"
    when = moment(reached[name], clock)
    return f"{well}{came} within {of_cells(name)} of the shape {when}{_since(summary, name)}"


def _one_swarm(summary: dict[str, Any], clock: Clock, cut: bool) -> tuple[str, str]:
    """Whether and when there was one swarm, before good news of the shape and before bad; empty for a yardstick."""
    if not has_swarms(summary):
        return "", ""
    single = single_of(summary)
    if single is None:
        one = "had not become one swarm" if cut else "never became one swarm"
        return f"{one}, yet ", f"{one} and "
    one = f"{'had become' if cut else 'became'} one swarm {moment(single, clock)}"
    return f"{one} and ", f"{one} but "


def of_cells(threshold: str) -> str:
    """A threshold of HD in words.

    >>> of_cells("1"), of_cells("0.1")
    ('1 cell', '0.1 cells')
    """
    return f"{threshold} cell{'' if threshold == '1' else 's'}"


def _since(summary: dict[str, Any], name: str, changed: bool = False) -> str:
    """What has become of it since. changed: the display has become its next shape, and this is said of that."""
    if summary.get("next_time_to_hd_s") and not changed:
        return ""
    last, share = summary.get("hd_cells"), summary.get("lit_share")
    points = summary.get("next_points" if changed else "points")
    if last is None:
        few = share is not None and points is not None and share * points < LIT_MIN
        return ", but too few are lit at the end" if few else "; how far away it ended is not known"
    lit = (
        f" with {share * points:.0f} of {count(points)} lit"
        if share is not None and points and share < 1
        else ""
    )
    return f", but ended {cells(last)} cells away{lit}" if last > 2 * float(name) else ""


def _next(summary: dict[str, Any]) -> str:
    """What became of the next shape, where there was to be one."""
    shape, at_s, times = (summary.get(name) for name in ("next_shape", "next_at_s", "next_time_to_hd_s"))
    if shape is None or at_s is None:
        return ""
    if not isinstance(times, dict):
        return f"; {shape}, which it was to become at {at_s:.1f} s, never began"
    reached = {name: t for name, t in times.items() if isinstance(t, (int, float)) and _is_number(name)}
    if not reached:
        return f"; {shape}, which it was to become from {at_s:.1f} s on, was not formed"
    name = min(reached, key=float)
    return (
        f"; from {at_s:.1f} s on it became {shape}, within {of_cells(name)} {reached[name]:.1f} s later"
        f"{_since(summary, name, changed=True)}"
    )


def _failures(summary: dict[str, Any]) -> str:
    number = summary.get("failures")
    if not number:
        return ""
    return f"; there were {count(number)} failures" if number != 1 else "; there was one failure"


def _trust(summary: dict[str, Any]) -> str:
    broken = summary.get("invariant_violations")
    if broken:
        return f"; {broken} broken invariant{'s' if broken != 1 else ''}: the protocol did what it must not"
    faithful = summary.get("faithful")
    if faithful is None:
        unheard = summary.get("status") != UNFINISHED and summary.get("handled_late_ms", "") is None
        return "; no message was handled, so nothing says whether to trust the times" if (
            unheard and summary.get("engine") in ("process", "virtual", "cluster")
        ) else ""  # fmt: skip
    if faithful:
        return "; timers and messages were in time, so the run can be trusted"
    slow = {"virtual": "the FLSs could not keep up", "cluster": "its hosts were too slow"}
    who = slow.get(str(summary.get("engine")), "this machine was too slow")
    return f"; but {who}, so do not trust the times"


def moment(t: float | None, clock: Clock) -> str:
    """`after 12.3 s`, `in round 5`."""
    return f"{'in' if clock is ROUNDS else 'after'} {clock.say(t)}"


def reached_of(summary: dict[str, Any]) -> dict[str, float | None]:
    """When HD was below each threshold, in seconds or in rounds."""
    for name in ("time_to_hd_s", "rounds_to_hd"):
        found = summary.get(name)
        if isinstance(found, dict) and any(isinstance(value, (int, float)) for value in found.values()):
            return {
                key: value if isinstance(value, (int, float)) else None
                for key, value in found.items()
                if _is_number(key)
            }
    return {}


def length_of(summary: dict[str, Any]) -> float | None:
    """How long the run was, in seconds or in rounds."""
    return _first_number(summary, "emulated_s", "rounds")


def single_of(summary: dict[str, Any]) -> float | None:
    """When all were one swarm for the first time, in seconds or in rounds."""
    return _first_number(summary, "first_single_swarm_s", "first_single_swarm_round")


def _first_number(summary: dict[str, Any], *names: str) -> float | None:
    found = (summary.get(name) for name in names)
    return next((float(value) for value in found if isinstance(value, (int, float))), None)


def _is_number(text: str) -> bool:
    try:
        return float(text) > 0
    except ValueError:
        return False


def heading(run: SavedRun) -> str:
    """The shape, or both of a run that changes it, and how many FLSs light it."""
    summary = run.summary
    shown = [(run.shape, summary.get("points")), (summary.get("next_shape"), summary.get("next_points"))]
    return ", then ".join(
        str(shape) if points is None else f"{shape}: {points:,.0f} FLSs" for shape, points in shown if shape
    )


def lead(run: SavedRun) -> str:
    """Engine, seed, how long, when."""
    summary, clock = run.summary, clock_of(run)
    parts = [
        str(summary.get("status", "nothing whole")),
        f"engine {summary.get('engine', '?')}",
        f"seed {'?' if summary.get('seed') is None else summary['seed']}",
    ]
    if (spent := length_of(summary)) is not None:
        parts.append(
            f"{spent:.0f} round{'s' * (spent != 1)}" if clock is ROUNDS else f"{spent:.1f} s emulated"
        )
    if summary.get("wall_s") is not None:
        parts.append(f"took {summary['wall_s']:.1f} s")
    if run.manifest.get("started"):
        parts.append(f"started {run.manifest['started']}")
    return ", ".join(parts)


# -- numbers ---------------------------------------------------------------------------------------------------------


def tiles(run: SavedRun) -> str:
    """The figures that most readers look for, large."""
    summary, clock = run.summary, clock_of(run)
    if not summary:
        return ""
    reached = reached_of(summary)
    lowest = min((name for name, t in reached.items() if t is not None), key=float, default="0.01")
    shown = [
        (cells(summary.get("hd_cells")), "HD at the end, cells", ""),
        (cells(summary.get("hd_absolute_cells")), "the same without translation", ""),
        (clock.say(reached.get(lowest)) if reached else "–", f"until HD < {lowest}", ""),
        *_next_tile(summary),
        (
            clock.say(single_of(summary)) if has_swarms(summary) else "–",
            f"until one swarm{_times(summary)}",
            "",
        ),
        (count(summary.get("thaws")) if has_swarms(summary) else "–", "thaws", ""),
        (cells(summary.get("distance_cells_mean")), "cells flown by an FLS, mean", ""),
        (count(summary.get("datagrams_sent")), "datagrams sent", ""),
        (count(summary.get("failures")) if summary.get("failures") else "–", "FLSs failed", "warn"),
        *_fidelity_tiles(summary),
    ]
    cards = (
        f"<li class=tile><b class='{kind}'>{esc(big)}</b><span>{esc(small)}</span></li>"
        for big, small, kind in shown
        if big != "–"
    )
    return f"<ul class=tiles aria-label='At a glance'>{''.join(cards)}</ul>"


def _times(summary: dict[str, Any]) -> str:
    number = summary.get("single_swarm_count")
    return "" if not number else " (once)" if number == 1 else f" ({text_of(number)} times)"


def _next_tile(summary: dict[str, Any]) -> list[tuple[str, str, str]]:
    times = summary.get("next_time_to_hd_s")
    if not isinstance(times, dict):
        return []
    reached = [name for name, t in times.items() if isinstance(t, (int, float))]
    lowest = min(reached, key=float, default="1")
    return [
        (
            SECONDS.say(times.get(lowest)),
            f"from the change until HD < {lowest} of {summary.get('next_shape')}",
            "",
        )
    ]


def _fidelity_tiles(summary: dict[str, Any]) -> list[tuple[str, str, str]]:
    faithful = summary.get("faithful")
    if faithful is None:
        return []
    late = [(summary.get(name) or {}).get("p99") for name in ("timer_late_ms", "handled_late_ms")]
    known = [value for value in late if value is not None]
    shown = [(f"{max(known):.0f} ms", "late at most, 99 % of timers and messages", "")] if known else []
    scale = summary.get("suggested_time_scale")
    advice = "" if faithful or scale is None else f"; --time-scale {scale:.2g} would do"
    if faithful:
        return [*shown, ("faithful", "in time, within half a lease", "good")]
    return [*shown, ("not faithful", f"later than half a lease{advice}", "warn")]


def summary_part(run: SavedRun) -> Part | None:
    """Every number of summary.json."""
    if not run.summary:
        return None
    rows = [
        [name, text_of(value)]
        for name, value in run.summary.items()
        if name != "format" and value is not None
    ]
    caption = "summary.json, without what is null; docs/reading-a-run.md says what each is"
    return Part("summary", "All numbers", table(["name", "value"], rows, caption))


def events_part(run: SavedRun) -> Part | None:
    """The last events."""
    if not run.events:
        return None
    shown, clock = run.events[-EVENTS_SHOWN:], clock_of(run)
    if len(shown) < len(run.events):
        which = f"the last {len(shown)} of {len(run.events)}"
    else:
        which = f"all {len(shown)}" if len(shown) > 1 else "1"
    said = f"{which} event{'s' * (len(shown) != 1)}"
    rows = [[clock.say(event.t_s), event.kind, str(event.fid or ""), event.text] for event in shown]
    body = table(["when", "kind", "FLS", "text"], rows, f"events.csv, {which}")
    return Part("events", "Events", f"<details><summary>{said}</summary>{body}</details>")


# -- what was run ----------------------------------------------------------------------------------------------------


def setting_part(run: SavedRun) -> Part:
    """Settings that differ from the preset, versions, and the commands that repeat the run."""
    preset = preset_of(run.manifest.get("command"))
    rows = settings(run.config, preset)
    changed = [row for row in rows if row.changed]
    same = [row for row in rows if not row.changed]
    body = []
    if not rows:
        body.append("<p>The settings are not there.</p>")
    elif changed:
        body.append(_setting_table(changed, preset, f"What differs from the preset {preset}"))
    else:
        body.append(f"<p>Everything is as in the preset {esc(preset)}.</p>")
    if same:
        inside = _setting_table(same, preset, "As in the preset")
        body.append(f"<details><summary>{len(same)} settings as in the preset</summary>{inside}</details>")
    body += ["<h3>To run it again</h3>", commands([run]), f"<p class=soft>{esc(versions(run))}</p>"]
    return Part("run", "What was run", "\n".join(body))


def settings(config: dict[str, Any], preset: str = "default") -> list[Setting]:
    """The settings of a run, those that differ from the preset first."""
    flat = flat_settings(config)
    try:
        usual = load_config(preset).flat()
    except SwarmerError:
        usual = {}
    known = [fact for fact in setting_facts() if fact.name in flat]
    rows = [
        Setting(fact.name, flat.pop(fact.name), usual.get(fact.name), fact.unit, fact.help) for fact in known
    ]
    rows += [Setting(name, value, None, "", "") for name, value in flat.items()]
    return sorted(rows, key=lambda row: not row.changed)


def preset_of(command: object) -> str:
    """The preset that a run was started with, by its command; `default` if it names none.

    >>> preset_of("swarmer-run --shape hat --config paper"), preset_of("swarmer-run --config=a.yaml"), preset_of(None)
    ('paper', 'default', 'default')
    """
    try:
        words = shlex.split(command) if isinstance(command, str) else []
    except ValueError:
        words = []
    named = [after for word, after in pairwise(words) if word == "--config"]
    named += [word.partition("=")[2] for word in words if word.startswith("--config=")]
    return next((name for name in named if name in preset_names()), "default")


def flat_settings(config: dict[str, Any], before: str = "") -> dict[str, Any]:
    """Settings by dotted name."""
    flat: dict[str, Any] = {}
    for name, value in config.items():
        if isinstance(value, dict):
            flat |= flat_settings(value, f"{before}{name}.")
        else:
            flat[f"{before}{name}"] = value
    return flat


def _setting_table(rows: Sequence[Setting], preset: str, caption: str) -> str:
    lines = "".join(
        f"<tr><td><code>{esc(row.name)}</code></td>"
        f"<td class=value>{html_of(row.value, row.unit)}</td>"
        f"<td>{esc(text_of(row.usual)) if row.changed else ''}</td><td class=help>{_marked(row.help)}</td></tr>"
        for row in rows
    )
    head = (
        f"<th scope=col>setting</th><th scope=col>this run</th><th scope=col>{esc(preset)}</th>"
        "<th scope=col class=help>meaning</th>"
    )
    inside = f"<table><caption>{esc(caption)}</caption><thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table>"
    return scrolling(inside, caption)


def _marked(text: str) -> str:
    """Help text as HTML: `names` as code."""
    return CODE.sub(r"<code>\1</code>", esc(text))


def commands(runs: Sequence[SavedRun]) -> str:
    """How each run was started, how to make it again, how to watch it."""
    lines = []
    for run in runs:
        if command := run.manifest.get("command"):
            lines.append(f"# as it was started\n{command}")
        where = run.path
        if (where / "config.yaml").exists():
            config = shlex.quote(str(where / "config.yaml"))
            lines.append(f"# from its resolved settings\nswarmer-run --config {config}")
        lines.append(f"# watch it\nswarmer replay {shlex.quote(str(where))}")
    return f"<pre>{esc(chr(10).join(lines))}</pre>"


def versions(run: SavedRun) -> str:
    """What it was made with."""
    made = run.manifest
    named = [f"{name} {made[name]}" for name in ("swarmer", "python") if made.get(name)]
    libraries = made.get("libraries")
    if isinstance(libraries, dict):
        named += [f"{name} {version}" for name, version in libraries.items()]
    named += [str(made["platform"])] if made.get("platform") else []
    named += [f"{made['cpus']} cores"] if made.get("cpus") else []
    return ", ".join(named)


def label_of(path: Path) -> str:
    """How a reader tells a run from others."""
    return path.resolve().name
