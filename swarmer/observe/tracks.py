"""Rows of a recording, gathered and sent many at a time: a chunk costs a kilobyte and 0.1 ms, whatever is in it."""

from __future__ import annotations

from collections.abc import Callable
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

EMULATED_TIME, SAMPLE = "emulated_time", "sample"  # the timelines


class Moment(NamedTuple):
    """When a row holds, on both timelines."""

    t_s: float
    sample: int


class Track:
    """What happens to some components of one entity, row by row."""

    def __init__(self, entity: str, columns: Callable[..., Any]) -> None:
        """columns: of rerun's archetype, which has a parameter for each component."""
        self.entity = entity
        self._columns = columns
        self._rows: list[tuple[Moment, dict[str, Any]]] = []

    def add(self, at: Moment, **components: Any) -> None:
        """One row: an array or a list for each component, all of one length, the same components in every row.

        They belong to the track from now on: rerun does not copy what it is given.
        """
        self._rows.append((at, components))

    def send(self, rec: Any) -> None:
        """Hand all rows to rerun, and begin anew."""
        if not self._rows:
            return
        import rerun as rr

        moments, rows = zip(*self._rows, strict=True)
        names = list(rows[0])
        counts = [len(row[names[0]]) for row in rows]
        joined = {name: _joined([row[name] for row in rows]) for name in names}
        indexes = [
            rr.TimeColumn(EMULATED_TIME, duration=np.array([at.t_s for at in moments])),
            rr.TimeColumn(SAMPLE, sequence=[at.sample for at in moments]),
        ]
        rec.send_columns(self.entity, indexes, self._columns(**joined).partition(counts))
        self._rows = []


def _joined(parts: list[Any]) -> Any:
    """What the rows have, one after the other."""
    return np.concatenate(parts) if isinstance(parts[0], np.ndarray) else list(chain.from_iterable(parts))
