"""The report's HTML: one file, no script, no request; light and dark, on screen and on paper."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from html import escape
from typing import Any, NamedTuple

import swarmer
from swarmer.observe.saved_run import SavedRun
from swarmer.observe.words import cells, count, seconds

GENERATOR = '<meta name="generator" content="swarmer report">'
EVENTS_SHOWN = 200

STYLE = """
:root { color-scheme: light dark; --ground: #fbfbfa; --card: #ffffff; --ink: #1d2330; --soft: #626b7c;
  --grid: #d9dde3; --faint: #b4bac4; --accent: #2f7fd0; --warn: #b3470f; --good: #1f7a55; }
@media (prefers-color-scheme: dark) { :root { --ground: #0f131a; --card: #171c25; --ink: #dfe4ec; --soft: #98a2b3;
  --grid: #2d3542; --faint: #4a5364; --accent: #6cb0f5; --warn: #f0a35e; --good: #5cc79a; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--ground); color: var(--ink); font: 15px/1.5 system-ui, sans-serif; }
main { max-width: 60rem; margin: 0 auto; padding: 2.2rem 1.2rem 4rem; }
h1 { font-size: 1.7rem; margin: 0; letter-spacing: -.01em; }
h2 { font-size: 1.1rem; margin: 2.2rem 0 .6rem; }
p.lead { color: var(--soft); margin: .2rem 0 1.4rem; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(11rem, 1fr)); gap: .7rem; }
.tile, figure, .note, pre { background: var(--card); border: 1px solid var(--grid); border-radius: .6rem;
  padding: .8rem 1rem; }
.tile b { display: block; font-size: 1.45rem; font-weight: 600; font-variant-numeric: tabular-nums; }
.tile span { color: var(--soft); font-size: .85rem; }
.good { color: var(--good); } .warn { color: var(--warn); }
figure { margin: 0; } figure svg { width: 100%; height: auto; display: block; color: var(--ink); }
figure svg text { font-family: system-ui, sans-serif !important; }
figcaption { color: var(--soft); font-size: .85rem; }
.note { border-left: 4px solid var(--warn); margin: 1rem 0; } .note ul { margin: .3rem 0 0; padding-left: 1.2rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; font-size: .9rem; }
td, th { text-align: left; padding: .28rem .8rem .28rem 0; border-bottom: 1px solid var(--grid); vertical-align: top; }
th { color: var(--soft); font-weight: 500; } td.help { color: var(--soft); }
tr.changed td:nth-child(2) { font-weight: 600; }
pre, code { font: .87rem/1.5 ui-monospace, monospace; }
pre { overflow-x: auto; }
summary { cursor: pointer; color: var(--accent); margin: .6rem 0; }
footer { color: var(--soft); font-size: .85rem; margin-top: 3rem; }
@media print { body { background: none; font-size: 10pt; } main { max-width: none; padding: 0; }
  figure, .tile, .note { break-inside: avoid; } h2 { break-after: avoid; } }
"""


class Section(NamedTuple):
    """A figure with its heading."""

    title: str
    svg: str
    caption: str


class Setting(NamedTuple):
    """A row of the table of settings."""

    name: str
    value: Any
    default: Any
    unit: str
    help: str

    @property
    def changed(self) -> bool:
        """True if it is not the default."""
        return bool(_text(self.value) != _text(self.default))


def single(run: SavedRun, figures: Sequence[Section], settings: Sequence[Setting]) -> str:
    """The report of one run."""
    summary = run.summary
    body = [
        f"<h1>{escape(run.shape)}: {_text(summary.get('points'))} FLSs</h1>",
        f"<p class=lead>{escape(_lead(run))}</p>",
        _note(summary.get("message")),
        _missing([run]),
        _tiles(summary),
        *map(_figure, figures),
        _settings(settings),
        _summary_table(summary),
        _events(run),
        _reproduce([run]),
    ]
    return _page(f"swarmer: {run.name}", body)


def several(runs: Sequence[SavedRun], figures: Sequence[Section], differing: dict[str, list[Any]]) -> str:
    """The report of several runs, side by side."""
    names = [run.name for run in runs]
    keys = dict.fromkeys(key for run in runs for key in run.summary)
    rows = {key: [_text(run.summary.get(key)) for run in runs] for key in keys if key != "format"}
    rows = {key: row for key, row in rows.items() if set(row) != {"–"}}
    body = [
        f"<h1>{len(runs)} runs compared</h1>",
        f"<p class=lead>{escape(', '.join(names))}</p>",
        _missing(runs),
        *map(_figure, figures[:2]),
        "<h2>Settings that differ</h2>",
        _side_by_side(names, {key: [_text(value) for value in row] for key, row in differing.items()})
        if differing
        else "<p>None: the runs differ in nothing that is set.</p>",
        "<h2>Summaries</h2>",
        _side_by_side(names, rows),
        *map(_figure, figures[2:]),
        _reproduce(runs),
    ]
    return _page(f"swarmer: {len(runs)} runs", body)


def _page(title: str, body: Sequence[str]) -> str:
    head = (
        f"<!doctype html>\n<html lang=en><head><meta charset=utf-8>\n{GENERATOR}\n"
        f'<meta name=viewport content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style></head>\n<body><main>\n"
    )
    foot = f"<footer>Made by swarmer {escape(swarmer.__version__)}.</footer>\n</main></body></html>\n"
    return head + "\n".join(part for part in body if part) + "\n" + foot


def _lead(run: SavedRun) -> str:
    summary = run.summary
    parts = [
        str(summary.get("status", "nothing whole")),
        f"engine {summary.get('engine', '?')}",
        f"seed {summary.get('seed', '?')}",
    ]
    if summary.get("emulated_s") is not None:
        parts.append(f"{summary['emulated_s']:.1f} s emulated")
    if summary.get("wall_s") is not None:
        parts.append(f"in {summary['wall_s']:.1f} s")
    if run.manifest.get("started"):
        parts.append(f"started {run.manifest['started']}")
    return ", ".join(parts)


def _tiles(summary: dict[str, Any]) -> str:
    if not summary:
        return ""
    single = summary.get("first_single_swarm_s")
    reached = (summary.get("time_to_hd_s") or {}).get("0.01")
    tiles = [
        (cells(summary.get("hd_cells")), "HD at the end, cells", ""),
        (cells(summary.get("hd_min_cells")), "lowest HD, cells", ""),
        (seconds(reached), "until HD < 0.01", ""),
        (seconds(single), f"until one swarm ({_times(summary.get('single_swarm_count'))})", ""),
        (cells(summary.get("distance_cells_mean")), "cells flown by an FLS, mean", ""),
        (count(summary.get("datagrams_sent")), "datagrams sent", ""),
        (_late(summary, "timer_late_ms"), "timers late, p99, emulated", ""),
        (_late(summary, "handled_late_ms"), "messages late, p99, emulated", ""),
    ]
    faithful = summary.get("faithful")
    if faithful is not None:
        scale = summary.get("suggested_time_scale")
        advice = "" if faithful or scale is None else f"; --time-scale {scale:.2g} would do"
        word = "faithful" if faithful else "not faithful"
        tiles.append(
            (word, f"time scale {summary.get('time_scale') or 0:.2g}{advice}", "good" if faithful else "warn")
        )
    cards = (
        f"<div class=tile><b class='{kind}'>{escape(big)}</b><span>{escape(small)}</span></div>"
        for big, small, kind in tiles
        if big != "–"
    )
    return f"<div class=tiles>{''.join(cards)}</div>"


def _times(number: Any) -> str:
    return "once" if number == 1 else f"{_text(number)} times"


def _late(summary: dict[str, Any], name: str) -> str:
    late = summary.get(name)
    return "–" if not isinstance(late, dict) or late.get("p99") is None else f"{late['p99']:.0f} ms"


def _figure(section: Section) -> str:
    caption = f"<figcaption>{escape(section.caption)}</figcaption>" if section.caption else ""
    return f"<h2>{escape(section.title)}</h2><figure>{section.svg}{caption}</figure>"


def _note(text: Any) -> str:
    return f"<div class=note>{escape(str(text))}</div>" if text else ""


def _missing(runs: Sequence[SavedRun]) -> str:
    lines = [(f"{run.name}: " if len(runs) > 1 else "") + line for run in runs for line in run.missing]
    if not lines:
        return ""
    items = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return f"<div class=note>Not everything is there; this report shows what is whole.<ul>{items}</ul></div>"


def _settings(rows: Sequence[Setting]) -> str:
    if not rows:
        return ""
    changed = [row for row in rows if row.changed]
    same = [row for row in rows if not row.changed]
    first = _setting_rows(changed) if changed else "<p>All are at their defaults.</p>"
    rest = (
        f"<details><summary>{len(same)} settings at their defaults</summary>{_setting_rows(same)}</details>"
        if same
        else ""
    )
    return f"<h2>Settings</h2>{first}{rest}"


def _setting_rows(rows: Sequence[Setting]) -> str:
    lines = "".join(
        f"<tr class='{'changed' if row.changed else ''}'><td><code>{escape(row.name)}</code></td>"
        f"<td>{escape(_text(row.value))} {escape(row.unit)}</td>"
        f"<td>{escape(_text(row.default)) if row.changed else ''}</td><td class=help>{escape(row.help)}</td></tr>"
        for row in rows
    )
    head = "<tr><th>setting<th>value<th>default<th></tr>" if rows and rows[0].changed else ""
    return f"<div class=wide><table>{head}{lines}</table></div>"


def _summary_table(summary: dict[str, Any]) -> str:
    if not summary:
        return ""
    lines = "".join(
        f"<tr><td><code>{escape(name)}</code></td><td>{escape(_text(value))}</td></tr>"
        for name, value in summary.items()
        if name != "format" and value is not None
    )
    return f"<h2>Summary</h2><div class=wide><table>{lines}</table></div>"


def _side_by_side(names: Sequence[str], rows: dict[str, list[str]]) -> str:
    head = "".join(f"<th>{escape(name)}" for name in names)
    lines = "".join(
        f"<tr><td><code>{escape(key)}</code></td>{''.join(f'<td>{escape(text)}</td>' for text in row)}</tr>"
        for key, row in rows.items()
    )
    return f"<div class=wide><table><tr><th>{head}</tr>{lines}</table></div>"


def _events(run: SavedRun) -> str:
    if not run.events:
        return ""
    shown = run.events[-EVENTS_SHOWN:]
    lines = "".join(
        f"<tr><td>{event.t_s:.2f} s</td><td>{escape(event.kind)}</td><td>{event.fid or ''}</td>"
        f"<td>{escape(event.text)}</td></tr>"
        for event in shown
    )
    which = (
        f"the last {len(shown)} of {len(run.events)} events"
        if len(shown) < len(run.events)
        else f"{len(shown)} events"
    )
    return f"<h2>Events</h2><details><summary>{which}</summary><div class=wide><table>{lines}</table></div></details>"


def _reproduce(runs: Sequence[SavedRun]) -> str:
    lines = []
    for run in runs:
        if command := run.manifest.get("command"):
            lines.append(f"# as it was started\n{command}")
        config = shlex.quote(str(run.path / "config.yaml"))
        lines.append(
            f"# from its resolved settings\nswarmer-run --config {config}\n"
            f"# watch it\nswarmer replay {shlex.quote(str(run.path))}"
        )
    made = runs[0].manifest
    versions = ", ".join(
        f"{name} {made[name]}" for name in ("swarmer", "python", "platform") if made.get(name)
    )
    foot = f"<p class=lead>{escape(versions)}</p>" if versions else ""
    return f"<h2>How to reproduce</h2><pre>{escape(chr(10).join(lines))}</pre>{foot}"


def _text(value: Any) -> str:
    """A value of a summary or a setting as a reader wants it."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}" if abs(value) >= 10_000 else str(value)
    if isinstance(value, float):
        return f"{value:.6g}" if math.isfinite(value) else str(value)
    if isinstance(value, dict):
        return ", ".join(f"{name}: {_text(inner)}" for name, inner in value.items())
    if isinstance(value, (list, tuple)):
        return ", ".join(map(_text, value)) if value else "none"
    return str(value)
