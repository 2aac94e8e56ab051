"""Make the pictures of README.md: docs/pictures/before_after.png of a run, docs/pictures/shapes.png of the catalogue.

    swarmer-run --shape dragon --lambda 500 --out RUN
    python scripts/make_pictures.py RUN [FOLDER]
    python scripts/make_pictures.py shapes [FOLDER]

Before is where each FLS came down from its first flight, which is what dead reckoning alone can do; after is the sample
with the smallest Hausdorff distance.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps

from swarmer.metrics.hausdorff import hausdorff
from swarmer.observe.words import cells
from swarmer.shapes.catalogue import CATALOGUE, load_shape
from swarmer.shapes.drawing import GROUND, Panel, draw_clouds
from swarmer.shapes.views import THREE_QUARTERS, View, usual_view

PICTURES = Path(__file__).resolve().parent.parent / "docs" / "pictures"
FROM_THE_RIGHT = View(THREE_QUARTERS.azimuth_deg - 8, THREE_QUARTERS.elevation_deg)
DPI = 170
TILE, COLUMNS = 290, 5  # pixels of a shape's place in shapes.png; shapes in a row
COLOURS = 255  # of the palette that the file is reduced to: a third of the size, and nothing to see of it


class Moments(NamedTuple):
    """What a run's timeline has to show, (F, 3) each, display cells."""

    truth: NDArray[np.float64]
    landed: NDArray[np.float64]
    localized: NDArray[np.float64]
    localized_s: float


def moments(timeline: Path) -> Moments:
    """Read them. Raises ValueError where some FLS was never lit, so there is no whole picture."""
    with np.load(timeline, allow_pickle=False) as saved:
        truth, position, lit = saved["truth"], saved["position"].astype(float), saved["lit"]
        hd, t_s = saved["hd_cells"], saved["t_s"]
    if not lit.any(axis=0).all():
        raise ValueError(f"{timeline}: {int((~lit.any(axis=0)).sum())} FLSs were never lit")
    whole = lit.all(axis=1)
    best = int(np.nanargmin(np.where(whole, hd, np.inf)))
    landed = position[lit.argmax(axis=0), np.arange(len(truth))]
    return Moments(truth, landed, position[best], float(t_s[best]))


def main(arguments: list[str]) -> None:
    """Draw into FOLDER, docs/pictures when none is given."""
    if not 1 <= len(arguments) <= 2:
        sys.exit(__doc__)
    folder = Path(arguments[1]) if len(arguments) == 2 else PICTURES
    if arguments[0] == "shapes":
        draw_shapes(folder)
        return
    try:
        seen = moments(Path(arguments[0]) / "timeline.npz")
    except (OSError, ValueError, KeyError) as error:
        sys.exit(f"error: {error}")
    view = FROM_THE_RIGHT if len(np.unique(seen.truth[:, 2])) > 1 else usual_view(2)
    folder.mkdir(parents=True, exist_ok=True)
    draw_clouds(
        [
            Panel(f"deployed by dead reckoning: HD {_hd(seen.landed, seen)} cells", seen.landed, None, view),
            Panel(
                f"localized, after {seen.localized_s:.0f} s: HD {_hd(seen.localized, seen)} cells",
                seen.localized, None, view,
            ),
        ],
        path := folder / "before_after.png",
        dpi=DPI,
    )  # fmt: skip
    shrink(path)
    sys.stdout.write(f"{path}\n")


def draw_shapes(folder: Path) -> None:
    """The shipped shapes side by side, each as large as its place allows."""
    names = [name for name, entry in CATALOGUE.items() if entry.make is None]
    rows = -(-len(names) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * TILE, rows * TILE), GROUND)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "shapes.png"
    for number, name in enumerate(names):
        cloud = load_shape(name)
        draw_clouds([Panel("", cloud.points, None, usual_view(cloud.dim))], path, dpi=DPI)
        with Image.open(path) as picture:
            tile = ImageOps.contain(picture.convert("RGB"), (TILE, TILE))
        row, column = divmod(number, COLUMNS)
        sheet.paste(tile, (column * TILE + (TILE - tile.width) // 2, row * TILE + (TILE - tile.height) // 2))
    sheet.save(path)
    shrink(path)
    sys.stdout.write(f"{path}\n")


def shrink(path: Path) -> None:
    """Reduce a picture to a palette of its own."""
    with Image.open(path) as picture:
        small = picture.convert("RGB").quantize(
            COLOURS, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE
        )
    small.save(path, optimize=True)


def _hd(positions: NDArray[np.float64], seen: Moments) -> str:
    return cells(hausdorff(positions, seen.truth))


if __name__ == "__main__":
    main(sys.argv[1:])
