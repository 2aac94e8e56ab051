"""The thaws of a display as an engine sees them: when it must begin one itself, and when one has begun (rule 11)."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from swarmer.plan import Rules


class Sight(NamedTuple):
    """What there is to see of FLSs at one moment, one place for each."""

    t_s: float
    lit: NDArray[np.bool_]
    swarm: NDArray[np.int32]
    epoch: NDArray[np.int64]
    started: int  # thaws that FLSs began themselves, all together


class Order(NamedTuple):
    """A thaw that the engine must begin."""

    epoch: int
    why: str


class ThawWatch:
    """Looks at every sample of a run; `seen` counts its thaws."""

    def __init__(self, rules: Rules) -> None:
        self.seen = 0
        self._rules = rules
        self._central = rules.thaw_policy == "centralized"
        self._epoch = 0
        self._last_s = 0.0

    def order(self, sight: Sight) -> Order | None:
        """Policy `centralized`: at one swarm, or H seconds after the last thaw."""
        if not self._central or not bool(sight.lit.all()):
            return None
        rules = self._rules
        single = bool((sight.swarm == sight.swarm[0]).all())
        overdue = sight.t_s - self._last_s >= rules.thaw_h_s
        # The last thaw must have reached everybody, or the same single swarm would thaw twice.
        settled = not rules.epochs or int(sight.epoch.min()) >= self._epoch
        if not (single and settled and sight.t_s - self._last_s > rules.lambda_s) and not overdue:
            return None
        self._last_s = sight.t_s
        if rules.epochs:
            self._epoch = int(sight.epoch.max()) + 1
        self.seen += 1
        return Order(self._epoch, "one swarm" if single else "overdue")

    def begun(self, sight: Sight) -> int | None:
        """The number of the newest thaw that FLSs began, if that is news."""
        if self._central:
            return None
        thaws = int(sight.epoch.max()) if self._rules.epochs else sight.started
        if thaws <= self.seen:
            return None
        self.seen = thaws
        return thaws
