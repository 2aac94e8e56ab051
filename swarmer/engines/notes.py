"""What a user should know of the settings before a run: those that change nothing in it, faults that never begin."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

from swarmer.engines.rounds_idle import idle_settings
from swarmer.fault_settings import too_late

if TYPE_CHECKING:
    from swarmer.config import RunConfig
    from swarmer.faults import Schedule
    from swarmer.rules import Rules

OF_RAY = ("cluster.address", "cluster.nodes")
OF_COMMANDS = ("cluster.launch", "cluster.python")


def notes_on(config: RunConfig, rules: Rules, faults: Schedule, changed: Collection[str]) -> list[str]:
    """Lines without the word `note`.

    rules, faults: of the plan. changed: the settings that somebody asked for, by name; those of a preset are none.
    """
    return [
        *config.ignored(changed),
        *idle_settings(config, rules, changed),
        *_idle_ways_to_hosts(config, changed),
        *too_late(faults, config.duration_s),
    ]


def _idle_ways_to_hosts(config: RunConfig, changed: Collection[str]) -> list[str]:
    """Hosts are named, or given by Ray; what belongs to the other way changes nothing."""
    if config.engine != "cluster":
        return []
    named = config.cluster.hosts is not None
    idle = [name for name in (OF_RAY if named else OF_COMMANDS) if name in changed]
    why = "with cluster.hosts, which names the hosts" if named else "without cluster.hosts"
    return [f"{', '.join(idle)}: no effect {why}"] if idle else []
