"""The physical side of the rounds engine: where the FLSs are, how they start, how they fly, what their HD is."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swarmer.metrics.hausdorff import HausdorffMeter, sampled_translation
from swarmer.physics.dead_reckoning_arrays import MODELS, lengths
from swarmer.streams import stream

if TYPE_CHECKING:
    from swarmer.plan import Plan

Vectors = NDArray[np.float64]
Rows = NDArray[np.int64]
LOCALIZING, FOLLOWING = 0, 1  # why an FLS flies
HAIR = 1e-9  # cells: nearer than this nobody comes
SAMPLE = 90  # FLSs that the paper's translation is taken from


class World:
    """Ground truth and estimated truth of a display, (F, 3) cells, and every draw that its physics makes.

    Row r is the FLS with the r-th lowest FID, and its point is the point[r]-th of the shape.
    """

    def __init__(self, plan: Plan) -> None:
        config = plan.config
        self.point = self._dealt(plan)
        self.truth: Vectors = plan.cloud.points[self.point]
        self.dim = plan.rules.dim
        self.flown_cells = 0.0  # by all FLSs, deployment included
        self.flown: Vectors = np.zeros((plan.size, 2))  # cells of each FLS: localizing, following
        model = config.rounds.dead_reckoning
        self._reckon = MODELS[plan.rules.dead_reckoning if model == "flight" else model]
        self._epsilon = plan.rules.epsilon
        self._flights = generator(config.seed, "flights")
        self.last_flight: Vectors = np.zeros(len(self.truth))  # cells, of each FLS
        self.position = self._deployed(plan)
        row = np.argsort(self.point)
        self.oracles: Rows = np.sort(row[np.array(plan.rules.oracles, dtype=np.int64) - 1])
        self._correct(max(plan.config.flight_threshold_cells, HAIR), generator(config.seed, "oracles"))

    def _correct(self, near_cells: float, rng: np.random.Generator) -> None:
        """Part of the deployment: oracles know how far they are from their points, and fly until that is little."""
        rows = self.oracles
        while len(rows):
            way = self.truth[rows] - self.position[rows]
            far = lengths(way) >= near_cells
            rows, way = rows[far], way[far]
            self.position[rows] += self._reckon(way, self._epsilon, self.dim, rng)
            self.flown_cells += float(lengths(way).sum())

    def __len__(self) -> int:
        return len(self.truth)

    def _dealt(self, plan: Plan) -> Rows:
        """Who gets which point. FIDs in the order of the shape's points follow its surface, where that order does."""
        if plan.config.rounds.fids == "shape":
            return np.arange(plan.size)
        return generator(plan.config.seed, "fids").permutation(plan.size)

    def by_point(self, values: NDArray[Any]) -> NDArray[Any]:
        """What rows have, in the order of the shape's points."""
        ordered = np.empty_like(values)
        ordered[self.point] = values
        return ordered

    def _deployed(self, plan: Plan) -> Vectors:
        """Where the FLSs begin: flown in from the dispatcher nearest to each point, or anywhere in a box."""
        deploy, box = plan.config.deploy, plan.config.rounds.box_cells
        rng = generator(plan.config.seed, "deployment")
        if deploy.start == "random":
            low, high = self.truth.min(axis=0), self.truth.max(axis=0)
            if box is not None:
                low, high = np.zeros(3), np.full(3, box)
            if self.dim == 2:
                low[2] = high[2] = self.truth[0, 2]
            return rng.uniform(low, high, size=self.truth.shape)
        stations = np.array(deploy.dispatchers)
        start = stations[np.argmin(np.stack([lengths(self.truth - one) for one in stations]), axis=0)]
        if self.dim == 2:
            start[:, 2] = self.truth[:, 2]
        flown = self._reckon(self.truth - start, self._epsilon, self.dim, rng)
        self._count(np.arange(len(self)), flown)
        return start + flown

    def fly(self, rows: Rows, vectors: Vectors, why: Rows | int = LOCALIZING, exact: bool = False) -> None:
        """Different FLSs fly vectors (n, 3), each with an error of its own; `exact`: without. Length 0 flies nothing.

        why: LOCALIZING or FOLLOWING, for all or for each.
        """
        flown = vectors if exact else self._reckon(vectors, self._epsilon, self.dim, self._flights)
        self.position[rows] += flown
        self.flown[rows, why] += self._count(rows, vectors)

    def _count(self, rows: Rows, flown: Vectors) -> NDArray[np.float64]:
        length = lengths(flown)
        self.last_flight[rows] = length
        self.flown_cells += float(length.sum())
        return length


class HdReader:
    """Reads the HD of a world by the translation that the settings name (section 3 of the specification)."""

    def __init__(self, plan: Plan, world: World) -> None:
        config = plan.config
        self._world, self._translation = world, config.rounds.hd_translation
        self._meter = HausdorffMeter(world.truth)
        self._rng = generator(config.seed, "hd")

    def read(self) -> float:
        """HD now, cells. `sampled` draws; from a stream of its own, so that reading changes nothing."""
        position, truth = self._world.position, self._world.truth
        if self._translation == "none":
            return self._meter.absolute(position)
        if self._translation == "centroid":
            return self._meter.hd(position)
        rows = self._rng.choice(len(truth), min(SAMPLE, len(truth)), replace=False)
        return self._meter.absolute(position + sampled_translation(truth[rows] - position[rows]))

    def absolute(self) -> float:
        """HD now without any translation, cells."""
        return self._meter.absolute(self._world.position)


def generator(seed: int, purpose: str) -> np.random.Generator:
    """numpy's generator of one purpose of the engine under a root seed."""
    return np.random.default_rng(stream(seed, f"rounds/{purpose}").getrandbits(128))
