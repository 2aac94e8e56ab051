"""`cause.html`, which `swarmer report` writes beside the report of a run with an event log; and the report's own part.

One file without a request: the moments at which HD rose, why, and the story of any FLS around any moment.
"""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Callable, Iterator, Sequence
from html import escape
from pathlib import Path
from typing import NamedTuple

import numpy as np

import swarmer
from swarmer.errors import BadInput
from swarmer.observe.cause import Cause, cause_of, flss
from swarmer.observe.files import write_text
from swarmer.observe.kept_scenes import MOST_OF_A_MOMENT, STATES, KeptScenes
from swarmer.observe.moves import Moves
from swarmer.observe.palette import STATE_COLOURS
from swarmer.observe.report_drawing import ROUNDS, SECONDS, Clock, clock_of
from swarmer.observe.report_page import (
    ASSETS,
    GENERATOR,
    STYLE,
    THEME,
    Part,
    data_block,
    note,
    policy,
    scrolling,
    table,
)
from swarmer.observe.rises import LEAST_FACTOR, Rise, rises
from swarmer.observe.run_directory import CAUSE, REPORT, TRACE
from swarmer.observe.saved_run import SavedRun, existing
from swarmer.observe.saved_timeline import SavedTimeline
from swarmer.observe.story import scenes
from swarmer.observe.summary import has_swarms
from swarmer.observe.trace_file import Record, TraceFile
from swarmer.observe.words import cells

TITLE = "From symptom to cause"
SCRIPTS = ("page.js", "cause.js")
FLIGHT_S = 1.0  # longer than a flight that localizes takes
SHOWN_IN_REPORT = 5  # moments
WIDTH, HEIGHT, LEFT, BOTTOM = 760, 220, 62, 34  # of the curve
CURVE_POINTS = 1500


def write_cause(run: SavedRun, report: Path, check: Callable[[Path], None]) -> Part:
    """Write the page beside the report, if the run has an event log; give the report's part.

    check: raises BadInput for a file that may not be replaced. Raises RunFailed if the page cannot be written.
    """
    if existing(run.path, TRACE) is None:
        return Part("cause", TITLE, _without_log(run))
    try:
        story = story_of(run)
    except BadInput as refused:
        return Part("cause", TITLE, note(str(refused)))
    out = report.with_name(CAUSE if report.name == REPORT else f"{report.stem}-{CAUSE}")
    check(out)
    write_text(out, page(run, story, report.name))
    return Part("cause", TITLE, section(story, out.name))


class Story(NamedTuple):
    """What a log tells of the moments at which HD rose."""

    causes: list[Cause]
    in_all: int  # such moments, also those that are not told
    kept: KeptScenes
    notes: list[str]  # what of the log was not whole


def story_of(run: SavedRun) -> Story:
    """Read the log of a run, if there is one. Raises BadInput for one that cannot be read."""
    found, in_all = rises(run.timeline) if run.timeline is not None and len(run.timeline.t_s) else ([], 0)
    trace = TraceFile(run.path)
    first = [off.fid for rise in found for off in rise.off[:2]]
    spans = [(rise.from_s - FLIGHT_S, rise.to_s) for rise in found]
    log = Moves(spans)
    kept = KeptScenes(trace.header.points, spans, first, trace.header.fids)
    for scene in scenes(_noted(trace.records(), log)):
        kept.add(scene)
    notes = trace.notes()
    if trace.header.fids is not None:
        few = flss(sorted(trace.header.fids))
        notes.append(f"--trace-fids kept the records of {few} alone: who else took part is not known")
    return Story([cause_of(rise, log) for rise in found], in_all, kept, notes)


def _noted(records: Iterator[Record], log: Moves) -> Iterator[Record]:
    for record in records:
        log.add(record)
        yield record


# -- the part of the report ------------------------------------------------------------------------------------------


def section(story: Story, page: str) -> str:
    """The report's part, as HTML. page: the name of the page beside the report."""
    items = "".join(
        f'<li><a href="{escape(page)}#rise-{number}">{_said(cause.rise)}</a> '
        f"{escape(cause.sentences[0] if cause.sentences else '')}</li>"
        for number, cause in enumerate(story.causes[:SHOWN_IN_REPORT], 1)
    )
    lead = _lead_of(story.in_all, bool(items))
    return (
        f"{lead}{f'<ol>{items}</ol>' if items else ''}"
        f'<p><a href="{escape(page)}">The datagrams, leases and vectors behind it</a>, of these moments and of any '
        f"FLS, are in <code>{escape(page)}</code> beside this file.</p>"
    )


def _lead_of(in_all: int, told: bool) -> str:
    share = f"{LEAST_FACTOR - 1:.0%}"
    if not in_all:
        return f"<p>HD never rose by more than {share} from one sample to the next.</p>"
    return f"<p>HD rose {_times(in_all)} by more than {share}{'; most, in proportion:' if told else '.'}</p>"


def _without_log(run: SavedRun) -> str:
    """The moments, as far as the positions tell them, and how to come by the rest."""
    timeline = run.timeline
    found, in_all = (
        rises(timeline, SHOWN_IN_REPORT) if timeline is not None and len(timeline.t_s) else ([], 0)
    )
    items = "".join(f"<li>{escape(_said(rise, clock_of(run)))} {escape(_who(rise))}</li>" for rise in found)
    return (
        f"{_lead_of(in_all, bool(items))}{f'<ol>{items}</ol>' if items else ''}"
        f"<p>This run has no event log, so this report cannot say why{_with_log(run)}"
    )


def _with_log(run: SavedRun) -> str:
    """Which run would have a log; virtual time refuses most techniques that have no swarms in rounds."""
    if not has_swarms(run.summary):
        return ": runs in rounds keep none.</p>"
    config = shlex.quote(str(run.path / "config.yaml"))
    command = f"swarmer-run --config {config} --engine virtual --trace"
    return f". The same settings in virtual time keep one; report that run:</p><pre>{escape(command)}</pre>"


def _who(rise: Rise) -> str:
    """Who is off, by how much at most."""
    if not rise.off:
        return ""
    many, worst = len(rise.off) > 1, rise.off[0]
    return (
        f"{flss([off.fid for off in rise.off])} {'are up to' if many else 'is'} {cells(worst.after_cells)} cells off"
        f"{', dark before' if worst.before_cells != worst.before_cells and not many else ''}."
    )


def _times(number: int) -> str:
    return {0: "never", 1: "once"}.get(number, f"{number:,} times")


def _said(rise: Rise, clock: Clock = SECONDS) -> str:
    when = clock.say(rise.to_s) if clock is ROUNDS else f"{rise.to_s:.2f} s"
    return (
        f"{when}: HD {cells(rise.before_cells)} to {cells(rise.after_cells)} cells, "
        f"{rise.factor:.3g} times as large."
    )


# -- the page --------------------------------------------------------------------------------------------------------


def page(run: SavedRun, story: Story, report: str) -> str:
    """The whole page. report: the name of the report beside it."""
    kept = story.kept
    scripts = [(ASSETS / name).read_text("utf-8") for name in SCRIPTS]
    style = STYLE + _state_colours() + (ASSETS / "cause.css").read_text("utf-8")
    body = [
        *map(note, story.notes),
        _curve(run.timeline, story.causes),
        f"<h2>Moments at which HD rose</h2>{_moments(run, story)}",
        _chooser(run, kept),
        data_block("data", _data(story, kept)),
    ]
    return (
        f"<!doctype html>\n<html lang=en><head><meta charset=utf-8>\n{GENERATOR}\n{policy(scripts)}\n"
        '<meta name=viewport content="width=device-width, initial-scale=1">\n'
        f"<title>{TITLE}: {escape(run.name)}</title>\n<style>{style}</style></head>\n"
        f"<body><header><div class=top><h1>{TITLE}</h1>{THEME}</div><p class=lead>{escape(_lead(run))} "
        f'<a href="{escape(report)}">The report</a>.</p></header>\n<main>\n{chr(10).join(body)}\n</main>\n'
        f"<footer>Made by swarmer {escape(swarmer.__version__)}. This file needs no other and no network.</footer>\n"
        + "".join(f"<script>{script}</script>\n" for script in scripts)
        + "</body></html>\n"
    )


def _lead(run: SavedRun) -> str:
    summary = run.summary
    parts = [f"{run.shape}, {summary.get('points', '?')} FLSs, seed {summary.get('seed', '?')}"]
    if summary.get("emulated_s") is not None:
        parts.append(f"{summary['emulated_s']:.1f} s emulated")
    return ", ".join(parts) + "."


def _state_colours() -> str:
    colours = "; ".join(f"--s{i}: {colour}" for i, colour in enumerate(STATE_COLOURS))
    return f":root {{ {colours} }}\n"


def _moments(run: SavedRun, story: Story) -> str:
    if not story.causes:
        return f"<p>HD never rose by more than {LEAST_FACTOR - 1:.0%} from one sample to the next.</p>"
    shown = len(story.causes)
    lead = f"HD rose {_times(story.in_all)} by more than {LEAST_FACTOR - 1:.0%}; "
    lead += "all are here" if shown == story.in_all else f"the {shown} largest are here"
    lead += ", the largest in proportion first. An FLS is off by as much as it adds to HD."
    parts = [_moment(run, story.kept, number, cause) for number, cause in enumerate(story.causes, 1)]
    return f"<p>{lead}</p>{''.join(parts)}"


def _moment(run: SavedRun, kept: KeptScenes, number: int, cause: Cause) -> str:
    cast, from_s, to_s = cause.moment
    rows = kept.around(number - 1, cause.moment)
    sentences = "".join(f"<p>{escape(sentence)}</p>" for sentence in cause.sentences)
    some = f"<p>The last {len(rows)} events of it:</p>" if len(rows) == MOST_OF_A_MOMENT else ""
    lines = escape("\n".join(row.line for row in rows)) or "nothing of these FLSs in these moments"
    fids = ",".join(map(str, cast)) or "1"
    command = f"{_explain(run)} --fls {fids} --from {_down(from_s)} --to {_up(to_s)}"
    return (
        f"<details id=rise-{number}{' open' if number == 1 else ''}><summary>{number}. {escape(_said(cause.rise))}"
        f"</summary>{sentences}{_moves(cause)}{some}"
        f"<div class=story data-rise={number - 1}><pre tabindex=0>{lines}</pre></div>"
        f"<p class=how>The same in a terminal: <code>{escape(command)}</code></p></details>"
    )


def _moves(cause: Cause) -> str:
    if not cause.moves:
        return ""
    rows = []
    for move in cause.moves:
        missed = [f"{fid} ({why})" for fid, why in move.missed().items()]
        rows.append([
            move.message, f"{move.t_s:.4f} s", str(move.localizer), str(move.anchor or "–"),
            cells(move.flights[0].cells) if move.flights else "–", _some(list(map(str, move.flown_by))), _some(missed),
        ])  # fmt: skip
    return table(
        ["vector", "sent", "of FLS", "anchor", "cells", "flown by", "not flown by"], rows, "Whose vector"
    )


def _some(names: Sequence[str], most: int = 12) -> str:
    left = len(names) - most
    return (", ".join(names[:most]) + (f" and {left} more" if left > 0 else "")) or "nobody"


def _explain(run: SavedRun) -> str:
    return f"swarmer explain {shlex.quote(str(run.path))}"


def _down(t_s: float) -> str:
    return f"{math.floor(t_s * 1e3) / 1e3:g}"


def _up(t_s: float) -> str:
    return f"{math.ceil(t_s * 1e3) / 1e3:g}"


def _chooser(run: SavedRun, kept: KeptScenes) -> str:
    whole = kept.whole
    if len(whole) == kept.points:
        held = "Of every FLS all that had an effect is here."
    else:
        held = (
            f"Of {escape(flss(whole)) if whole else 'no FLS'} all that had an effect is here; of the others, what "
            f"belongs to the moments above. The rest: <code>{escape(_explain(run))} --fls FID --from S --to S</code>."
        )
    states = "".join(
        f"<span><i style='background:var(--s{i})'></i>{name}</span>" for i, name in enumerate(STATES)
    )
    return f"""<section id=chooser class=needs-script><h2>The story of an FLS</h2><p>{held}</p>
<form id=choice><label>FLS <input id=fls value="{whole[0] if whole else 1}" size=9 autocomplete=off></label>
<label>from <input id=from type=number min=0 step=any> s</label>
<label>to <input id=to type=number min=0 step=any> s</label>
<button>Show</button><button type=button data-move=-1>Earlier</button><button type=button data-move=1>Later</button>
<button type=button data-scale=.5>Closer</button><button type=button data-scale=2>Wider</button></form>
<p id=said role=status></p><div id=life></div><p class=legend>{states}</p><div id=talk></div>
<h2>The life of a datagram</h2><form id=asked><label>its id, as it stands in brackets
<input id=message size=12 placeholder="17.0#203" autocomplete=off></label><button>Follow</button></form>
<p id=heard role=status></p><div id=followed></div></section>
<noscript><p>The pictures, and the stories of other moments, need a script that this page holds itself; yours does not
run it. All of it is told by <code>swarmer explain</code>, too.</p></noscript>"""


def _data(story: Story, kept: KeptScenes) -> str:
    """What the script shows, as JSON."""
    causes = story.causes
    head = {
        "points": kept.points,
        "states": STATES,
        "whole": kept.whole,
        "rises": [dict(zip(("cast", "from", "to"), cause.moment, strict=True)) for cause in causes],
    }
    rows = ",\n".join(row.text for row in kept.rows([cause.moment for cause in causes]))
    return f'{json.dumps(head)[:-1]}, "rows": [\n{rows}\n]}}'


# -- the curve -------------------------------------------------------------------------------------------------------


def _curve(timeline: SavedTimeline | None, causes: Sequence[Cause]) -> str:
    """HD over time, logarithmic, with a numbered mark at each moment that is told."""
    if timeline is None:
        return ""
    shown = np.isfinite(timeline.hd_cells) & (timeline.hd_cells > 0)
    if shown.sum() < 2:
        return ""
    t_s, hd = timeline.t_s[shown], np.log10(timeline.hd_cells[shown])
    end = max(float(t_s[-1]), 1e-9)
    low, high = math.floor(hd.min()), max(math.ceil(hd.max()), math.floor(hd.min()) + 1)

    def at(seconds: float, value: float) -> tuple[float, float]:
        x = LEFT + seconds / end * (WIDTH - LEFT - 14)
        return round(x, 1), round(14 + (high - value) / (high - low) * (HEIGHT - BOTTOM - 14), 1)

    grid = "".join(_level(value, at(0.0, value)[1]) for value in range(low, high + 1))
    step = max(1, len(t_s) // CURVE_POINTS)
    way = " ".join(f"{x},{y}" for x, y in (at(*one) for one in zip(t_s[::step], hd[::step], strict=True)))
    ticks = "".join(
        f"<text x={at(end * i / 4, low)[0]} y={HEIGHT - 12} text-anchor={'end' if i == 4 else 'middle'}>"
        f"{end * i / 4:.3g} s</text>"
        for i in range(5)
    )
    marks = "".join(
        _mark(number, cause, at(cause.rise.to_s, math.log10(max(cause.rise.after_cells, 1e-9))))
        for number, cause in reversed(list(enumerate(causes, 1)))
    )
    drawing = (
        f"<svg id=curve viewBox='0 0 {WIDTH} {HEIGHT}' role=group "
        f"aria-label='Hausdorff distance over time, with the moments at which it rose'>{grid}{ticks}"
        f"<polyline points='{way}' fill=none stroke='var(--accent)' stroke-width=1.8 />{marks}</svg>"
    )
    caption = "Hausdorff distance in cells, logarithmic, over emulated time; a number is a moment below."
    caption += " <span class=narrow>Wider than this screen: it scrolls sideways.</span>"
    return f"<figure>{scrolling(drawing, 'Hausdorff distance')}<figcaption>{caption}</figcaption></figure>"


def _level(value: int, y: float) -> str:
    name = f"{10.0**value:g}" if -4 <= value <= 4 else f"1e{value}"
    return (
        f"<line x1={LEFT} x2={WIDTH - 14} y1={y} y2={y} stroke='var(--grid)' />"
        f"<text x={LEFT - 8} y={y + 4} text-anchor=end>{name}</text>"
    )


def _mark(number: int, cause: Cause, place: tuple[float, float]) -> str:
    x, y = place
    return (
        f"<a href='#rise-{number}' aria-label='{escape(_said(cause.rise))}'><circle cx={x} cy={y} r=10 />"
        f"<text class=mark x={x} y={y + 4} text-anchor=middle>{number}</text></a>"
    )
