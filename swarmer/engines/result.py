"""What every engine gives, and what may watch it while it runs."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

    from swarmer.messages import Message, Stamp, Vec3
    from swarmer.physics.flight import Flight
    from swarmer.plan import Plan
    from swarmer.protocol.events import Action
    from swarmer.protocol.events import Event as Happening
    from swarmer.radio import Ears
    from swarmer.state_machine import StateMachine


class Snapshot(NamedTuple):
    """All FLSs at one moment; row i is FID i + 1. The arrays belong to the receiver."""

    t_s: float  # emulated seconds since the go signal; of an engine that has rounds and no time: the round
    position: NDArray[np.float64]  # (F, 3), display cells, the estimated truth
    swarm: NDArray[np.int32]  # (F,), Swarm-ID; 0 while dark
    state: NDArray[np.int8]  # (F,), index into swarmer.state_machine.State
    lit: NDArray[np.bool_]  # (F,)
    alive: NDArray[np.bool_]  # (F,), False between a failure and its replacement
    counters: dict[str, float]  # totals since time 0, by their name in the summary
    live: Live
    swarm_incarnation: NDArray[np.int32] | None = (
        None  # (F,), of the Swarm-ID's owner; None: 0, nobody was replaced
    )
    flown: NDArray[np.float64] | None = None  # (F, 2), cells flown: localizing, following
    hd_cells: float | None = None  # as the engine has read it, NaN: not read; None: the observer reads it
    localized: Localized | None = (
        None  # since the sample before; None: nobody was, or the engine does not know
    )

    def of(self, rows: NDArray[np.bool_]) -> Snapshot:
        """The same moment, of some FLSs alone."""
        owners = self.swarm_incarnation
        return self._replace(
            position=self.position[rows], swarm=self.swarm[rows], state=self.state[rows], lit=self.lit[rows],
            alive=self.alive[rows], swarm_incarnation=None if owners is None else owners[rows],
        )  # fmt: skip


class Localized(NamedTuple):
    """FLSs that took off to where a localization led them; row by row, cells in the display."""

    fid: NDArray[np.int32]  # (K,)
    anchor: NDArray[np.int32]  # (K,), FID of the FLS that each localized by; 0 where there is no single one
    start: NDArray[np.float32]  # (K, 3)
    vector: NDArray[np.float32]  # (K, 3), flown, with its error of dead reckoning


class RoundRow(NamedTuple):
    """A line of rounds.csv: one round of an engine that has no clock. Lengths in cells."""

    round: int  # 0: the deployment
    swarms: int  # at its end
    hd_cells: float | None  # None where it was not read
    localizing: int  # FLSs that localized
    anchors: int  # FLSs relative to which
    busy_joins: int
    waves: int
    size_min: int  # FLSs of the smallest swarm at its end
    size_mean: float
    size_max: int
    group_min: int  # swarms that merged at one anchor; 0 where none did
    group_mean: float
    group_max: int
    flight_min: float  # |V| of the localizing FLSs
    flight_mean: float
    flight_max: float
    localizing_cells: float  # flown by the localizing FLSs
    swarm_cells: float  # flown by those that followed them
    failed: int = 0  # FLSs that found no fix; a yardstick's
    hd_absolute_cells: float | None = None  # without translation, where oracles are and HD was read


class HostRow(NamedTuple):
    """A line of hosts.csv: one host of a run over many. Its relay's counts are as far as it lived to tell them."""

    host: str
    cores: int
    flss_begun: int
    flss: int  # at the end; 0 of a host that was lost
    datagrams_out: int | None  # sent on to relays of other hosts, once for each
    datagrams_in: int | None
    packets: int | None  # sent, those that tell of swarms too
    packets_of_datagrams: int | None
    packet_bytes: int | None
    lost: int | None  # by cluster.relay_loss
    send_failed: int | None
    rejected: int | None
    dropped_by_kernel: int
    late_p50_ms: float | None  # from an FLS on another host to this one's relay, emulated
    late_p99_ms: float | None
    late_max_ms: float | None
    clock_apart_ms: float  # its time of day is so far ahead of the engine's
    clock_bound_ms: float
    clock_drift_ms: float
    lost_s: float | None  # emulated; None: it was there to the end
    replaced_on: str  # hosts and how many FLSs each took, as `12 on oak, 4 on elm`; empty: none


class Lateness(NamedTuple):
    """How late something was, in emulated milliseconds."""

    p50: float
    p99: float
    max: float


class Live(NamedTuple):
    """What an engine knows of its own health at a sample; None where it has no such thing."""

    time_scale: float | None  # emulated seconds per wall second, now
    timer_late_ms: Lateness | None  # of the last few seconds
    handled_late_ms: Lateness | None
    processes: int | None
    memory_mb: float | None  # private memory of all FLSs together
    faithful: bool | None


# What a report finds in the texts of events.
BEGINS, OVER, CALM = "begins: ", "over: ", "all faults are over"  # the first two before the words of a fault
GONE = " is gone"  # behind the name of a host


class Event(NamedTuple):
    """Something worth a line in events.csv: a failure, a replacement, a thaw, one swarm, ..."""

    t_s: float
    kind: str
    fid: int  # 0 where no single FLS is meant
    text: str


class Observer(Protocol):
    """Watches a run. An engine calls it from one thread and never waits for more than it needs."""

    def planned(self, plan: Plan) -> None:
        """The plan stands and nothing has started."""

    def launching(self, ready: int, total: int) -> None:
        """`ready` of `total` FLSs are ready to fly."""

    def go(self, launch_s: float) -> None:
        """Time 0: every FLS is ready; getting there took `launch_s` wall seconds."""

    def sample(self, snapshot: Snapshot) -> bool:
        """Take one sample; True asks the engine to stop, because what was waited for is reached."""

    def event(self, event: Event) -> None:
        """Something happened."""

    def beat(self, t_s: float) -> None:
        """Emulated second `t_s` is reached; told where computing from one sample to the next takes long."""


class Seen(Protocol):
    """An FLS as a witness may read it."""

    @property
    def fid(self) -> int: ...

    @property
    def machine(self) -> StateMachine: ...

    @property
    def flight(self) -> Flight: ...

    @property
    def ears(self) -> Ears: ...

    @property
    def alive(self) -> bool: ...

    @property
    def lit(self) -> bool: ...

    def position(self) -> Vec3: ...


class Witness:
    """Sees a run in virtual time from inside, event by event, and changes nothing: checks and traces are witnesses.

    Nothing is done here: override what is of interest. `now_s` is the emulated second. A witness that raises RunFailed
    ends the run.
    """

    def made(self, fls: Seen, now_s: float) -> None:
        """A new FLS is on the air, dark; one of incarnation > 0 takes the place of another."""

    def handled(
        self, fls: Seen, event: Happening, actions: Sequence[Action], cause: Stamp | None, now_s: float
    ) -> None:
        """The machine has taken an event; nothing of what it wants done has been done yet.

        cause: the stamp of the datagram, for an event that is one.
        """

    def sent(self, fls: Seen, message: Message, stamp: Stamp, copies: int, now_s: float) -> None:
        """A datagram is stamped. copies: that leave the sender; 0 if its end of the radio loses it."""

    def heard(self, fls: Seen, message: Message, stamp: Stamp, fate: str, now_s: float) -> None:
        """A datagram came to an FLS, and its fate is one of FATES; one that the radio delays comes twice."""

    def flew(self, fls: Seen, asked: Vec3, flight: Flight, now_s: float) -> None:
        """A flight begins where the FLS is. asked: the vector that it was told to fly, cells."""

    def ended(self, fls: Seen, how: str, now_s: float) -> None:
        """An FLS has gone dark: `failed` or `departed`."""

    def finished(self, now_s: float) -> None:
        """The run has come to its end, in good order; not called if it failed."""

    def summary(self) -> dict[str, Any]:
        """What it adds to the summary, by name."""
        return {}


# What becomes of a datagram at a receiver: refused by the radio's rules (the first five, in the words of
# `radio.heard`), lost or delayed by the receiver's end, received before, or judged at the door (`race.judge`).
FATES = ("run", "sender", "address", "range", "own", "lost", "delayed", "replayed", "queued", "answered", "noted",
         "dropped")  # fmt: skip


@dataclass(slots=True)
class RunResult:
    """How a run ended, whatever the engine; what an engine does not have stays None."""

    engine: str
    status: str  # done | interrupted | failed
    emulated_s: float
    wall_s: float
    launch_s: float | None = None
    message: str = ""  # why, when the status is not `done`
    counters: dict[str, float] = field(default_factory=dict)
    time_scale: float | None = None  # used: emulated seconds per wall second over the whole run
    timer_late_ms: Lateness | None = None
    handled_late_ms: Lateness | None = None
    processes: int | None = None
    memory_mb_per_fls: float | None = None
    faithful: bool | None = None
    suggested_time_scale: float | None = None
    first_single_swarm_s: float | None = None  # as far as the engine knows, be it between two samples
    in_rounds: bool = False  # every `_s` of the run, in samples and events, counts rounds: there is no clock
    round_rows: list[RoundRow] = field(default_factory=list)  # a line for each of them
    host_rows: list[HostRow] = field(default_factory=list)  # of a run over several hosts: a line for each
    extra: dict[str, Any] = field(
        default_factory=dict
    )  # what only this engine has, by its name in the summary
