"""The machine's own small records: its states, who it is, by which rules it plays, what it shows to others."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple, Protocol

from swarmer.messages import Swarm, Vec3
from swarmer.protocol.anchor_selection import AnchorSelection

if TYPE_CHECKING:
    from swarmer.plugins import Localizer
    from swarmer.protocol.thaw import ThawPolicy

SHAPE_EPOCHS = (
    1 << 24
)  # the epochs of a run's n-th shape, from 0, begin at n times this: they outlive all before


def shape_of(epoch: int) -> int:
    """Which of a run's shapes an epoch belongs to, from 0."""
    return epoch // SHAPE_EPOCHS


class State(IntEnum):
    """The paper's five states (figure 4)."""

    DEPLOYING = 0
    AVAILABLE = 1
    BUSY_ANCHOR = 2
    BUSY_LOCALIZING = 3
    WAITING = 4


D, A, BA, BL, W = State


class Identity(NamedTuple):
    """Who an FLS is: its FID, how often that FID has been replaced, its point in display cells."""

    fid: int
    incarnation: int
    truth: Vec3


class NextPoint(NamedTuple):
    """What an FLS is in the shape that comes after (rule 15)."""

    epoch: int  # the first of that shape
    truth: Vec3 | None  # None: it has no point there, and leaves
    neighbours: tuple[int, ...]
    range_start: float
    thaw_policy: ThawPolicy


class MachineSettings(NamedTuple):
    """The rules a machine plays by. Times are emulated seconds, lengths display cells."""

    lambda_s: float
    lease_s: float  # δ
    lease_margin_s: float  # an anchor's lease is δ and this
    m: float  # most swarms merged at one anchor at a time; math.inf
    waiting_bound_s: float
    waiting_ends_at_tick: bool
    flight_threshold: float
    range_start: float
    range_step: float
    range_max: float
    challenge_on_available: bool
    accept_gap_s: float
    neighbour_reply: bool
    busy_join: str  # newcomer | all | off
    epochs: bool
    thaw_repeat: float  # probability of repeating a THAW that was obeyed
    anchors: AnchorSelection
    localizer: Localizer


class Counters(Protocol):
    """One whole number for each `Count`: a list, or a view of memory that others watch."""

    def __getitem__(self, index: int, /) -> int: ...

    def __setitem__(self, index: int, value: int, /) -> None: ...


class Accept(NamedTuple):
    """An acceptance that was sent; it reserves nothing and is remembered for a lease."""

    challenge: int
    size: int  # and these two as it said them, for by them the challenger decides who anchors
    flags: int
    until_s: float


class View(NamedTuple):
    """What the network thread may know (`protocol.race.Published`)."""

    awake: bool
    epoch: int
    flying: bool
    available: bool
    anchoring: bool
    swarm: Swarm
    size: int


class ProtocolBug(RuntimeError):
    """An engine fed an event that cannot happen in this state."""
