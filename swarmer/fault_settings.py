"""The fault schedule that the settings mean: what they list, what a file has, and what is drawn from the seed."""

from __future__ import annotations

from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any

from swarmer.errors import BadInput, shown
from swarmer.fault_places import AXES
from swarmer.faults import NO_FAULTS, Schedule, from_data
from swarmer.streams import stream
from swarmer.yaml_file import read_mapping

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from swarmer.config import RunConfig

ROUND = 3  # digits of what is drawn: a schedule is read by people


def with_schedule(config: RunConfig) -> RunConfig:
    """The same settings with all faults in `faults.schedule`: those of the file and those drawn, too.

    So they make the same run again, wherever the file may be. Raises BadInput.
    """
    given = config.faults
    rows, calm = list(given.schedule), given.calm_s
    if given.file is not None:
        more, calm = _read(given.file, calm)
        rows += more
    rng = stream(config.seed, "faults")
    rows += [draw_fault(rng, config.duration_s, config.lambda_ms / 1e3) for _ in range(given.random)]
    faults = given.model_copy(update={"schedule": tuple(rows), "calm_s": calm, "file": None, "random": 0})
    return config.model_copy(update={"faults": faults})


def schedule_of(config: RunConfig, points: NDArray[np.float64]) -> Schedule:
    """The schedule in `config.faults`, with places as FIDs. points: (F, 3), display cells. Raises BadInput."""
    given = config.faults
    if not given.schedule and given.calm_s is None:
        return NO_FAULTS
    data = {"faults": list(given.schedule), "calm": given.calm_s}
    return from_data(data, len(points), points.tolist(), config.seed)


def too_late(schedule: Schedule, duration_s: float) -> list[str]:
    """A line if some faults can never begin: the run has ended by then, or all is well."""
    last_s = duration_s if schedule.calm_s is None else min(duration_s, schedule.calm_s)
    late = [fault.at_s for fault in schedule.faults if fault.at_s >= last_s]
    if not late:
        return []
    why = "the end of the run" if last_s == duration_s else "the calm"
    many = f"{len(late)} of {len(schedule.faults)} faults never"
    return [f"faults: {many} begin: {why} comes at {last_s:g} s, the first of them would at {min(late):g} s"]


def _read(name: str, calm: float | None) -> tuple[list[Any], float | None]:
    """The faults and the calm of a file."""
    found = read_mapping(Path(name))
    if not set(found) <= {"calm", "faults"} or not isinstance(found.get("faults") or [], list):
        raise BadInput.saying(
            f"faults.file: {shown(name, 200)[1:-1]} is no schedule: `faults`, a list, and maybe `calm`, seconds"
        )
    if calm is not None and found.get("calm") is not None:
        raise BadInput.saying("faults.calm_s: is given in faults.file, too; give it once")
    return found.get("faults") or [], calm if found.get("calm") is None else found["calm"]


def draw_fault(rng: Random, duration_s: float, lambda_s: float) -> dict[str, Any]:
    """A fault as a schedule has it, of any kind, at any time within `duration_s`, for up to ten times λ and more."""

    def number(low: float, high: float) -> float:
        return round(rng.uniform(low, high), ROUND)

    what = rng.choice(
        ("kill", "hang", "slow", "cut", "loss", "delay", "duplicate", "reorder", "bias", "outliers")
    )
    half = {"half": rng.choice(("low", "high")), "axis": rng.choice(tuple(AXES))}
    where = rng.choice((half, *({"share": share} for share in (0.02, 0.1, 0.3))))
    row = {"at": number(0.0, duration_s), "for": round(lambda_s * 10 ** rng.uniform(-1.0, 1.3), ROUND)}
    own: dict[str, Any] = {
        "slow": {"late": number(0.01, 0.5)}, "cut": {"way": rng.choice(("both", "both", "in", "out"))},
        "loss": {"p": number(0.1, 1.0), "burst": rng.choice((0, 0, 5, 50))},
        "delay": {"delay": number(0.0, 0.5), "jitter": number(0.0, 0.5)},
        "duplicate": {"p": number(0.0, 0.5)}, "reorder": {"p": number(0.0, 0.5), "delay": number(0.0, 0.5)},
        "bias": {"by": number(-2.0, 2.0)}, "outliers": {"p": number(0.0, 0.3), "by": number(0.0, 5.0)},
    }  # fmt: skip
    return row | {"what": what, "where": where} | own.get(what, {})
