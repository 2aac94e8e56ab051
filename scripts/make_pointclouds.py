"""Make the shipped point clouds anew: pointclouds/NAME.xyz, NAME.png and README.md.

    python scripts/make_pointclouds.py [NAME ...]

Needs the extra `shapes` (manifold3d). To add a shape: a file with `make()` in scripts/solids, a line
in MAKERS below, and a line in CATALOGUE of swarmer/shapes/catalogue.py.
"""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swarmer.shapes.drawing import Panel, draw_clouds
from swarmer.shapes.generators import to_corner
from swarmer.shapes.neighbours import NeighbourPlan, neighbour_plan
from swarmer.shapes.views import FRONT, SIDE, THREE_QUARTERS, TOP

FOLDER = Path(__file__).resolve().parent.parent / "pointclouds"
DECIMALS = 3  # of a cell: 0.05 mm
MAKERS = {
    "dragon": "solids.dragon",
    "hat": "solids.hat",
    "skateboard": "solids.skateboard",
    "racecar": "solids.racecar",
    "statue": "solids.statue",
    "chess": "solids.chess",
    "butterfly": "solids.butterfly",
    "butterfly1008": "solids.butterfly1008",
    "cat": "solids.cat",
    "teapot": "solids.teapot",
}

README = """# Point clouds

One point a line, `length height depth` in display cells (a cell is a cube of 5 cm), height up, the
lower corner at 3. Line i is the ground truth of FLS i. Every cloud is the project's own work, made by
`python scripts/make_pointclouds.py` (extra `shapes`), under the project's licence, MIT; nobody else's
points or meshes went into them.

| shape | points | box, cells (L x H x D) | nearest two, cells | parts at η = 5 | longest planned link, cells |
|---|---|---|---|---|---|
{rows}

`swarmer shapes` lists them, `swarmer shapes show NAME` draws one.
{pictures}"""


def made(name: str) -> NDArray[np.float64]:
    """The cloud as it is written, (F, 3): made, moved to the corner, rounded."""
    return np.round(to_corner(import_module(MAKERS[name]).make()), DECIMALS)


def main(names: list[str]) -> None:
    """Write the named clouds, all when none is named, and the table of all that are there."""
    unknown = sorted(set(names) - set(MAKERS))
    if unknown:
        sys.exit(f"no maker of {', '.join(unknown)}; there are: {', '.join(MAKERS)}")
    for name in names or MAKERS:
        points = made(name)
        np.savetxt(FOLDER / f"{name}.xyz", points, fmt=f"%.{DECIMALS}f")
        draw(name, points)
        sys.stdout.write(f"{name}: {len(points)} points\n")
    rows, pictures = "", ""
    for name in MAKERS:
        points = np.loadtxt(FOLDER / f"{name}.xyz")
        rows += row(name, points, neighbour_plan(points)) + "\n"
        pictures += f"\n![{name}]({name}.png)\n"
    (FOLDER / "README.md").write_text(README.format(rows=rows.rstrip(), pictures=pictures), encoding="utf-8")


def row(name: str, points: NDArray[np.float64], plan: NeighbourPlan) -> str:
    """The shape's line of the table."""
    box = " x ".join(f"{extent:g}" for extent in np.ptp(points, axis=0).round(DECIMALS))
    return (
        f"| `{name}` | {len(points)} | {box} | {plan.spacing_min_cells:.2f} | {plan.components} "
        f"| {plan.longest_link_cells:.1f} |"
    )


def draw(name: str, points: NDArray[np.float64]) -> None:
    """The picture of the shape from four sides; of a flat one from the only side it has."""
    if np.ptp(points[:, 2]) == 0:
        draw_clouds([Panel(name, points, None, SIDE)], FOLDER / f"{name}.png", dpi=100)
        return
    views = [("three quarters", THREE_QUARTERS), ("side", SIDE), ("front", FRONT), ("top", TOP)]
    panels = [Panel(f"{name}, {title}", points, None, view) for title, view in views]
    draw_clouds(panels, FOLDER / f"{name}.png", columns=2, dpi=100)


if __name__ == "__main__":
    main(sys.argv[1:])
