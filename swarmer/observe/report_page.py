"""The report's HTML: one file that asks the network for nothing; light and dark, on screen, phone and paper.

A page is a head, one sentence, and parts in order, each with a heading of the second level. A part is made elsewhere by
a function that gets the saved run; what it must keep to:

- its HTML is escaped (`esc`), its headings begin at the third level, its ids begin with its key;
- colours are the variables of report_assets/page.css, and nothing is wider than 390 pixels but inside `.scroll`;
- a script is a file in report_assets/ that is named in `SCRIPTS`: the page's policy lets no other run, and refuses all
  requests; data for it goes into `data_block`.
"""

from __future__ import annotations

import base64
import csv
import hashlib
import io
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

import swarmer
from swarmer.observe.report_drawing import Absent, Figure
from swarmer.observe.saved_run import SavedRun

GENERATOR = '<meta name="generator" content="swarmer report">'
ASSETS = Path(__file__).parent / "report_assets"
STYLE = (ASSETS / "page.css").read_text("utf-8")
SCRIPTS = ("page.js", "scene.js")
TABLE_ROWS = 25  # shown of a figure's data; all of it is in the CSV

THEME = """<p class="theme needs-script"><label for=theme>Colours</label> <select id=theme>
<option value=system>as the system</option><option value=light>light</option><option value=dark>dark</option>
</select></p>"""


class Part(NamedTuple):
    """A section of the page."""

    key: str  # its id
    title: str
    html: str


def esc(text: object) -> str:
    """Any text as HTML; also inside quoted attributes."""
    return escape(str(text), quote=True)


def page(title: str, heading: str, verdict: str, lead: str, above: str, parts: Sequence[Part]) -> str:
    """The whole file. title, heading, verdict, lead: plain text; above: HTML between those and the parts."""
    scripts = [(ASSETS / name).read_text("utf-8") for name in SCRIPTS]
    links = "".join(f'<li><a href="#{esc(part.key)}">{esc(part.title)}</a></li>' for part in parts)
    body = "\n".join(
        f'<section id="{esc(part.key)}" aria-labelledby="{esc(part.key)}-title">'
        f'<h2 id="{esc(part.key)}-title">{esc(part.title)}</h2>\n{part.html}</section>'
        for part in parts
    )
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">\n{GENERATOR}\n{policy(scripts)}\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{esc(title)}</title>\n<style>{STYLE}</style></head>\n"
        '<body><a class=skip href="#main">To the figures</a>\n'
        f"<header><div class=top><h1>{esc(heading)}</h1>{THEME}</div>\n"
        f"<p class=verdict>{esc(verdict)}</p>\n<p class=lead>{esc(lead)}</p></header>\n"
        f'<nav class=parts aria-label="Parts of this report"><ul>{links}</ul></nav>\n'
        f"<main id=main tabindex=-1>\n{above}\n{body}\n</main>\n"
        f"<footer>Made by swarmer {esc(swarmer.__version__)}. This file is whole: it needs no other and no network."
        "</footer>\n" + "".join(f"<script>{script}</script>\n" for script in scripts) + "</body></html>\n"
    )


def policy(scripts: Sequence[str]) -> str:
    """Only our own scripts run, and nothing is fetched, whatever a name in a run directory says."""
    digests = (base64.b64encode(hashlib.sha256(one.encode()).digest()).decode() for one in scripts)
    allowed = " ".join(f"'sha256-{digest}'" for digest in digests)
    return (
        '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; '
        f"script-src {allowed}; style-src 'unsafe-inline'; img-src data:; form-action 'none'; base-uri 'none'\">"
    )


def data_block(key: str, text: str) -> str:
    """Data for a script: found by its id, never run."""
    return f'<script type="application/octet-stream" id="{esc(key)}">{text.replace("<", chr(92) + "u003c")}</script>'


def figures(made: Sequence[Figure | Absent]) -> str:
    """A grid of figures, and a word on those for which there is no data."""
    shown = "".join(figure_html(one) for one in made if isinstance(one, Figure))
    absent = [one for one in made if isinstance(one, Absent)]
    words = "".join(f"<li>{esc(one.title)}: {esc(one.why)}</li>" for one in absent)
    note = f'<div class="soft absent"><p>Left out:</p><ul>{words}</ul></div>' if absent else ""
    return (f"<div class=figures>{shown}</div>" if shown else "") + note


def figure_html(figure: Figure) -> str:
    """A figure with its caption, its data as a table, and both to take away."""
    key, data = esc(figure.key), base64.b64encode(csv_of(figure).encode()).decode()
    return (
        f'<figure id="{key}"{" class=wide" if figure.wide else ""}><h3>{esc(figure.title)}</h3>{figure.svg}'
        f"<figcaption>{esc(figure.caption)}</figcaption><div class=take>"
        f'<button class=needs-script type=button data-svg="{key}" aria-label="Save as SVG: {esc(figure.title)}">'
        f'SVG</button> <a download="{key}.csv" href="data:text/csv;base64,{data}" '
        f'aria-label="Save the data as CSV: {esc(figure.title)}">CSV</a>'
        f"<details><summary>Data</summary>{_data_table(figure)}</details></div></figure>"
    )


def csv_of(figure: Figure) -> str:
    """The data of a figure, with a line of titles."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(figure.columns)
    writer.writerows(["" if cell is None else cell for cell in row] for row in figure.rows)
    return text.getvalue()


def _data_table(figure: Figure) -> str:
    count = len(figure.rows)
    step = -(-count // TABLE_ROWS) if count else 1
    rows = [*figure.rows[::step]]
    if count and (count - 1) % step:
        rows.append(figure.rows[-1])
    which = f"{len(rows)} of {count} rows; all are in the CSV" if step > 1 else f"{count} rows"
    return table(
        figure.columns, [[cell_text(cell) for cell in row] for row in rows], f"{figure.title}: {which}"
    )


def table(titles: Sequence[str], rows: Sequence[Sequence[str]], caption: str = "") -> str:
    """A table that scrolls by itself where it is too wide; titles and cells are plain text."""
    head = "".join(f"<th scope=col>{esc(title)}</th>" for title in titles)
    body = "".join("<tr>" + "".join(f"<td>{esc(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    above = f"<caption>{esc(caption)}</caption>" if caption else ""
    return scrolling(
        f"<table>{above}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>", caption or "Table"
    )


def scrolling(html: str, label: str) -> str:
    """Something wide in a box that scrolls, also by keys."""
    return f'<div class=scroll tabindex=0 role=region aria-label="{esc(label)}">{html}</div>'


def cell_text(value: Any) -> str:
    """A number of a figure's data in a table."""
    if value is None:
        return "–"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def missing_note(runs: Sequence[SavedRun]) -> str:
    """What of the run directories is not there or not whole."""
    lines = [(f"{run.name}: " if len(runs) > 1 else "") + line for run in runs for line in run.missing]
    return note("Not everything is there; this report shows what is whole.", lines) if lines else ""


def note(lead: str, lines: Sequence[str] = ()) -> str:
    """A box that warns."""
    items = "".join(f"<li>{esc(line)}</li>" for line in lines)
    return f"<div class=note>{esc(lead)}{f'<ul>{items}</ul>' if items else ''}</div>"
