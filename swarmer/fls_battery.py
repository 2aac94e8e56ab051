"""An FLS with a battery, in every engine: what its flights and its light cost it, and when it must leave (rule 13)."""

from __future__ import annotations

from swarmer.fls import BATTERY, LANDING, LAUNCH, NEVER, BaseFls
from swarmer.messages import NO_SWARM, Vec3
from swarmer.physics.battery import Battery
from swarmer.standbys import handover_s


class ChargedFls(BaseFls):
    """`BaseFls`, and its battery if the settings give it one; without it costs a look at each flight."""

    __slots__ = ("_battery",)

    def begin(self) -> None:
        """Whoever is in the air on its way in has begun to fly before its life here did."""
        flight_s, light_s, reserve, stagger = self.rules.battery
        self._battery: Battery | None = None
        if flight_s > 0 or light_s > 0:
            first = stagger and self.spec.incarnation == 0  # else all of them would leave at once
            used = self.own_stream("battery").uniform(0.0, 1.0 - reserve) if first else 0.0
            self._battery = Battery(flight_s, light_s, reserve, used)
        super().begin()
        if self.spec.waits_at is not None:  # called before there was a process: that is no lateness
            self.wait(LAUNCH, max(self.spec.launch_at_s, self.now()))

    def lasts(self) -> None:
        """From now on its battery lasts for ever."""
        self._battery = None
        self.due[BATTERY] = NEVER

    def _fly_legs(self, legs: tuple[Vec3, ...], now: float) -> None:
        super()._fly_legs(legs, now)
        spec, flight = self.spec, self.flight
        if spec.waits_at is not None and flight.start == spec.waits_at and spec.launch_at_s < now:
            self.flight = flight._replace(begins_s=spec.launch_at_s)  # it was called then
            self.wait(LANDING, spec.launch_at_s + flight.duration_s)
            self.moved()
        if self._battery is not None:
            self._battery.flies(flight.duration_s)
            self._wait_for_low(now)

    def _retune(self) -> None:
        before = self.ears.swarm
        super()._retune()
        if self._battery is not None and before == NO_SWARM != self.ears.swarm:
            self._battery.lights_up(self.now())
            self._wait_for_low(self.now())

    def _wait_for_low(self, now: float) -> None:
        """It leaves when its relief is there: the standby is called when only the reserve is left."""
        assert self._battery is not None
        self.wait(BATTERY, self._battery.low_at(now) + handover_s(self.spec, self.velocity))
