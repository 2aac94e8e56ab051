"""Which host has which FLSs: the points are shared out by space, so that most of the radio's traffic stays at home.

Recursive coordinate bisection (Berger and Bokhari, 1987): the points are cut in two across their longest extent, in
proportion to what the hosts on either side can carry, and each part again.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from swarmer.plan import Plan

Box = tuple[tuple[float, float, float], tuple[float, float, float]]  # lowest and highest corner, cells


def shares(points: NDArray[np.float64], weights: Sequence[float]) -> NDArray[np.int64]:
    """(F,) the host of each point, 0 to len(weights) - 1; no host is without a point.

    points: (F, 3), at least as many as there are hosts. weights: how much each host can carry, above 0.
    """
    host_of = np.zeros(len(points), np.int64)
    _share(points, np.arange(len(points)), list(enumerate(weights)), host_of)
    return host_of


def _share(
    points: NDArray[np.float64], rows: NDArray[np.int64], hosts: list[tuple[int, float]], host_of: NDArray[np.int64]
) -> None:  # fmt: skip
    if len(hosts) == 1:
        host_of[rows] = hosts[0][0]
        return
    half = len(hosts) // 2
    first, second = hosts[:half], hosts[half:]
    share = sum(weight for _, weight in first) / sum(weight for _, weight in hosts)
    cut = min(max(round(share * len(rows)), len(first)), len(rows) - len(second))
    axis = int(np.ptp(points[rows], axis=0).argmax())
    rows = rows[np.argsort(points[rows, axis], kind="stable")]
    _share(points, rows[:cut], first, host_of)
    _share(points, rows[cut:], second, host_of)


def taken_over(
    points: NDArray[np.float64], host_of: NDArray[np.int64], lost: NDArray[np.int64], weights: dict[int, float]
) -> NDArray[np.int64]:  # fmt: skip
    """The hosts that the lost rows go to: parts of about equal weight, each to the host whose points are nearest.

    host_of: (F,) as before. lost: rows. weights: by host, of those that are left. Gives (len(lost),) hosts.
    """
    from scipy.optimize import linear_sum_assignment

    hosts = sorted(weights)[: max(1, len(lost))]
    part_of = shares(points[lost], [weights[host] for host in hosts])
    parts = np.array([points[lost[part_of == part]].mean(axis=0) for part in range(len(hosts))])
    there = np.array([points[host_of == host].mean(axis=0) for host in hosts])
    far = np.linalg.norm(parts[:, None, :] - there[None, :, :], axis=2)
    _, columns = linear_sum_assignment(far)
    return np.array(hosts)[columns[part_of]]


def box_of(points: NDArray[np.float64]) -> Box:
    """The smallest box around points, (N, 3)."""
    return tuple(points.min(axis=0).tolist()), tuple(points.max(axis=0).tolist())


def out_of_box(point: tuple[float, float, float], box: Box) -> float:
    """How far a point is from a box, cells; 0 within."""
    low, high = box
    far2 = 0.0
    for x, least, most in zip(point, low, high, strict=True):
        off = least - x if x < least else x - most if x > most else 0.0
        far2 += off * off
    return far2**0.5


def all_points(plan: Plan) -> NDArray[np.float64]:
    """(F, 2, 3): of each FLS its points, in the first shape and in the last, cells; twice the same where it has one."""
    points = np.full((plan.size, 2, 3), np.nan)
    points[: len(plan.cloud), 0] = plan.cloud.points
    if plan.next is not None:
        points[plan.next.fids - 1, 1] = plan.next.cloud.points
    for one, other in ((0, 1), (1, 0)):
        there = np.isnan(points[:, one, 0])
        points[there, one] = points[there, other]
    return points
