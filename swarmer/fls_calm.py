"""The calm of a fault schedule, at one FLS, in every engine: from here on nothing goes wrong with it."""

from __future__ import annotations

from swarmer.fls import FAILURE, NEVER
from swarmer.fls_battery import ChargedFls
from swarmer.protocol.events import Timer
from swarmer.protocol.thaw import Never


def calm_down(fls: ChargedFls) -> None:
    """It fails no more, leaves no more, and thaws nobody. Its radio and its sensor know by themselves."""
    machine = fls.machine
    machine.thaw_policy = Never()
    if machine.then is not None:
        machine.then = machine.then._replace(thaw_policy=Never())
    fls.lasts()
    for what in (int(Timer.THAW), int(Timer.REPORT), FAILURE):
        fls.due[what] = NEVER
