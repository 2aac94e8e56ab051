"""Hostile input by the million: `fuzz.py [--seed S] [--decoder N] [--mac N] [--machine N]`.

decoder: mutated and random datagrams; each is refused for a reason that is counted, or is exactly what it says. mac:
forged ones of a run with a key; none gets past. machine: any message that can be decoded, in any state of a state
machine, between the timers and landings of a right engine; it never raises, and its books stay in order. The counts
that were run are printed; exit status 1, with the seed and the input, at the first that fails.
"""

from __future__ import annotations

import argparse
import math
import struct
import sys
import time
from collections import Counter
from pathlib import Path
from random import Random

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests" / "simulation"))

from lone import machine  # noqa: E402

from swarmer.messages import (  # noqa: E402
    ALL_FLAGS,
    LARGEST,
    MAC_BYTES,
    REASONS,
    SIZE,
    SWARM_KINDS,
    BadDatagram,
    Kind,
    Message,
    Stamp,
    Swarm,
    To,
    decode,
    encode,
)  # fmt: skip
from swarmer.protocol.events import Arm, Depart, Disarm, Due, Fly, Landed, Launch, Measure, Measured, Received  # noqa: E402
from swarmer.state_machine import State, StateMachine  # noqa: E402

KEY, ANOTHER = b"of this run", b"of another run"
SPECIAL = (math.nan, math.inf, -math.inf, 1e300, -1e300, -1.0, 5e-324)
LIFE = 2_000  # events of one machine; then another one, under other rules
RULES = (
    {}, {"m": 2}, {"busy_join": "all"}, {"busy_join": "off", "neighbour_reply": False},
    {"epochs": False, "thaw_repeat": 0.5}, {"challenge_on_available": True, "accept_gap_s": 0.02},
)  # fmt: skip


def any_message(rng: Random, epoch: int = 0) -> Message:
    """A message that the decoder lets pass, as a liar would make it."""
    edge = (0.0, 1.0, -3.5, LARGEST, -LARGEST, 1e-300)

    def vector() -> tuple[float, float, float]:
        return (rng.choice(edge), rng.uniform(-50.0, 50.0), rng.choice(edge))

    def swarm() -> Swarm:
        return Swarm(rng.choice((1, 3, 5, 7, 8, 9, 2**32 - 1)), rng.choice((0, 0, 1, 65535)))

    kind = rng.choice([kind for kind in Kind if kind != Kind.CONTROL])
    sender = rng.choice((2, 3, 4, 7, 8, 9, 2**32 - 1))
    return Message(
        int(kind), sender, rng.choice((0, 0, 1, 65535)), max(0, epoch + rng.choice((0, 0, 0, 1, -1, 2**31))), swarm(),
        rng.choice((0, 1, 7, 2**32 - 1)), vector(), int(rng.choice(list(To))), swarm(), rng.randint(0, ALL_FLAGS),
        rng.choice((0, 1, 77, 2**32 - 1)), rng.choice((0.0, 30.0, LARGEST)), swarm(), vector(),
    )  # fmt: skip


def fitting(rng: Random, m: StateMachine) -> Message:
    """Nearly the next step of what is going on: so a liar gets into every state."""
    said = any_message(rng)
    kinds = [Kind.CHALLENGE_INIT, Kind.CHALLENGE_FIN, Kind.LEASE_RENEW, Kind.LEASE_CANCEL, *SWARM_KINDS]
    kinds += [Kind.CHALLENGE_ACK] * 8 if m.accepts else []
    kinds += [Kind.CHALLENGE_ACCEPT] * 8 if m.challenge else []
    kind = rng.choice(kinds)
    sender = rng.choice(
        sorted(m.accepts) if kind == Kind.CHALLENGE_ACK else sorted(m.leases.ends()) or [2, 3, 7, 8]
    )
    noted = m.accepts.get(sender)
    return said._replace(
        kind=int(kind), sender=sender, incarnation=0, epoch=m.epoch, truth=(1.0, 2.0, 0.0), vector=(1.0, 0.0, 0.0),
        swarm=m.swarm if kind in SWARM_KINDS else Swarm(sender, 0), range=30.0,
        challenge=noted.challenge if noted and kind == Kind.CHALLENGE_ACK else m.challenge or 1,
    )  # fmt: skip


def signed(rng: Random, key: bytes) -> bytearray:
    stamp = Stamp(rng.getrandbits(32), rng.getrandbits(32), (0.0, 1.0, 2.0), rng.uniform(0.0, 99.0))
    return bytearray(encode(any_message(rng), stamp, key))


def mutated(rng: Random, data: bytearray) -> bytes:
    """Bits turned, cut, made longer, numbers that are none, or nothing but noise."""
    how = rng.randrange(6)
    if how == 0:
        return rng.randbytes(rng.choice((0, 1, SIZE - 1, SIZE, SIZE + MAC_BYTES, 201, 1472)))
    if how == 1:
        return bytes(data[: rng.randrange(len(data))])
    if how == 2:
        return bytes(data) + rng.randbytes(rng.randint(1, 60))
    if how == 3:
        struct.pack_into("!d", data, len(data) - 8 * rng.randint(1, 11), rng.choice(SPECIAL))
        return bytes(data)
    for _ in range(rng.randint(1, 4) if how == 4 else 1):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(data)


def decoder(rng: Random, count: int) -> str:
    """What became of so many broken datagrams."""
    fates: Counter[str] = Counter()
    for _ in range(count):
        data = mutated(rng, signed(rng, b""))
        try:
            message, stamp = decode(data)
        except BadDatagram as error:
            fates[error.reason] += 1
        else:
            numbers = (*message.truth, *message.vector, *stamp.origin, message.range)
            assert all(abs(number) <= LARGEST for number in numbers), data.hex()
            assert encode(message, stamp) == data, data.hex()
            fates["well-formed"] += 1
    assert set(fates) <= {*REASONS, "well-formed"}, fates
    return ", ".join(f"{fate} {number:,}" for fate, number in fates.most_common())


def mac(rng: Random, count: int) -> str:
    """So many forged datagrams; raises AssertionError at the first that passes."""
    for _ in range(count):
        true = signed(rng, KEY)
        forged = rng.choice((
            mutated(rng, bytearray(true)),
            bytes(signed(rng, ANOTHER)),
            bytes(signed(rng, b"")) + bytes(MAC_BYTES),
            bytes(signed(rng, b"")) + bytes(true[SIZE:]),
            bytes(signed(rng, b"")),
        ))  # fmt: skip
        if forged == true:
            continue
        try:
            decode(forged, KEY)
        except BadDatagram:
            continue
        raise AssertionError(f"a forged datagram passed: {forged.hex()}")
    return "none passed"


def one_life(rng: Random, count: int, states: Counter[str]) -> int:
    """A machine from its launch on, through so many hostile messages; events in all."""
    m, now, armed = (
        machine(seed=rng.randrange(10), incarnation=rng.choice((0, 1)), **rng.choice(RULES)),
        0.0,
        {},
    )
    flying = measuring = gone = False
    events, messages, event = 0, 0, Launch((0.0, 0.0, -3.0))
    while not gone:
        for action in m.handle(event, now):
            if isinstance(action, Arm):
                armed[action.timer] = action.at_s
            elif isinstance(action, Disarm):
                del armed[action.timer]
            elif isinstance(action, Fly):
                assert not flying, event
                assert all(map(math.isfinite, action.vector)), event
                flying = True
            elif isinstance(action, Measure):
                measuring = True
            gone = gone or isinstance(action, Depart)
        events += 1
        states[m.state.name] += 1
        assert gone or (m.state is State.BUSY_ANCHOR) == (len(m.leases) > 0), event
        if messages >= count:
            break
        now += rng.choice((0.0, 0.0, 0.001, 0.05))
        what = rng.random()
        if flying and what < 0.1:
            flying, event = False, Landed()
        elif measuring and what < 0.2:
            measuring, event = False, Measured((rng.uniform(-9.0, 9.0), 0.0, 0.0))
        elif armed and what < 0.3:
            due = min(armed, key=armed.__getitem__)
            now, event = max(now, armed.pop(due)), Due(due)
        else:
            messages += 1
            said = fitting(rng, m) if m.awake and rng.random() < 0.7 else any_message(rng, m.epoch)
            event = Received(said._replace(addressee=Swarm(5, 0)))
    return events


def machines(rng: Random, count: int) -> str:
    """State machines through so many hostile messages."""
    states: Counter[str] = Counter()
    lives = [one_life(rng, min(LIFE, count - at), states) for at in range(0, count, LIFE)]
    often = ", ".join(f"{state} {number:,}" for state, number in states.most_common())
    return f"{len(lives):,} machines, {sum(lives):,} events: {often}"


PARTS = {"decoder": (decoder, 1_000_000), "mac": (mac, 100_000), "machine": (machines, 200_000)}


def main(arguments: list[str]) -> int:
    """The exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seed", type=int, default=1, help="of all that is drawn (default 1)")
    for name, (_, count) in PARTS.items():
        parser.add_argument(f"--{name}", type=int, default=count, help=f"how many (default {count:,})")
    options = parser.parse_args(arguments)
    for name, (part, _) in PARTS.items():
        count, began = getattr(options, name), time.process_time()
        try:
            found = part(Random(f"{name} {options.seed}"), count)
        except Exception as error:
            print(f"{name}: FAILED with --seed {options.seed}: {type(error).__name__}: {error}")
            return 1
        print(
            f"{name}: {count:,} inputs in {time.process_time() - began:.1f} s of processor time: {found}",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
