"""The settings that stand together under one name: `range.`, `thaw.`, `radio.`, ... See `config.RunConfig`."""

from __future__ import annotations

from typing import Any, Literal

from swarmer.entry_points import OURS, SENSOR_ERRORS, THAW_POLICIES
from swarmer.settings import Group, choice, flag, named, number, positions, rows, text, whole

FAR = 1_000_000  # cells, seconds: beyond any display and any run
Carrier = Literal["auto", "unicast", "broadcast"]


class Range(Group):
    """The radio range of challenges."""

    start_cells: float | None = number(
        None,
        "cells",
        0,
        FAR,
        "radio range of the first challenge",
        above=True,
        none="the farthest planned neighbour",
    )
    step_cells: float = number(5, "cells", 0, FAR, "added when a challenge found no taker")
    max_cells: float | None = number(
        None, "cells", 0, FAR, "never farther than this", above=True, none="the display's diagonal"
    )
    measured: Literal["ground_truth", "estimated"] = choice(
        "ground_truth", "positions between which the range is measured"
    )


class Thaw(Group):
    """When swarms dissolve to localize anew."""

    policy: str = named(
        "roster",
        OURS[THAW_POLICIES],
        THAW_POLICIES,
        "who says when: the owner of the swarm that all have joined (roster), or in which all are R-Complete "
        "(census); a timer in each FLS; FLSs far from the centre (corner); the engine that sees one swarm; nobody",
    )
    h_s: float | None = number(
        None,
        "s",
        0.01,
        FAR,
        "H, the shortest time from thaw to thaw",
        none="log2 of the number of points",
    )
    spread: float = number(2, "", 1, 100, "the timer is uniform between H and this times H")
    repeat: float = number(0, "p", 0, 1, "an FLS repeats a THAW that it heard")
    rest_below_cells: float | None = number(
        None,
        "cells",
        0,
        FAR,
        "roster: leave it to the timer once a formation moves nobody this far, and half as far as the one before",
        none="10 flight_threshold_cells",
    )


class Radio(Group):
    """What happens to a datagram, and which way it takes."""

    loss: float = number(0, "p", 0, 1, "a datagram is lost, at its sender and again at each receiver")
    loss_sender: float | None = number(None, "p", 0, 1, "it is lost at its sender", none="radio.loss")
    loss_receiver: float | None = number(None, "p", 0, 1, "it is lost at a receiver", none="radio.loss")
    duplicate: float = number(
        0, "p", 0, 1, "a datagram comes twice, made by its sender and again by each receiver"
    )
    duplicate_sender: float | None = number(
        None, "p", 0, 1, "its sender sends it twice", none="radio.duplicate"
    )
    duplicate_receiver: float | None = number(
        None, "p", 0, 1, "a receiver gets it twice", none="radio.duplicate"
    )
    reorder: float = number(0, "p", 0, 1, "a datagram is held back, at its sender and again at each receiver")
    reorder_sender: float | None = number(None, "p", 0, 1, "its sender holds it back", none="radio.reorder")
    reorder_receiver: float | None = number(None, "p", 0, 1, "a receiver holds it back", none="radio.reorder")
    reorder_ms: float = number(5, "ms", 0, 60_000, "how long a datagram is held back to lose its place")
    delay_ms: float = number(0, "ms", 0, 60_000, "added to the way of every datagram")
    jitter_ms: float = number(
        0, "ms", 0, 60_000, "the delay varies by up to this, both ways, never below zero"
    )
    burst: int = whole(
        0, "", 0, 10_000, "datagrams that a burst of losses spans in the mean; 0: each is lost by itself"
    )
    burst_loss: float = number(1, "p", 0, 1, "a datagram is lost within a burst", above=True)
    dead_links: float = number(
        0,
        "p",
        0,
        1,
        "nothing gets from one FLS to another in the whole run; each direction is drawn by itself",
    )
    mac: bool = flag(False, "sign every datagram and drop those that are not signed by this run")
    carrier: Carrier = choice("auto", "how datagrams for several FLSs travel", only="process")
    unicast_max: int = whole(
        32, "", 0, FAR, "auto: up to so many addressees get a datagram each, more a broadcast", only="process"
    )
    kernel_filter: Literal["auto", "off"] = choice(
        "auto", "filter broadcasts inside the kernel", only="process"
    )
    port: int = whole(0, "", 0, 65_535, "UDP port of the run; 0 is the first free one", only="process")
    receive_buffer_kb: int = whole(
        1024, "kB", 16, 1_048_576, "receive buffer of each socket, if the system grants it", only="process"
    )

    @property
    def sender_loss(self) -> float:
        """Probability that the sender loses a datagram."""
        return self.loss if self.loss_sender is None else self.loss_sender

    @property
    def receiver_loss(self) -> float:
        """Probability that a receiver loses a datagram."""
        return self.loss if self.loss_receiver is None else self.loss_receiver

    @property
    def sender_duplicate(self) -> float:
        """Probability that the sender doubles a datagram."""
        return self.duplicate if self.duplicate_sender is None else self.duplicate_sender

    @property
    def receiver_duplicate(self) -> float:
        """Probability that a receiver gets a datagram twice."""
        return self.duplicate if self.duplicate_receiver is None else self.duplicate_receiver

    @property
    def sender_reorder(self) -> float:
        """Probability that the sender holds a datagram back."""
        return self.reorder if self.reorder_sender is None else self.reorder_sender

    @property
    def receiver_reorder(self) -> float:
        """Probability that a receiver holds a datagram back."""
        return self.reorder if self.reorder_receiver is None else self.reorder_receiver


class Sensing(Group):
    """How well an FLS measures the vector to the sender of a datagram."""

    model: str = named(
        "none",
        OURS[SENSOR_ERRORS],
        SENSOR_ERRORS,
        "error of a measured distance; mixed is accurate or uniform",
    )
    error_percent: float = number(
        0, "%", 0, 100, "uniform and mixed: the distance is off by up to this, both ways"
    )
    accurate_probability: float = number(0.9, "p", 0, 1, "mixed: a sample has no error")
    samples: int = whole(1, "", 1, 1000, "samples taken for one measurement")
    average: Literal["mean", "median"] = choice("mean", "what is made of several samples")
    sample_ms: float = number(0, "ms", 0, 60_000, "time that one sample takes")


class Flight(Group):
    """How an FLS flies."""

    speed_m_s: float = number(10, "m/s", 0, 1000, "top speed", above=True)
    acceleration_m_s2: float = number(10, "m/s2", 0, 1000, "acceleration", above=True)
    braking_m_s2: float = number(10, "m/s2", 0, 1000, "braking", above=True)
    cell_m: float = number(0.05, "m", 0, 100, "edge of a display cell", above=True)
    dead_reckoning: Literal["full", "one_sided", "one_sided_random"] = choice(
        "full",
        "angle error: uniform within +-epsilon in a random plane, or one of the two models of the authors' programs",
    )


class Deploy(Group):
    """How a run begins."""

    start: Literal["dispatcher", "random"] = choice(
        "dispatcher", "fly in from a dispatcher, or begin at a random place in the display"
    )
    dispatchers: tuple[tuple[float, float, float], ...] = positions(
        ((0.0, 0.0, 0.0),), "cells", 1, 16, "where dispatchers stand; an FLS takes the nearest to its point"
    )
    rate_per_s: float = number(0, "1/s", 0, FAR, "FLSs that each dispatcher launches; 0 is all at once")
    error: Literal["own", "shared"] = choice(
        "own", "first flight errors drawn by each FLS, or one draw for all"
    )


class Battery(Group):
    """What flying and shining cost an FLS, and who lights its point meanwhile."""

    flight_s: float = number(0, "s", 0, FAR, "flying time of a full battery; 0: flying costs nothing")
    light_s: float = number(0, "s", 0, FAR, "light time of a full battery; 0: shining costs nothing")
    reserve: float = number(
        0.2, "p", 0, 0.9, "an FLS leaves when so much of it is left, and its relief is there"
    )
    charge_s: float = number(20, "s", 0, FAR, "time that charging takes, at home")
    stagger: bool = flag(
        True, "first batteries are partly used, each by its own draw; else all leave at once"
    )
    standby_group: int = whole(
        0, "", 0, FAR, "points that share one standby, which waits dark in their middle; 0: there are none"
    )


class Oracle(Group):
    """FLSs that know where they are."""

    count: int = whole(0, "", 0, FAR, "so many FLSs, spread over the shape, know their own position exactly")


class Transition(Group):
    """The shape that comes after the first one."""

    shape: str | None = text(
        None, "what the display becomes, a name or a path as for shape", none="it stays what it is"
    )
    points: int | None = whole(
        None,
        "",
        2,
        10_000_000,
        "sample exactly this many points of that shape",
        none="as many as it has",
    )
    at_s: float | None = number(
        None,
        "s",
        0,
        FAR,
        "when, from the go signal; must be given with transition.shape",
        above=True,
        none="never",
    )


class Failure(Group):
    """What goes wrong with FLSs themselves."""

    rate: float = number(0, "1/s", 0, 10, "how often each FLS fails")
    replace: bool = flag(True, "launch a replacement from a dispatcher")
    hang_s: float = number(
        0, "s", 0, FAR, "an FLS that shows no sign of life for so long is ended and replaced; 0 never is"
    )
    battery_s: float = number(0, "s", 0, FAR, "flying time of a battery; 0 lasts for ever")


class Faults(Group):
    """What goes wrong at set times: see the page on faults."""

    schedule: tuple[dict[str, Any], ...] = rows(
        0, 10_000, "faults, each with at, what, where, maybe for, and what it needs besides"
    )
    calm_s: float | None = number(
        None, "s", 0, FAR, "then every fault ends and nothing goes wrong any more", none="never"
    )
    file: str | None = text(None, "a YAML file with more faults, and maybe calm", none="none")
    random: int = whole(0, "", 0, 1000, "so many faults besides, drawn from the seed over the whole run")


class Recording(Group):
    """What is kept of a run."""

    rate_hz: float = number(10, "Hz", 0.1, 60, "samples of all FLSs, in emulated time")
    enabled: bool = flag(True, "write the recording that `swarmer replay` plays")
    positions_per_s: float = number(
        50_000,
        "1/s",
        100,
        FAR,
        "positions that the recording takes in an emulated second; of more it shows every so many samples",
    )


class Process(Group):
    """The process engine alone."""

    pin: bool = flag(True, "keep each FLS process on one core", only="process")


class Cluster(Group):
    """The cluster engine alone: where its hosts are, and what is asked of them."""

    address: str | None = text(
        None, "address of Ray, as HOST:PORT, or auto", none="as RAY_ADDRESS says, else on this machine alone",
        only="cluster",
    )  # fmt: skip
    nodes: int | None = whole(
        None, "", 1, 10_000, "hosts to take from Ray, each another node", none="all nodes", only="cluster"
    )
    hosts: str | None = text(
        None,
        "hosts by name, without Ray, with commas between; localhost, also several times, is this machine",
        none="by Ray",
        only="cluster",
    )
    launch: str = text(
        "ssh -o BatchMode=yes {host}", "cluster.hosts: what starts a program on {host}", only="cluster"
    )
    python: str | None = text(
        None, "cluster.hosts: Python on the hosts", none="at the same path as here", only="cluster"
    )
    listen: str | None = text(
        None,
        "address at which the hosts reach this machine",
        none="the one from which the first host, or Ray, is reached",
        only="cluster",
    )
    flss_per_host: int | None = whole(
        None, "", 1, FAR, "most FLSs on one host", none="as many as its limits allow", only="cluster"
    )
    clocks_apart_s: float = number(
        1, "s", 0, FAR, "most that the time of day of a host may differ", above=True, only="cluster"
    )
    clock_bound_ms: float = number(
        10, "ms", 0, 60_000, "how well the clock of each host must be known", above=True, only="cluster"
    )
    wall_patience_s: float = number(
        5, "s", 0.5, 3600, "wall time: a host that is silent for longer is gone", only="cluster"
    )
    relay_loss: float = number(0, "p", 0, 1, "a datagram is lost between two hosts", only="cluster")
    relay_delay_ms: float = number(0, "ms", 0, 60_000, "added to the way between two hosts", only="cluster")


class Virtual(Group):
    """The virtual-time engine alone."""

    latency_min_ms: float = number(
        0.05, "ms", 0, 60_000, "shortest time that a datagram is on its way", only="virtual"
    )
    latency_max_ms: float = number(
        0.5, "ms", 0, 60_000, "longest; each receiver of a datagram has a time of its own", only="virtual"
    )
    handling_ms: float = number(
        0.15, "ms", 0, 60_000, "time that an FLS takes for one message, while others queue", only="virtual"
    )


class Rounds(Group):
    """The rounds engine alone."""

    max_rounds: int = whole(100, "", 1, FAR, "rounds at most", only="rounds")
    stop: Literal["hd", "none"] = choice(
        "hd",
        "end at a single swarm whose Hausdorff distance is low enough, or only by max_rounds and max_thaws",
        only="rounds",
    )
    stop_hd_cells: float = number(
        0.09,
        "cells",
        0,
        FAR,
        "how low the Hausdorff distance of a single swarm must be",
        above=True,
        only="rounds",
    )
    max_thaws: int | None = whole(
        None, "", 0, FAR, "end at the single swarm after so many thaws", none="no limit", only="rounds"
    )
    neighbours: Literal["estimated", "planned"] = choice(
        "estimated",
        "links to the eta nearest FLSs where they are, found anew each round, or to the planned neighbours",
        only="rounds",
    )
    anchor: Literal["largest", "smallest", "lowest", "challenger", "random"] = choice(
        "largest", "which of the swarms that merge is the anchor", only="rounds"
    )
    fids: Literal["drawn", "shape"] = choice(
        "drawn",
        "who is the lowest FID of a swarm, which challenges for it and names it: FIDs are drawn for each run, or are "
        "those of the shape's points, whose order often follows its surface",
        only="rounds",
    )
    order: Literal["random", "fid"] = choice(
        "random", "order in which swarms challenge: drawn for each round, or by Swarm-ID", only="rounds"
    )
    pairing: Literal["fast", "exact"] = choice(
        "fast",
        "m 2: pair along links, then the nearest of the others; or one after the other with the nearest FLS of any "
        "free swarm, as the authors' program",
        only="rounds",
    )
    dead_reckoning: Literal["flight", "full", "one_sided", "one_sided_random"] = choice(
        "flight", "angle error of flights; flight: as flight.dead_reckoning says", only="rounds"
    )
    pm_first_leg: Literal["dead_reckoning", "exact"] = choice(
        "dead_reckoning",
        "physical_movement: how the way to the anchor is flown; exact: without error, to 0.1 cell beside it, as in the "
        "authors' program",
        only="rounds",
    )
    threshold_cells: float = number(0, "cells", 0, 1000, "shorter flights are skipped", only="rounds")
    dim: Literal["auto", 2, 3, "flatten"] = choice(
        "auto", "2 for a flat shape, 3 for others; or said so; flatten drops the depth", only="rounds"
    )
    box_cells: float | None = number(
        None,
        "cells",
        0,
        FAR,
        "deploy.start random: anywhere from 0 to this on each axis",
        above=True,
        none="the display's box",
        only="rounds",
    )
    hd_translation: Literal["centroid", "sampled", "none"] = choice(
        "centroid",
        "the Hausdorff distance is read after moving the swarm by the mean error, by the best of a sample of "
        "errors, or not at all",
        only="rounds",
    )
    hd_every: Literal["auto", "round", "formation"] = choice(
        "auto",
        "when it is read; auto: each round, with more than 50000 FLSs at each formation",
        only="rounds",
    )
    yardstick_order: Literal["independent", "sequential"] = choice(
        "independent",
        "triangulation, trilateration: many FLSs in a round, none next to another, or one",
        only="rounds",
    )
    yardstick_radius: Literal["worst", "average"] = choice(
        "worst", "error that an FLS reckons with: of the worst flight, or half of it", only="rounds"
    )
    yardstick_confidence: float = number(
        0.99, "p", 0, 1, "an FLS with at least this confidence stays where it is", only="rounds"
    )
    yardstick_flight_error: bool = flag(
        False,
        "triangulation, trilateration: dead reckoning errs on the way to the computed position",
        only="rounds",
    )
