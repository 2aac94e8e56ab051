"""Names become things: a shape becomes points and planned neighbours, names of policies and techniques become objects.

`make_plan` turns the settings into a `Plan`, once, before anything starts; unknown names are refused here. A plan holds
`Rules`, plain data that travels to wherever an FLS runs; there `make_machine` builds the state machine from them.
Importing this file costs no numpy: FLS processes do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from importlib import import_module
from random import Random
from typing import TYPE_CHECKING, Any

from swarmer.entry_points import installed
from swarmer.errors import BadInput
from swarmer.faults import NO_FAULTS, Schedule
from swarmer.fls_spec import NextSpec
from swarmer.next_shape import NextShape, Standing, corners, oracles, plan_next, standings_of
from swarmer.physics.flight import Velocity
from swarmer.physics.sensing import MODELS as SENSOR_MODELS
from swarmer.physics.sensing import Sensor, SensorErrorModel
from swarmer.plugins import ENTRY_POINTS, Localizer, references_of
from swarmer.protocol.anchor_selection import STRATEGIES
from swarmer.protocol.census import Census
from swarmer.protocol.challenge_policy import Always, ChallengePolicy, Decay, RComplete
from swarmer.protocol.corner import Corner
from swarmer.protocol.records import Counters, NextPoint, shape_of
from swarmer.protocol.roster import Roster
from swarmer.protocol.thaw import Never, ThawPolicy, Timer
from swarmer.rules import Rules, make_rules
from swarmer.state_machine import Identity, MachineSettings, StateMachine

if TYPE_CHECKING:
    from swarmer.config import RunConfig
    from swarmer.shapes.cloud import PointCloud
    from swarmer.shapes.neighbours import NeighbourPlan


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Everything a run stands on. Row i of the cloud is the ground truth of FID i + 1."""

    config: RunConfig
    cloud: PointCloud
    neighbours: NeighbourPlan
    rules: Rules
    diagonal_cells: float  # of the display
    faults: Schedule = NO_FAULTS
    next: NextShape | None = None

    @property
    def size(self) -> int:
        """F, the number of FLSs; with a next shape those of the larger one."""
        return len(self.cloud) + (0 if self.next is None else len(self.next.joiners))

    def standings(self) -> tuple[Standing, ...]:
        """The truth of the first shape, and of the next if there is one."""
        return standings_of(self.cloud, self.next)


def make_plan(config: RunConfig) -> Plan:
    """Plan a run. Raises BadInput for a shape, a technique or an η that cannot be.

    In the plan's settings a shape's path is absolute, and the faults of a file are listed: so they make the same run
    from every directory.
    """
    from swarmer.fault_settings import schedule_of, with_schedule
    from swarmer.shapes.catalogue import load_shape, place_of
    from swarmer.shapes.neighbours import neighbour_plan

    technique = find_technique(config.technique)
    cloud = load_shape(config.shape, config.points, config.duplicates, config.seed)
    config = with_schedule(config.model_copy(update={"shape": place_of(config.shape)}))
    cloud, dim = dimensioned(config, cloud)
    check_references(config, technique, len(cloud), dim)
    neighbours = neighbour_plan(cloud.points, config.eta, config.neighbours)
    diagonal = math.dist((0.0, 0.0, 0.0), cloud.box_cells)
    rules = make_rules(config, len(cloud), dim, diagonal, technique)
    try_plugins(rules, config.engine == "rounds")
    if config.thaw.policy == "corner":
        rules = rules._replace(thaw_corners=corners(cloud))
    if config.oracle.count:
        rules = rules._replace(oracles=oracles(cloud, config.oracle.count))
    plan = Plan(config, cloud, neighbours, rules, diagonal, schedule_of(config, cloud.points))
    return plan if config.transition.shape is None else _with_next_shape(plan)


def _with_next_shape(plan: Plan) -> Plan:
    """The plan with the shape that its settings say comes after. Raises BadInput."""
    config, shape = plan.config, plan_next(plan.config, plan.cloud)
    rules = plan.rules._replace(
        count=len(plan.cloud) + len(shape.joiners),
        dim=shape.dim,
        range_max=shape.diagonal_cells if config.range.max_cells is None else config.range.max_cells,
        change_s=shape.at_s,
        counts=(len(plan.cloud), len(shape.cloud)),
        next_thaw_h_s=config.thaw_h_s(len(shape.cloud)),
        next_corners=shape.corners if config.thaw.policy == "corner" else (),
        leavers=shape.leavers,
    )
    transition = config.transition.model_copy(update={"shape": shape.place})
    config = config.model_copy(update={"transition": transition})
    return replace(plan, config=config, rules=rules, diagonal_cells=shape.diagonal_cells, next=shape)


def dimensioned(config: RunConfig, cloud: PointCloud) -> tuple[PointCloud, int]:
    """The cloud and the number of its dimensions as `rounds.dim` has them. Raises BadInput."""
    asked = config.rounds.dim if config.engine == "rounds" else "auto"
    if asked == "auto":
        return cloud, cloud.dim
    if asked == "flatten":
        from swarmer.shapes.cloud import flattened

        return flattened(cloud, config.duplicates), 2
    if asked < cloud.dim:
        raise BadInput(
            "rounds.dim",
            asked,
            f"{cloud.name} is {cloud.box_cells[2]:g} cells deep; auto, 3, or flatten to drop it",
        )
    return cloud, asked


def check_references(config: RunConfig, technique: str, count: int, dim: int) -> None:
    """Raises BadInput for a technique of several references in an engine, or a display, that has no use for it."""
    from swarmer.plugins.guard import refusing

    with refusing():
        needed = references_of(make_technique(technique), dim)
    if config.engine == "rounds" and config.oracle.count and needed != 1:
        raise BadInput(
            "oracle.count", config.oracle.count, f"0, for technique {config.technique} has no swarms"
        )
    if needed < 2:
        return
    if config.engine != "rounds":
        raise BadInput(
            "technique",
            config.technique,
            f"it needs {needed} references at a time; only --engine rounds has them",
        )
    if count <= needed:
        raise BadInput(
            "technique", config.technique, f"too few points: it needs {needed + 1} or more, {count} are there"
        )


def find_technique(name: str) -> str:
    """Where the technique's class is, as "module:class". Raises BadInput with the nearest name."""
    from difflib import get_close_matches  # only here: FLS processes import this file

    known = installed(ENTRY_POINTS)
    if name in known:
        if rival := known[name].rival:
            both = " and ".join(sorted((known[name].package, rival)))
            raise BadInput("technique", name, f"one that a single package has; {both} call one of theirs so")
        return known[name].place
    near = get_close_matches(name, known, 1)
    hint = f"did you mean {near[0]!r}?" if near else "installed are"
    raise BadInput("technique", name, f"{hint} {', '.join(sorted(known)) or 'none: is swarmer installed?'}")


def try_plugins(rules: Rules, in_rounds: bool) -> None:
    """Ask the plugins of other packages for something before a run begins. Raises BadInput."""
    technique, sensing, thaws = outside_places(rules)
    if technique or sensing or thaws:
        from swarmer.plugins import guard

        if technique:
            guard.try_localizer(technique, rules.dim, in_rounds)
        if sensing:
            guard.try_sensor_error(sensing, rules.sensing_error, rules.sensing_accurate)
        if thaws:
            guard.try_policy(thaws, rules.count, rules.thaw_h_s, rules.thaw_spread, rules.epochs)


def outside_places(rules: Rules) -> tuple[str, str, str]:
    """Technique, error of sensors and thaw policy, where they are of another package; else nothing."""
    technique = "" if rules.technique.startswith("swarmer.") else rules.technique
    others = (name if ":" in name else "" for name in (rules.sensing_model, rules.thaw_policy))
    return (technique, *others)  # type: ignore[return-value]


def make_machine(
    rules: Rules,
    identity: Identity,
    neighbours: tuple[int, ...],
    reach: float,
    rng: Random,
    counts: Counters | None = None,
    epoch: int = 0,
    then: NextSpec | None = None,
) -> StateMachine:
    """The state machine of one FLS. reach: cells to its farthest planned neighbour. then: what it is to be after."""
    settings = MachineSettings(
        lambda_s=rules.lambda_s,
        lease_s=rules.lease_s,
        lease_margin_s=rules.lease_margin_s,
        m=math.inf if rules.m is None else rules.m,
        waiting_bound_s=1e9 if rules.waiting_ends_at_tick else rules.waiting_bound_s,
        waiting_ends_at_tick=rules.waiting_ends_at_tick,
        flight_threshold=rules.flight_threshold,
        range_start=range_start(rules, reach),
        range_step=rules.range_step,
        range_max=rules.range_max * (1 + 1e-9),
        challenge_on_available=rules.challenge_on_available,
        accept_gap_s=rules.accept_gap_s,
        neighbour_reply=rules.neighbour_reply,
        busy_join=rules.busy_join,
        epochs=rules.epochs,
        thaw_repeat=rules.thaw_repeat,
        anchors=STRATEGIES[rules.anchor],
        localizer=make_localizer(rules.technique),
    )
    challenges = make_challenge_policy(rules, identity.fid)
    thaws = make_thaw_policy(rules, identity.fid, shape_of(epoch))
    oracle = identity.fid in rules.oracles
    if then is None:
        return StateMachine(
            identity, neighbours, settings, challenges, thaws, rng, counts, epoch, oracle=oracle
        )
    point = NextPoint(
        then.epoch, then.truth, then.neighbours, range_start(rules, then.reach),
        make_thaw_policy(rules, identity.fid, shape_of(then.epoch)),
    )  # fmt: skip
    return StateMachine(identity, neighbours, settings, challenges, thaws, rng, counts, epoch, point, oracle)


def make_challenge_policy(rules: Rules, fid: int) -> ChallengePolicy:
    """When one FLS challenges."""
    if rules.challenge_policy == "decay":
        return Decay(rules.challenge_decay)
    if rules.challenge_policy == "always":
        return Always()
    return RComplete(rules.probe_every, fid)


def range_start(rules: Rules, reach: float) -> float:
    """The range of an FLS's first challenge, cells. reach: to its farthest planned neighbour."""
    start = reach if rules.range_start is None else rules.range_start
    # A hair more, so that whoever is just in range is, whichever way the distance was computed.
    return min(start, rules.range_max) * (1 + 1e-9)


def thaw_h_of(rules: Rules, shape: int) -> float:
    """H in the n-th shape of the run, emulated seconds."""
    return rules.next_thaw_h_s if shape else rules.thaw_h_s


def make_thaw_policy(rules: Rules, fid: int, shape: int = 0) -> ThawPolicy:
    """What one FLS does for the thaws of the display, in the n-th shape of the run."""
    shape = min(shape, len(rules.counts) - 1)  # a stranger may have said any epoch
    count, h_s, spread = rules.counts[shape], thaw_h_of(rules, shape), rules.thaw_spread
    if rules.thaw_policy == "timer":
        return Timer(h_s, spread)
    if rules.thaw_policy == "roster":
        gone = rules.leavers if shape else ()
        falls = rules.anchor == "lowest" and not rules.oracles
        return Roster(count, h_s, spread, rules.thaw_rest, falls, gone)
    if rules.thaw_policy == "census":
        return Census(count, h_s, spread)
    if rules.thaw_policy == "corner":
        return Corner(count, h_s, spread, fid in (rules.next_corners if shape else rules.thaw_corners))
    if ":" in rules.thaw_policy:
        from swarmer.plugins.guard import GuardedPolicy

        return GuardedPolicy(rules.thaw_policy, count, h_s, spread)
    return Never()


def make_technique(place: str) -> Any:
    """The technique at "module:class", as it is. Raises PluginFailed if another package's is not there."""
    module, _, name = place.partition(":")
    if module.startswith("swarmer."):
        return getattr(import_module(module), name)()
    from swarmer.plugins import guard

    return guard.make_technique(place)


def make_localizer(place: str) -> Localizer:
    """The technique at "module:class", for an FLS: another package's is watched, and raises PluginFailed."""
    if place.startswith("swarmer."):
        localizer: Localizer = make_technique(place)
        return localizer
    from swarmer.plugins.guard import GuardedLocalizer

    return GuardedLocalizer(place)


def make_sensor_error(rules: Rules) -> SensorErrorModel:
    """By what factor a sample of the distance is off."""
    share, accurate = rules.sensing_error, rules.sensing_accurate
    if ":" in rules.sensing_model:
        from swarmer.plugins import guard

        return guard.make_sensor_error(rules.sensing_model, share, accurate)
    return SENSOR_MODELS[rules.sensing_model](share, accurate)


def make_sensor(rules: Rules) -> Sensor:
    error = make_sensor_error(rules)
    return Sensor(error, rules.sensing_samples, rules.sensing_average, rules.sensing_sample_s)


def make_velocity(rules: Rules) -> Velocity:
    return Velocity(*rules.velocity)


def as_data(rules: Rules) -> dict[str, Any]:
    """Rules as JSON takes them."""
    return rules._asdict()


def from_data(data: dict[str, Any]) -> Rules:
    fields: Any = {name: tuple(value) if isinstance(value, list) else value for name, value in data.items()}
    return Rules(**fields)
