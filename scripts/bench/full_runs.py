"""Whole runs: shapes at the time scale that stays faithful, and the authors' cases beside what their program does."""

from __future__ import annotations

from itertools import product

from bench.runs import Run, middle, middle_of, repeated
from bench.tables import show

# Shape, emulated seconds at most, and the HD that ends it.
SHAPES = (("dragon", 60.0, 0.01), ("hat", 45.0, 0.1), ("skateboard", 45.0, 0.1))
BY_CLOCK = {"thaw.policy": "timer"}
SHAPE_COLUMNS = (
    "shape", "FLSs", "launch s", "HD < 1 at s", "< 0.1", "< 0.01", "time scale", "faithful", "MB each",
    "cores busy %", "engine's share of wall %",
)  # fmt: skip

# Wall seconds until HD < 0.09 that are known of the authors' published program, with samples of the dragon on a machine
# of two cores; None: never. Nothing else in these tables is anything but measured now.
AUTHORS_S = {100: 45.0, 200: None}
AUTHORS_PATIENCE_S = 120.0


def shapes(repeat: int) -> None:
    """Print the table of shapes."""
    rows = [
        shape_row(shape, repeated(repeat, shape=shape, duration_s=most_s, until_hd_cells=hd, **BY_CLOCK))
        for shape, most_s, hd in SHAPES
    ]
    show(
        "shapes: time scale auto, λ 500 ms, thaws by the timer, until the HD asked for or the end", SHAPE_COLUMNS, rows,
        ["; ".join(f"{shape}: until HD < {hd:g} cells, {most:g} emulated s at most" for shape, most, hd in SHAPES)],
    )  # fmt: skip


def shape_row(shape: str, runs: list[Run]) -> list[object]:
    return [
        shape,
        runs[0].summary["points"],
        middle_of(runs, "launch_s"),
        *(middle_of(runs, "time_to_hd_s", hd) for hd in ("1", "0.1", "0.01")),
        middle_of(runs, "time_scale"),
        all(one.summary["faithful"] for one in runs),
        middle_of(runs, "memory_mb_per_fls"),
        middle([100 * one.cost.busy for one in runs]),
        middle([100 * one.cost.engine_cpu_s / one.cost.wall_s for one in runs if one.cost.wall_s]),
    ]


def authors(repeat: int) -> None:
    """Print the table of the authors' cases."""
    rows = []
    for (points, theirs), preset in product(AUTHORS_S.items(), ("default", "authors_code")):
        runs = repeated(
            repeat,
            preset,
            **{"thaw.policy": "centralized"},
            shape="dragon",
            points=points,
            duration_s=AUTHORS_PATIENCE_S,
            until_hd_cells=0.09,
        )
        mine = middle_of(runs, "time_to_hd_s", "0.09")
        wall = middle([one.summary["wall_s"] for one in runs])
        rows.append([
            f"dragon, {points} points, {preset}", mine, wall, "never" if theirs is None else theirs,
            "-" if mine is None or theirs is None or wall is None else f"{theirs / wall:.0f} times as fast",
            middle_of(runs, "time_scale"), all(one.summary["faithful"] for one in runs),
        ])  # fmt: skip
    show(
        "authors' cases: centralized thaw, our rules (default) and theirs (authors_code), until HD < 0.09 cells",
        ("case", "emulated s", "wall s", "their program, wall s", "ratio", "time scale", "faithful"), rows,
        [f"at most {AUTHORS_PATIENCE_S:g} emulated seconds; theirs: known of their published program, two cores"],
    )  # fmt: skip
