"""Which settings of a run in rounds another one makes idle: they are heeded in rounds, but not in these."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

from swarmer.plan import make_technique
from swarmer.plugins import references_of

if TYPE_CHECKING:
    from swarmer.config import RunConfig
    from swarmer.rules import Rules

OF_SWARMS = (
    "m", "neighbours", "rounds.neighbours", "rounds.anchor", "rounds.order", "rounds.pairing", "rounds.pm_first_leg",
    "rounds.threshold_cells", "rounds.max_thaws", "rounds.stop",
)  # fmt: skip
OF_YARDSTICKS = (
    "rounds.yardstick_order", "rounds.yardstick_radius", "rounds.yardstick_confidence",
    "rounds.yardstick_flight_error",
)  # fmt: skip


def idle_settings(config: RunConfig, rules: Rules, changed: Collection[str]) -> list[str]:
    """Lines for those of the changed settings, by name, that change nothing in this run; none with another engine."""
    if config.engine != "rounds":
        return []
    return [
        f"{', '.join(idle)}: no effect with {why}"
        for names, why in _idle(config, rules)
        if (idle := [name for name in names if name in changed])
    ]


def _idle(config: RunConfig, rules: Rules) -> list[tuple[tuple[str, ...], str]]:
    """Settings, and why they are idle."""
    settings, technique = config.rounds, make_technique(rules.technique)
    references = references_of(technique, rules.dim)
    found: list[tuple[tuple[str, ...], str]] = []
    if references != 1:
        found.append((OF_SWARMS, f"technique {config.technique}, which has no swarms"))
    else:
        if settings.neighbours == "estimated":
            found.append((("neighbours",), "rounds.neighbours: estimated"))
        alone = ("rounds.pairing", "m: inf") if config.m == "inf" else ("rounds.order", "m: 2")
        found.append(((alone[0],), alone[1]))
        if not hasattr(technique, "legs"):
            found.append((("rounds.pm_first_leg",), f"technique {config.technique}, which flies one way"))
    if references < 2:
        found.append((OF_YARDSTICKS, f"technique {config.technique}, which is none of the yardsticks"))
    if config.deploy.start != "random":
        found.append((("rounds.box_cells",), f"deploy.start: {config.deploy.start}"))
    return found
