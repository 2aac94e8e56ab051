"""The thaws of a display as an engine sees them: when it must begin one itself, and when one has begun (rule 11)."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from swarmer.messages import Swarm
from swarmer.plan import thaw_h_of
from swarmer.protocol.events import ThawBegins
from swarmer.protocol.records import SHAPE_EPOCHS, shape_of
from swarmer.telemetry import Began

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from swarmer.rules import Rules


class Sight(NamedTuple):
    """What there is to see of FLSs at one moment, one place for each."""

    t_s: float
    lit: NDArray[np.bool_]
    swarm: NDArray[np.int64]  # as `metrics.swarms.swarm_names` has them
    epoch: NDArray[np.int64]
    started: int  # thaws that FLSs began themselves, all together


class Order(NamedTuple):
    """A thaw that the engine must begin."""

    epoch: int
    single: bool  # there is one swarm; else it is overdue

    @property
    def why(self) -> str:
        return "one swarm" if self.single else "overdue"


class ThawTally:
    """How the thaws of a run began, for an engine that knows what was true at that moment."""

    def __init__(self, rules: Rules) -> None:
        self._epochs, self._knows = rules.epochs, rules.thaw_policy not in ("timer", "off")
        self._newest = -1  # the last epoch that a thaw has ended
        self.at_one_swarm = self.by_clock = self.wrong = 0
        self.first_s: float | None = None  # when the first at one swarm began

    def note(self, t_s: float, begins: ThawBegins, single: bool) -> None:
        """An FLS begins a thaw. single: all lit FLSs were one swarm of that epoch. The same thaw counts once."""
        if self._epochs and begins.epoch <= self._newest:
            return
        self._newest = begins.epoch
        self._add(t_s, begins.known, single)

    def ordered(self, t_s: float, order: Order) -> None:
        """The engine begins one, and sees whether there is one swarm."""
        self._add(t_s, order.single, order.single)

    def _add(self, t_s: float, known: bool, single: bool) -> None:
        if single and self.first_s is None:
            self.first_s = t_s
        self.at_one_swarm += single
        self.by_clock += not known
        self.wrong += known and not single

    def counters(self) -> dict[str, float]:
        """By their names in the summary; nobody is wrong where no policy claims to know anything."""
        counts: dict[str, float] = {"thaws_at_one_swarm": self.at_one_swarm, "thaws_by_clock": self.by_clock}
        if self._knows:
            counts["wrong_thaws"] = self.wrong
        return counts


class ThawsInHindsight:
    """How thaws began, by what every FLS has written down of its own (`telemetry.Thawed`), where an engine only looks.

    A thaw is counted once all lit FLSs have obeyed it, and not at all if the next one begins before anybody has looked.
    Without epochs nobody can tell which thaw an FLS has obeyed.
    """

    def __init__(self, rules: Rules, tally: ThawTally) -> None:
        """tally: told of what is seen here; the engine's own thaws it is told of by the engine."""
        self._tally, self._central = tally, rules.thaw_policy == "centralized"
        self._epochs = rules.epochs
        self._newest = 0

    def counters(self) -> dict[str, float]:
        """Those of the tally, if it can know them."""
        return self._tally.counters() if self._epochs or self._central else {}

    def look(self, lit: NDArray[np.bool_], epoch: NDArray[np.int64], thawed: NDArray[np.void]) -> None:
        """A sample: one place for each FLS."""
        if self._central or not self._epochs or not lit.any():
            return
        thawed, epoch = thawed[lit], epoch[lit]
        newest = int(epoch.max())
        if newest <= self._newest or epoch.min() < newest:
            return
        self._newest = newest
        if newest % SHAPE_EPOCHS == 0:  # no thaw, the next shape
            return
        took_part = thawed[thawed["xi"] > 0]  # the others have lit up since
        if not len(took_part):
            return
        first = took_part[took_part["at_s"].argmin()]
        swarm = Swarm(int(first["xi"]), int(first["incarnation"]))
        ended = {"epoch": newest - 1, "xi": swarm.xi, "incarnation": swarm.incarnation}
        one = all(bool((took_part[name] == value).all()) for name, value in ended.items())
        self._tally.note(float(first["at_s"]), ThawBegins(swarm, newest - 1, _knew(took_part)), one)


def _knew(took_part: NDArray[np.void]) -> bool:
    """Did the first of those who began it know of one swarm? Not, if whoever began it is gone."""
    began = took_part[took_part["began"] != Began.ANOTHER]
    return bool(len(began)) and int(began["began"][began["at_s"].argmin()]) == Began.KNOWING


class ThawWatch:
    """Looks at every sample of a run, or oftener; `seen` counts its thaws."""

    def __init__(self, rules: Rules) -> None:
        self.seen = 0
        self._rules = rules
        self.central = rules.thaw_policy == "centralized"  # thaws are the engine's to begin
        self._epoch = 0
        self._last_s = 0.0
        self._shape = self._before = 0  # thaws that were seen in the shapes before the present one

    def stop(self) -> None:
        """Begin none any more."""
        self.central = False

    def order(self, sight: Sight) -> Order | None:
        """Policy `centralized`: at one swarm, or H seconds after the last thaw."""
        if not self.central or not bool(sight.lit.all()):
            return None
        rules = self._rules
        single = bool((sight.swarm == sight.swarm[0]).all())
        since_s = sight.t_s - self._last_s
        overdue = since_s >= thaw_h_of(rules, shape_of(int(sight.epoch.max())))
        # The last thaw must have reached everybody, or the same single swarm would thaw twice.
        settled = int(sight.epoch.min()) >= self._epoch if rules.epochs else since_s > rules.lambda_s
        if not (single and settled) and not overdue:
            return None
        self._last_s = sight.t_s
        if rules.epochs:
            self._epoch = int(sight.epoch.max()) + 1
        self.seen += 1
        return Order(self._epoch, single)

    def begun(self, sight: Sight) -> int | None:
        """The number of the newest thaw that FLSs began, if that is news."""
        if self.central:
            return None
        thaws = self._counted(int(sight.epoch.max())) if self._rules.epochs else sight.started
        if thaws <= self.seen:
            return None
        self.seen = thaws
        return thaws

    def _counted(self, epoch: int) -> int:
        """Thaws of all shapes until an epoch."""
        shape, thaws = divmod(epoch, SHAPE_EPOCHS)
        if shape != self._shape:
            self._shape, self._before = shape, self.seen
        return self._before + thaws
