"""One seed, one run: to the last event, in whatever process; and every purpose draws from a stream of its own."""

import os
import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from random import Random

import pytest
from virtual_runs import fly, trace

from swarmer import fls
from swarmer.physics.dead_reckoning import MODELS
from swarmer.streams import stream

ROUGH = {"radio.loss": 0.05, "radio.duplicate": 0.1, "radio.reorder": 0.1, "failure.rate": 0.01}
ELSEWHERE = (
    "import sys; sys.path.insert(0, sys.argv[1]); from virtual_runs import trace; print(trace(seed=3, **{}))"
)


@pytest.mark.parametrize("settings", [{}, ROUGH, {"virtual.handling_ms": 2}], ids=["calm", "rough", "busy"])
def test_the_same_seed_gives_the_same_run_in_any_process(tmp_path, settings):
    here = trace(seed=3, **settings)
    assert trace(seed=3, **settings) == here
    for hash_seed in ("1", "2"):
        done = subprocess.run(
            [sys.executable, "-c", ELSEWHERE.format(settings), str(Path(__file__).parent)],
            cwd=tmp_path, capture_output=True, text=True, env={**os.environ, "PYTHONHASHSEED": hash_seed},
        )  # fmt: skip
        assert done.stdout.strip() == here, done.stderr


def test_whoever_watches_changes_nothing():
    assert trace(**{"recording.rate_hz": 10}) == trace(**{"recording.rate_hz": 3})


@pytest.mark.parametrize(
    "fault",
    [
        {"radio.loss": 1e-12},
        {"radio.duplicate": 1e-12, "radio.reorder": 1e-12},
        {"failure.rate": 1e-9},
        {"failure.battery_s": 1000},
    ],
)
def test_a_fault_that_never_strikes_changes_nothing(fault):
    assert trace(**fault) == trace()


def test_another_seed_or_another_rule_gives_another_run():
    traces = [trace(), trace(seed=2), trace(lambda_ms=400), trace(**{"virtual.latency_max_ms": 1.4})]
    assert len(set(traces)) == 4


class Watched(Random):
    """A stream that remembers what was drawn."""

    def __init__(self, source: Random) -> None:
        super().__init__()
        self.setstate(source.getstate())
        self.drawn: list[float] = []

    def random(self) -> float:
        self.drawn.append(super().random())
        return self.drawn[-1]

    def randbytes(self, n: int) -> bytes:
        """As many numbers at once as `virtual_radio.next_draws` makes of them."""
        before = self.getstate()
        taken = super().randbytes(n)
        self.setstate(before)
        for _ in range(n // 8):
            self.random()
        return taken


def drawn(monkeypatch, **settings):
    """What a run drew: purpose -> (FID, incarnation) -> numbers."""
    found = defaultdict(dict)

    def watched(seed, purpose, fid=0, incarnation=0):
        found[purpose][fid, incarnation] = one = Watched(stream(seed, purpose, fid, incarnation))
        return one

    monkeypatch.setattr(fls, "stream", watched)
    _, watcher = fly(**settings)
    return found, watcher


def test_a_fault_turned_on_leaves_the_streams_of_other_purposes_alone(monkeypatch):
    calm, _ = drawn(monkeypatch)
    rough, _ = drawn(monkeypatch, **ROUGH)
    assert {"flight", "machine", "latency"} <= set(calm)
    assert not {"sender", "receiver", "failure"} & set(calm)
    assert {"sender", "receiver", "failure"} <= set(rough)
    for purpose in calm:
        assert set(calm[purpose]) == {(fid, 0) for fid in range(1, 41)}
        for one, before in calm[purpose].items():
            after = rough[purpose][one].drawn
            shorter = min(len(before.drawn), len(after))
            assert before.drawn[:shorter] == after[:shorter]
    flown = [one.drawn[0] for one in rough["flight"].values() if one.drawn]
    assert len(flown) > 40, "some FLS was replaced"
    assert len(set(flown)) == len(flown), "and a replacement does not repeat its predecessor's draws"


def test_who_fails_when_does_not_depend_on_the_radio():
    settings = {"failure.rate": 0.05, "failure.replace": False, "duration_s": 8}
    calm, rough = (
        [(event.t_s, event.fid) for event in fly(**settings, **radio)[1].events if event.kind == "failure"]
        for radio in ({}, {"radio.loss": 0.2})
    )
    assert len(calm) > 3
    assert calm == rough


@pytest.mark.parametrize("error", ["own", "shared"])
def test_the_first_flight_errs_as_a_process_would(error):
    """By the stream of `fls_process` for the way from the dispatcher, with the same seed; shared: one for all."""
    result, watcher = fly(seed=8, duration_s=3, lambda_ms=600_000, **{"deploy.error": error})
    assert result.counters["localizations"] == 0, "nobody has moved since"
    rules = watcher.plan.rules
    rows = zip(watcher.plan.cloud.points, watcher.samples[-1].position, strict=True)
    for fid, (point, there) in enumerate(rows, 1):
        rng = stream(8, "flight", fid, 0) if error == "own" else stream(8, "flight")
        way = MODELS[rules.dead_reckoning](tuple(point), rules.epsilon, rules.dim, rng)
        assert tuple(there) == pytest.approx(way, abs=1e-9)
