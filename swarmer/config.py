"""Every setting of a run: unit, range, default and one line of help, declared once.

`load_config` reads a preset or a YAML file, then `--set` overrides, then options, and checks all of it. Errors,
the preset `default.yaml` and the settings reference come from the declarations below.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any, Literal

import yaml
from pydantic import ValidationError

import swarmer
from swarmer.config_groups import (
    FAR,
    Battery,
    Cluster,
    Deploy,
    Failure,
    Faults,
    Flight,
    Oracle,
    Process,
    Radio,
    Range,
    Recording,
    Rounds,
    Sensing,
    Thaw,
    Transition,
    Virtual,
)
from swarmer.errors import BadInput
from swarmer.settings import (
    Group,
    Setting,
    as_yaml,
    choice,
    error_lines,
    flag,
    number,
    text,
    unknown_line,
    walk,
    whole,
)
from swarmer.settings_file import flat_layers

Word = Literal["auto"]
NEED_EPOCHS = (
    "roster",
    "census",
    "corner",
)  # thaw policies: without epochs what is said of one counts in the next
# Besides its own: an engine without protocol, clock and radio has no use for others.
HEEDED_IN_ROUNDS = (
    "shape", "points", "engine", "seed", "until_hd_cells", "time_scale", "epsilon_deg", "eta", "m", "technique",
    "neighbours", "duplicates", "flight.dead_reckoning", "flight.cell_m", "deploy.start", "deploy.dispatchers",
    "recording.enabled", "oracle.count",
)  # fmt: skip
OF_ORACLES = ("flight_threshold_cells",)  # heeded in rounds, too, where there are any
GAP_MS, BATTERY_S = 1.0, 0.1  # less makes storms of events in which emulated time stands still
OFTEN = 600_000  # ms: the longest pause that makes sense


class RunConfig(Group):
    """Every setting of one run. Made by `load_config`."""

    shape: str = text(
        "dragon", "a name of the catalogue (`swarmer shapes`) or the path of a point cloud or mesh"
    )
    points: int | None = whole(
        None,
        "",
        2,
        10_000_000,
        "sample exactly this many points of the shape",
        none="as many as the shape has",
    )
    engine: Literal["process", "virtual", "rounds", "cluster"] = choice(
        "process",
        "what runs the FLSs: one process each, over UDP; one process for all, in virtual time; no protocol at all, "
        "round by round; or one process each, on many hosts",
    )
    seed: int = whole(1, "", 0, 4_294_967_295, "root of every random draw of the run")
    duration_s: float = number(60, "s", 0, FAR, "length of the run, from the go signal", above=True)
    until_hd_cells: float | None = number(
        None,
        "cells",
        0,
        FAR,
        "end as soon as the Hausdorff distance is below this",
        above=True,
        none="run to the end",
    )
    time_scale: float | Word = number(
        "auto",
        "wall",
        0.001,
        10,
        "speed; auto is as fast as stays faithful here, at most 1",
        words=("auto",),
        only="process",
    )
    lambda_ms: float = number(500, "ms", 1, OFTEN, "mean time between two challenges of an FLS")
    epsilon_deg: float = number(5, "deg", 0, 45, "bound of the dead-reckoning angle error")
    eta: int | None = whole(
        None,
        "",
        1,
        1000,
        "nearest neighbours an R-Complete FLS must have in its swarm",
        none="5, or all others if fewer",
    )
    lease_ms: float = number(250, "ms", 1, 60_000, "how long an anchor waits for its localizer")
    m: Literal["inf", 2] = choice("inf", "most swarms that merge at one anchor at a time")
    technique: str = text("signal_strength", "localization technique, a plugin's name")
    anchor: Literal["lowest", "largest", "smallest", "challenger", "random"] = choice(
        "lowest", "which of two swarms becomes the anchor"
    )
    neighbours: Literal["connected", "nearest"] = choice(
        "connected", "the eta nearest made symmetric and connected, or the eta nearest alone"
    )
    duplicates: Literal["refuse", "drop"] = choice("refuse", "points given twice in the shape")
    flight_threshold_cells: float = number(0.001, "cells", 0, 1000, "shorter flights are skipped")
    challenge_policy: Literal["r_complete", "decay", "always"] = choice(
        "r_complete", "challenge until R-Complete, ever less likely with each merge, or at every tick"
    )
    challenge_decay: float = number(1.25, "", 1, 1000, "decay: each merge divides the probability by this")
    challenge_on_available: bool = flag(False, "challenge on every entry to Available, too")
    probe_every: int = whole(8, "", 0, FAR, "an R-Complete FLS challenges at every so many ticks; 0 is never")
    neighbour_reply: bool = flag(
        True, "answer a challenge from the own swarm with NEIGHBOUR if a planned neighbour"
    )
    busy_join: Literal["newcomer", "all", "off"] = choice(
        "newcomer", "who may join a busy neighbour's swarm at once"
    )
    epochs: bool = flag(True, "count thaws, and tell an FLS that has missed one")
    accept_gap_ms: float = number(0, "ms", 0, 60_000, "an FLS lets this pass between two accepts")
    lease_margin_ms: float = number(0, "ms", 0, 60_000, "an anchor holds a lease this much longer")
    waiting_bound_ms: float | None = number(
        None,
        "ms",
        1,
        OFTEN,
        "a Waiting FLS that hears nothing goes on after this",
        none="lambda_ms, or 2 lease_ms if longer",
    )
    waiting_ends: Literal["bound", "tick"] = choice(
        "bound", "Waiting ends after its bound, or at the next tick of the challenge timer"
    )
    fls_loop: Literal["single", "threads", "asyncio"] = choice(
        "single", "how an FLS process is built: one thread, two, or asyncio", only="process"
    )

    range: Range = Range()
    thaw: Thaw = Thaw()
    radio: Radio = Radio()
    sensing: Sensing = Sensing()
    flight: Flight = Flight()
    deploy: Deploy = Deploy()
    battery: Battery = Battery()
    oracle: Oracle = Oracle()
    transition: Transition = Transition()
    failure: Failure = Failure()
    faults: Faults = Faults()
    recording: Recording = Recording()
    process: Process = Process()
    cluster: Cluster = Cluster()
    virtual: Virtual = Virtual()
    rounds: Rounds = Rounds()

    @classmethod
    def from_flat(cls, flat: Mapping[str, Any]) -> RunConfig:
        """Settings from values by dotted name. Raises BadInput."""
        facts = {setting.name: setting for setting in FACTS}
        unknown = [name for name in flat if name not in facts]
        lines = [unknown_line(name, facts if count < 20 else ()) for count, name in enumerate(unknown)]
        nested: dict[str, Any] = {}
        for name, value in flat.items():
            if name in facts:
                group, _, field = name.rpartition(".")
                (nested.setdefault(group, {}) if group else nested)[field] = value
        try:
            config = cls.model_validate(nested)
        except ValidationError as error:
            raise BadInput.saying(*lines, *error_lines(error, facts)) from None
        lines = lines or contradictions(config)
        if lines:
            raise BadInput.saying(*lines)
        return config

    def eta_of(self, count: int) -> int:
        """How many neighbours R-Complete asks for in a display of `count` points."""
        return min(5 if self.eta is None else self.eta, count - 1)

    def thaw_h_s(self, count: int) -> float:
        """H in seconds, in a display of `count` points."""
        return math.log2(max(count, 2)) if self.thaw.h_s is None else self.thaw.h_s

    @property
    def rest_below_cells(self) -> float:
        """Below which longest flight of a formation the policy `roster` lets the display rest."""
        rest = self.thaw.rest_below_cells
        return 10 * self.flight_threshold_cells if rest is None else rest

    @property
    def waiting_bound(self) -> float:
        """After how many milliseconds a Waiting FLS that hears nothing is Available again."""
        if self.waiting_bound_ms is not None:
            return self.waiting_bound_ms
        return max(self.lambda_ms, 2 * self.lease_ms)

    @property
    def merge_limit(self) -> float:
        """M as a number: 2 or infinity."""
        return math.inf if self.m == "inf" else self.m

    @property
    def length(self) -> float:
        """How long the run may take, in its own unit."""
        return self.rounds.max_rounds if self.engine == "rounds" else self.duration_s

    @property
    def unit(self) -> str:
        """What the engine counts: seconds, or rounds."""
        return "rounds" if self.engine == "rounds" else "s"

    def changed(self, **flags: Any) -> RunConfig:
        """A checked copy with other values; names as in `load_config`."""
        return RunConfig.from_flat(flat_layers(None, (), _given(flags), setting_facts(), base=self.flat()))

    def flat(self) -> dict[str, Any]:
        """Every setting by its dotted name, in declared order."""
        return {setting.name: _at(self, setting.name) for setting in setting_facts()}

    def unusual(self) -> dict[str, str]:
        """The settings that are not at their default, each as a file spells it."""
        return {
            fact.name: as_yaml(value)
            for fact in setting_facts()
            if (value := _at(self, fact.name)) != fact.default
        }

    def unlike(self, base: RunConfig | None = None) -> list[str]:
        """The names of the settings that are not as in `base`, such as a preset; None: the defaults."""
        given = RunConfig() if base is None else base
        return [fact.name for fact in setting_facts() if _at(self, fact.name) != _at(given, fact.name)]

    def ignored(self, names: Collection[str] | None = None) -> list[str]:
        """Lines for those of the settings that the engine does not heed.

        names: of those that somebody asked for; None: all that are not as by default.
        """
        asked = self.unlike() if names is None else names
        changed = [fact for fact in setting_facts() if fact.name in asked]
        lines = [
            f"{fact.name}: {as_yaml(_at(self, fact.name))} has no effect with the engine {self.engine}; "
            f"only {fact.only} has it"
            for fact in changed
            if fact.only not in ("", self.engine)
            and not (self.engine == "cluster" and fact.only == "process")
        ]
        if self.engine == "rounds":
            heeded = HEEDED_IN_ROUNDS + (OF_ORACLES if self.oracle.count else ())
            of_protocol = [fact.name for fact in changed if not fact.only and fact.name not in heeded]
            if of_protocol:
                names = ", ".join(of_protocol)
                lines.append(f"{names}: no effect with the engine rounds, which plays no protocol")
        return lines

    def to_yaml(self) -> str:
        """The resolved settings as a file that makes the same run again."""
        head = (
            f"# swarmer {swarmer.__version__}: settings of a run; `swarmer-run --config FILE` runs it again\n"
        )
        return head + yaml.safe_dump(self.model_dump(mode="json"), sort_keys=False, allow_unicode=True)


def load_config(file: str | Path | None = None, overrides: Iterable[str] = (), **flags: Any) -> RunConfig:
    """The settings of a run: a file, changed by overrides, changed by flags.

    file: the name of a preset (default, paper, authors_code), the path of a YAML file, or None.
    overrides: texts `a.b=value`, as after `--set`; the value is read as YAML.
    flags: settings by name, groups as mappings or `**{"radio.loss": 0.1}`; None means not given.
    Raises BadInput with a line for everything that is wrong.
    """
    return RunConfig.from_flat(flat_layers(file, overrides, _given(flags), setting_facts()))


def contradictions(config: RunConfig) -> list[str]:
    """Lines for values that are fine alone and wrong together."""
    start, most = config.range.start_cells, config.range.max_cells
    if start is not None and most is not None and start > most:
        return [f"range.start_cells: {start:g} is more than range.max_cells, {most:g}"]
    if config.challenge_on_available and config.accept_gap_ms < GAP_MS:
        # Two FLSs would challenge, accept and cancel without end, as fast as they can.
        return [
            f"accept_gap_ms: {config.accept_gap_ms:g} is not allowed with challenge_on_available: true; "
            f"milliseconds, {GAP_MS:g} or more"
        ]
    radio = config.radio
    if radio.burst and max(radio.sender_loss, radio.receiver_loss) > radio.burst_loss:
        return [
            f"radio.burst_loss: {radio.burst_loss:g} is too little for the loss at an end, "
            f"{max(radio.sender_loss, radio.receiver_loss):g}; at least as much"
        ]
    if 0 < config.failure.battery_s < BATTERY_S:
        return [
            f"failure.battery_s: {config.failure.battery_s:g} is too short; 0, or seconds from {BATTERY_S:g}"
        ]
    if wrong := _battery(config):
        return [wrong]
    if config.thaw.policy in NEED_EPOCHS and not config.epochs:
        return [
            f"epochs: false is not allowed with thaw.policy: {config.thaw.policy}, whose late reports would count; "
            "true, or thaw.policy: timer"
        ]
    if wrong := _transition(config):
        return [wrong]
    if config.engine in ("virtual", "rounds") and config.time_scale != "auto":
        return [
            f"time_scale: {config.time_scale:g} is not for the engine {config.engine}; "
            "auto, for it runs as fast as it can"
        ]
    least, longest = config.virtual.latency_min_ms, config.virtual.latency_max_ms
    if least > longest:
        return [f"virtual.latency_min_ms: {least:g} is more than virtual.latency_max_ms, {longest:g}"]
    return []


def _transition(config: RunConfig) -> str:
    """What is wrong with the change of shape, or with oracles, if anything."""
    then = config.transition
    if config.engine == "rounds" and then.shape is not None:
        return f"transition.shape: {_at(config, 'transition.shape')} is not for the engine rounds; process or virtual"
    if then.shape is None:
        given = [name for name in ("at_s", "points") if getattr(then, name) is not None]
        return (
            f"transition.shape: null leaves transition.{given[0]} without a shape to become" if given else ""
        )
    if then.at_s is None:
        return "transition.at_s: null does not say when; seconds from the go signal, with transition.shape"
    if then.at_s >= config.duration_s:
        return (
            f"transition.at_s: {then.at_s:g} is not before the end of the run; seconds, less than duration_s, "
            f"{config.duration_s:g}"
        )
    if not config.epochs:
        return "epochs: false is not allowed with transition.shape: what the old shape says must be told from the new"
    return ""


def _battery(config: RunConfig) -> str:
    """What is wrong with batteries and standbys, if anything."""
    battery = config.battery
    for name in ("flight_s", "light_s"):
        if 0 < getattr(battery, name) < BATTERY_S:
            return (
                f"battery.{name}: {getattr(battery, name):g} is too short; 0, or seconds from {BATTERY_S:g}"
            )
    group = battery.standby_group
    if group and not (battery.flight_s or battery.light_s):
        return f"battery.standby_group: {group} waits for nobody without battery.flight_s or battery.light_s"
    return ""


def setting_facts() -> list[Setting]:
    """Every setting in declared order: name, unit, range, default, help, and what makes its error line."""
    return list(FACTS)


def _given(flags: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in flags.items() if value is not None}


def _at(config: Group, name: str) -> Any:
    value: Any = config
    for part in name.split("."):
        value = getattr(value, part)
    return value


FACTS = tuple(walk(RunConfig))
