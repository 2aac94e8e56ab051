"""The display in three dimensions, as a recording has it: FLSs, who flies where by which anchor, who failed.

Lengths are in display cells, the radius of a light included. FLSs lie in blocks of so many FIDs that follow each other,
an entity each: a block in which nobody has moved is not written again, and within a block what stood still packs well.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swarmer.next_shape import standing_at
from swarmer.observe.palette import STATE_COLOURS, STATES, TRUTH, Palette, rgb
from swarmer.observe.tracks import Moment, Track

if TYPE_CHECKING:
    from swarmer.config import RunConfig
    from swarmer.engines.result import Localized, Snapshot
    from swarmer.next_shape import Standing

BLOCK_MIN, BLOCKS_MAX = 128, 16
ARROW_S = 0.5  # emulated; how long a flight's vector stays
FLASH_S = 1.2  # emulated; how long a failure flashes
FLASHES_MIN = 2  # frames; however seldom those are
FLASH_SIZES, FLASH_COLOURS = (3.0, 1.5), ((255, 48, 96), (255, 220, 228))  # by turns; of a light's radius
DISPATCHER = (226, 232, 240)
ANCHOR, LOCALIZER = (
    rgb(STATE_COLOURS[STATES.index("Busy Anchor")]),
    rgb(STATE_COLOURS[STATES.index("Busy Localizing")]),
)
ANCHORING = STATES.index("Busy Anchor")
DARK_SIZE, TRUTH_SIZE, ANCHOR_SIZE, DISPATCHER_SIZE = 0.45, 0.3, 1.6, 3.0  # of a light's radius


@dataclass(slots=True)
class Flash:
    """A failure that is being shown."""

    place: NDArray[np.float32]
    until_s: float  # emulated
    frames: int = 0  # in which it has been


class Scene:
    """Takes every sample by `note`, and draws those that it is told to by `draw`."""

    def __init__(self, rec: Any, standings: tuple[Standing, ...], config: RunConfig) -> None:
        """rec: the rerun stream. standings: where everybody belongs, and from when on."""
        import rerun as rr

        truth = standings[0].truth
        count = len(truth)
        self.light = light_radius(truth)
        self._palette = Palette(count)
        size = max(BLOCK_MIN, -(-count // BLOCKS_MAX))
        self._starts = np.arange(0, count, size)
        names = [f"swarm/fls_{start + 1}-{min(start + size, count)}" for start in self._starts.tolist()]
        self._places = [Track(name, rr.Points3D.columns) for name in names]
        self._looks = [Track(name, rr.Points3D.columns) for name in names]
        self._anchors = Track("anchors", rr.Boxes3D.columns)
        self._arrows = Track("localizations", rr.Arrows3D.columns)
        self._failures = Track("failures", rr.Points3D.columns)
        self._standings, self._standing = standings, standings[0]
        self._truth_radii = Track("ground_truth", rr.Points3D.columns)
        self._truth_places = Track(
            "ground_truth", rr.Points3D.columns
        )  # of a display that becomes another shape
        self._covered: NDArray[np.bool_] | None = None  # the points that an FLS stands before
        self._position: NDArray[np.float32] | None = None  # as drawn last
        self._colour = np.zeros((count, 3), np.uint8)
        self._lit = np.zeros(count, np.bool_)
        self._anchored: NDArray[np.float32] = np.zeros((0, 3), np.float32)
        self._flown: deque[tuple[float, Localized]] = deque()
        self._drawn = 0  # of those, from the left: in a frame already
        self._flashes: list[Flash] = []
        self._describe(rec, truth, names, size, config)

    def _describe(
        self, rec: Any, truth: NDArray[np.float64], names: list[str], size: int, config: RunConfig
    ) -> None:
        """Log what never changes."""
        import rerun as rr

        light = self.light
        rec.log("/", rr.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)
        if len(self._standings) == 1:
            rec.log("ground_truth", rr.Points3D(truth, colors=TRUTH), static=True)  # radii come later
        else:
            rec.log("ground_truth", rr.Points3D.from_fields(colors=TRUTH), static=True)
        for start, name in zip(self._starts.tolist(), names, strict=True):
            fids = np.arange(start, min(start + size, len(truth))) + 1
            rec.log(name, rr.AnyValues(fid=fids), static=True)  # shown when one points at an FLS
        rec.log(
            "anchors",
            rr.Boxes3D.from_fields(colors=ANCHOR, radii=0.12 * light, fill_mode="majorwireframe"),
            static=True,
        )
        rec.log("localizations", rr.Arrows3D.from_fields(colors=LOCALIZER, radii=0.18 * light), static=True)
        if config.deploy.start == "dispatcher":
            places = np.array(config.deploy.dispatchers, np.float32)
            half = np.full((len(places), 3), DISPATCHER_SIZE * light, np.float32)
            labels = ["dispatcher"] * len(places)
            look = rr.Boxes3D(
                centers=places, half_sizes=half, colors=DISPATCHER, radii=0.2 * light, labels=labels
            )
            rec.log("dispatchers", look, static=True)

    def tracks(self) -> list[Track]:
        """All that have rows to send."""
        truth = self._truth_places, self._truth_radii
        return [*truth, *self._places, *self._looks, self._anchors, self._arrows, self._failures]

    def failed(self, fid: int, t_s: float) -> None:
        """An FLS has failed: it flashes where it was seen last."""
        if self._position is not None:
            self._flashes.append(Flash(self._position[fid - 1].copy(), t_s + FLASH_S))

    def note(self, snapshot: Snapshot) -> None:
        """Remember what only this sample tells."""
        if snapshot.localized is not None:
            self._flown.append((snapshot.t_s, snapshot.localized))

    def draw(self, at: Moment, snapshot: Snapshot) -> None:
        """Write down what has changed since the frame before."""
        position = snapshot.position.astype(np.float32)
        self._draw_places(at, position)
        self._draw_truth(at, snapshot)
        self._draw_looks(at, snapshot)
        self._draw_anchors(at, snapshot)
        self._draw_arrows(at)
        self._draw_flashes(at)

    def _draw_places(self, at: Moment, position: NDArray[np.float32]) -> None:
        if self._position is None:
            touched = np.ones(len(self._starts), np.bool_)
        else:
            touched = np.logical_or.reduceat((position != self._position).any(axis=1), self._starts)
        self._position = position
        parts = np.split(position, self._starts[1:])
        for block in np.flatnonzero(touched).tolist():
            self._places[block].add(at, positions=parts[block])

    def _draw_truth(self, at: Moment, snapshot: Snapshot) -> None:
        """Points with their FLS before them are left out: the viewer would draw them on top of it, like pupils."""
        standing = standing_at(self._standings, snapshot.t_s)
        if len(self._standings) > 1 and (standing is not self._standing or self._covered is None):
            self._standing = standing
            self._truth_places.add(at, positions=standing.truth.astype(np.float32))
        apart = np.linalg.norm(snapshot.position - standing.truth, axis=1)
        covered = (apart < self.light) & snapshot.lit | ~standing.member
        if self._covered is None or not np.array_equal(covered, self._covered):
            radii = np.where(covered, 0.0, TRUTH_SIZE * self.light).astype(np.float32)
            self._truth_radii.add(at, radii=radii)
            self._covered = covered

    def _draw_looks(self, at: Moment, snapshot: Snapshot) -> None:
        """Colours and sizes."""
        colour, lit = self._palette.colours(snapshot.swarm, snapshot.lit), snapshot.lit
        changed = (colour != self._colour).any(axis=1) | (lit != self._lit)
        touched = np.logical_or.reduceat(changed, self._starts)
        self._colour, self._lit = colour, lit.copy()
        if not touched.any():
            return
        radius = np.where(lit, self.light, DARK_SIZE * self.light).astype(np.float32)
        colours, radii = np.split(colour, self._starts[1:]), np.split(radius, self._starts[1:])
        for block in np.flatnonzero(touched).tolist():
            self._looks[block].add(at, colors=colours[block], radii=radii[block])

    def _draw_anchors(self, at: Moment, snapshot: Snapshot) -> None:
        assert self._position is not None
        anchored = self._position[(snapshot.state == ANCHORING) & snapshot.lit]
        if np.array_equal(anchored, self._anchored):
            return
        self._anchored = anchored
        half = np.full(anchored.shape, ANCHOR_SIZE * self.light, np.float32)
        self._anchors.add(at, centers=anchored, half_sizes=half)

    def _draw_arrows(self, at: Moment) -> None:
        """The flights of a while; each is in one frame at least."""
        before = self._drawn
        while self._drawn and at.t_s - self._flown[0][0] > ARROW_S:
            self._flown.popleft()
            self._drawn -= 1
        if self._drawn == before == len(self._flown):
            return
        self._drawn = len(self._flown)
        origins = [none := np.zeros((0, 3), np.float32), *(flown.start for _, flown in self._flown)]
        vectors = [none, *(flown.vector for _, flown in self._flown)]
        self._arrows.add(at, origins=np.concatenate(origins), vectors=np.concatenate(vectors))

    def _draw_flashes(self, at: Moment) -> None:
        """Large and small by turns, where they failed."""
        if not self._flashes:
            return
        self._flashes = [
            flash for flash in self._flashes if at.t_s <= flash.until_s or flash.frames < FLASHES_MIN
        ]
        turn = [flash.frames % len(FLASH_SIZES) for flash in self._flashes]
        for flash in self._flashes:
            flash.frames += 1
        self._failures.add(
            at,
            positions=np.array([flash.place for flash in self._flashes], np.float32).reshape(-1, 3),
            colors=np.array(FLASH_COLOURS, np.uint8)[turn],
            radii=np.array(FLASH_SIZES, np.float32)[turn] * self.light,
        )


def light_radius(truth: NDArray[np.float64]) -> float:
    """Radius of a lit FLS in cells: a good part of the usual spacing."""
    from scipy.spatial import cKDTree

    few = truth[:: max(1, len(truth) // 2000)]
    distances = np.asarray(cKDTree(truth).query(few, k=min(2, len(truth)))[0])
    spacing = float(np.median(distances[:, -1])) if distances.ndim == 2 else 0.0
    return 0.28 * spacing or 0.5
