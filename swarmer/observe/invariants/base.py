"""What an invariant is made of: what it knows of a run and of each FLS, and the moments at which it looks."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from swarmer.messages import Kind
from swarmer.protocol.events import KEYS
from swarmer.state_machine import State

if TYPE_CHECKING:
    from collections.abc import Sequence

    from swarmer.engines.result import Seen
    from swarmer.messages import Message, Stamp, Swarm, Vec3
    from swarmer.physics.flight import Flight
    from swarmer.plan import Plan
    from swarmer.protocol.events import Action
    from swarmer.protocol.events import Event as Happening
    from swarmer.rules import Rules
    from swarmer.state_machine import StateMachine

D, A, BA, BL, W = State
TINY = 1e-9
NOTED = 0  # the key of a datagram that is only noted; those of other events are the table's
EVERY: frozenset[int] = frozenset(range(KEYS))
QUIET = frozenset({NOTED, int(Kind.NEIGHBOUR)})  # those that only tell a Swarm-ID, in an epoch that goes on
ACTIVE = EVERY - QUIET
RECENT = 20  # events of an FLS that a report can tell

NO_LEASES: dict[int, float] = {}
NO_HOLDERS: dict[int, bool] = {}


class Past(NamedTuple):
    """One event of an FLS, as it is remembered for a report."""

    t_s: float
    before: State
    after: State
    swarm: Swarm  # before
    event: Happening
    actions: Sequence[Action]


class Life:
    """What the checks remember of one incarnation of an FLS: its machine as it was before the present event."""

    __slots__ = (
        "acks", "alive", "anchor", "challenge_at", "complete_ticks", "epoch", "fid", "first_challenge", "flight_s",
        "flights", "fls", "flying", "grants", "holders", "incarnation", "joined", "joins", "leases",
        "localizes_since", "machine", "newest", "number", "onward", "origin", "pending", "place", "reach", "recent",
        "reporters", "state", "swarm", "taken", "thawed_s", "thaws_at", "thaws_heard", "thaws_run", "truth",
        "waits_since",
    )  # fmt: skip

    def __init__(self, fls: Seen, now_s: float) -> None:
        m = fls.machine
        self.fls, self.machine, self.fid, self.incarnation, self.alive = fls, m, m.fid, m.incarnation, True
        self.recent: deque[tuple[Any, ...]] = deque(maxlen=RECENT)  # as Past has them
        # The machine before the present event.
        self.state, self.epoch, self.swarm, self.flying = m.state, m.epoch, m.swarm, m.flying
        self.reach, self.joins, self.anchor = m.reach, m.joins, m.anchor
        self.truth, self.onward = m.truth, m.onward
        self.leases: dict[int, float] = NO_LEASES
        self.pending: tuple[Message, ...] = ()
        self.holders: dict[int, bool] = NO_HOLDERS
        # What only a longer memory knows.
        self.grants: dict[int, set[int]] = {}  # whom it owes a lease -> the challenges they paired in
        self.joined: set[int] = set()  # of these, who joined M aside
        self.acks: dict[int, int] = {}  # challenge -> ACKs to it
        self.newest: dict[
            int, list[int]
        ] = {}  # sender -> [incarnation, newest number, bit k: newest - k was handled]
        self.number = 0  # of its last datagram
        self.first_challenge: int | None = None
        self.challenge_at = -1  # how many challenges after the first one the last one was
        self.taken = True  # it found somebody
        self.complete_ticks = 1 << 30  # since the last probe
        self.origin: Vec3 | None = None  # where the anchor said it was
        self.place: Vec3 = fls.flight.start  # where its last flight ended
        self.reporters: set[int] = set()  # who has told it, in this epoch and swarm, that it is in it, too
        self.flight_s, self.flights = (
            0.0,
            0,
        )  # how long its flights took, and how many, since it began to localize
        self.localizes_since = self.waits_since = now_s
        self.thawed_s = -1e9
        # A handler that takes its time takes up THAWs before whatever is due: how many, how many in a row until now.
        self.thaws_heard = self.thaws_run = 0
        self.thaws_at = 0  # how many when it began to localize

    def thawed(self) -> None:
        """A thaw ends what there was to remember."""
        self.taken, self.complete_ticks = True, 1 << 30

    def note(self, anchors: bool) -> None:
        """The present event is over. anchors: the machine owes leases."""
        m = self.machine
        self.state, self.epoch, self.swarm, self.flying = m.state, m.epoch, m.swarm, m.flying
        self.reach, self.anchor = m.reach, m.anchor
        self.truth, self.onward = m.truth, m.onward
        self.joins = self.incarnation > 0 and m.joins
        self.leases = m.leases.ends() if anchors else NO_LEASES
        self.pending = tuple(m.pending) if m.pending else ()
        self.holders = dict(m.holders) if m.holders else NO_HOLDERS


class Step:
    """One event of one FLS. One object for all: what must be kept is copied."""

    __slots__ = ("actions", "anchors", "cause", "event", "key", "m", "message", "now", "sent", "thaws", "was")

    m: StateMachine
    was: Life
    event: Any
    key: int  # which event, as the table has it
    actions: Sequence[Action]
    sent: Sequence[Message]
    cause: Stamp | None
    now: float
    anchors: bool  # the machine owes leases
    thaws: int  # that the machine obeyed in this event
    message: (
        Message | None
    )  # a datagram that is judged by a rule: no note, not of another epoch, not before the landing


@dataclass(eq=False)
class Facts:
    """What holds for a whole run."""

    plan: Plan
    rules: Rules
    tau: list[float]  # by FID: the most that faults may delay what reaches an FLS, emulated seconds
    handling_s: float  # that an FLS takes for a message
    calm_s: float | None = None  # since when all is well, if there is such a moment
    replaced: bool = False  # some FLS has had a successor
    lives: list[Life | None] = field(default_factory=list)  # by FID: the present incarnation
    misled: frozenset[int] = frozenset()  # FIDs whose sensor the schedule spoils
    single_s: float | None = None  # when, all well, all were first one swarm

    def late_s(self, life: Life) -> float:
        """The most that what is due may be late at an FLS now, if nothing else than faults and THAWs delays it."""
        return self.tau[life.fid] + self.handling_s * (2 + life.thaws_run) + TINY

    def lights(self, now_s: float) -> int:
        """Points of the shape of that moment."""
        change_s = self.rules.change_s
        return self.rules.counts[0 if change_s is None or now_s < change_s else 1]

    @property
    def ids_decide(self) -> bool:
        """Of two Swarm-IDs the lower one always anchors."""
        return self.rules.anchor == "lowest" and self.rules.busy_join != "all" and not self.rules.oracles


class Invariant:
    """One thing that must hold. A check returns what is wrong, in words, or None.

    Nothing is done here: a check is overridden, and asked only at the events or messages that the class names.
    """

    name: ClassVar[str]  # as S3
    title: ClassVar[str]
    guards: ClassVar[str]  # a sentence: what it guards
    on: ClassVar[frozenset[int]] = frozenset()  # keys of the events of a lit FLS that `after` looks at
    on_dark: ClassVar[frozenset[int]] = frozenset()  # and of one that is Deploying
    says: ClassVar[frozenset[int]] = frozenset()  # kinds of messages that `said` looks at
    hears: ClassVar[frozenset[int]] = frozenset()  # and `came`

    def __init__(self, facts: Facts) -> None:
        self.facts = facts
        self.looked = 0  # how often it had something to look at

    def begun(self) -> str | None:
        """The plan stands."""

    def after(self, step: Step) -> str | None:
        """A machine has taken an event."""

    def said(self, step: Step, message: Message) -> str | None:
        """A message is among the actions of an event."""

    def stamped(self, life: Life, message: Message, stamp: Stamp) -> str | None:
        """A datagram is on its way to the air."""

    def came(self, life: Life, message: Message, fate: str) -> str | None:
        """A datagram came to an FLS."""

    def flew(self, life: Life, asked: Vec3, flight: Flight) -> str | None:
        """A flight begins."""

    def finished(self, now_s: float) -> tuple[Life | None, str] | None:
        """The run has come to its end: what is wrong, and with whom."""
