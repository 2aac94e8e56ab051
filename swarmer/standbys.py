"""Who takes over the light of an FLS that leaves to charge, and when: the drones of each group, in the air and at home.

A display with batteries has no spare drones but its standbys. Where there are none, whoever leaves comes back to its
own light once it has flown home and charged. With standbys a group of points has one more drone than lights: it waits
in the middle of the group, dark. Whoever leaves is relieved by it, flies home, charges, and is the group's next
standby. When the next shape begins there are other groups; the standbys fly to the middles of those. An engine asks
this file at each departure; nothing here has a clock or a seed (SwarMer, rule 13; the standbys are ours).
"""

from __future__ import annotations

from math import dist
from typing import NamedTuple

from swarmer.fls_spec import FlsSpec
from swarmer.messages import Vec3
from swarmer.physics.flight import Velocity, duration
from swarmer.protocol.records import shape_of


def handover_s(spec: FlsSpec, velocity: Velocity) -> float:
    """Seconds that the standby of its group needs to an FLS's point; 0 without a standby."""
    return 0.0 if spec.standby is None else duration(dist(spec.standby, spec.truth), velocity)


class Drone(NamedTuple):
    """The one of a group that has no light."""

    ready_s: float  # when it stands in the group's middle, or will
    launch_at_s: float
    origin: Vec3


class Place(NamedTuple):
    """Of a group."""

    middle: Vec3
    origin: Vec3  # where its first drone comes from, if that has not been another group's before


class Standbys:
    """All groups of one run."""

    def __init__(
        self, flss: list[FlsSpec], velocity: Velocity, charge_s: float, change_s: float | None = None
    ) -> None:
        """flss: of all FIDs. charge_s: that a drone needs at home. change_s: when the next shape begins, if ever."""
        self._velocity, self._charge_s, self._change_s = velocity, charge_s, change_s
        self._places = _places([spec for spec in flss if not shape_of(spec.epoch)])
        self._next_places = _places([spec.changed() for spec in flss if not spec.leaves])
        self._drones = {group: self._comes(0.0, place) for group, place in self._places.items()}

    def relieved(self, after: FlsSpec, now_s: float) -> FlsSpec:
        """The FLS that lights the point of one that leaves now; it may have begun its flight before.

        after: who would replace that one had it failed.
        """
        velocity = self._velocity
        if self._change_s is not None and now_s >= self._change_s:
            self._regroup(self._change_s)
        home_s = now_s + duration(dist(after.truth, after.origin), velocity) + self._charge_s
        if after.standby is None:
            return after._replace(launch_at_s=home_s)
        comes = self._comes(home_s, Place(after.standby, after.origin))
        first, self._drones[after.group] = sorted((self._drones[after.group], comes))
        ready_s = max(first.ready_s, now_s - handover_s(after, velocity))
        return after._replace(launch_at_s=ready_s, waits_at=after.standby)

    def _comes(self, launch_at_s: float, place: Place) -> Drone:
        way_s = duration(dist(place.origin, place.middle), self._velocity)
        return Drone(launch_at_s + way_s, launch_at_s, place.origin)

    def _regroup(self, change_s: float) -> None:
        """The groups are those of the next shape: of one that is called as one before, the standby is that one's."""
        self._change_s = None
        before, self._places = self._places, self._next_places
        drones, self._drones = self._drones, {}
        for group, place in self._places.items():
            drone = drones.get(group)
            if drone is None:
                self._drones[group] = self._comes(change_s, place)
            elif drone.launch_at_s >= change_s:  # still at home
                self._drones[group] = self._comes(drone.launch_at_s, place._replace(origin=drone.origin))
            else:  # it flies on from where it waits, or from where it is expected
                way_s = duration(dist(before[group].middle, place.middle), self._velocity)
                self._drones[group] = drone._replace(ready_s=max(drone.ready_s, change_s) + way_s)


def _places(flss: list[FlsSpec]) -> dict[int, Place]:
    """By group; empty without standbys."""
    places: dict[int, Place] = {}
    for spec in flss:
        if spec.standby is not None:
            places.setdefault(spec.group, Place(spec.standby, spec.origin))
    return places
