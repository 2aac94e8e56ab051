"""`trace.jsonl.gz` read back: line by line, so that its size does not matter, and as far as it is whole."""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from swarmer.errors import BadInput
from swarmer.observe.files import PARTIAL
from swarmer.observe.run_directory import TRACE
from swarmer.observe.saved_run import check_run_directory, existing
from swarmer.observe.trace import FORMAT

CHUNK = 1 << 16  # bytes read, and
UNPACKED = 1 << 20  # bytes unpacked at a time
LONGEST = 1 << 20  # bytes of a line; a record has some hundred
HEAD = 48  # bytes within which a record has said when and who

Record = dict[str, Any]


class Header(NamedTuple):
    """What the first line says."""

    shape: str
    points: int  # F
    seed: int
    swarmer: str
    fids: frozenset[int] | None  # whose records were kept; None: everybody's


class TraceFile:
    """The event log of a run directory. Iterating it gives the lines; afterwards `cut` says if any are missing."""

    def __init__(self, run: Path) -> None:
        """Raises BadInput for a directory without an event log that can be read."""
        check_run_directory(run)
        path = existing(run, TRACE)
        if path is None:
            raise BadInput(
                "run", str(run), "it has no event log; `swarmer-run --engine virtual --trace` writes one"
            )
        self.run, self.path = run, path
        self.cut = path.name.endswith(PARTIAL)
        self.header = self._read_header()

    def _read_header(self) -> Header:
        try:
            first = json.loads(next(iter(self.lines()), b""))
            version = first["swarmer_trace"]
            if version != FORMAT:
                raise BadInput(
                    "run", str(self.run), f"an event log of format {FORMAT}; this one's is {version}"
                )
            fids = first["fids"]
            return Header(
                str(first["shape"]), int(first["points"]), int(first["seed"]), str(first["swarmer"]),
                None if fids is None else frozenset(map(int, fids)),
            )  # fmt: skip
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            raise BadInput(
                "run", str(self.run), f"an event log that can be read; its {self.path.name} is none"
            ) from None

    def lines(self) -> Iterator[bytes]:
        """Every whole line, in order."""
        rest = b""
        for data in self._unpacked():
            *whole, rest = (rest + data).split(b"\n")
            yield from whole
            if len(rest) > LONGEST:
                self.cut = True
                return
        if rest:
            self.cut = True

    def _unpacked(self) -> Iterator[bytes]:
        unzip = zlib.decompressobj(31)
        with self.path.open("rb") as file:
            try:
                while not unzip.eof:
                    packed = unzip.unconsumed_tail or file.read(CHUNK)
                    if not packed:
                        self.cut = True
                        return
                    yield unzip.decompress(packed, UNPACKED)
            except zlib.error:
                self.cut = True

    def records(
        self,
        fids: frozenset[int] | None = None,
        message: str = "",
        from_s: float = 0.0,
        to_s: float = float("inf"),
    ) -> Iterator[Record]:
        """Records of these FLSs, about this datagram, within these emulated seconds; what is none is passed over."""
        who = (
            None
            if fids is None
            else re.compile(rb'"fid":(?:%s),' % "|".join(map(str, sorted(fids))).encode())
        )
        needle = f'"{message}"'.encode() if message else b""
        for line in self.lines():
            if who is not None and not who.search(line, 0, HEAD):
                continue
            if needle and needle not in line:
                continue
            try:
                record = json.loads(line)
                at = record["t"]
                if at > to_s and record["is"] != "end":
                    return
                if at >= from_s and "fid" in record:
                    yield record
            except (ValueError, KeyError, TypeError, RecursionError):
                continue  # the header, the end, or damaged
