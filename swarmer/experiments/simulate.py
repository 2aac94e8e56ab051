"""Worlds that fail: found, made as small as they can be, kept in a file, and read from it.

A file is a world as YAML: its settings, its faults, and what went wrong when it was written. `judge` is what a worker
of `swarmer simulate` does with a seed.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from swarmer.errors import BadInput, shown
from swarmer.experiments.world_watch import TOO_LONG, processor_time
from swarmer.experiments.worlds import Outcome, World, draw, play
from swarmer.faults import Fault, from_data, simpler, smallest, to_data
from swarmer.observe.files import write_text
from swarmer.yaml_file import read_mapping

SHRINK_S = 60.0  # wall seconds, at most, to make a failing world small
WORLD_S = 120.0  # seconds of processor time, at most, that a world takes
POINTS_MIN = 2
PARTS = ("seed", "settings", "calm", "faults", "failure")
EXTRAS = (  # what a world can go without, group by group
    "radio.", "failure.", "transition.", "oracle.", "battery.", "sensing.", "virtual.handling_ms", "accept_gap_ms",
    "waiting_bound_ms", "lease_margin_ms", "epsilon_deg", "thaw.repeat", "thaw.rest_below_cells", "deploy.", "range.",
    "flight", "eta", "technique", "challenge_", "anchor", "m", "virtual.latency",
)  # fmt: skip


class Task(NamedTuple):
    """A seed to play, with the settings that every world has."""

    seed: int
    given: dict[str, Any]
    shrink_s: float = SHRINK_S
    known: frozenset[str] = (
        frozenset()
    )  # what has failed so often before that a smaller world tells nothing new
    world_s: float = WORLD_S


class Finding(NamedTuple):
    """How the world of a seed went."""

    seed: int
    outcome: Outcome
    words: str = ""  # about the world
    small: str = ""  # about the smallest that fails likewise
    file: Path | None = None  # where that one is kept
    refused: str = ""  # the settings do not go together: there is no such world


def judge(task: Task, out: Path) -> Finding:
    """Play the world of a seed; one that fails is made small and kept in the directory `out`."""
    world = draw(task.seed, task.given)
    try:
        with processor_time(task.world_s):
            outcome = play(world)
    except BadInput as error:
        return Finding(task.seed, Outcome(), world.words(), refused=str(error))
    if outcome.failure is None or outcome.invariant in task.known:
        return Finding(task.seed, outcome, world.words())
    if TOO_LONG in outcome.failure:  # to make it small would take as long again, many times
        return Finding(task.seed, outcome, world.words())
    small = shrink_world(world, outcome, frozenset(task.given), task.shrink_s)
    path = out / f"seed-{task.seed}.yaml"
    write_world(path, small, outcome if small is world else play(small))
    return Finding(task.seed, outcome, world.words(), small.words(), path)


# -- smaller ---------------------------------------------------------------------------------------------------------


def shrink_world(world: World, outcome: Outcome, keep: frozenset[str], wall_s: float = SHRINK_S) -> World:
    """The smallest world found that breaks the same invariant. keep: settings that stay as they are."""

    def fails(candidate: World) -> bool:
        try:
            again = play(candidate)
        except BadInput:  # what was taken away was needed
            return False
        return again.failure is not None and again.invariant == outcome.invariant

    return smallest(world, lambda one: smaller(one, keep), fails, wall_s)


def smaller(world: World, keep: frozenset[str]) -> Iterator[World]:
    """Worlds with a little less in them: fewer FLSs first, then fewer faults, then plainer settings."""
    count = world.settings["points"]
    if "points" not in keep:
        for fewer in sorted({max(POINTS_MIN, count // 2), max(POINTS_MIN, 3 * count // 4), count - 1}):
            if POINTS_MIN <= fewer < count:
                yield with_points(world, fewer)
    for schedule in simpler(world.schedule):
        yield world._replace(schedule=schedule)
    for start in EXTRAS:
        left = {
            name: value
            for name, value in world.settings.items()
            if name in keep or not name.startswith(start)
        }
        if len(left) < len(world.settings):
            yield world._replace(settings=left)


def with_points(world: World, count: int) -> World:
    """The same world with the first `count` FLSs of it; faults of others are gone."""
    settings = world.settings | {"points": count}
    if settings.get("oracle.count", 0) > count:
        settings["oracle.count"] = count
    smallest_shape = min(count, settings.get("transition.points", count))
    if settings.get("eta", 1) >= smallest_shape:
        settings["eta"] = smallest_shape - 1
    faults = (_within(fault, count) for fault in world.schedule.faults)
    left = tuple(fault for fault in faults if fault is not None)
    return world._replace(settings=settings, schedule=world.schedule._replace(faults=left))


def _within(fault: Fault, count: int) -> Fault | None:
    """The fault as far as it is one of the first `count` FLSs."""
    where = tuple(fid for fid in fault.where if fid <= count)
    source = tuple(fid for fid in fault.source if fid <= count)
    if fault.swarm_of > count or not (where or fault.swarm_of) or (fault.source and not source):
        return None
    return fault._replace(where=where, source=source)


# -- in a file -------------------------------------------------------------------------------------------------------


def write_world(path: Path, world: World, outcome: Outcome) -> None:
    """Keep a world, with what went wrong in it. Raises RunFailed."""
    import yaml

    head = {"seed": world.seed, "failure": outcome.failure or "", "settings": world.settings}
    write_text(
        path,
        f"# replay: {command_of(path)}\n"
        + yaml.safe_dump(head | to_data(world.schedule), sort_keys=False, allow_unicode=True, width=120),
    )


def read_world(path: Path) -> World:
    """The world of such a file. Raises BadInput."""
    found = read_mapping(path)
    where = shown(str(path), 200)[1:-1]
    if unknown := sorted(set(found) - set(PARTS)):
        raise BadInput.saying(f"{where}: {shown(unknown[0])} is not known; it has {', '.join(PARTS)}")
    settings, seed = found.get("settings"), found.get("seed")
    if not isinstance(settings, dict) or not isinstance(seed, int) or isinstance(seed, bool):
        raise BadInput.saying(
            f"{where}: is no world of `swarmer simulate`: seed, a number, and settings, a mapping"
        )
    points = settings.get("points")
    if not isinstance(points, int) or isinstance(points, bool) or points < POINTS_MIN:
        raise BadInput.saying(
            f"{where}: settings.points: {shown(points)} is not allowed; {POINTS_MIN} or more"
        )
    schedule = from_data({name: found[name] for name in ("calm", "faults") if name in found}, points)
    return World(seed, settings, schedule)


def command_of(path: Path) -> str:
    """The command that plays a file's world."""
    return f"swarmer simulate {shlex.quote(str(path))}"
