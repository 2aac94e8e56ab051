"""`swarmer shapes make`: a file of points, a mesh or a picture becomes a cloud that can be run."""

from __future__ import annotations

import math
import os
import re
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import click

from swarmer.commands.shapes_words import seed_option
from swarmer.errors import BadInput, RunFailed
from swarmer.interrupts import ends_at_once

if TYPE_CHECKING:
    from swarmer.shapes.making import Drawn
    from swarmer.shapes.placing import Gaps, Placed, Size

# As in swarmer.shapes.placing, which takes too long to import for --help.
AXES = ("x", "y", "z", "-x", "-y", "-z")
MEASURES = ("mm", "cm", "m", "cells")
SIDES = re.compile(r"\s*[xX×]\s*")
UNEVEN = 10.0  # times the least gap: a median gap above it says that some points lie on top of others


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--points",
    type=int,
    metavar="N",
    help="Exactly N points. A file of points gives all of them without it; a mesh and a picture need it.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="NAME.xyz",
    help="What is written. [default: FILE's name with .xyz, here]",
)
@click.option(
    "--box",
    metavar="LxHxD",
    help="Fit into a box of length, height and depth in cells, proportions kept; LxH leaves the depth free.",
)
@click.option(
    "--spacing",
    type=float,
    metavar="CELLS",
    help="Scale until the nearest two are so far apart. [default: 1.5]",
)
@click.option("--scale", type=float, metavar="X", help="Scale by X, and by --unit.")
@click.option(
    "--unit",
    type=click.Choice(MEASURES),
    help="The unit of the file's numbers: they keep their size, a cell being 5 cm. [default with --scale: cells]",
)
@click.option(
    "--up", type=click.Choice(AXES), default="y", show_default=True, help="Which axis of the file points up."
)
@seed_option("For what is drawn by chance from a mesh or a picture.")
@click.option(
    "--dedupe", is_flag=True, help="Drop points that the file has twice; without it they are an error."
)
@click.option("--invert", is_flag=True, help="Of a picture take what is light, or cut out.")
@click.option("--flat", is_flag=True, help="Press it flat: a 2D cloud, as seen from the front.")
@click.option("--force", is_flag=True, help="Overwrite the file at --out.")
def make(
    file: Path,
    points: int | None,
    out: Path | None,
    box: str | None,
    spacing: float | None,
    scale: float | None,
    unit: str | None,
    up: str,
    seed: int,
    dedupe: bool,
    invert: bool,
    flat: bool,
    force: bool,
) -> None:
    """Make a cloud that can be run of FILE: points, a mesh, or a picture's silhouette.

    Points: .ptcld .xyz .csv .txt .npy .mat. Meshes, whose surface is sampled: .off .ply .obj .stl .glb. Pictures:
    .png, what is opaque, or dark. The points are turned upright, scaled into display cells (5 cm) by one of --box,
    --spacing and --scale/--unit, moved until their lower corner is at 3, rounded to 3 decimals and written.
    """
    with ends_at_once():
        from swarmer.shapes.making import Wish, draw_file
        from swarmer.shapes.placing import place

        refuse_name(file)
        out = checked_out(out, file, force)
        size = checked_size(box, spacing, scale, unit)
        wish = Wish(checked_points(points), up, seed, "drop" if dedupe else "refuse", invert, flat)
        drawn = draw_file(file, wish)
        placed = place(drawn.points, size)
    write(out, placed)
    tell(file, out, drawn, placed, size)


# -- what was asked for ----------------------------------------------------------------------------------------------


def refuse_name(file: Path) -> None:
    """A shape of the catalogue needs no making."""
    from swarmer.shapes.catalogue import CATALOGUE

    if str(file) in CATALOGUE and not file.exists():
        raise BadInput("file", str(file), f"that has a name: `swarmer-run --shape {file} --points N` runs it")


def checked_points(points: int | None) -> int | None:
    from swarmer.shapes.cloud import POINTS_MAX

    if points is not None and not 2 <= points <= POINTS_MAX:
        raise BadInput("points", points, f"a whole number, 2 to {POINTS_MAX:,}")
    return points


def checked_out(out: Path | None, file: Path, force: bool) -> Path:
    """Where to write: a .xyz in a directory that is there, not the file that is read, nothing that is there already."""
    out = Path(file.stem + ".xyz") if out is None else out
    if out.suffix.lower() != ".xyz" or not str(out).isprintable():
        allowed = "a file that ends in .xyz, its name without special characters; name one with --out"
        raise BadInput("out", str(out), allowed)
    try:
        if not out.parent.is_dir():
            raise BadInput("out", str(out), "a file in a directory that is there")
        if out.exists() and file.exists() and out.samefile(file):
            raise BadInput("out", str(out), "another file than the one that is read; name one with --out")
        if out.is_dir():
            raise BadInput("out", str(out), "a file; that is a directory")
        if os.path.lexists(out) and not force:  # a link to nothing is there, too
            raise BadInput("out", str(out), "it is there already; name another with --out, or say --force")
    except OSError as error:
        raise BadInput("out", str(out), f"a file that can be written ({error.strerror})") from None
    return out


def checked_size(box: str | None, spacing: float | None, scale: float | None, unit: str | None) -> Size:
    """One size of what was given; the default's spacing if nothing was. Raises BadInput."""
    from swarmer.shapes.placing import SPACING, Size

    ways = {"--box": box, "--spacing": spacing, "--scale/--unit": scale if scale is not None else unit}
    given = [name for name, value in ways.items() if value is not None]
    if len(given) > 1:
        raise BadInput.saying(f"size: {' with '.join(given)}; only one of them can say how large it shall be")
    if box is not None:
        return Size(box=parsed_box(box))
    if spacing is not None:
        return Size(spacing=above_0("spacing", spacing, "cells"))
    if given:
        return Size(scale=None if scale is None else above_0("scale", scale, "a factor"), unit=unit)
    return Size(spacing=SPACING)


def parsed_box(text: str) -> tuple[float, ...]:
    """`95x59x57` as numbers."""
    try:
        sides = tuple(float(side) for side in SIDES.split(text.strip()))
    except ValueError:
        sides = ()
    if len(sides) not in (2, 3) or not all(0 < side <= 1e6 for side in sides):
        raise BadInput(
            "box", text, "two or three numbers of cells, as 95x59x57 or 95x59, up to 1,000,000 each"
        )
    return sides


def above_0(name: str, value: float, unit: str) -> float:
    if not (value > 0 and math.isfinite(value)):
        raise BadInput(name, value, f"{unit}, a number above 0")
    return value


# -- what was made ---------------------------------------------------------------------------------------------------


def write(out: Path, placed: Placed) -> None:
    """Write the cloud, whole or not at all. Raises RunFailed."""
    import numpy as np

    from swarmer.observe.files import write_file
    from swarmer.shapes.placing import DECIMALS

    try:
        write_file(out, lambda file: np.savetxt(file, placed.points, fmt=f"%.{DECIMALS}f"))
    except RunFailed as failure:
        cause = failure.__cause__
        reason = (cause.strerror if isinstance(cause, OSError) else None) or "it cannot be written"
        raise RunFailed(f"{out}: {reason}; nothing was written") from None


def tell(file: Path, out: Path, drawn: Drawn, placed: Placed, size: Size) -> None:
    """What was made of what, what to mind, and the next command."""
    from swarmer.commands.run import program_beside_python
    from swarmer.shapes import placing
    from swarmer.shapes.files import end_of, pasteable

    gaps = placing.gaps(placed.points)
    click.echo(f"read    {end_of(str(file))}: {drawn.what}")
    click.echo(f"scale   {placed.factor:.4g} cells for 1 in the file ({size})")
    click.echo(f"wrote   {out}: {len(placed.points)} points, {box_of(placed)}")
    click.echo(f"        nearest two {gaps.least:.2f} cells apart, median {gaps.median:.2f}")
    for warning in (*drawn.warnings, *size_warnings(gaps)):
        click.echo(f"warning: {warning}", err=True)
    program = shlex.quote(program_beside_python() + "-run")
    click.echo(f"next    {program} --shape {pasteable(out)}")


def box_of(placed: Placed) -> str:
    """The box in cells and in metres."""
    import numpy as np

    from swarmer.shapes.placing import CELL_M

    extent = np.ptp(placed.points, axis=0)
    cells, metres = (" x ".join(f"{side:.3g}" for side in sides) for sides in (extent, extent * CELL_M))
    return f"box {cells} cells = {metres} m"


def size_warnings(gaps: Gaps) -> list[str]:
    """What is wrong with the gaps between the points."""
    from swarmer.shapes.cloud import SMALLEST_SPACING

    found = []
    if gaps.least < SMALLEST_SPACING:
        found.append(
            f"the nearest two are {gaps.least:.3g} cells apart, lights need {SMALLEST_SPACING:g}: make it "
            f"{SMALLEST_SPACING / gaps.least:.3g} times as large, or take fewer points"
        )
    if gaps.median > UNEVEN * gaps.least:
        found.append(
            f"uneven: most points are {gaps.median:.3g} cells from the next, the nearest two {gaps.least:.3g}; "
            "with fewer points (--points) the nearest ones go first"
        )
    return found
