"""timeline.npz in memory: read back whole, or from the chunks that a killed run left; nothing in it is trusted."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from swarmer.next_shape import Standing, standing_at
from swarmer.observe import strange_npz, timeline

SHAPES: dict[str, DTypeLike] = {"truth_at_s": np.float64, "truths": np.float64}
SERIES: dict[str, DTypeLike] = {"series_name": np.str_, "series": np.float64}
FLOWN: dict[str, DTypeLike] = {"flown_cells": np.float64}
FRAME: dict[str, DTypeLike] = {name: timeline.TYPES[name] for name in timeline.Frame._fields}
FIXED: dict[str, DTypeLike] = {"truth": np.float64}
LARGEST = 1e9  # cells, or seconds: what is more is none that anybody flew


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


def whole(path: Path) -> SavedTimeline:
    """timeline.npz of a run that was closed. Raises one of BROKEN."""
    return _from(strange_npz.arrays(path, FIXED | FRAME, SHAPES | SERIES | FLOWN))


def chunked(directory: Path) -> tuple[SavedTimeline | None, str]:
    """All chunks up to the first that is not whole, and why it is not; no text if all are."""
    parts: list[SavedTimeline] = []
    fixed: dict[str, Any] = {}
    room, why = strange_npz.largest(), ""
    try:
        fixed = strange_npz.arrays(directory / "truth.npz", FIXED, SHAPES, room)
        for path in sorted(directory.glob("[0-9]*.npz")):
            frames = strange_npz.arrays(path, FRAME, SERIES, room)
            room -= sum(array.nbytes for array in frames.values())
            parts.append(_from(fixed | frames))
    except strange_npz.BROKEN as error:
        why = type(error).__name__
    if not parts:
        return None, why
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in timeline.Frame._fields
    }
    names = parts[0].series if all(part.series.keys() == parts[0].series.keys() for part in parts) else ()
    saved = SavedTimeline(**fixed, **joined)
    saved.series = {name: np.concatenate([part.series[name] for part in parts]) for name in names}
    return saved, why


def _from(arrays: dict[str, Any]) -> SavedTimeline:
    """The timeline of these arrays. Raises ValueError if they do not fit each other, or cannot be."""
    names, values = arrays.pop("series_name", None), arrays.pop("series", None)
    saved = SavedTimeline(**arrays)
    _check(saved)
    if (names is None) != (values is None):
        raise ValueError("its series have no names, or the other way round")
    if names is not None and values is not None:
        if names.ndim != 1 or values.shape != (len(saved.t_s), len(names)):
            raise ValueError("its series do not fit")
        values[np.isinf(values)] = np.nan
        saved.series = {_printable(name): values[:, i] for i, name in enumerate(names.tolist())}
    return saved


def _printable(name: str) -> str:
    if not name.isprintable():  # half of a surrogate pair, say, which no file can hold
        raise ValueError("a name of its series is no text")
    return name


def _check(saved: SavedTimeline) -> None:
    """Raises ValueError unless the arrays fit each other and hold what can be."""
    samples, count = len(saved.t_s), len(saved.truth)
    shapes = {"truth": (count, 3), "position": (samples, count, 3), "t_s": (samples,), "hd_cells": (samples,)}
    if any(getattr(saved, name).shape != shapes.get(name, (samples, count)) for name in ("truth", *FRAME)):
        raise ValueError("its arrays do not fit each other")
    if not count:
        raise ValueError("it has no FLS")
    flown, at_s, truths = saved.flown_cells, saved.truth_at_s, saved.truths
    if flown is not None and flown.shape != (count, 2):
        raise ValueError("its distances do not fit")
    if (at_s is None) != (truths is None):
        raise ValueError("its shapes have no times, or the other way round")
    if at_s is not None and truths is not None:
        if at_s.ndim != 1 or not len(at_s) or truths.shape != (len(at_s), count, 3):
            raise ValueError("the points of its shapes do not fit")
        if not _can_be(at_s) or not _can_be(truths[~np.isnan(truths)]):
            raise ValueError("its shapes have values that are not finite, or absurd")
    values: list[NDArray[Any]] = [saved.t_s, saved.truth, saved.position]
    values += [] if flown is None else [flown]
    if not all(_can_be(one) for one in values):
        raise ValueError("it has values that are not finite, or absurd")
    if (saved.swarm < 0).any():
        raise ValueError("it has Swarm-IDs below 0")


def _can_be(values: NDArray[Any]) -> bool:
    return bool((np.abs(values) <= LARGEST).all())  # NaN is not
