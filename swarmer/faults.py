"""Fault schedules as data, for every engine: what goes wrong, when, for how long, and where (docs/faults.md).

A schedule is read from a YAML or JSON text and written as one. It says nothing of how a fault is brought about: that is
an engine's own. `simpler` gives the schedules with a little less in them, and `shrink` the simplest that still does
what a failing test wants shown.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple, TypeVar

from swarmer.errors import BadInput
from swarmer.fault_places import AXES, Ground, Place, Points, is_axis, is_number, longest_axis, place, slabs
from swarmer.messages import Kind
from swarmer.physics.sensor_faults import SensorFault

ON_THE_AIR = ("cut", "loss", "delay", "duplicate", "reorder")
OF_SENSORS = ("bias", "outliers", "dead_sensor")
WHAT = ("kill", "hang", "slow", *ON_THE_AIR, *OF_SENSORS)
PARTITION = "partition"  # in a text; it becomes cuts
WAYS = ("both", "in", "out")
PARTS_MAX = 64
T = TypeVar("T")
WIDE = 1_000_000  # characters: no line of a schedule is broken

_ALWAYS = ("at", "for", "what", "where")
_AIR = ("way", "kinds", "from")
_NEEDS = {
    "slow": ("late",), "loss": ("p",), "delay": ("delay",), "duplicate": ("p",), "reorder": ("p", "delay"),
    "bias": ("by",), "outliers": ("p", "by"),
}  # fmt: skip
_TAKES = {
    "cut": ("way", "kinds"), "loss": ("burst", *_AIR), "delay": ("jitter", *_AIR), "duplicate": _AIR, "reorder": _AIR,
    PARTITION: ("parts", "axis"),
}  # fmt: skip
SECONDS_MAX = 1e6  # beyond any run; and sums of such seconds are seconds, too
_SECONDS = (0.0, SECONDS_MAX, "emulated seconds, 0 to 1000000")
_NUMBERS = {  # key -> lowest, highest, what is allowed
    "late": _SECONDS, "delay": _SECONDS, "jitter": _SECONDS,
    "p": (0.0, 1.0, "a probability, 0 to 1"),
    "burst": (0.0, 1e6, "datagrams that a burst of losses spans, 0 (none) or 1 and more"),
    "by": (-1e6, 1e6, "cells (bias), or how many times as long (outliers), -1000000 to 1000000"),
}  # fmt: skip


class Fault(NamedTuple):
    """One thing that goes wrong. Times are emulated seconds.

    kill: dark at once; after `for_s` a replacement is launched. hang: nothing reaches its processes meanwhile, and then
    all of it at once. slow: whatever reaches them is up to `late_s` late.

    cut: nothing crosses the border of the part `where` (both), or nothing gets out of it (out), or in (in). loss,
    delay, duplicate, reorder: what happens to the datagrams of the FLSs of `where`, as the radio's settings have it;
    at their receiver (in), their sender (out), or both ends. These five hit what is sent while they last, and only
    `kinds` of datagrams, and only those that come from `source`, if either is given.

    bias: a sensed distance is off by `by` cells. outliers: with probability `p` it is `by` times as long.
    dead_sensor: it is 0.
    """

    at_s: float
    what: str  # one of WHAT
    where: tuple[int, ...]  # FIDs
    for_s: float | None = None  # None: for good
    late_s: float = 0.0  # slow
    way: str = "both"  # on the air; one of WAYS
    p: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0
    burst: float = 0.0
    by: float = 0.0
    kinds: tuple[int, ...] = ()  # of messages; none: all
    source: tuple[int, ...] = ()  # FIDs; none: all
    swarm_of: int = 0  # in place of `where`: whoever is in the swarm of this FLS when the fault begins

    @property
    def ends_s(self) -> float:
        return math.inf if self.for_s is None else self.at_s + self.for_s


class Turn(NamedTuple):
    """A fault begins or ends; or, without one, all is well from now on."""

    at_s: float
    begins: bool
    fault: Fault | None


class Schedule(NamedTuple):
    """Faults, and the moment from which all is well.

    calm_s: then every fault ends that has not, the radio is perfect, whoever is dark is replaced, nobody fails or
    thaws any more: the weather in which one swarm must form. None: never.
    """

    faults: tuple[Fault, ...] = ()
    calm_s: float | None = None

    def late_s(self, fid: int) -> float:
        """The most that the schedule may delay what reaches an FLS."""
        late = 0.0
        for fault in self.faults:
            if fault.what in ("hang", "slow") and (fid in fault.where or fault.swarm_of):
                late += fault.late_s if fault.what == "slow" else self.length_s(fault)
        return late

    def length_s(self, fault: Fault) -> float:
        """How long a fault lasts."""
        end = fault.ends_s if self.calm_s is None else min(fault.ends_s, self.calm_s)
        return max(0.0, end - fault.at_s)

    def turns(self) -> list[Turn]:
        """Every beginning and end, in order; of those at one moment ends come first, but of what lasts no time.

        The calm comes last.
        """
        calm_s = math.inf if self.calm_s is None else self.calm_s
        faults = [fault for fault in self.faults if fault.at_s < calm_s]
        order = [(fault.at_s, 1, number, fault) for number, fault in enumerate(faults)]
        for number, fault in enumerate(faults):
            end_s = min(fault.ends_s, calm_s)
            order.append((end_s, 0 if end_s > fault.at_s else 2, number, fault))
        turns = [Turn(at_s, what == 1, fault) for at_s, what, _, fault in sorted(order, key=_moment)]
        return [turn for turn in (*turns, Turn(calm_s, True, None)) if turn.at_s < math.inf]

    def slows(self, fid: int) -> tuple[tuple[float, float], ...]:
        """From when until when the schedule may keep an FLS from what it has to do."""
        return tuple(
            (fault.at_s, fault.at_s + self.length_s(fault))
            for fault in self.faults
            if fault.what in ("hang", "slow") and (fid in fault.where or fault.swarm_of)
        )

    def of_the_air(self) -> tuple[Fault, ...]:
        return tuple(fault for fault in self.faults if fault.what in ON_THE_AIR)

    def of_sensors(self, fid: int) -> tuple[SensorFault, ...]:
        """Those that the sensor of an FLS has."""
        return tuple(
            SensorFault(fault.what, fault.at_s, fault.at_s + self.length_s(fault), fault.by, fault.p)
            for fault in self.faults
            if fault.what in OF_SENSORS and fid in fault.where
        )


NO_FAULTS = Schedule()


def _moment(turn: tuple[float, int, int, Fault]) -> tuple[float, int, int]:
    return turn[:3]


def words(fault: Fault) -> str:
    """A fault in some words: what it is and whom it strikes."""
    one = f"FLS {fault.where[0]}" if len(fault.where) == 1 else f"{len(fault.where)} FLSs"
    whom = f"the swarm of FLS {fault.swarm_of}" if fault.swarm_of else one
    kinds = f", {' and '.join(Kind(kind).name for kind in fault.kinds)} only" if fault.kinds else ""
    return f"{fault.what}: {whom}{'' if fault.way == 'both' else f', way {fault.way}'}{kinds}"


# -- as text ---------------------------------------------------------------------------------------------------------


def to_yaml(schedule: Schedule) -> str:
    """The schedule as a text that `from_text` reads, one fault a line."""
    import yaml  # only here and below: FLS processes import this file

    lines = [] if schedule.calm_s is None else [f"calm: {schedule.calm_s!r}"]
    lines.append("faults:" if schedule.faults else "faults: []")
    for fault in schedule.faults:
        row = yaml.safe_dump(_fault_data(fault), default_flow_style=True, sort_keys=False, width=WIDE)
        lines.append("- " + row.strip())
    return "\n".join(lines) + "\n"


def to_data(schedule: Schedule) -> dict[str, Any]:
    """The schedule as plain data that `from_data` reads."""
    return {"calm": schedule.calm_s, "faults": [_fault_data(fault) for fault in schedule.faults]}


def _fault_data(fault: Fault) -> dict[str, Any]:
    where: Any = {"swarm_of": fault.swarm_of} if fault.swarm_of else list(fault.where)
    data: dict[str, Any] = {"at": fault.at_s, "what": fault.what, "where": where}
    if fault.for_s is not None:
        data["for"] = fault.for_s
    given = {
        "late": fault.late_s, "way": fault.way, "p": fault.p, "delay": fault.delay_s, "jitter": fault.jitter_s,
        "burst": fault.burst, "by": fault.by, "from": list(fault.source),
        "kinds": [Kind(kind).name for kind in fault.kinds],
    }  # fmt: skip
    taken = (*_NEEDS.get(fault.what, ()), *_TAKES.get(fault.what, ()))
    return data | {key: given[key] for key in taken if given[key] or key in _NEEDS.get(fault.what, ())}


def from_text(text: str, count: int, points: Points | None = None, seed: int = 0) -> Schedule:
    """A schedule from YAML, of which JSON is a part; as `from_data`. Raises BadInput."""
    import yaml

    from swarmer.yaml_file import parse

    try:
        data = parse(text)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        raise BadInput.saying(f"faults: {where}{error.problem or 'not YAML'}") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise BadInput.saying(f"faults: not YAML: {(str(error) or 'unreadable').splitlines()[0]}") from None
    return from_data(data, count, points, seed)


def from_data(data: Any, count: int, points: Points | None = None, seed: int = 0) -> Schedule:
    """A schedule from what YAML or JSON gave. Raises BadInput.

    count: F. points: (F, 3), display cells, for places that are parts of the display. seed: the run's, for draws.
    """
    if not isinstance(data, Mapping) or not set(data) <= {"calm", "faults"}:
        raise BadInput("faults", data, "a mapping with `faults`, a list, and maybe `calm`, seconds")
    calm, rows = data.get("calm"), data.get("faults") or []
    if calm is not None and not _seconds(calm):
        raise BadInput("calm", calm, _SECONDS[2])
    if not isinstance(rows, list):
        raise BadInput("faults", rows, "a list of mappings with at, what, where, ...")
    ground = Ground(count, points, seed)
    faults = [fault for number, row in enumerate(rows) for fault in _faults(f"faults[{number}]", row, ground)]
    return Schedule(
        tuple(sorted(faults, key=lambda fault: fault.at_s)), None if calm is None else float(calm)
    )


def _faults(name: str, row: Any, ground: Ground) -> Iterator[Fault]:
    """What one entry of a list stands for: one fault, or the cuts of a partition."""
    if not isinstance(row, Mapping):
        raise BadInput(name, row, "a mapping with at, what, where, ...")
    what = row.get("what")
    if what not in WHAT and what != PARTITION:
        raise BadInput(f"{name}.what", what, f"one of {', '.join((*WHAT, PARTITION))}{_meant(what)}")
    needs = _NEEDS.get(what, ())
    taken = (*_ALWAYS, *needs, *_TAKES.get(what, ()))
    for key in row:
        if key not in taken:
            raise BadInput(f"{name}.{key}", row[key], f"{what} has only {', '.join(taken)}")
    for key in ("at", *needs, *(() if what == PARTITION else ("where",))):
        if key not in row:
            raise BadInput.saying(f"{name}.{key}: is missing; {what} has {', '.join(taken)}")
    if not _seconds(row.get("at")):
        raise BadInput(f"{name}.at", row.get("at"), _SECONDS[2])
    if row.get("for") is not None and not _seconds(row["for"]):
        raise BadInput(f"{name}.for", row["for"], f"{_SECONDS[2]}; left out: for good")
    numbers = {key: _number(f"{name}.{key}", key, row) for key in _NUMBERS if key in taken}
    fault = Fault(
        float(row["at"]), what, (), None if row.get("for") is None else float(row["for"]),
        late_s=numbers.get("late", 0.0), p=numbers.get("p", 0.0), delay_s=numbers.get("delay", 0.0),
        jitter_s=numbers.get("jitter", 0.0), burst=numbers.get("burst", 0.0), by=numbers.get("by", 0.0),
    )  # fmt: skip
    if what == PARTITION:
        yield from _partition(name, row, fault, ground)
    else:
        yield _placed(name, row, fault, ground)


def _placed(name: str, row: Mapping[str, Any], fault: Fault, ground: Ground) -> Fault:
    """With its place, and whose and what datagrams it hits."""
    purpose = f"{fault.what} {fault.at_s!r}"
    where = place(f"{name}.where", row.get("where"), ground, purpose)
    if where.swarm_of and fault.what not in ("kill", "hang", "slow"):
        raise BadInput(f"{name}.where", row["where"], f"for {fault.what} all but swarm_of")
    way, kinds, source = row.get("way", "both"), row.get("kinds", []), row.get("from")
    if way not in WAYS:
        raise BadInput(f"{name}.way", way, f"one of {', '.join(WAYS)}")
    names = [kind.name for kind in Kind if kind is not Kind.CONTROL]
    if not isinstance(kinds, list) or not all(kind in names for kind in kinds):
        raise BadInput(f"{name}.kinds", kinds, f"a list of some of {', '.join(names)}")
    come = Place(()) if source is None else place(f"{name}.from", source, ground, f"{purpose} from")
    if source is not None and (way != "in" or come.swarm_of):
        raise BadInput(f"{name}.from", source, "FIDs or a part of the display, and only with `way: in`")
    return fault._replace(
        where=where.fids, swarm_of=where.swarm_of, way=way, source=come.fids,
        kinds=tuple(sorted({int(Kind[kind]) for kind in kinds})),
    )  # fmt: skip


def _partition(name: str, row: Mapping[str, Any], fault: Fault, ground: Ground) -> Iterator[Fault]:
    """Parts side by side that do not hear each other: all but the last are cut off."""
    if row.get("where", "all") != "all":
        raise BadInput(f"{name}.where", row["where"], "nothing: a partition is of all; use cut for a part")
    parts, most = row.get("parts", 2), min(PARTS_MAX, ground.count)
    if not isinstance(parts, int) or isinstance(parts, bool) or not 2 <= parts <= most:
        raise BadInput(f"{name}.parts", parts, f"a whole number of parts side by side, 2 to {most}")
    if ground.points is None:
        raise BadInput(f"{name}.what", PARTITION, "cut, where no points are known")
    axis = row.get("axis") or longest_axis(ground.points)
    if not is_axis(axis):
        raise BadInput(f"{name}.axis", axis, f"one of {', '.join(AXES)}; left out: the longest")
    for rows in slabs(ground.points, parts, axis)[:-1]:
        yield fault._replace(what="cut", where=tuple(at + 1 for at in rows))


def _number(name: str, key: str, row: Mapping[str, Any]) -> float:
    low, high, allowed = _NUMBERS[key]
    value = row.get(key, 0.0)
    if not is_number(value) or not low <= value <= high or (key == "burst" and 0 < value < 1):
        raise BadInput(name, value, allowed)
    return float(value)


def _meant(word: Any) -> str:
    import difflib

    close = difflib.get_close_matches(word[:40], (*WHAT, PARTITION), n=1) if isinstance(word, str) else []
    return f"; did you mean {close[0]}?" if close else ""


def _seconds(value: Any) -> bool:
    return is_number(value) and 0.0 <= value <= SECONDS_MAX


# -- smaller ---------------------------------------------------------------------------------------------------------


def simpler(schedule: Schedule) -> Iterator[Schedule]:
    """Schedules with a little less in them, the largest steps first: half the faults, one fault, half of its FLSs."""
    faults = schedule.faults
    half = len(faults) // 2
    if half > 1:
        yield schedule._replace(faults=faults[:half])
        yield schedule._replace(faults=faults[half:])
    for at in range(len(faults)):
        yield schedule._replace(faults=faults[:at] + faults[at + 1 :])
    for at, fault in enumerate(faults):
        middle = len(fault.where) // 2
        for where in (fault.where[:middle], fault.where[middle:]) if middle else ():
            yield schedule._replace(faults=(*faults[:at], fault._replace(where=where), *faults[at + 1 :]))


def shrink(schedule: Schedule, fails: Callable[[Schedule], bool], wall_s: float = 60.0) -> Schedule:
    """The simplest schedule found of which `fails` still is true; `schedule` itself must be one.

    wall_s: after so many seconds what has been found until then is given.
    """
    return smallest(schedule, simpler, fails, wall_s)


def smallest(start: T, smaller: Callable[[T], Iterator[T]], fails: Callable[[T], bool], wall_s: float) -> T:
    """The same for anything: `smaller` gives things with a little less in them."""
    stop = time.monotonic() + wall_s
    while True:
        for candidate in smaller(start):
            if time.monotonic() > stop:
                return start
            if fails(candidate):
                start = candidate
                break
        else:
            return start
