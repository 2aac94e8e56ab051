"""A stranger on the machine sends to the FLSs of a run, over real UDP: forged, broken, copied datagrams, and floods.

With `radio.mac` nothing of it changes anything, and all of it is counted. Without, what is not of this run is refused
all the same; what is made to look as if it were is believed, which one test shows, so that the others could fail.
"""

import contextlib
import itertools
import json
import time
from random import Random

import numpy as np
import pytest
from helpers import start
from stranger import Stranger, broken, forged, free_port, lie, run_of

POINTS = 10
# Nobody thaws by himself, so whoever has thawed has obeyed a stranger.
QUIET = ["--shape", "random", "--points", str(POINTS), "--no-recording", "--set", "thaw.policy=off"]


def beset(tmp_path, attack, *more, duration=6, port=None):
    """A run, and what `attack(stranger, its first broadcast)` does to it; its summary and all its counters."""
    port = port or free_port()
    stranger = Stranger(port)
    out = tmp_path / f"run-{len(list(tmp_path.iterdir()))}"
    process = start(
        *QUIET,
        "--duration",
        str(duration),
        "--set",
        f"radio.port={port}",
        "--out",
        str(out),
        *more,
        cwd=tmp_path,
    )
    try:
        attack(stranger, stranger.wait_for_a_word())
        _, err = process.communicate(timeout=120)
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        stranger.close()
    assert process.returncode == 0, err
    summary = json.loads((out / "summary.json").read_text())
    with np.load(out / "timeline.npz") as data:
        totals = dict(zip(data["series_name"].tolist(), data["series"][-1], strict=True))
        swarms = set(data["swarm"].ravel().tolist())
    return summary, totals, swarms, stranger.sent


def spread(stranger, words, each=40, pause_s=0.03):
    """Say `each` words to every FLS, some at a time."""
    for _ in range(each):
        for fid in range(1, POINTS + 1):
            stranger.say(fid, next(words))
        time.sleep(pause_s)


def unharmed(summary):
    assert summary["status"] == "done"
    assert summary["swarms_last"] == 1
    assert summary["lit_share"] == 1
    assert summary["thawed_flss"] == 0
    assert summary["failures"] == 0


def test_with_the_mac_no_forged_datagram_changes_anything(tmp_path):
    rng = Random("forged")

    def attack(stranger, word):
        numbers = itertools.cycle((1, 2**31, 2**32 - 1, 0, 77))
        spread(stranger, (forged(rng, run_of(word), POINTS, next(numbers), word) for _ in itertools.count()))

    summary, _, swarms, sent = beset(tmp_path, attack, "--set", "radio.mac=true")
    unharmed(summary)
    assert sent == 40 * POINTS
    assert summary["rejected"] + summary["dropped_by_kernel"] == sent
    assert swarms <= set(range(POINTS + 1))


def test_without_the_mac_what_is_not_of_this_run_is_refused(tmp_path):
    rng = Random("broken")

    def attack(stranger, word):
        run = run_of(word)

        def words():
            for number in itertools.count():
                yield rng.choice(
                    (broken(rng, word), lie(rng, run ^ 1, POINTS, number), lie(rng, 0, POINTS, number))
                )

        spread(stranger, words())

    summary, _, _, sent = beset(tmp_path, attack)
    unharmed(summary)
    assert summary["rejected"] + summary["dropped_by_kernel"] == sent


def test_without_the_mac_a_liar_who_knows_the_run_is_believed(tmp_path):
    """What `radio.mac` is for; and that the attack of the other tests is one."""
    rng = Random("believed")

    def attack(stranger, word):
        run = run_of(word)
        spread(stranger, (lie(rng, run, POINTS, number) for number in itertools.count(1000)))

    summary, _, _, sent = beset(tmp_path, attack)
    assert summary["status"] == "done"
    assert summary["thawed_flss"] > 0
    assert summary["rejected"] < sent / 2


@pytest.mark.parametrize("mac", ["true", "false"])
def test_what_was_said_before_is_not_believed_again(tmp_path, mac):
    """A capture sent again, first to the same run, then to the next one, on the same port."""
    port, capture = free_port(), []
    wires = ["--set", f"radio.mac={mac}", "--set", "radio.carrier=broadcast"]

    def again(stranger, word):
        """Whatever is heard, at once to everybody."""
        until = time.monotonic() + 3.0
        capture.append(word)
        while time.monotonic() < until:
            for data in stranger.heard():
                capture.append(data)
                for fid in range(1, POINTS + 1):
                    stranger.say(fid, data)
            time.sleep(0.005)

    summary, totals, _, sent = beset(tmp_path, again, *wires, port=port)
    unharmed(summary)
    assert len(capture) > 2 * POINTS, "as many as a busy machine comes to in these seconds"
    assert summary["rejected"] <= len(capture), "each FLS refuses its own alone"
    assert totals["replayed"] + totals["not_addressed"] + summary["rejected"] > 0.8 * (
        sent - summary["dropped_by_kernel"]
    )

    def later(stranger, word):
        assert run_of(word) != run_of(capture[0])
        spread(stranger, itertools.cycle(capture))

    summary, totals, _, sent = beset(tmp_path, later, *wires, port=port)
    unharmed(summary)
    assert summary["rejected"] + summary["dropped_by_kernel"] == sent
    assert totals["replayed"] == 0


FLOOD_S = 1.0  # wall seconds, as fast as one process can send


def flood(stranger, words, targets):
    """All that one process can send to some FLSs; gives how often all `words` were said."""
    until = time.monotonic() + FLOOD_S
    while time.monotonic() < until:
        for word in words:
            for fid in targets:
                stranger.say(fid, word)


def test_a_flood_is_refused_and_the_run_goes_on(tmp_path):
    rng = Random("flood")

    def attack(stranger, word):
        time.sleep(1.0)  # into the making of the swarm
        flood(stranger, [forged(rng, run_of(word), POINTS, n, word) for n in range(200)], (1, 5, 9))

    summary, _, _, sent = beset(tmp_path, attack, "--set", "radio.mac=true")
    unharmed(summary)
    assert sent > 5000, "no flood"
    assert summary["rejected"] <= sent
    assert summary["rejected"] + summary["dropped_by_kernel"] >= sent, (
        "a full queue drops friends' words, too"
    )
    assert summary["handled_late_ms"]["p99"] > 0, "what it did to the others is told"
