"""timeline.npz: where every FLS was at every sample, written while the run lives.

Samples gather in memory and go to disk in chunks, `timeline.npz.partial/00000.npz` and so on, each whole under its
name; `close` streams the chunks into one compressed file. A run that is killed leaves its chunks.

`truth` (F, 3) is the first shape's. A run that becomes another shape has `truth_at_s` (K,), since when each of its K
shapes is the one, and `truths` (K, F, 3), NaN for an FLS that has no point in it; in `truth` such an FLS has the point
that it gets later.
"""

from __future__ import annotations

import contextlib
import math
import shutil
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from swarmer.observe.files import PARTIAL, disk_errors, write_file

if TYPE_CHECKING:
    from swarmer.engines.result import Snapshot
    from swarmer.next_shape import Standing

NAME = "timeline.npz"
CHUNK_SAMPLES = 50
FIRST_CHUNK_SAMPLES = 5  # the next ones are twice as long each: a run killed early has left something, too
CHUNK_BYTES = 16 << 20
COMPRESSION = 4  # of 9; half the time of the default 6 and 3 % larger


class Frame(NamedTuple):
    """One sample; stored in these types, in a chunk with one more axis in front."""

    t_s: float
    position: NDArray[Any]  # (F, 3), cells
    swarm: NDArray[Any]  # (F,), Swarm-ID, 0 while dark
    state: NDArray[Any]  # (F,), index into State
    lit: NDArray[Any]  # (F,)
    hd_cells: float  # NaN while fewer than 2 are lit


TYPES: dict[str, type[np.generic]] = {
    "t_s": np.float64,
    "position": np.float32,
    "swarm": np.int32,
    "state": np.int8,
    "lit": np.bool_,
    "hd_cells": np.float64,
}


def series_of(snapshot: Snapshot) -> dict[str, float | None]:
    """What else a sample tells, a number each: every counter by its name, and how the engine does."""
    live = snapshot.live
    timer, handled = live.timer_late_ms, live.handled_late_ms
    return {
        **snapshot.counters,
        "time_scale": live.time_scale,
        "timer_late_p99_ms": timer and timer.p99,
        "handled_late_p99_ms": handled and handled.p99,
        "processes": live.processes,
        "memory_mb": live.memory_mb,
    }


class TimelineWriter:
    """Takes frames, keeps chunks, ends as timeline.npz."""

    def __init__(
        self, directory: Path, truth: NDArray[np.float64], standings: Sequence[Standing] = ()
    ) -> None:
        """truth: (F, 3), cells. standings: the shapes of the run, if there are several. Raises RunFailed, as all
        methods do.
        """
        self.path = directory / NAME
        self.partial = directory / (NAME + PARTIAL)
        self._truth = np.asarray(truth, dtype=np.float64)
        self._standings = standings if len(standings) > 1 else ()
        self._frames: list[Frame] = []
        self._chunks: list[tuple[Path, int]] = []
        self._series_name: tuple[str, ...] = ()
        self._series: list[list[float]] = []
        self.flown: NDArray[Any] | None = (
            None  # (F, 2), cells, at the last sample; whoever looks puts it here
        )
        frame_bytes = max(1, 20 * len(truth))
        self._chunk_samples = max(1, min(CHUNK_SAMPLES, CHUNK_BYTES // frame_bytes))
        with disk_errors(self.path):
            self.partial.mkdir(exist_ok=True)
        write_file(self.partial / "truth.npz", self._write_truth, durable=False)

    @property
    def _samples(self) -> int:
        return len(self._frames) + sum(count for _, count in self._chunks)

    def _fixed(self) -> dict[str, Any]:
        fixed = {"fid": np.arange(1, len(self._truth) + 1, dtype=np.int32), "truth": self._truth}
        if not self._standings:
            return fixed
        nowhere = np.full_like(self._truth, np.nan)
        truths = [np.where(one.member[:, None], one.truth, nowhere) for one in self._standings]
        return fixed | {
            "truth_at_s": np.array([one.from_s for one in self._standings]),
            "truths": np.stack(truths),
        }

    def _write_truth(self, file: BinaryIO) -> None:
        np.savez(file, allow_pickle=False, **self._fixed())

    def append(self, frame: Frame, series: Mapping[str, float | None] | None = None) -> None:
        """Take a frame; its arrays are copied into the types of the file.

        series: one number each of what else is known at this sample. Those that the first frame names are kept, NaN
        where a later one has none.
        """
        if series and not self._samples:
            self._series_name = tuple(series)
        self._series.append([_number((series or {}).get(name)) for name in self._series_name])
        own = [np.array(value, dtype=TYPES[name]) for name, value in zip(Frame._fields, frame, strict=True)]
        self._frames.append(Frame(*own))  # type: ignore[arg-type]
        if len(self._frames) >= min(self._chunk_samples, FIRST_CHUNK_SAMPLES << min(len(self._chunks), 16)):
            self.flush()

    def flush(self) -> None:
        """Put what is in memory on disk."""
        if not self._frames:
            return
        columns = {name: np.stack([getattr(f, name) for f in self._frames]) for name in Frame._fields}
        if self._series_name:
            columns |= {"series_name": np.array(self._series_name), "series": np.array(self._series)}
        path = self.partial / f"{len(self._chunks):05d}.npz"
        write_file(path, lambda file: np.savez(file, allow_pickle=False, **columns), durable=False)
        self._chunks.append((path, len(self._frames)))
        self._frames.clear()
        self._series.clear()

    def close(self) -> None:
        """Make timeline.npz of the chunks and remove them."""
        if self.path.exists():
            return
        self.flush()
        write_file(self.path, self._compact)
        with contextlib.suppress(OSError):
            shutil.rmtree(self.partial)

    def _compact(self, file: BinaryIO) -> None:
        """Write the whole npz, an array at a time and of that a chunk at a time."""
        shapes = {"position": self._truth.shape, "t_s": (), "hd_cells": ()}
        types, fixed = dict(TYPES), self._fixed()
        if self._series_name:
            types["series"], shapes["series"] = np.float64, (len(self._series_name),)
            fixed["series_name"] = np.array(self._series_name)
        if self.flown is not None:
            fixed["flown_cells"] = np.asarray(self.flown, dtype=np.float64)
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=COMPRESSION) as archive:
            for name, array in fixed.items():
                with archive.open(f"{name}.npy", "w") as member:
                    npy.write_array(member, array)
            for name, dtype in types.items():
                shape = (self._samples, *shapes.get(name, (len(self._truth),)))
                header = {
                    "descr": npy.dtype_to_descr(np.dtype(dtype)),
                    "fortran_order": False,
                    "shape": shape,
                }
                with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                    npy.write_array_header_1_0(member, header)
                    for part in self._parts(name):
                        member.write(np.ascontiguousarray(part).tobytes())

    def _parts(self, name: str) -> Iterator[NDArray[Any]]:
        for path, _ in self._chunks:
            with np.load(path, allow_pickle=False) as chunk:
                yield chunk[name]


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)
