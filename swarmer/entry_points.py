"""What installed packages add to swarmer: named things, each under an entry point of its kind's group."""

from __future__ import annotations

import sys
from functools import cache
from typing import NamedTuple

TECHNIQUES = "swarmer.localizers"
SENSOR_ERRORS = "swarmer.sensor_errors"
THAW_POLICIES = "swarmer.thaw_policies"

OURS = {
    SENSOR_ERRORS: ("none", "uniform", "mixed"),
    THAW_POLICIES: ("roster", "timer", "census", "corner", "centralized", "off"),
}
"""Names that need no look at what is installed."""


class Plugin(NamedTuple):
    """One thing that a package adds."""

    name: str
    place: str  # "module:attribute"
    package: str  # its name and version
    rival: str = ""  # another package that has something of the same name

    @property
    def outside(self) -> bool:
        """True if it is not swarmer's own."""
        return not self.place.startswith("swarmer.")


def installed(group: str) -> dict[str, Plugin]:
    """Everything that is installed under a group, by name."""
    return _installed(group, tuple(sys.path))


@cache
def _installed(group: str, path: tuple[str, ...]) -> dict[str, Plugin]:
    # path: where the packages are looked for; another path, another answer.
    from importlib.metadata import entry_points  # only here: it costs a command 20 ms, and an FLS 1 MB

    found: dict[str, Plugin] = {}
    for entry in entry_points(group=group):
        package = f"{entry.dist.name} {entry.dist.version}" if entry.dist else "an unknown package"
        one = Plugin(entry.name, entry.value, package)
        other = found.setdefault(entry.name, one)
        if other.place != one.place:
            found[entry.name] = other._replace(rival=package)
    return found


def at(group: str, place: str) -> Plugin:
    """The plugin whose code is at a place; where none is installed so, one that is called by its place."""
    return next(
        (plugin for plugin in installed(group).values() if plugin.place == place), Plugin(place, place, "?")
    )
