"""The rules of a run as plain data, made from its settings: what travels to wherever an FLS runs.

Importing this file costs no numpy: FLS processes do.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

from swarmer.entry_points import OURS, SENSOR_ERRORS, THAW_POLICIES, installed
from swarmer.radio import EndRules

if TYPE_CHECKING:
    from swarmer.config import RunConfig


class Rules(NamedTuple):
    """Every rule of a run as plain data: seconds, cells, radians, names. What an FLS is made from, wherever it runs."""

    count: int  # type: ignore[assignment]  # F; hides tuple.count, which nobody needs
    dim: int
    lambda_s: float
    epsilon: float
    lease_s: float
    lease_margin_s: float
    m: float | None  # None: no limit
    waiting_bound_s: float
    waiting_ends_at_tick: bool
    flight_threshold: float
    range_start: float | None  # None: each FLS's farthest planned neighbour
    range_step: float
    range_max: float
    range_estimated: bool
    challenge_policy: str
    challenge_decay: float
    challenge_on_available: bool
    probe_every: int
    accept_gap_s: float
    neighbour_reply: bool
    busy_join: str
    epochs: bool
    anchor: str
    technique: str  # "module:class"
    thaw_policy: str  # one of ours, or "module:class"
    thaw_h_s: float
    thaw_spread: float
    thaw_repeat: float
    thaw_rest: float  # cells
    thaw_corners: tuple[int, ...]  # FIDs, for the policy that has any
    dead_reckoning: str
    velocity: tuple[float, float, float]
    sensing_model: str  # one of ours, or "module:function"
    sensing_error: float
    sensing_accurate: float
    sensing_samples: int
    sensing_average: str
    sensing_sample_s: float
    sender: tuple[float, ...]  # radio.EndRules
    receiver: tuple[float, ...]
    deploy_random: bool
    deploy_shared_error: bool
    launch_rate: float  # FLSs per second and dispatcher; 0: all at once
    failure_rate: float
    battery_s: float
    battery: tuple[float, ...]  # flying and light time, seconds; reserve, a share; 1: staggered
    charge_s: float
    dead_links: float
    change_s: float | None  # when the display becomes its next shape; None: never
    counts: tuple[int, ...]  # FLSs of each shape
    next_thaw_h_s: float
    next_corners: tuple[int, ...]
    leavers: tuple[int, ...]  # FIDs that have no point in the next shape
    oracles: tuple[int, ...]  # FIDs that know where they are


def make_rules(config: RunConfig, count: int, dim: int, diagonal: float, technique: str) -> Rules:
    """The settings as plain data, in seconds, cells and radians. count: F. diagonal: of the display, cells."""
    return Rules(
        count=count,
        dim=dim,
        technique=technique,
        **_challenges(config, diagonal),
        **_thaws(config, count),
        **_flights(config),
        **_radio(config),
        **_lives(config),
    )


def place_or_name(group: str, name: str) -> str:
    """Where a plugin is, as "module:attribute"; what is ours is known by its name."""
    plugin = installed(group).get(name) if name not in OURS[group] else None
    return name if plugin is None else plugin.place


def _challenges(config: RunConfig, diagonal: float) -> dict[str, Any]:
    """When and how far an FLS challenges, with whom it pairs, how long a lease lasts."""
    return {
        "lambda_s": config.lambda_ms / 1e3,
        "lease_s": config.lease_ms / 1e3,
        "lease_margin_s": config.lease_margin_ms / 1e3,
        "m": None if math.isinf(config.merge_limit) else config.merge_limit,
        "waiting_bound_s": config.waiting_bound / 1e3,
        "waiting_ends_at_tick": config.waiting_ends == "tick",
        "range_start": config.range.start_cells,
        "range_step": config.range.step_cells,
        "range_max": diagonal if config.range.max_cells is None else config.range.max_cells,
        "range_estimated": config.range.measured == "estimated",
        "challenge_policy": config.challenge_policy,
        "challenge_decay": config.challenge_decay,
        "challenge_on_available": config.challenge_on_available,
        "probe_every": config.probe_every,
        "accept_gap_s": config.accept_gap_ms / 1e3,
        "neighbour_reply": config.neighbour_reply,
        "busy_join": config.busy_join,
        "anchor": config.anchor,
    }


def _thaws(config: RunConfig, count: int) -> dict[str, Any]:
    """When the display begins anew, in its first shape."""
    return {
        "epochs": config.epochs,
        "thaw_policy": place_or_name(THAW_POLICIES, config.thaw.policy),
        "thaw_h_s": config.thaw_h_s(count),
        "thaw_spread": config.thaw.spread,
        "thaw_repeat": config.thaw.repeat,
        "thaw_rest": config.rest_below_cells,
        "thaw_corners": (),
        "change_s": None,
        "counts": (count,),
        "next_thaw_h_s": 0.0,
        "next_corners": (),
        "leavers": (),
        "oracles": (),
    }


def _flights(config: RunConfig) -> dict[str, Any]:
    """How an FLS flies and what it measures."""
    flight, cell = config.flight, config.flight.cell_m
    return {
        "epsilon": math.radians(config.epsilon_deg),
        "flight_threshold": config.flight_threshold_cells,
        "dead_reckoning": flight.dead_reckoning,
        "velocity": tuple(
            one / cell for one in (flight.speed_m_s, flight.acceleration_m_s2, flight.braking_m_s2)
        ),
        "sensing_model": place_or_name(SENSOR_ERRORS, config.sensing.model),
        "sensing_error": config.sensing.error_percent / 100,
        "sensing_accurate": config.sensing.accurate_probability,
        "sensing_samples": config.sensing.samples,
        "sensing_average": config.sensing.average,
        "sensing_sample_s": config.sensing.sample_ms / 1e3,
    }


def _radio(config: RunConfig) -> dict[str, Any]:
    """What happens to datagrams."""
    radio = config.radio
    return {
        "sender": EndRules(
            radio.sender_loss, radio.sender_duplicate, radio.sender_reorder, radio.reorder_ms / 1e3,
            burst=radio.burst, burst_loss=radio.burst_loss,
        ),
        "receiver": EndRules(
            radio.receiver_loss, radio.receiver_duplicate, radio.receiver_reorder, radio.reorder_ms / 1e3,
            radio.delay_ms / 1e3, radio.jitter_ms / 1e3, radio.burst, radio.burst_loss,
        ),
        "dead_links": radio.dead_links,
    }  # fmt: skip


def _lives(config: RunConfig) -> dict[str, Any]:
    """How FLSs come and go."""
    battery = config.battery
    return {
        "deploy_random": config.deploy.start == "random",
        "deploy_shared_error": config.deploy.error == "shared",
        "launch_rate": config.deploy.rate_per_s,
        "failure_rate": config.failure.rate,
        "battery_s": config.failure.battery_s,
        "battery": (battery.flight_s, battery.light_s, battery.reserve, float(battery.stagger)),
        "charge_s": battery.charge_s,
    }
