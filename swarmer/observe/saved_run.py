"""A run directory read back, whole or not: what can be read, and a list of what is missing."""

from __future__ import annotations

import csv
import json
import math
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from swarmer.engines.result import Event
from swarmer.errors import BadInput
from swarmer.next_shape import Standing, standing_at
from swarmer.observe import timeline
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
from swarmer.observe.summary import COUNTERS, FORMAT
from swarmer.yaml_file import parse

# What readers raise at files that were cut or hold something else.
BROKEN = (
    OSError, ValueError, KeyError, IndexError, TypeError, EOFError, RuntimeError, RecursionError, NotImplementedError,
    zipfile.BadZipFile, zipfile.LargeZipFile, zlib.error, csv.Error, yaml.YAMLError, BadInput,
)  # fmt: skip
# Tables of a summary.
TABLES = {
    "time_to_hd_s", "time_to_hd_absolute_s", "next_time_to_hd_s", "rounds_to_hd", "rounds_to_hd_absolute",
    "timer_late_ms", "handled_late_ms",
}  # fmt: skip
NUMBERS = {
    "points", "seed", "emulated_s", "wall_s", "hd_cells", "hd_min_cells", "hd_absolute_cells", "first_single_swarm_s",
    "single_swarm_count", "thaws", "distance_cells_mean", "localizing_cells_mean", "following_cells_mean", "time_scale",
    "suggested_time_scale", "invariant_violations", *COUNTERS,
}  # fmt: skip
SHAPES = ("truth_at_s", "truths")  # of a timeline
LARGEST_TEXT = 64 << 20  # bytes of a config, a summary or a manifest


@dataclass(slots=True)
class SavedTimeline:
    """timeline.npz in memory; T samples of F FLSs."""

    t_s: NDArray[np.float64]  # (T,)
    truth: NDArray[np.float64]  # (F, 3), cells
    position: NDArray[np.float32]  # (T, F, 3), cells
    swarm: NDArray[np.int32]  # (T, F)
    state: NDArray[np.int8]  # (T, F)
    lit: NDArray[np.bool_]  # (T, F)
    hd_cells: NDArray[np.float64]  # (T,), NaN while fewer than 2 were lit
    series: dict[str, NDArray[np.float64]] = field(default_factory=dict)  # (T,) each; see timeline.series_of
    flown_cells: NDArray[np.float64] | None = None  # (F, 2): localizing, following; at the end
    truth_at_s: NDArray[np.float64] | None = (
        None  # (K,), of a run with several shapes: since when each is the one
    )
    truths: NDArray[np.float64] | None = None  # (K, F, 3), NaN for who has no point in that shape

    def standings(self) -> tuple[Standing, ...]:
        """The shapes of the run, one after the other."""
        if self.truth_at_s is None or self.truths is None:
            return (Standing(0.0, self.truth, np.ones(len(self.truth), np.bool_)),)
        members = ~np.isnan(self.truths[:, :, 0])
        truths = np.where(members[:, :, None], self.truths, self.truth)
        return tuple(
            Standing(float(at_s), truth, member)
            for at_s, truth, member in zip(self.truth_at_s, truths, members, strict=True)
        )

    def truth_rows(self, t_s: float) -> NDArray[np.float64]:
        """(F, 3): where each FLS belonged at an emulated second, cells; who had no point, where it did or will."""
        return standing_at(self.standings(), t_s).truth

    def truth_at(self, t_s: float) -> NDArray[np.float64]:
        """(G, 3): the points of the shape that was the one at an emulated second, cells."""
        standing = standing_at(self.standings(), t_s)
        points: NDArray[np.float64] = standing.truth[standing.member]
        return points

    def first_all_lit(self) -> int | None:
        """The first sample by which every FLS of the first shape had been lit; None if that never was."""
        ever = np.logical_or.accumulate(self.lit[:, self.standings()[0].member], axis=0).all(axis=1)
        return int(ever.argmax()) if ever.any() else None

    def most_lit(self) -> int:
        """The first sample in which most FLSs are lit."""
        return int(self.lit.sum(axis=1).argmax())

    def swarms(self) -> NDArray[np.int64]:
        """Number of swarms at each sample, (T,)."""
        counts = [len(np.unique(swarm[lit])) for swarm, lit in zip(self.swarm, self.lit, strict=True)]
        return np.array(counts, dtype=np.int64)

    def states(self, kinds: int) -> NDArray[np.int64]:
        """FLSs in each of `kinds` states at each sample, (T, kinds)."""
        return np.stack([(self.state == kind).sum(axis=1) for kind in range(kinds)], axis=1)


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
    run.config = _read(run, CONFIG, lambda file: _mapping(parse(_text(file)))) or {}
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
        if not (path.is_file() or path.is_dir()):
            raise ValueError("no file")  # a pipe would be waited for
        return reader(path)
    except BROKEN as error:
        reason = " ".join(str(error).split())[:100] or type(error).__name__
        run.missing.append(f"{path.name}: cannot be read ({reason})")
        return None


def _text(path: Path) -> str:
    if path.stat().st_size > LARGEST_TEXT:
        raise ValueError(f"larger than {LARGEST_TEXT >> 20} MB")
    return path.read_text(encoding="utf-8")


def _mapping(data: object) -> dict[str, Any]:
    if not isinstance(data, dict):
        raise ValueError("no table of names and values")
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
    return value is None or (isinstance(value, (int, float)) and math.isfinite(value))


def _events(run: SavedRun, path: Path) -> list[Event]:
    """Every whole line; a last line without its end is dropped."""
    events, bad = [], 0
    with path.open(newline="", encoding="utf-8", errors="replace") as file:
        lines = list(csv.reader(file))
        if not lines:
            raise ValueError("it is empty, without its line of titles")
        for cells in lines[1:]:
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
    if path is None or path.is_file():
        whole = _read(run, TIMELINE, _whole_timeline)
    chunks = run.path / (TIMELINE + PARTIAL)
    if whole is None and chunks.is_dir():
        run.missing.append(f"{TIMELINE}: cut, the run ended before it was closed")
        whole = _chunked_timeline(run, chunks)
    return whole


def _whole_timeline(path: Path) -> SavedTimeline:
    with np.load(path, allow_pickle=False) as data:
        arrays = {name: data[name] for name in ("truth", *timeline.Frame._fields)}
        shapes = {name: data[name] for name in SHAPES if name in data}
        flown = data.get("flown_cells")
        return _checked(SavedTimeline(**arrays, **shapes, series=_series(data), flown_cells=flown))


def _series(data: Any) -> dict[str, NDArray[np.float64]]:
    """By name; none in a run from before there were any. Raises what BROKEN has."""
    if "series" not in data:
        return {}
    names, values = data["series_name"].tolist(), np.asarray(data["series"], dtype=np.float64)
    if values.shape != (len(data["t_s"]), len(names)):
        raise ValueError("its series do not fit")
    return {str(name): values[:, i] for i, name in enumerate(names)}


def _chunked_timeline(run: SavedRun, directory: Path) -> SavedTimeline | None:
    """All chunks up to the first that is not whole."""
    parts: list[SavedTimeline] = []
    try:
        with np.load(directory / "truth.npz", allow_pickle=False) as data:
            truths = {name: data[name] for name in ("truth", *SHAPES) if name in data}
        for path in sorted(directory.glob("[0-9]*.npz")):
            with np.load(path, allow_pickle=False) as data:
                frame = {name: data[name] for name in timeline.Frame._fields}
                parts.append(_checked(SavedTimeline(**truths, **frame, series=_series(data))))
    except BROKEN as error:
        run.missing.append(f"{directory.name}: a part cannot be read ({type(error).__name__})")
    if not parts:
        return None
    joined = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in timeline.Frame._fields
    }
    names = parts[0].series if all(part.series.keys() == parts[0].series.keys() for part in parts) else ()
    series = {name: np.concatenate([part.series[name] for part in parts]) for name in names}
    return SavedTimeline(**truths, **joined, series=series)


def _checked(saved: SavedTimeline) -> SavedTimeline:
    """The timeline, if its arrays fit each other. Raises ValueError."""
    samples, count = len(saved.t_s), len(saved.truth)
    shapes = [
        (count, 3),
        (samples, count, 3),
        (samples, count),
        (samples, count),
        (samples, count),
        (samples,),
    ]
    arrays: tuple[NDArray[Any], ...] = (
        saved.truth,
        saved.position,
        saved.swarm,
        saved.state,
        saved.lit,
        saved.hd_cells,
    )
    flown = saved.flown_cells
    if flown is not None and (flown.shape != (count, 2) or not np.isfinite(flown).all()):
        raise ValueError("its distances do not fit")
    if saved.t_s.ndim != 1 or any(array.shape != shape for array, shape in zip(arrays, shapes, strict=True)):
        raise ValueError("its arrays do not fit each other")
    if (saved.truth_at_s is None) != (saved.truths is None):
        raise ValueError("its shapes have no times, or the other way round")
    if saved.truth_at_s is not None and saved.truths is not None:
        if saved.truth_at_s.ndim != 1 or saved.truths.shape != (len(saved.truth_at_s), count, 3):
            raise ValueError("the points of its shapes do not fit")
        if not len(saved.truth_at_s) or not np.isfinite(saved.truth_at_s).all():
            raise ValueError("the times of its shapes are not finite")
    if not np.isfinite(saved.t_s).all() or not np.isfinite(saved.position).all():
        raise ValueError("it has values that are not finite")
    return saved
