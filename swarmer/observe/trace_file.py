"""`trace.jsonl.gz` read back: line by line, so that its size does not matter, and as far as it is whole."""

from __future__ import annotations

import json
import math
import re
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, TypeGuard

from swarmer.errors import BadInput
from swarmer.observe.files import PARTIAL
from swarmer.observe.run_directory import TRACE
from swarmer.observe.saved_run import check_run_directory, existing
from swarmer.observe.trace import FORMAT

CHUNK = 1 << 16  # bytes read, and
UNPACKED = 1 << 20  # bytes unpacked at a time
LONGEST = 1 << 20  # bytes of a line; a record has some hundred
MOST_FLSS = 1_000_000  # of a run; a log of more is none
MOST_STRANGE = 10_000  # lines that are no records; who reads on looks for what will not come
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
    """The event log of a run directory. What is not whole shows once it has been read: see `notes`."""

    def __init__(self, run: Path) -> None:
        """Raises BadInput for a directory without an event log that can be read."""
        check_run_directory(run)
        path = existing(run, TRACE)
        if path is None:
            raise BadInput(
                "run", str(run), "it has no event log; `swarmer-run --engine virtual --trace` writes one"
            )
        self.run, self.path = run, path
        self.cut = path.name.endswith(PARTIAL)  # the run ended before it was closed
        self.damaged = False  # nothing can be read from some place on
        self.strange = 0  # lines that are no records
        self.header = self._read_header()

    def _read_header(self) -> Header:
        try:
            if self.path.exists() and not (self.path.is_file() or self.path.is_dir()):
                raise OSError(0, "not a file")  # a pipe would be waited for
            first = json.loads(next(iter(self.lines()), b""))
            version = first["swarmer_trace"]
            if version != FORMAT:
                raise BadInput(
                    "run", str(self.run), f"an event log of format {FORMAT}; this one's is {version}"
                )
            fids = first["fids"]
            header = Header(
                str(first["shape"]), _whole(first["points"], 1, MOST_FLSS), _whole(first["seed"], 0),
                str(first["swarmer"]), None if fids is None else frozenset(_whole(fid, 1) for fid in fids),
            )  # fmt: skip
            if header.fids and max(header.fids) > header.points:
                raise ValueError("a log of an FLS that the run does not have")
            return header
        except OSError as error:
            raise self._unreadable(f"its {self.path.name}: {error.strerror}") from None
        except (ValueError, KeyError, TypeError, RecursionError):
            raise self._unreadable(f"its {self.path.name} is none") from None

    def _unreadable(self, why: str) -> BadInput:
        return BadInput("run", str(self.run), f"an event log that can be read; {why}")

    def notes(self) -> list[str]:
        """What of the log was not whole, as far as it has been read: a line each."""
        notes = []
        if self.strange:
            lines = f"{self.strange:,} line{'s' * (self.strange > 1)}"
            notes.append(
                f"{lines} of {self.path.name} cannot be read and {'are' if self.strange > 1 else 'is'} left out"
            )
        if self.damaged:
            notes.append(f"{self.path.name} is damaged; what is told may lack lines, or have wrong ones")
        elif self.cut:
            notes.append("the run ended before its event log was closed; this is what is whole")
        return notes

    def lines(self) -> Iterator[bytes]:
        """Every whole line, in order."""
        rest = b""
        for data in self._unpacked():
            *whole, rest = (rest + data).split(b"\n")
            yield from whole
            if len(rest) > LONGEST:
                self.damaged = True
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
                self.damaged = True
            except OSError as error:
                raise self._unreadable(f"its {self.path.name}: {error.strerror}") from None

    def records(
        self,
        fids: frozenset[int] | None = None,
        message: str = "",
        from_s: float = 0.0,
        to_s: float = float("inf"),
    ) -> Iterator[Record]:
        """Records of these FLSs, about this datagram, within these emulated seconds; what is none is counted."""
        any_of = "|".join(map(str, sorted(fids or ()))).encode()
        who = None if fids is None else re.compile(rb'"fid": ?(?:%s),' % any_of)
        needle = f'"{message}"'.encode() if message else b""
        lines = self.lines()
        next(lines, None)  # the header
        self.strange = 0
        for line in lines:
            wanted = (who is None or who.search(line, 0, HEAD)) and (not needle or needle in line)
            if not wanted and (looks := LOOKS_WELL.match(line)) and line.endswith(b"}"):
                if _seconds(looks[1]) > to_s:
                    return
                continue  # to read each would take several times as long
            record = self._record(line)
            if self.strange > MOST_STRANGE:
                self.damaged = True
                return
            if record is None or not wanted:
                continue
            if record["t"] > to_s:
                return
            if record["t"] >= from_s:
                yield record

    def _record(self, line: bytes) -> Record | None:
        """What a line holds, if that is a record; a line that is nothing is counted."""
        try:
            record = json.loads(line)
        except (ValueError, RecursionError):
            record = None
        if is_record(record) and 1 <= record["fid"] <= self.header.points:
            return record
        if not (isinstance(record, dict) and record.get("is") == "end"):
            self.strange += 1
        return None


def _seconds(digits: bytes) -> float:
    """What a line says of its time; 0 for what is no number."""
    try:
        return float(digits)
    except ValueError:
        return 0.0


def _whole(value: object, least: int, most: float = math.inf) -> int:
    if type(value) is not int or not least <= value <= most:
        raise ValueError(f"no whole number from {least} to {most}")
    return value


TEXT, NUMBER, STATE = "text", "number", "state"
# What a record of each kind has at least, and what some have.
NEEDED = {
    "made": {"incarnation": NUMBER},
    "handled": {"event": TEXT, "before": STATE},
    "heard": {"message": TEXT, "kind": TEXT, "fate": TEXT},
    "sent": {"message": TEXT, "kind": TEXT, "to": TEXT, "xi": TEXT},
    "flew": {"cells": NUMBER, "until": NUMBER},
    "ended": {"how": TEXT},
}
OPTIONAL = {
    "after": STATE,
    "cause": TEXT,
    "xi": TEXT,
    "why": TEXT,
    "event": TEXT,
    "kind": TEXT,
    "copies": NUMBER,
}
LOOKS_WELL = re.compile(
    rb'\{"t": ?([-+.0-9e]+), ?"fid": ?[0-9]+, ?"is": ?"(?:%s)"' % "|".join(NEEDED).encode()
)
SWARM = re.compile(r"[0-9]{1,10}(\.[0-9]{1,10})?")


def is_record(record: object) -> TypeGuard[Record]:
    """Whether it has what a record needs, so that whoever reads it need not ask."""
    if not isinstance(record, dict) or record.get("is") not in NEEDED:
        return False
    if not _is(record.get("t"), NUMBER) or type(record.get("fid")) is not int:
        return False
    parts = NEEDED[record["is"]]
    if not all(_is(record.get(name), kind) for name, kind in parts.items()):
        return False
    if not all(_is(record[name], kind) for name, kind in OPTIONAL.items() if name in record):
        return False
    if "xi" in record and not (
        SWARM.fullmatch(record["xi"]) and (record["is"] != "handled" or "cause" in record)
    ):
        return False
    judged = record.get("judged", [])
    return isinstance(judged, list) and all(_is(name, TEXT) for name in judged)


def _is(value: object, kind: str) -> bool:
    if kind == TEXT:
        return isinstance(value, str) and value.isprintable()
    if kind == NUMBER:
        return isinstance(value, (int, float)) and math.isfinite(value)
    return (
        isinstance(value, list)
        and len(value) == 5
        and _is(value[0], TEXT)
        and isinstance(value[1], str)
        and bool(SWARM.fullmatch(value[1]))
        and all(_is(number, NUMBER) for number in value[2:])
    )
