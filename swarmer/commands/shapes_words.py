"""What the commands about shapes have alike: an option, aligned columns, warnings about a cloud."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from swarmer.shapes.cloud import PointCloud
    from swarmer.shapes.neighbours import NeighbourPlan


def seed_option(what_for: str) -> Callable[[Any], Any]:
    """`--seed N` of a command."""
    return click.option(
        "--seed", type=click.IntRange(min=0), metavar="N", default=0, show_default=True, help=what_for
    )


def aligned(rows: list[tuple[str, ...]]) -> list[str]:
    """One line a row, the columns below each other."""
    widths = [max(len(cell) for cell in column) for column in zip(*rows, strict=True)]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    ]


def cloud_warnings(cloud: PointCloud, plan: NeighbourPlan) -> list[str]:
    """What a run would suffer from, though it is possible."""
    from swarmer.shapes.cloud import SMALLEST_SPACING

    found = []
    # A light of its own for each display cell; generated gaps may miss it by rounding.
    if plan.spacing_min_cells < SMALLEST_SPACING * (1 - 1e-9):
        factor = SMALLEST_SPACING / plan.spacing_min_cells
        found.append(
            f"warning: {cloud.name}: points come as near as {plan.spacing_min_cells:.3g} cells; lights need "
            f"{SMALLEST_SPACING:g}, so scale the shape by {factor:.3g} (`swarmer shapes make`)"
        )
    if 2 * plan.eta > len(cloud):
        found.append(
            f"warning: {cloud.name}: η {plan.eta} is more than half of the {len(cloud)} points; nearly everybody is "
            "everybody's neighbour, so nobody rests until all are one swarm"
        )
    return found
