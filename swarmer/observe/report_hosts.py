"""The report's part on the hosts of a run over many, from its hosts.csv: what relays carried, and who was lost."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

from swarmer.observe.report_page import Part, esc, table
from swarmer.observe.run_directory import HOSTS
from swarmer.observe.saved_run import BROKEN, SavedRun
from swarmer.observe.words import count

Row = Mapping[str, str]

HOSTS_SHOWN = 64
CAPTION = (
    "Out, in: datagrams to and from other hosts. Packets: between relays; beside it how many datagrams one "
    "holds. Lost: by cluster.relay_loss. Dropped: by full buffers, or not sent. Way: from an FLS on "
    "another host to the relay here, emulated. Clock: the host's time of day against the engine's; beside it how "
    "well the clock that counts was known. hosts.csv has all."
)
TITLES = (
    "host", "FLSs", "out", "in", "packets", "in one", "lost", "dropped", "way, ms: p50", "p99", "clock, ms", "known to",
)  # fmt: skip


def hosts_part(run: SavedRun) -> Part | None:
    """A line for each host; None for a run on one machine."""
    rows = read_hosts(run)
    if not rows:
        return None
    lost = [row for row in rows if row["lost_s"]]
    body = [f"<p>{esc(_summary(rows, lost))}</p>"]
    if lost:
        body.append(f"<ul>{''.join(f'<li>{esc(_fate(row))}</li>' for row in lost)}</ul>")
    shown = rows[:HOSTS_SHOWN]
    some = f"The first {len(shown)} of {len(rows)} hosts. " if len(shown) < len(rows) else ""
    body.append(table(TITLES, [_cells(row) for row in shown], "Host by host"))
    body.append(f"<p class=soft>{esc(some + CAPTION)}</p>")
    return Part("hosts", "Hosts", "\n".join(body))


def read_hosts(run: SavedRun) -> list[Row]:
    """The lines of hosts.csv; none if it is not there, or not what this version writes."""
    path: Path = run.path / HOSTS
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows: list[Row] = list(csv.DictReader(file))
        for row in rows:
            _cells(row)
            _number(row["lost_s"])
            if None in row.values() or None in row:
                return []
    except BROKEN:
        return []
    return rows


def _summary(rows: list[Row], lost: list[Row]) -> str:
    out, went_in, packets = (_sum(rows, name) for name in ("datagrams_out", "datagrams_in", "packets"))
    gone = "" if not lost else f"; {len(lost)} of them {'was' if len(lost) == 1 else 'were'} lost"
    one = f"{len(rows)} hosts" if len(rows) != 1 else "One host"
    return f"{one}{gone}. Their relays sent {count(out)} datagrams in {count(packets)} packets; {count(went_in)} came."


def _fate(row: Row) -> str:
    to = row["replaced_on"]
    then = f"its FLSs were replaced, {to}" if to else "its FLSs were not replaced"
    return f"{row['host']} was lost at {float(row['lost_s']):.1f} s; {then}"


def _cells(row: Row) -> list[str]:
    out, packets = _number(row["datagrams_out"]), _number(row["packets_of_datagrams"])
    begun, left = row["flss_begun"], row["flss"]
    dropped = [_number(row[name]) for name in ("dropped_by_kernel", "send_failed")]
    return [
        row["host"],
        begun if begun == left else f"{begun}, then {left}",
        *(count(_number(row[name])) for name in ("datagrams_out", "datagrams_in", "packets")),
        f"{out / packets:.1f}" if out is not None and packets else "–",
        count(_number(row["lost"])),
        count(sum(value or 0 for value in dropped)),
        *(_ms(row[name]) for name in ("late_p50_ms", "late_p99_ms")),
        f"{_number(row['clock_apart_ms']) or 0:+.1f}",
        _ms(row["clock_bound_ms"]),
    ]


def _ms(text: str) -> str:
    value = _number(text)
    return "–" if value is None else f"{value:.2g}" if value < 10 else f"{value:.0f}"


def _number(text: str) -> float | None:
    return float(text) if text else None


def _sum(rows: list[Row], name: str) -> float:
    return sum(_number(row[name]) or 0 for row in rows)
