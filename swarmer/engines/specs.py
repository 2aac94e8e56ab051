"""What a dispatcher is told of a run, as JSON there and back: plain data, nothing that needs numpy to be read."""

from __future__ import annotations

import os
from itertools import count as counting
from typing import TYPE_CHECKING, Any

from swarmer.faults import from_data as faults_from_data
from swarmer.faults import to_data
from swarmer.fls_process import RunSpec
from swarmer.fls_spec import FlsSpec, NextSpec
from swarmer.plan import as_data, from_data
from swarmer.protocol.records import SHAPE_EPOCHS
from swarmer.radio import Grid
from swarmer.streams import stream
from swarmer.udp_wrapper import Wires

if TYPE_CHECKING:
    from swarmer.plan import Plan
    from swarmer.rules import Rules

NEAR_MAX = 64  # nearest FLSs an FLS can reach by unicast; more go by broadcast


def setup(plan: Plan, run: int, port: int, key: bytes) -> dict[str, Any]:
    """Everything a dispatcher needs, as JSON takes it. run: the id on every datagram. key: of the MAC, or empty."""
    config, radio = plan.config, plan.config.radio
    cpus = sorted(os.sched_getaffinity(0)) if config.process.pin else []
    wires = Wires(
        port,
        radio.carrier,
        radio.unicast_max,
        radio.kernel_filter == "auto",
        radio.receive_buffer_kb * 1024,
    )
    common = {
        "run": run,
        "seed": config.seed,
        "key": key.hex(),
        "rules": as_data(plan.rules),
        "wires": wires._asdict(),
        "steps_per_cell": Grid.for_display(plan.diagonal_cells).steps_per_cell,
        "loop": config.fls_loop,
        "cpus": cpus,
        "faults": to_data(plan.faults),
        "hang_s": config.failure.hang_s,
    }
    return {"run": common, "fls": fls_rows(plan), "replace": config.failure.replace}


def fls_rows(plan: Plan) -> list[list[Any]]:
    """One `FlsSpec` per FLS, FID 1 first; each from the dispatcher that is nearest to its point."""
    import numpy as np

    from swarmer.shapes.neighbours import nearest_table

    near, distances = nearest_table(plan.cloud.points, min(NEAR_MAX, len(plan.cloud) - 1))
    stations = np.array(plan.config.deploy.dispatchers)
    starts = _random_starts(plan) if plan.rules.deploy_random else None
    launched = [0] * len(stations)
    groups, places = standby_groups(plan.cloud.points, plan.config.battery.standby_group)
    after = next_specs(plan, places)
    rows = []
    for row, point in enumerate(plan.cloud.points):
        station = int(np.argmin(((stations - point) ** 2).sum(axis=1)))
        rate = plan.config.deploy.rate_per_s
        spec = FlsSpec(
            fid=row + 1,
            incarnation=0,
            truth=point.tolist(),
            neighbours=plan.neighbours.neighbours[row],
            reach=float(plan.neighbours.reach_cells[row]),
            near=near[row].tolist(),
            distances=distances[row].tolist(),
            origin=stations[station].tolist(),
            launch_at_s=launched[station] / rate if rate else 0.0,
            epoch=0,
            start=None if starts is None else starts[row].tolist(),
            group=int(groups[row]),
            standby=places[groups[row]].tolist() if len(places) else None,
            then=after.get(row + 1),
        )
        launched[station] += 1
        rows.append(list(spec))
    return rows + [
        _joiner(plan, fid, after[fid], stations) for fid in (plan.next.joiners if plan.next else ())
    ]


def standby_groups(points: Any, most: int) -> tuple[Any, Any]:
    """(F,) the group of each point, of at most so many near each other, and (groups, 3) where standbys wait, cells.

    most: 0 for no groups. The points are halved by planes across their longest extent until the parts are small enough.
    """
    import numpy as np

    groups = np.zeros(len(points), np.int64)
    if not most:
        return groups, np.zeros((0, 3))
    left = [np.arange(len(points))]
    places: list[Any] = []
    while left:
        rows = left.pop()
        if len(rows) > most:
            axis = int(np.ptp(points[rows], axis=0).argmax())
            rows = rows[np.argsort(points[rows, axis], kind="stable")]
            half = -(-len(rows) // most) // 2 * most  # whole groups on one side
            left += [rows[half:], rows[:half]]
            continue
        groups[rows] = len(places)
        places.append(points[rows].mean(axis=0))
    return groups, np.array(places)


def next_specs(plan: Plan, before: Any) -> dict[int, NextSpec]:
    """By FID, what each FLS is in the next shape; empty if there is none.

    before: (groups, 3) where the standbys of the first shape wait, cells.
    """
    from swarmer.shapes.neighbours import nearest_table

    shape = plan.next
    if shape is None:
        return {}
    near, distances = nearest_table(shape.cloud.points, min(NEAR_MAX, len(shape.cloud) - 1))
    fids = shape.fids
    specs = {fid: NextSpec(SHAPE_EPOCHS, None) for fid in shape.leavers}
    groups, places = standby_groups(shape.cloud.points, plan.config.battery.standby_group)
    left = _left_groups(before, places)
    for row, fid in enumerate(fids.tolist()):
        neighbours = [int(fids[other - 1]) for other in shape.neighbours.neighbours[row]]
        specs[fid] = NextSpec(
            SHAPE_EPOCHS, tuple(shape.cloud.points[row].tolist()), tuple(neighbours),
            float(shape.neighbours.reach_cells[row]), tuple(fids[near[row] - 1].tolist()),
            tuple(distances[row].tolist()),
            *((left[groups[row]], tuple(places[groups[row]].tolist())) if left else ()),
        )  # fmt: skip
    return specs


def _left_groups(before: Any, places: Any) -> list[int]:
    """What each group of the next shape is called: as that of the first whose standby it gets, or beyond all of them.

    before, places: (groups, 3) where they wait in either shape. The sum of the squared ways is the least possible.
    """
    from swarmer.shapes.assignment import assign

    if not len(places):
        return []
    point_of = assign(before, places).point_of.tolist()
    fresh = counting(len(before))
    return [point_of.index(at) if at in point_of else next(fresh) for at in range(len(places))]


def why_it_left(rules: Rules, fid: int, t_s: float) -> str:
    """Of an FLS that went home, in words."""
    changed = rules.change_s is not None and t_s >= rules.change_s
    return (
        "left: the next shape has no point for it" if changed and fid in rules.leavers else "left to charge"
    )


def _joiner(plan: Plan, fid: int, spec: NextSpec, stations: Any) -> list[Any]:
    """The row of an FLS that waits at its dispatcher until the next shape begins."""
    import numpy as np

    assert plan.next is not None
    assert spec.truth is not None
    station = int(np.argmin(((stations - spec.truth) ** 2).sum(axis=1)))
    return list(
        FlsSpec(
            fid, 0, spec.truth, spec.neighbours, spec.reach, spec.near, spec.distances,
            stations[station].tolist(), plan.next.at_s, spec.epoch, None, spec.group, spec.standby,
        )
    )  # fmt: skip


def _random_starts(plan: Plan) -> Any:
    """(F, 3): anywhere in the display's box, by a stream of its own: a random cloud is drawn by the seed, too."""
    import numpy as np

    low, high = plan.cloud.points.min(axis=0), plan.cloud.points.max(axis=0)
    rng = np.random.default_rng(stream(plan.config.seed, "placement").getrandbits(128))
    return rng.uniform(low, high, size=(len(plan.cloud), 3))


def run_spec(data: dict[str, Any]) -> RunSpec:
    """What `setup` put under `run`."""
    return RunSpec(
        run=data["run"],
        seed=data["seed"],
        key=bytes.fromhex(data["key"]),
        rules=from_data(data["rules"]),
        wires=Wires(**data["wires"]),
        steps_per_cell=data["steps_per_cell"],
        loop=data["loop"],
        cpus=tuple(data["cpus"]),
        faults=faults_from_data(data["faults"], data["rules"]["count"]),
        hang_s=data["hang_s"],
    )


def fls_spec(row: list[Any]) -> FlsSpec:
    """A row of `fls_rows`."""
    spec = FlsSpec._make(map(_frozen, row))
    return spec if spec.then is None else spec._replace(then=NextSpec._make(map(_frozen, spec.then)))


def _frozen(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value
