"""Who takes over the light of an FLS that leaves to charge, and when: the drones of each group, in the air and at home.

A display with batteries has no spare drones but its standbys. Where there are none, whoever leaves comes back to its
own light once it has flown home and charged. With standbys a group of points has one more drone than lights: it waits
in the middle of the group, dark. Whoever leaves is relieved by it, flies home, charges, and is the group's next
standby. An engine asks this file at each departure; nothing here has a clock or a seed (SwarMer, rule 13; the standbys
are ours).
"""

from __future__ import annotations

from heapq import heapify, heappop, heappush
from math import dist

from swarmer.fls_spec import FlsSpec
from swarmer.physics.flight import Velocity, duration


def handover_s(spec: FlsSpec, velocity: Velocity) -> float:
    """Seconds that the standby of its group needs to an FLS's point; 0 without a standby."""
    return 0.0 if spec.standby is None else duration(dist(spec.standby, spec.truth), velocity)


class Standbys:
    """All groups of one run."""

    def __init__(self, flss: list[FlsSpec], velocity: Velocity, charge_s: float) -> None:
        """flss: of all FIDs. charge_s: that a drone needs at home."""
        self._velocity, self._charge_s = velocity, charge_s
        # When each drone of a group that is not in a light stands at the group's place, or will.
        self._there: dict[int, list[float]] = {}
        for spec in flss:
            if spec.standby is not None:
                ready_s = duration(dist(spec.origin, spec.standby), velocity)
                self._there.setdefault(spec.group, [ready_s])
        for times in self._there.values():
            heapify(times)

    def relieved(self, spec: FlsSpec, now_s: float) -> FlsSpec:
        """The FLS that lights the point of one that leaves now. It may have begun its flight before."""
        velocity = self._velocity
        home_s = now_s + duration(dist(spec.truth, spec.origin), velocity) + self._charge_s
        after = spec._replace(incarnation=spec.incarnation + 1, launch_at_s=home_s, waits_at=None)
        if spec.standby is None:
            return after
        times = self._there[spec.group]
        heappush(times, home_s + duration(dist(spec.origin, spec.standby), velocity))
        ready_s = max(heappop(times), now_s - handover_s(spec, velocity))
        return after._replace(launch_at_s=ready_s, waits_at=spec.standby)
