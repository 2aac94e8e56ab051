"""What must hold after every event of a soak world."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from swarmer.state_machine import State

if TYPE_CHECKING:
    from world import World

Check = Callable[[int, Any, Any], None]


class Broken(AssertionError):
    """Something that must hold did not."""


def make_checks(world: World) -> Check:
    """One function for `world.tap`. It raises Broken, naming FLS and rule."""
    seen: dict[int, tuple[Any, ...]] = {}

    def check(fid: int, event: Any, actions: Any) -> None:
        machine = world.bodies[fid].machine
        look = (machine.incarnation, machine.epoch, machine.swarm)
        for rule in RULES:
            wrong = rule(machine, seen.get(fid), look, world)
            if wrong:
                raise Broken(f"FLS {fid} at {world.now:.4f} s: {wrong}")
        seen[fid] = look

    return check


def lease_and_anchor(m: Any, before: Any, look: Any, world: World) -> str | None:
    """S7: Busy Anchor if and only if there is a lease."""
    if (m.state is State.BUSY_ANCHOR) != (len(m.leases) > 0):
        return f"{m.state.name} with {len(m.leases)} leases (S7)"
    return None


def epochs_rise(m: Any, before: Any, look: Any, world: World) -> str | None:
    """S11: an FLS never goes back to an earlier epoch."""
    if before and before[0] == look[0] and look[1] < before[1]:
        return f"epoch {before[1]} -> {look[1]} (S11)"
    return None


def swarm_ids_fall(m: Any, before: Any, look: Any, world: World) -> str | None:
    """S16: between two thaws ξ never rises, where the lowest anchors and nobody joins."""
    rules = world.rules
    if rules.anchor != "lowest" or rules.busy_join != "off" or not rules.epochs or not before:
        return None
    if before[:2] == look[:2] and look[2] > before[2]:
        return f"ξ {before[2]} -> {look[2]} within an epoch (S16)"
    return None


def limited(m: Any, before: Any, look: Any, world: World) -> str | None:
    """S3: at most M-1 leases, joins aside; S16: tables are bounded, positions finite."""
    if m.settings.busy_join == "off" and len(m.leases) > m.settings.m - 1:
        return f"{len(m.leases)} leases, M is {m.settings.m} (S3)"
    if len(m.holders) > world.rules.count or len(m.leases) > world.rules.count:
        return "a table outgrew F (S16)"
    if not all(map(math.isfinite, world.bodies[m.fid].flight.displacement)):
        return "a flight is not finite (S16)"
    return None


RULES = (lease_and_anchor, epochs_rise, swarm_ids_fall, limited)
