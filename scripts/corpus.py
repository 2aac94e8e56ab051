"""Hostile inputs that between them go everywhere: `corpus.py [--seconds N] [--seed S]`.

Inputs are changed at random, and one that takes a way through the code that none has taken before is kept: a line of
messages, radio, state machine or protocol, the one after it, and the state of the machine (of a datagram, its kind). At
the end those stay that are needed for all the ways, each cut where it takes no more of its own; they are written to
tests/corpus, which the tests replay. With what is there already it begins. Exit status 1, with the input, at the first
that fails.

Two kinds: a datagram, as it comes off the air; and a life, a liar's choices from a machine's launch on (`fuzz.py`).
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from base64 import b85decode, b85encode
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from types import FrameType
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "scripts"))

from fuzz import KEY, mutated, one_life, signed  # noqa: E402
from lone import given  # noqa: E402

from swarmer.messages import BadDatagram, decode, encode  # noqa: E402
from swarmer.protocol import race  # noqa: E402
from swarmer.radio import Ears, ReplayWindow, heard  # noqa: E402

KEPT = ROOT / "tests" / "corpus"
WATCHED = ("messages.py", "radio.py", "state_machine.py", "protocol/")
LIFE_MAX = 400  # messages in a life
BYTES_MAX = 6000  # of a life
COUNT = 9  # FLSs that there are
KEPT_MAX = 60_000  # bytes of a kind, about
MACHINES = tuple(given(state).m for state in ("A", "BA", "BL", "Wl", "W flying", "D"))
Way = tuple[
    str, str, int, int
]  # the machine's state, or the datagram's kind; a file, a line of it, and the next one


class Spent(Exception):
    """There are no more choices."""


class Choices(Random):
    """Draws what is written down: every byte is a choice. Raises Spent at the end."""

    def __init__(self, data: bytes) -> None:
        super().__init__(0)
        self._data, self._at = data, 0

    def _take(self, count: int) -> bytes:
        taken = self._data[self._at : self._at + count]
        self._at += count
        if len(taken) < count:
            raise Spent
        return taken

    def random(self) -> float:
        return self._take(1)[0] / 256

    def getrandbits(self, k: int) -> int:
        return int.from_bytes(self._take(-(-k // 8))) >> -k % 8


def datagram(data: bytes) -> str:
    """What becomes of a datagram, with and without a key: a reason, or words from the radio and from FLSs in any state.

    Raises AssertionError.
    """
    States.last = "not decoded"
    with contextlib.suppress(BadDatagram):
        decode(data, KEY)
        raise AssertionError("without the key it was signed")
    try:
        message, stamp = decode(data)
    except BadDatagram as error:
        return error.reason
    States.last = str(message.kind)
    assert encode(message, stamp) == data
    me = MACHINES[0]
    ears = Ears(stamp.run, me.fid, me.swarm, me.truth, me.beliefs.neighbours)
    window = ReplayWindow()
    assert window.fresh(message.sender, message.incarnation, stamp.number)
    assert not window.fresh(message.sender, message.incarnation, stamp.number), "twice"
    assert heard(message, stamp, ears._replace(run=stamp.run ^ 1), COUNT) == "run"
    words = [heard(message, stamp, ears, COUNT) or "heard"]
    for one in MACHINES:
        verdict = race.judge(message, one, ears.neighbours, True)
        words.append(verdict.word)
        if verdict.reply is not None:
            said = race.answer(message, verdict.reply, one, one.fid, 0, one.truth)
            assert decode(encode(said, stamp))[0] == said
    return " ".join(words)


class States(Counter[str]):
    """Counts the states of a machine, and knows the last one."""

    last = "DEPLOYING"

    def __setitem__(self, state: str, count: int) -> None:
        States.last = state
        super().__setitem__(state, count)


def life(data: bytes) -> str:
    """The states that a machine was in. Raises what `fuzz.one_life` does."""
    states, States.last = States(), "DEPLOYING"
    with contextlib.suppress(Spent):
        one_life(Choices(data), LIFE_MAX, states)
    return " ".join(sorted(states))


class Ways:
    """Watches which ways through the watched files are taken."""

    def __init__(self) -> None:
        self.taken: set[Way] = set()
        self._names: dict[str, str] = {}

    def of(self, play: Callable[[bytes], object], data: bytes) -> set[Way]:
        """Those that an input takes."""
        self.taken = set()
        sys.settrace(self._call)
        try:
            play(data)
        finally:
            sys.settrace(None)
        return self.taken

    def _call(self, frame: FrameType, event: str, argument: Any) -> Any:
        path = frame.f_code.co_filename
        name = self._names.get(path)
        if name is None:
            inner = path.rpartition("swarmer/")[2] if "/swarmer/" in path else ""
            name = self._names[path] = inner if inner.startswith(WATCHED) else ""
        if not name:
            return None
        last = [-frame.f_lineno]

        def line(frame: FrameType, event: str, argument: Any) -> Any:
            if event == "line":
                self.taken.add((States.last, name, last[0], frame.f_lineno))
                last[0] = frame.f_lineno
            return line

        return line


class Kind(NamedTuple):
    """A kind of input: its file, what plays it, and what one begins with."""

    name: str
    play: Callable[[bytes], str]
    seeds: Callable[[Random], Iterator[bytes]]


def first_datagrams(rng: Random) -> Iterator[bytes]:
    """Whole ones, broken ones, signed ones."""
    for _ in range(60):
        yield bytes(signed(rng, b""))
        yield mutated(rng, signed(rng, b""))
    yield mutated(rng, signed(rng, KEY))


def first_lives(rng: Random) -> Iterator[bytes]:
    """Any choices."""
    for _ in range(20):
        yield rng.randbytes(1500)


KINDS = (Kind("datagrams", datagram, first_datagrams), Kind("lives", life, first_lives))


def changed(rng: Random, data: bytes, other: bytes) -> bytes:
    """The input with something in it set, taken out, put in, said twice, or from another one."""
    found = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        at, length = rng.randrange(len(found) + 1), rng.choice((1, 1, 2, 8, 40))
        how = rng.randrange(6)
        if how <= 1 and at < len(found):
            found[at] = (
                rng.choice((0, 1, 255, rng.randrange(256))) if how else found[at] ^ 1 << rng.randrange(8)
            )
        elif how == 2:
            del found[at : at + length]
        elif how == 3:
            found[at:at] = rng.randbytes(length)
        elif how == 4:
            found[at:at] = found[at : at + length]
        else:
            there = rng.randrange(len(other) + 1)
            found[at:] = other[there:]
    return bytes(found[:BYTES_MAX])


def kept(kind: Kind) -> list[bytes]:
    """The inputs of a kind in the corpus."""
    path = KEPT / f"{kind.name}.txt"
    return [b85decode(line) for line in path.read_text("ascii").splitlines()] if path.exists() else []


def grow(kind: Kind, rng: Random, seconds: float) -> dict[bytes, set[Way]]:
    """Inputs that each took a way of their own when they came, with all their ways."""
    ways, known, found = Ways(), set[Way](), {}
    until, played = time.process_time() + seconds, 0

    def offer(data: bytes) -> None:
        nonlocal played
        played += 1
        try:
            taken = ways.of(kind.play, data)
        except Exception as error:
            raise SystemExit(f"{kind.name}: {type(error).__name__}: {error}: {data.hex()}") from error
        if taken - known:
            known.update(taken)
            found[data] = taken

    for data in (*kept(kind), *kind.seeds(rng)):
        offer(data)
    while time.process_time() < until:
        pool = list(found)
        for _ in range(200):
            offer(changed(rng, rng.choice(pool), rng.choice(pool)))
    print(f"{kind.name}: {played:,} played, {len(known)} ways, {len(found)} inputs kept", flush=True)
    return found


def needed(kind: Kind, found: dict[bytes, set[Way]]) -> list[bytes]:
    """As few and as short inputs as greed finds that take all the ways between them."""
    ways, missing, chosen = Ways(), set().union(*found.values()), set()
    while missing and sum(map(len, chosen)) < KEPT_MAX:
        best = max(found, key=lambda data: (len(found[data] & missing) / (len(data) + 20), data))
        own, (short, long) = found[best] & missing, (0, len(best))
        while kind.name == "lives" and long - short > 1:  # a life goes the same way as far as it goes
            middle = (short + long) // 2
            short, long = (short, middle) if own <= ways.of(kind.play, best[:middle]) else (middle, long)
        chosen.add(best[:long])
        missing -= own
    return sorted(chosen, key=lambda data: (len(data), data))


def main(arguments: list[str]) -> int:
    """The exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--seconds", type=float, default=60.0, help="of processor time, for each kind (default 60)"
    )
    parser.add_argument("--seed", type=int, default=1, help="of all that is drawn (default 1)")
    parser.add_argument(
        "--only", choices=[kind.name for kind in KINDS], help="look for inputs of this kind alone"
    )
    options = parser.parse_args(arguments)
    KEPT.mkdir(exist_ok=True)
    for kind in KINDS:
        if options.only not in (None, kind.name):
            continue
        chosen = needed(kind, grow(kind, Random(f"{kind.name} {options.seed}"), options.seconds))
        text = "".join(f"{b85encode(data).decode()}\n" for data in chosen)
        (KEPT / f"{kind.name}.txt").write_text(text, "ascii")
        print(f"{kind.name}: {len(chosen)} inputs, {len(text):,} bytes")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
