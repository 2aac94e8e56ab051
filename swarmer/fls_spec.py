"""What one FLS is, as plain data that travels to wherever it runs: in the first shape, and in the one after."""

from __future__ import annotations

from typing import NamedTuple

from swarmer.messages import Vec3


class NextSpec(NamedTuple):
    """What one FLS is in the next shape; as `FlsSpec` has it for the first."""

    epoch: int
    truth: Vec3 | None  # None: it leaves
    neighbours: tuple[int, ...] = ()
    reach: float = 0.0
    near: tuple[int, ...] = ()
    distances: tuple[float, ...] = ()
    group: int = 0  # that of the first shape whose standby it is left, or one beyond
    standby: Vec3 | None = None


class FlsSpec(NamedTuple):
    """What one FLS is."""

    fid: int
    incarnation: int
    truth: Vec3
    neighbours: tuple[int, ...]
    reach: float  # cells to the farthest planned neighbour
    near: tuple[int, ...]  # FIDs nearest in ground truth, nearest first
    distances: tuple[float, ...]
    origin: Vec3  # where it, and whoever replaces it, is launched from
    launch_at_s: float
    epoch: int
    start: Vec3 | None = None  # where it is instead, lit as soon as it is launched; who replaces it flies in
    group: int = 0  # that shares a standby
    standby: Vec3 | None = None  # where that one waits; None: there is none
    waits_at: Vec3 | None = None  # a standby that relieves another FLS: where it is launched from
    then: NextSpec | None = None  # what it is in the shape that comes after; None: there is none to come

    def changed(self) -> FlsSpec:
        """What it is once the next shape has begun; who has no point there stays what it was."""
        then = self.then
        if then is None or then.truth is None:
            return self
        return self._replace(
            truth=then.truth, neighbours=then.neighbours, reach=then.reach, near=then.near,
            distances=then.distances, epoch=then.epoch, group=then.group, standby=then.standby, then=None,
        )  # fmt: skip

    @property
    def starts_lit(self) -> bool:
        """Where it is launched it is lit at once; not so who replaces it."""
        return self.start is not None and not self.incarnation

    @property
    def begins_at(self) -> Vec3:
        """Where it is before its launch."""
        here = self.start if self.starts_lit else self.waits_at
        return self.origin if here is None else here

    @property
    def leaves(self) -> bool:
        """It has no point in the shape that comes after."""
        return self.then is not None and self.then.truth is None


def successor(spec: FlsSpec, now_s: float, change_s: float | None) -> FlsSpec | None:
    """What replaces an FLS that is gone, launched now; None: its point is no more.

    change_s: when the next shape begins, if there is one. Who is for that alone is not launched before.
    """
    launch_at_s = now_s
    if change_s is not None:
        if now_s >= change_s:
            if spec.leaves:
                return None
            spec = spec.changed()
        elif spec.epoch:
            launch_at_s = change_s
    return spec._replace(incarnation=spec.incarnation + 1, launch_at_s=launch_at_s, waits_at=None)
