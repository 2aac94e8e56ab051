"""Moments at which HD rose, as a run's timeline has them: when, by how much, and which FLSs were off for it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmer.metrics.hausdorff import HausdorffMeter
from swarmer.next_shape import standing_at
from swarmer.observe.saved_timeline import SavedTimeline

LEAST_FACTOR = 1.05  # HD grew by more than a twentieth
SMALLEST_CELLS = 1e-4  # an HD below counts as this one: nothing to see, and no factor is infinite
MOST = 12  # moments that are told
MOST_OFF = 60  # FLSs that are looked at for a moment
LEAST_SHARE = 0.5  # of a rise, that an FLS must have to be named


class Off(NamedTuple):
    """An FLS that is farther from where it should be than HD was before, by half of the rise or more."""

    fid: int
    before_cells: float  # what it added to HD before; NaN if it was dark
    after_cells: float
    flown_cells: float  # between the two samples; NaN if it was dark


class Rise(NamedTuple):
    """HD grew from one sample to another, without falling in between."""

    from_s: float
    to_s: float
    before_cells: float
    after_cells: float
    off: tuple[Off, ...]  # the farthest first
    moved: int  # FLSs that are not where they were
    before_by_fls: NDArray[np.float64]  # (F,), what each added to HD before; NaN while dark

    @property
    def factor(self) -> float:
        """How many times as large HD became."""
        return max(self.after_cells, SMALLEST_CELLS) / max(self.before_cells, SMALLEST_CELLS)


def rises(timeline: SavedTimeline, most: int = MOST) -> tuple[list[Rise], int]:
    """The moments at which HD rose most times over, the largest factor first; and how many there were in all.

    As HD itself, they count from the sample on by which every FLS had been lit (docs/reading-a-run.md).
    """
    hd = timeline.hd_cells
    spans = sorted(
        _spans(hd, timeline.first_all_lit() or 0), key=lambda span: _factor(hd, span), reverse=True
    )
    return [_rise(timeline, *span) for span in spans[:most]], len(spans)


def _spans(hd: np.ndarray, first: int) -> list[tuple[int, int]]:
    """Samples before and after each growth; a NaN ends it."""
    spans, start = [], first
    for at in range(first + 1, len(hd) + 1):
        if at < len(hd) and hd[at] > hd[at - 1]:
            continue
        if at - 1 > start and _factor(hd, (start, at - 1)) > LEAST_FACTOR:
            spans.append((start, at - 1))
        start = at
    return spans


def _factor(hd: np.ndarray, span: tuple[int, int]) -> float:
    before, after = (max(float(hd[at]), SMALLEST_CELLS) for at in span)
    return after / before


def _rise(timeline: SavedTimeline, start: int, end: int) -> Rise:
    shape = standing_at(timeline.standings(), float(timeline.t_s[end]))  # which the display is to be then
    meter, lit, place = HausdorffMeter(shape.truth), timeline.lit & shape.member, timeline.position
    before = _by_fls(meter, place[start], lit[start])
    after = _by_fls(meter, place[end], lit[end])
    flown = np.linalg.norm(place[end].astype(float) - place[start], axis=1)
    flown[~(lit[start] & lit[end])] = np.nan
    hd_before, hd_after = float(timeline.hd_cells[start]), float(timeline.hd_cells[end])
    named = hd_before + LEAST_SHARE * (hd_after - hd_before)
    rows = np.flatnonzero(np.nan_to_num(after) >= named)
    rows = rows[np.argsort(-after[rows], kind="stable")]
    off = tuple(
        Off(int(row) + 1, float(before[row]), float(after[row]), float(flown[row])) for row in rows[:MOST_OFF]
    )
    moved = int((np.nan_to_num(flown) > SMALLEST_CELLS).sum())
    times = float(timeline.t_s[start]), float(timeline.t_s[end])
    return Rise(*times, hd_before, hd_after, off, moved, before)


def _by_fls(meter: HausdorffMeter, place: NDArray[np.float32], lit: NDArray[np.bool_]) -> NDArray[np.float64]:
    return meter.by_fls(place.astype(float), lit) if lit.any() else np.full(len(lit), np.nan)
