"""Fault schedules as data, for every engine: what goes wrong, when, for how long, and where.

A schedule is read from a YAML or JSON text and written as one (docs/invariants.md shows one). It says nothing of how a
fault is brought about: that is an engine's own. `simpler` gives the schedules with a little less in them, and `shrink`
the simplest that still does what a failing test wants shown.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import yaml

from swarmer.errors import BadInput
from swarmer.yaml_file import parse

WHAT = ("kill", "hang", "slow", "cut")
WAYS = ("both", "in", "out")
WIDE = 1_000_000  # characters: no line of a schedule is broken
_KEYS = ("at", "for", "what", "where", "late", "way")


class Fault(NamedTuple):
    """One thing that goes wrong. Times are emulated seconds.

    kill: dark at once; after `for_s` a replacement is launched. hang: nothing reaches its processes meanwhile, and then
    all of it at once. slow: whatever reaches them is up to `late_s` late. cut: nothing crosses the border of the part
    `where` (both), or nothing gets out of it (out), or in (in).
    """

    at_s: float
    what: str  # one of WHAT
    where: tuple[int, ...]  # FIDs
    for_s: float | None = None  # None: for good
    late_s: float = 0.0  # slow
    way: str = "both"  # cut; one of WAYS

    @property
    def ends_s(self) -> float:
        return math.inf if self.for_s is None else self.at_s + self.for_s


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
            if fid in fault.where and fault.what in ("hang", "slow"):
                late += fault.late_s if fault.what == "slow" else self.length_s(fault)
        return late

    def length_s(self, fault: Fault) -> float:
        """How long a fault lasts."""
        end = fault.ends_s if self.calm_s is None else min(fault.ends_s, self.calm_s)
        return max(0.0, end - fault.at_s)


NO_FAULTS = Schedule()


# -- as text ---------------------------------------------------------------------------------------------------------


def to_yaml(schedule: Schedule) -> str:
    """The schedule as a text that `from_text` reads, one fault a line."""
    lines = [] if schedule.calm_s is None else [f"calm: {schedule.calm_s!r}"]
    lines.append("faults:" if schedule.faults else "faults: []")
    for fault in schedule.faults:
        row = yaml.safe_dump(_fault_data(fault), default_flow_style=True, sort_keys=False, width=WIDE)
        lines.append("- " + row.strip())
    return "\n".join(lines) + "\n"


def _fault_data(fault: Fault) -> dict[str, Any]:
    data: dict[str, Any] = {"at": fault.at_s, "what": fault.what, "where": list(fault.where)}
    if fault.for_s is not None:
        data["for"] = fault.for_s
    if fault.what == "slow":
        data["late"] = fault.late_s
    if fault.what == "cut":
        data["way"] = fault.way
    return data


def from_text(text: str, count: int) -> Schedule:
    """A schedule from YAML, of which JSON is a part. count: F. Raises BadInput."""
    try:
        data = parse(text)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        place = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        raise BadInput.saying(f"faults: {place}{error.problem or 'not YAML'}") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise BadInput.saying(f"faults: not YAML: {(str(error) or 'unreadable').splitlines()[0]}") from None
    return from_data(data, count)


def from_data(data: Any, count: int) -> Schedule:
    """A schedule from what YAML or JSON gave. count: F. Raises BadInput."""
    if not isinstance(data, Mapping) or not set(data) <= {"calm", "faults"}:
        raise BadInput("faults", data, "a mapping with `faults`, a list, and maybe `calm`, seconds")
    calm, rows = data.get("calm"), data.get("faults") or []
    if calm is not None and not _seconds(calm):
        raise BadInput("calm", calm, "emulated seconds, 0 or more")
    if not isinstance(rows, list):
        raise BadInput("faults", rows, "a list of mappings with at, what, where, ...")
    faults = [_fault(f"faults[{number}]", row, count) for number, row in enumerate(rows)]
    return Schedule(
        tuple(sorted(faults, key=lambda fault: fault.at_s)), None if calm is None else float(calm)
    )


def _fault(name: str, row: Any, count: int) -> Fault:
    if not isinstance(row, Mapping) or not set(row) <= set(_KEYS):
        raise BadInput(name, row, f"a mapping with some of {', '.join(_KEYS)}")
    what, where, way = row.get("what"), row.get("where"), row.get("way", "both")
    if what not in WHAT:
        raise BadInput(f"{name}.what", what, f"one of {', '.join(WHAT)}")
    if not _seconds(row.get("at")):
        raise BadInput(f"{name}.at", row.get("at"), "emulated seconds, 0 or more")
    if row.get("for") is not None and not _seconds(row["for"]):
        raise BadInput(f"{name}.for", row["for"], "emulated seconds, 0 or more; left out: for good")
    if not isinstance(where, list) or not where or not all(_fid(fid, count) for fid in where):
        raise BadInput(f"{name}.where", where, f"a list of FIDs, 1 to {count}")
    late = row.get("late", 0.0)
    if not _seconds(late) or (what == "slow") != ("late" in row):
        raise BadInput(f"{name}.late", late, "emulated seconds, 0 or more, with slow and only there")
    if way not in WAYS or ("way" in row and what != "cut"):
        raise BadInput(f"{name}.way", way, f"one of {', '.join(WAYS)}, and only with cut")
    length = None if row.get("for") is None else float(row["for"])
    return Fault(float(row["at"]), what, tuple(sorted(set(where))), length, float(late), way)


def _seconds(value: Any) -> bool:
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return number and 0.0 <= value < math.inf


def _fid(value: Any, count: int) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= count


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
    stop = time.monotonic() + wall_s
    while True:
        for candidate in simpler(schedule):
            if time.monotonic() > stop:
                return schedule
            if fails(candidate):
                schedule = candidate
                break
        else:
            return schedule
