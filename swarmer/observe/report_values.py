"""Values of settings and summaries as a reader of the report wants them."""

from __future__ import annotations

import math
from typing import Any

from swarmer.observe.report_page import esc
from swarmer.observe.words import unit_after

ENTRIES_SHOWN = 20


def text_of(value: Any) -> str:
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
        return ", ".join(f"{name}: {_inner(inner)}" for name, inner in value.items())
    if isinstance(value, (list, tuple)):
        return ("; " if _entries(value) else ", ").join(map(text_of, value)) if value else "none"
    return str(value)


def _inner(value: Any) -> str:
    """Within a mapping brackets tell where a value ends.

    >>> text_of({"at": 10, "where": {"half": "low", "axis": "l"}, "kinds": ["ACK", "FIN"]})
    'at: 10, where: {half: low, axis: l}, kinds: [ACK, FIN]'
    >>> text_of({"0.1": 2.5, "0.01": None})
    '0.1: 2.5, 0.01: –'
    """
    if isinstance(value, dict):
        return f"{{{text_of(value)}}}"
    return f"[{text_of(value)}]" if isinstance(value, (list, tuple)) else text_of(value)


def _entries(value: Any) -> bool:
    """Is it a list of mappings, as the faults of a schedule are?"""
    return isinstance(value, (list, tuple)) and bool(value) and all(isinstance(one, dict) for one in value)


def html_of(value: Any, unit: str) -> str:
    """The value of a setting in a cell of a table; each entry of a list of mappings on a line of its own."""
    if not _entries(value):
        return esc(text_of(value) + unit_after(value, unit))
    lines = [text_of(entry) for entry in value[:ENTRIES_SHOWN]]
    if len(value) > ENTRIES_SHOWN:
        lines.append(f"and {len(value) - ENTRIES_SHOWN} more, in config.yaml")
    return f"<ul class=entries>{''.join(f'<li>{esc(line)}</li>' for line in lines)}</ul>"
