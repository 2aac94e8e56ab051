"""A run directory read back, whole or not: what can be read, and a list of what is missing."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from swarmer.engines.result import Event
from swarmer.errors import BadInput
from swarmer.observe import saved_timeline, strange_npz
from swarmer.observe.files import PARTIAL
from swarmer.observe.run_directory import (
    CONFIG,
    EVENTS,
    FILES,
    MANIFEST,
    MANIFEST_FORMAT,
    RECORDING,
    SUMMARY,
    TIMELINE,
)
from swarmer.observe.saved_timeline import SavedTimeline
from swarmer.observe.summary import FORMAT, WITHIN, number_names
from swarmer.yaml_file import SIZE_MAX, parse

# What readers raise at files that were cut or hold something else.
BROKEN = (*strange_npz.BROKEN, RecursionError, csv.Error, yaml.YAMLError, BadInput)
# Tables of a summary.
TABLES = {*WITHIN, "relay_late_ms"}
NUMBERS = {"invariant_violations", *(name for name in number_names() if name not in TABLES)}
LARGEST_CONFIG = SIZE_MAX  # bytes, as of what a run is made from
LARGEST_TEXT = 4 << 20  # bytes of a summary or a manifest, which have some thousand
LARGEST_NUMBER = 1e300  # of a summary; also a whole number can be too large to be printed
LARGEST_EVENTS = 32 << 20  # bytes that are read of events.csv; a line of them takes some 300 in memory


@dataclass(slots=True)
class SavedRun:
    """What is whole in a run directory; `missing` says the rest, a line each."""

    path: Path
    config: dict[str, Any] = field(default_factory=dict)
    manifest: dict[str, Any] = field(default_factory=dict)
    summary: dict[str, Any] = field(default_factory=dict)
    events: list[Event] = field(default_factory=list)
    timeline: SavedTimeline | None = None
    missing: list[str] = field(default_factory=list)

    @property
    def name(self) -> str:
        """How a reader tells it from others."""
        return self.path.resolve().name

    @property
    def shape(self) -> str:
        """The shape's name, from whatever names it."""
        return str(self.summary.get("shape") or self.manifest.get("shape") or self.config.get("shape") or "?")

    def recording(self) -> Path | None:
        """recording.rrd, or what a killed run left of it."""
        return existing(self.path, RECORDING)


def load(path: Path) -> SavedRun:
    """Read a run directory. Raises BadInput if it is none."""
    check_run_directory(path)
    run = SavedRun(path)
    run.config = _read(run, CONFIG, lambda file: _mapping(parse(_text(file, LARGEST_CONFIG)))) or {}
    run.manifest = _read(run, MANIFEST, lambda file: _mapping(json.loads(_text(file)))) or {}
    run.summary = _read(run, SUMMARY, lambda file: _summary(run, json.loads(_text(file)))) or {}
    run.events = _read(run, EVENTS, lambda file: _events(run, file)) or []
    run.timeline = _timeline(run)
    run.missing += newer_lines(run.summary, run.manifest)
    if run.recording() is None and not _wanted_none(run.config):
        run.missing.append(f"{RECORDING}: none")
    elif run.recording() not in (None, path / RECORDING):
        run.missing.append(f"{RECORDING}: cut, the run ended before it was closed")
    return run


def _wanted_none(config: dict[str, Any]) -> bool:
    """Was the run told to write no recording?"""
    recording = config.get("recording")
    return isinstance(recording, dict) and recording.get("enabled") is False


def newer_lines(summary: dict[str, Any], manifest: dict[str, Any]) -> list[str]:
    """A line for each of them that a later version wrote: what it has besides is not shown."""
    lines = []
    for name, table, known in ((SUMMARY, summary, FORMAT), (MANIFEST, manifest, MANIFEST_FORMAT)):
        number = table.get("format")
        if isinstance(number, (int, float)) and number > known:
            lines.append(
                f"{name}: format {number:g}, newer than {known}, which this version of swarmer knows; "
                "what is shown may lack something"
            )
    return lines


def newer_in(path: Path) -> list[str]:
    """The same of a run directory, of which nothing else is read."""
    return newer_lines(_mapping_in(path / SUMMARY), _mapping_in(path / MANIFEST))


def _mapping_in(path: Path) -> dict[str, Any]:
    """What a JSON file holds; nothing if that cannot be told."""
    try:
        return _mapping(json.loads(_text(path)))
    except BROKEN:
        return {}


def check_run_directory(path: Path) -> None:
    """Raise BadInput unless `path` looks like a run directory."""
    if not path.exists():
        raise BadInput("run", str(path), "no such directory; a run prints its directory as its last line")
    names = {name + suffix for name in FILES for suffix in ("", PARTIAL)}
    if not path.is_dir() or not any((path / name).exists() for name in sorted(names)):
        raise BadInput(
            "run",
            str(path),
            "not a run directory: none of its files is there",
        )


def existing(directory: Path, name: str) -> Path | None:
    """The file if it is whole, else its partial stream, else None."""
    for path in (directory / name, directory / (name + PARTIAL)):
        if path.exists():
            return path
    return None


def _read(run: SavedRun, name: str, reader: Callable[[Path], Any]) -> Any:
    """What `reader` makes of a file; None, and a line in `missing`, if it cannot."""
    path = existing(run.path, name)
    if path is None:
        run.missing.append(f"{name}: none" + (", the run did not end" if name == SUMMARY else ""))
        return None
    if path.name.endswith(PARTIAL):
        run.missing.append(f"{name}: cut, the run ended before it was closed")
    try:
        return reader(_plain(path))
    except BROKEN as error:
        reason = " ".join(str(error).split())[:100] or type(error).__name__
        run.missing.append(f"{path.name}: cannot be read ({reason})")
        return None


def _plain(path: Path) -> Path:
    """The path, if it is a file or a directory: a pipe would be waited for, and a device may never end."""
    if not (path.is_file() or path.is_dir()):
        raise ValueError("no file")
    return path


def _text(path: Path, largest: int = LARGEST_TEXT) -> str:
    with _plain(path).open("rb") as file:
        raw = file.read(largest + 1)
    if len(raw) > largest:
        raise ValueError(f"larger than {largest >> 10:,} kB")
    return raw.decode()


def _mapping(data: object) -> dict[str, Any]:
    if not isinstance(data, dict):
        raise ValueError("no table of names and values")
    json.dumps(data, ensure_ascii=False).encode()  # half of a surrogate pair can be in no file
    return data


def _summary(run: SavedRun, data: object) -> dict[str, Any]:
    """The summary without what is not of its kind: numbers where numbers are due, tables of numbers where those are."""
    summary = _mapping(data)
    tables = {name: value for name, value in summary.items() if name in TABLES and value is not None}
    bad = [
        name
        for name, value in tables.items()
        if not isinstance(value, dict) or not all(map(_number, value.values()))
    ]
    bad += [name for name, value in summary.items() if name in NUMBERS and not _number(value)]
    for name in bad:
        del summary[name]
    if bad:
        run.missing.append(f"{SUMMARY}: cannot be used: {', '.join(bad)}")
    return summary


def _number(value: object) -> bool:
    return value is None or (isinstance(value, (int, float)) and -LARGEST_NUMBER <= value <= LARGEST_NUMBER)


def _events(run: SavedRun, path: Path) -> list[Event]:
    """Every whole line; a last line without its end is dropped."""
    events, bad = [], 0
    with path.open(newline="", encoding="utf-8", errors="replace") as file:
        read = file.read(LARGEST_EVENTS)
        if file.read(1):
            read = read.rpartition("\n")[0]
            run.missing.append(f"{path.name}: only its first {LARGEST_EVENTS >> 20} MB are read")
    lines = csv.reader(io.StringIO(read, newline=""))
    if next(lines, None) is None:
        raise ValueError("it is empty, without its line of titles")
    for cells in lines:
        try:
            t_s, kind, fid, text = cells
            event = Event(float(t_s), kind, int(fid), text)
        except ValueError:
            bad += 1
            continue
        if math.isfinite(event.t_s):
            events.append(event)
    if bad:
        run.missing.append(f"{path.name}: {bad} lines cannot be read")
    return events


def _timeline(run: SavedRun) -> SavedTimeline | None:
    path = existing(run.path, TIMELINE)
    whole: SavedTimeline | None = None
    if path is None or not path.is_dir():
        whole = _read(run, TIMELINE, saved_timeline.whole)
    chunks = run.path / (TIMELINE + PARTIAL)
    if whole is None and chunks.is_dir():
        run.missing.append(f"{TIMELINE}: cut, the run ended before it was closed")
        whole, why = saved_timeline.chunked(chunks)
        if why:
            run.missing.append(f"{chunks.name}: a part cannot be read ({why})")
    return whole
