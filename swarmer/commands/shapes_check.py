"""`swarmer shapes check`: what the planner sees in a shape, and what a run of it takes from this machine."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from swarmer.commands.shapes_words import aligned, cloud_warnings
from swarmer.interrupts import ends_at_once

if TYPE_CHECKING:
    from swarmer.errors import BadInput
    from swarmer.shapes.cloud import PointCloud
    from swarmer.shapes.neighbours import NeighbourPlan

# Measured with the dragon on two cores, as README tells; here they are scaled to count and cores.
LAUNCH_S = 2.1
LAUNCH_POINTS = 760
REAL_TIME_POINTS = 430  # the most at time scale 1
MEASURED_CORES = 2


@click.command()
@click.argument("shape", metavar="NAME_OR_FILE")
@click.option("--points", type=int, metavar="N", help="Exactly N points: made, sampled or chosen.")
@click.option(
    "--eta", type=int, metavar="N", help="Nearest neighbours in the plan (default 5, or F-1 if smaller)."
)
@click.option("--dedupe", is_flag=True, help="Remove duplicate points; without it they are an error.")
def check(shape: str, points: int | None, eta: int | None, dedupe: bool) -> None:
    """Tell whether a shape can be run, and how: spacing, neighbour graph, memory and time on this machine.

    Lengths in display cells (5 cm). The exit status is 0 if the shape can be run, and 2, with one line
    that says why, if it cannot. That this machine is too small for it is a warning: another one may not be.
    """
    with ends_at_once():
        from swarmer.shapes.catalogue import load_shape
        from swarmer.shapes.neighbours import neighbour_plan

        cloud = load_shape(shape, points, "drop" if dedupe else "refuse")
        plan = neighbour_plan(cloud.points, eta)
    trouble = machine_trouble(len(cloud))
    for line in aligned([*cloud_rows(cloud), *graph_rows(cloud, plan), *machine_rows(len(cloud), trouble)]):
        click.echo(line)
    for line in cloud_warnings(cloud, plan):
        click.echo(line, err=True)
    if trouble is not None:
        click.echo(f"warning: one process per FLS is too much for this machine: {trouble}", err=True)


def cloud_rows(cloud: PointCloud) -> list[tuple[str, ...]]:
    """The points themselves."""
    from swarmer.shapes.placing import CELL_M, gaps

    found = gaps(cloud.points)
    cells = " x ".join(f"{extent:.4g}" for extent in cloud.box_cells)
    metres = " x ".join(f"{extent * CELL_M:.3g}" for extent in cloud.box_cells)
    dropped = f", {cloud.dropped} duplicates dropped" if cloud.dropped else ""
    return [
        ("shape", f"{cloud.name}: {len(cloud)} points in {cloud.dim}D{dropped}"),
        ("box", f"{cells} cells = {metres} m"),
        ("spacing", f"nearest two {found.least:.3g} cells apart, median {found.median:.3g}"),
    ]


def graph_rows(cloud: PointCloud, plan: NeighbourPlan) -> list[tuple[str, ...]]:
    """The neighbour graph, as the paper has it and as it is planned."""
    joined = f"joined by {links(plan.added_links)}" if plan.added_links else "no link added"
    return [
        ("nearest", f"η {plan.eta}: {parts(plan.components)}, {plan.one_way_share:.0%} of the links one-way"),
        ("connected", f"1 part, {joined}; longest link {plan.longest_link_cells:.3g} cells, "
                      f"{plan.mean_degree:.1f} neighbours each"),
        ("one swarm", one_swarm(plan)),
    ]  # fmt: skip


def one_swarm(plan: NeighbourPlan) -> str:
    """Whether a run can form one, with the planned neighbours and with the paper's, in words."""
    if plan.components > 1:
        return (
            f"yes; with --set neighbours=nearest never: its {plan.components} parts do not know of each other"
        )
    if plan.one_way_share:
        return "yes; with --set neighbours=nearest a one-way link may leave two swarms silent"
    return "yes, with --set neighbours=nearest too: all its links go both ways"


def machine_trouble(count: int) -> BadInput | None:
    """Why the process engine cannot run so many FLSs here; None if it can."""
    from swarmer.errors import BadInput

    try:
        from swarmer.engines.limits import check_limits

        check_limits(count)
    except BadInput as error:
        return error
    return None


def machine_rows(count: int, trouble: BadInput | None) -> list[tuple[str, ...]]:
    """What a run takes from this machine."""
    if trouble is not None:
        return [("memory", "too little here, or too few processes are allowed: see the warning")]
    from swarmer.engines.limits import MEMORY_MB_PER_FLS, available_mb, cores

    free = available_mb()
    here = "" if free is None else f" of the {free:.0f} MB that are free"
    share = min(1.0, REAL_TIME_POINTS * cores() / MEASURED_CORES / count)
    launch = max(1.0, LAUNCH_S * count / LAUNCH_POINTS)
    return [
        ("memory", f"up to {count * MEMORY_MB_PER_FLS:.0f} MB{here}, for {count} processes"),
        ("time", f"launch some {launch:.0f} s, then {60 / share:.0f} s for 60 emulated ones (time scale {share:.2g}): "
                 "a guess, `swarmer doctor` measures"),
    ]  # fmt: skip


def parts(number: int) -> str:
    return "1 part" if number == 1 else f"{number} parts"


def links(number: int) -> str:
    return "1 link" if number == 1 else f"{number} links"
