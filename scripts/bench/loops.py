"""One run with each of the three loops an FLS process can have: what they cost, and how late they are."""

from __future__ import annotations

from bench.runs import Run, middle, middle_of, repeated
from bench.tables import show

LOOPS = ("single", "threads", "asyncio")
SCALE = 0.5  # slow enough that two cores are not simply overrun
STRETCH_S = 12.0
COLUMNS = (
    "loop", "all cores busy %", "handled late p50 / p90 / p99 ms", "timers late p99 ms", "private MB", "faithful"
)  # fmt: skip


def run(repeat: int) -> None:
    """Print the table."""
    rows = []
    for loop in LOOPS:
        runs = repeated(
            repeat,
            shape="dragon",
            fls_loop=loop,
            duration_s=STRETCH_S,
            time_scale=SCALE,
            **{"recording.enabled": False, "thaw.policy": "timer"},
        )
        rows.append(row(loop, runs))
    show(
        f"loops: the dragon (760), {STRETCH_S:g} emulated seconds at time scale {SCALE:g}", COLUMNS, rows,
        ["lateness in emulated ms; busy: FLSs and engine, of all cores"],
    )  # fmt: skip


def row(loop: str, runs: list[Run]) -> list[object]:
    late = [middle([one.cost.handled_ms(share) for one in runs]) for share in (0.5, 0.9, 0.99)]
    return [
        loop,
        middle([100 * one.cost.busy for one in runs]),
        " / ".join("-" if ms is None else f"{ms:.0f}" for ms in late),
        middle_of(runs, "timer_late_ms", "p99"),
        middle_of(runs, "memory_mb_per_fls"),
        all(one.summary["faithful"] for one in runs),
    ]
