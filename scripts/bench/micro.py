"""What the smallest pieces cost, in µs: the wire format, the radio's rules, one event of the state machine, a slot."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from statistics import median

from bench.tables import median_of, show
from swarmer.config import load_config
from swarmer.messages import Kind, Message, Stamp, Swarm, To, decode, encode
from swarmer.physics.flight import Flight
from swarmer.plan import Plan, make_machine, make_plan
from swarmer.protocol import race
from swarmer.protocol.events import Due, Event, Landed, Launch, Received, Timer
from swarmer.radio import Ears, Grid, ReplayWindow, heard
from swarmer.state_machine import Identity, StateMachine
from swarmer.streams import stream
from swarmer.telemetry import Row, SharedMemory, Slot
from swarmer.udp_wrapper import UdpWrapper, Wires, lock_port

LOOP_S = 0.02  # one measurement lasts about so long
CYCLES = 400  # lives of the state machine in one measurement
KEY = bytes(16)


def run(repeat: int) -> None:
    """Print the table."""
    plan = make_plan(load_config(None, [], shape="sphere", points=100))
    with ExitStack() as stack:
        pieces = [*wire(plan), *radio(plan), *slot(stack), *tune(plan, stack)]
        rows = [(name, median_of(repeat, lambda act=act: per_call(act)), what) for name, act, what in pieces]
    rows += [(f"handle {name}", cost, what) for name, what, cost in handle(plan, repeat)]
    show("micro: µs per call", ("", "µs", "what it is"), rows, ["one process, warm; median of the repeats"])


def per_call(act: Callable[[], object]) -> float:
    """µs per call, by a loop of some hundredths of a second; the loop's own cost taken off."""
    count = 64
    while True:
        took = loop_s(act, count)
        if took > LOOP_S / 2:
            return 1e6 * max(0.0, took - loop_s(nothing, count)) / count
        count *= 4


def loop_s(act: Callable[[], object], count: int) -> float:
    began = time.perf_counter()
    for _ in range(count):
        act()
    return time.perf_counter() - began


def nothing() -> None:
    """What an empty call costs."""


Piece = tuple[str, Callable[[], object], str]


def init(plan: Plan, sender: int = 2, swarm: Swarm | None = None) -> tuple[Message, Stamp]:
    """A challenge from a neighbour of FLS 1."""
    grid = Grid.for_display(plan.diagonal_cells)
    truth = point(plan, sender)
    message = Message(
        Kind.CHALLENGE_INIT,
        sender,
        0,
        0,
        swarm or Swarm(sender, 0),
        1,
        truth,
        To.ALL,
        challenge=1,
        range=50.0,
    )
    return message, Stamp(7, 1, truth, 1.0, grid.of(truth), grid.reach2(message.range))


def point(plan: Plan, fid: int) -> tuple[float, float, float]:
    x, y, z = plan.cloud.points[fid - 1].tolist()
    return (x, y, z)


def wire(plan: Plan) -> Iterator[Piece]:
    message, stamp = init(plan)
    plain, signed = encode(message, stamp), encode(message, stamp, KEY)
    yield "encode", lambda: encode(message, stamp), f"message to {len(plain)} bytes"
    yield "encode, MAC", lambda: encode(message, stamp, KEY), f"and sign it: {len(signed)} bytes"
    yield "decode", lambda: decode(plain), "and check it"
    yield "decode, MAC", lambda: decode(signed, KEY), "and check its signature"


def radio(plan: Plan) -> Iterator[Piece]:
    message, stamp = init(plan)
    ears = Ears(7, 1, Swarm(1, 0), point(plan, 1), frozenset(plan.neighbours.neighbours[0]))
    other = message._replace(kind=Kind.SET_WAITING, to=To.SWARM, addressee=Swarm(99, 0))
    machine = make_fls(plan)
    window = ReplayWindow()
    numbers = iter(range(1, 1 << 40))
    yield "heard, yes", lambda: heard(message, stamp, ears, 100), "a challenge in range"
    yield "heard, no", lambda: heard(other, stamp, ears, 100), "for another swarm"
    yield "ReplayWindow.fresh", lambda: window.fresh(2, 0, next(numbers)), "a new number"
    yield (
        "race.judge",
        lambda: race.judge(message, machine, machine.beliefs.neighbours, True),
        "queue, drop or answer",
    )


def slot(stack: ExitStack) -> Iterator[Piece]:
    shared = SharedMemory(1)
    mine = Slot(shared, 1)
    row = Row(0, 0, 1, 0, 1, True, False, Flight((1.0, 2.0, 3.0), (0.0, 0.0, 0.0), 0.0, 0.0, 0.0))
    yield "publish", lambda: mine.publish(row), "write the shared-memory slot"


def tune(plan: Plan, stack: ExitStack) -> Iterator[Piece]:
    """Take another Swarm-ID: patch the filter and attach it to both sockets."""
    lock = stack.enter_context(lock_port(0))
    ears = Ears(7, 1, Swarm(1, 0), point(plan, 1), frozenset(plan.neighbours.neighbours[0]))
    shared = SharedMemory(100)
    grid = Grid.for_display(plan.diagonal_cells)
    udp = UdpWrapper(ears, shared.directory(), Wires(lock.getsockname()[1]), grid, (2, 3), (2.0, 3.0))
    stack.callback(udp.close)
    both = [ears, ears._replace(swarm=Swarm(2, 0))]
    turns = iter(range(1 << 40))
    filtered = "kernel filter on both sockets" if udp.wires.kernel_filter else "no kernel filter here"
    yield "tune", lambda: udp.tune(both[next(turns) & 1]), filtered


# -- the state machine -----------------------------------------------------------------------------------------------


def make_fls(plan: Plan) -> StateMachine:
    """FLS 1, landed and Available."""
    machine = make_machine(
        plan.rules, Identity(1, 0, point(plan, 1)), plan.neighbours.neighbours[0],
        float(plan.neighbours.reach_cells[0]), stream(1, "bench"),
    )  # fmt: skip
    machine.handle(Launch((0.0, 0.0, 0.0)), 0.0)
    machine.handle(Landed(), 1.0)
    return machine


def life(plan: Plan, machine: StateMachine, now: float) -> Iterator[tuple[str, str, Event]]:
    """A round of events that ends where it began, Available; each with a name and words."""
    base, _ = init(plan, 2, Swarm(2, 0))
    epoch, mine = machine.epoch, machine.swarm
    base = base._replace(epoch=epoch)
    to_me = base._replace(to=To.FLS, addressee=Swarm(1, 0))
    to_us = base._replace(to=To.SWARM, addressee=mine)
    neighbour = plan.neighbours.neighbours[0][0]
    yield "INIT", "another swarm: accept", Received(base)
    yield "INIT, own swarm", "a neighbour's: NEIGHBOUR", Received(base._replace(sender=neighbour, swarm=mine))
    yield "ACK", "become Busy Anchor", Received(to_me._replace(kind=Kind.CHALLENGE_ACK, other=mine))
    yield "LEASE_RENEW", "grant anew", Received(to_me._replace(kind=Kind.LEASE_RENEW))
    yield "FIN", "Available, tell the swarm", Received(to_me._replace(kind=Kind.CHALLENGE_FIN))
    yield "SET_WAITING", "Waiting", Received(to_us._replace(kind=Kind.SET_WAITING))
    yield "SET_AVAILABLE", "Available", Received(to_us._replace(kind=Kind.SET_AVAILABLE))
    yield "challenge due", "a tick of the timer", Due(Timer.CHALLENGE)
    follow = to_us._replace(kind=Kind.FOLLOW_MERGE, other=mine, vector=(1.0, 0.0, 0.0))
    yield "FOLLOW_MERGE", "take off", Received(follow)
    yield "landed", "Available", Landed()
    yield "THAW", "the next epoch", Received(base._replace(kind=Kind.THAW, epoch=epoch + 1))


def handle(plan: Plan, repeat: int) -> Iterator[tuple[str, str, float]]:
    """µs of `StateMachine.handle` for each event of that life."""
    machine = make_fls(plan)
    costs: dict[str, list[float]] = defaultdict(list)
    words: dict[str, str] = {}
    own = clock_cost_ns()
    now = 1.0
    for _ in range(CYCLES * max(1, repeat)):
        for name, what, event in life(plan, machine, now):
            now += 0.001
            began = time.perf_counter_ns()
            machine.handle(event, now)
            costs[name].append(time.perf_counter_ns() - began - own)
            words[name] = what
        now += 1.0
    for name, found in costs.items():
        yield name, words[name], max(0.0, median(found)) / 1e3


def clock_cost_ns() -> float:
    """What reading the clock twice costs."""
    found = []
    for _ in range(1000):
        began = time.perf_counter_ns()
        found.append(time.perf_counter_ns() - began)
    return median(found)
