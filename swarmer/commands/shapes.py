"""`swarmer shapes`: the catalogue, and a look at one shape. `make` and `check` have files of their own."""

from __future__ import annotations

import contextlib
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from swarmer.commands.shapes_check import check
from swarmer.commands.shapes_make import make
from swarmer.commands.shapes_words import aligned, cloud_warnings, seed_option
from swarmer.interrupts import ends_at_once

if TYPE_CHECKING:
    from swarmer.shapes.cloud import PointCloud
    from swarmer.shapes.neighbours import NeighbourPlan

COLUMNS = ("name", "points", "dim", "box (cells)", "nearest", "parts", "longest", "licence")


@click.group(name="shapes", invoke_without_command=True)
@click.pass_context
def command(ctx: click.Context) -> None:
    """List the shapes that a name stands for, with the facts of their neighbour graphs.

    Lengths in display cells (5 cm). Nearest: how far the nearest two points are apart. Parts: into how many pieces
    the graph of the 5 nearest neighbours falls before the plan joins them. Longest: link between two planned
    neighbours.
    """
    if ctx.invoked_subcommand is None:
        with ends_at_once():
            _list()


def _list() -> None:
    from swarmer.shapes.catalogue import CATALOGUE, load_shape
    from swarmer.shapes.neighbours import neighbour_plan

    rows: list[tuple[str, ...]] = [COLUMNS]
    for name, entry in CATALOGUE.items():
        cloud = load_shape(name)
        plan = neighbour_plan(cloud.points)
        rows.append(
            (
                name,
                f"{len(cloud)}{'' if entry.make is None else ' *'}",
                f"{cloud.dim}D",
                " x ".join(f"{extent:.0f}" for extent in cloud.box_cells),
                f"{plan.spacing_min_cells:.2f}",
                str(plan.components),
                f"{plan.longest_link_cells:.1f}",
                cloud.licence,
            )
        )
    for line in aligned(rows):
        click.echo(line)
    click.echo("\n* made with any count: --points N. `swarmer shapes show NAME` draws one,")
    click.echo("`check NAME` tells more, `make FILE` makes one of your points, mesh or picture.")


command.add_command(make)
command.add_command(check)


@command.command()
@click.argument("shape", metavar="NAME_OR_FILE")
@click.option("--points", type=int, metavar="N", help="Exactly N points: made, sampled or chosen.")
@click.option("--dedupe", is_flag=True, help="Remove duplicate points; without it they are an error.")
@click.option(
    "--eta", type=int, metavar="N", help="Nearest neighbours in the plan (default 5, or F-1 if smaller)."
)
@seed_option("For `random`, and for sampling a mesh.")
@click.option(
    "--out", type=click.Path(path_type=Path), metavar="FILE.png", help="Draw it into a picture too."
)
def show(shape: str, points: int | None, dedupe: bool, eta: int | None, seed: int, out: Path | None) -> None:
    """Draw a shape in the terminal, with its neighbour facts."""
    with ends_at_once():
        from swarmer.shapes.braille import terminal_picture
        from swarmer.shapes.catalogue import load_shape
        from swarmer.shapes.neighbours import neighbour_plan
        from swarmer.shapes.views import usual_view

        if out is not None:
            _refuse_picture(out)
        cloud = load_shape(shape, points, "drop" if dedupe else "refuse", seed)
        plan = neighbour_plan(cloud.points, eta)
    size = shutil.get_terminal_size((80, 40))
    picture = terminal_picture(
        cloud.points,
        usual_view(cloud.dim),
        columns=max(20, min(100, size.columns - 2)),
        rows=max(10, min(40, size.lines - 14)),
        colour=sys.stdout.isatty(),
        ascii_only=not _speaks_braille(),
    )
    click.echo(picture + "\n", color=True)  # its codes are there on a terminal only
    for line in aligned(_facts(cloud, plan)):
        click.echo(line)
    for line in cloud_warnings(cloud, plan):
        click.echo(line, err=True)
    if out is not None:
        _draw(cloud, out)


def _facts(cloud: PointCloud, plan: NeighbourPlan) -> list[tuple[str, ...]]:
    facts: list[tuple[str, ...]] = [
        ("shape", cloud.name),
        ("points", f"{len(cloud)}" + (f" ({cloud.dropped} duplicates removed)" if cloud.dropped else "")),
        ("dimensions", f"{cloud.dim}" + (" (constant depth)" if cloud.dim == 2 else "")),
        ("box", f"{_box(cloud)} cells"),
        ("nearest two", f"{plan.spacing_min_cells:.3g} cells apart"),
        ("neighbours", f"{plan.eta} nearest, {plan.mode}: {plan.mean_degree:.1f} on average"),
        ("one-way", f"{plan.one_way_share:.0%} of the nearest are not mutual"),
        ("parts", f"{plan.components} before {plan.added_links} links were added"),
        ("longest link", f"{plan.longest_link_cells:.2f} cells"),
        ("source", cloud.source),
        ("licence", cloud.licence),
    ]
    return [*facts, ("credit", cloud.credit)] if cloud.credit else facts


def _refuse_picture(out: Path) -> None:
    from swarmer.errors import BadInput

    if out.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise BadInput("out", str(out), "a file that ends in .png, .svg or .pdf")
    if not out.parent.is_dir():
        raise BadInput("out", str(out), "a file in a directory that is there")


def _draw(cloud: PointCloud, out: Path) -> None:
    from swarmer.errors import BadInput
    from swarmer.shapes.drawing import Panel, draw_clouds
    from swarmer.shapes.views import usual_view

    title = f"{cloud.name}, {len(cloud)} points"
    unfinished = out.with_name(f"{out.stem}.tmp{out.suffix}")  # so that `out` is whole or not there
    try:
        draw_clouds([Panel(title, cloud.points, None, usual_view(cloud.dim))], unfinished, dpi=200)
        unfinished.replace(out)
    except OSError as error:
        raise BadInput("out", str(out), f"a file that can be written ({error.strerror})") from None
    finally:
        with contextlib.suppress(OSError):
            unfinished.unlink()
    click.echo(f"picture: {out}", err=True)


def _box(cloud: PointCloud) -> str:
    return " x ".join(f"{round(extent, 1):g}" for extent in cloud.box_cells)


def _speaks_braille() -> bool:
    try:
        "⠿".encode(sys.stdout.encoding or "ascii")
    except (UnicodeError, LookupError):
        return False
    return True
