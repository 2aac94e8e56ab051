"""What the display becomes after its first shape: who flies to which point, and who knows where it is.

Here names become points, as in `plan`, which puts together what this file finds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from swarmer.errors import BadInput
from swarmer.protocol.corner import CORNERS, CORNERS_2D

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from swarmer.config import RunConfig
    from swarmer.shapes.cloud import PointCloud
    from swarmer.shapes.neighbours import NeighbourPlan


@dataclass(frozen=True, slots=True, eq=False)
class NextShape:
    """The shape that comes after the first one: who lights which of its points, and from when on."""

    at_s: float
    cloud: PointCloud
    neighbours: NeighbourPlan  # by rows of the cloud
    fids: NDArray[np.int64]  # (G,) the FLS of each row
    leavers: tuple[int, ...]  # FIDs of the first shape that have no point here
    joiners: tuple[int, ...]  # FIDs that have none in the first; they wait at the dispatcher
    way_cells: float  # mean way of who flies from point to point
    optimal: bool  # their assignment is the best there is
    corners: tuple[int, ...]  # FIDs of the points farthest from the centroid
    dim: int  # of both shapes together, as is the diagonal
    diagonal_cells: float
    place: str  # its name, or the whole path of its file


class Standing(NamedTuple):
    """What is to be seen from a moment on. Row i is FID i + 1."""

    from_s: float
    truth: NDArray[np.float64]  # (N, 3), cells; of who has no point now, the one it had or will have
    member: NDArray[np.bool_]  # (N,), it has a point now


def standing_at(standings: tuple[Standing, ...], t_s: float) -> Standing:
    """The last one that has begun."""
    return max(
        (one for one in standings if one.from_s <= t_s), key=lambda one: one.from_s, default=standings[0]
    )


def standings_of(first: PointCloud, shape: NextShape | None) -> tuple[Standing, ...]:
    """The truth of the first shape, and of the next if there is one."""
    import numpy as np

    if shape is None:
        return (Standing(0.0, first.points, np.ones(len(first), np.bool_)),)
    count = len(first) + len(shape.joiners)
    begins = np.arange(count) < len(first)
    truth = np.zeros((count, 3))
    truth[begins] = first.points
    after, there = truth.copy(), np.zeros(count, np.bool_)
    after[shape.fids - 1] = shape.cloud.points
    there[shape.fids - 1] = True
    truth[~begins] = after[~begins]
    return (Standing(0.0, truth, begins), Standing(shape.at_s, after, there))


def plan_next(config: RunConfig, first: PointCloud) -> NextShape:
    """The shape that the settings say comes after `first`. Raises BadInput."""
    import numpy as np

    from swarmer.shapes.assignment import assign
    from swarmer.shapes.catalogue import load_shape, place_of
    from swarmer.shapes.neighbours import neighbour_plan

    then = config.transition
    assert then.shape is not None
    assert then.at_s is not None
    try:
        cloud = load_shape(then.shape, then.points, config.duplicates, config.seed)
    except BadInput as error:  # which of the two shapes is wrong?
        raise BadInput.saying(f"transition.{error}") from None
    pairs = assign(first.points, cloud.points)
    fids = np.zeros(len(cloud), np.int64)
    stay = np.flatnonzero(pairs.point_of >= 0)
    fids[pairs.point_of[stay]] = stay + 1
    fids[pairs.joining] = len(first) + 1 + np.arange(len(pairs.joining))
    ways = np.linalg.norm(cloud.points[pairs.point_of[stay]] - first.points[stay], axis=1)
    both = np.concatenate([first.points, cloud.points])
    return NextShape(
        at_s=then.at_s,
        cloud=cloud,
        neighbours=neighbour_plan(cloud.points, config.eta, config.neighbours),
        fids=fids,
        leavers=tuple((pairs.leaving + 1).tolist()),
        joiners=tuple(fids[pairs.joining].tolist()),
        way_cells=float(ways.mean()),
        optimal=pairs.optimal,
        corners=tuple(int(fids[row - 1]) for row in corners(cloud)),
        dim=2 if np.ptp(both[:, 2]) == 0 else 3,
        diagonal_cells=float(np.linalg.norm(np.ptp(both, axis=0))),
        place=place_of(then.shape),
    )


def corners(cloud: PointCloud) -> tuple[int, ...]:
    """FIDs of the points farthest from the centroid: 8, in a flat cloud 4, or all; of equal ones the lower FIDs."""
    import numpy as np

    far = ((cloud.points - cloud.points.mean(axis=0)) ** 2).sum(axis=1)
    most = CORNERS_2D if cloud.dim == 2 else CORNERS
    return tuple(sorted((np.argsort(-far, kind="stable")[:most] + 1).tolist()))


def oracles(cloud: PointCloud, count: int) -> tuple[int, ...]:
    """FIDs of so many points, well spread over the cloud. Raises BadInput if it does not have that many."""
    from swarmer.shapes.sampling import spread_choice

    if count > len(cloud):
        raise BadInput("oracle.count", count, f"0 to {len(cloud)}, as many as there are points")
    row_of = {tuple(point): row for row, point in enumerate(cloud.points.tolist())}
    return tuple(sorted(row_of[tuple(point)] + 1 for point in spread_choice(cloud.points, count).tolist()))
