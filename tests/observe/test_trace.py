"""The event log: what is in it fits the run, and itself."""

import gzip
import json
from collections import Counter
from types import SimpleNamespace

import pytest

from swarmer.config import load_config
from swarmer.engines.result import RunResult
from swarmer.engines.virtual import VirtualEngine
from swarmer.errors import BadInput
from swarmer.observe import files
from swarmer.observe.files import Stream
from swarmer.observe.trace import Tracer, fids_named
from swarmer.observe.trace_file import is_record
from swarmer.plan import make_plan

ROUGH = {
    "shape": "sphere", "points": 30, "duration_s": 9, "radio.loss": 0.1, "radio.duplicate": 0.1, "failure.rate": 0.02,
    "thaw.policy": "timer",
}  # fmt: skip
UNWATCHED = SimpleNamespace(
    planned=lambda plan: None, launching=lambda ready, total: None, go=lambda launch_s: None,
    sample=lambda snapshot: False, event=lambda event: None,
)  # fmt: skip


def traced(path, fids=None, **settings) -> tuple[RunResult, list[dict]]:
    """A run and its records."""
    plan = make_plan(load_config(None, (), **{**ROUGH, **settings}))
    tracer = Tracer(plan, fids)
    stream = Stream(path / "trace.jsonl.gz")
    tracer.open(stream)
    with VirtualEngine(plan, [tracer]) as engine:
        result = engine.run(UNWATCHED)
    tracer.close(result)
    stream.close()
    with gzip.open(path / "trace.jsonl.gz", "rt") as file:
        return result, [json.loads(line) for line in file]


@pytest.fixture(scope="module")
def rough(tmp_path_factory):
    return traced(tmp_path_factory.mktemp("rough"))


@pytest.fixture(scope="module")
def slow(tmp_path_factory):
    """Handlers take time, measurements too, and the radio holds datagrams back."""
    settings = {"virtual.handling_ms": 3.0, "radio.delay_ms": 4, "sensing.samples": 3, "sensing.sample_ms": 5}
    return traced(tmp_path_factory.mktemp("slow"), **settings)


@pytest.mark.parametrize("name", ["rough", "slow"])
def test_it_counts_what_the_run_counts(name, request):
    result, records = request.getfixturevalue(name)
    kinds = Counter(record.get("is") for record in records)
    fates = Counter(record["fate"] for record in records if record.get("is") == "heard")
    handled = [record for record in records if record.get("is") == "handled"]
    lost = sum(record.get("copies") == 0 for record in records)
    counters = result.counters
    assert kinds["sent"] == counters["datagrams_sent"]
    assert lost + fates["lost"] == counters["datagrams_lost"]
    assert kinds["made"] == 30 + counters["replacements"]
    assert kinds["ended"] == counters["failures"] > 0
    if name == "rough":  # who is busy notes a datagram as queued, and that it was handled later
        judged = sum("xi" in record for record in handled) + sum(
            fates[f] for f in ("answered", "noted", "dropped")
        )
        assert judged == counters["datagrams_delivered"]
    assert sum(r["event"] == "measured" and "after" in r for r in handled) == counters["localizations"]
    assert sum(r["event"] == "thaw due" and "after" in r for r in handled) >= 1


@pytest.mark.parametrize("name", ["rough", "slow"])
def test_every_record_is_one_and_each_state_follows_from_the_one_before(name, request):
    _, (header, *records, end) = request.getfixturevalue(name)
    assert header["swarmer_trace"] == 1
    assert (end["is"], end["status"], end["t"]) == ("end", "done", 9.0)
    assert [record["t"] for record in records] == sorted(record["t"] for record in records)
    state = {}
    for record in records:
        assert is_record(record), record
        if record["is"] == "made":
            state.pop(record["fid"], None)
        elif record["is"] == "handled":
            assert record["before"] == state.get(record["fid"], record["before"]), record
            state[record["fid"]] = record.get("after", record["before"])
    assert len(state) == 30


@pytest.mark.parametrize("name", ["rough", "slow"])
def test_every_cause_was_sent_before_and_every_effect_names_its_cause(name, request):
    _, records = request.getfixturevalue(name)
    sent_at = {}
    for record in records[1:-1]:
        if record["is"] == "sent":
            assert record["message"] not in sent_at, "an id is given once"
            assert record["message"].startswith(f"{record['fid']}.")
            sent_at[record["message"]] = record["t"]
            assert "event" in record
        for cause in (record.get("cause"), record.get("message"), *record.get("judged", ())):
            if cause and not cause.startswith("0."):
                assert sent_at[cause] <= record["t"], record
        if record["is"] == "sent" and record["kind"] in ("ACCEPT", "ACK", "NEIGHBOUR", "CANCEL", "FIN"):
            assert "cause" in record, record
        if record["is"] == "handled" and record["event"] == "measured" and "after" in record:
            assert "cause" in record, record


def test_what_waited_in_flight_is_judged_at_a_landing(rough):
    waits, judged = set(), set()
    for record in rough[1]:
        if record.get("why") == "waits for the landing":
            waits.add((record["fid"], record["cause"]))
        for name in record.get("judged", ()):
            assert (record["fid"], name) in waits
            judged.add((record["fid"], name))
    assert judged
    died = {record["fid"] for record in rough[1] if record.get("is") == "ended"}
    assert len({fid for fid, _ in waits - judged} - died) <= 5, "only what still waits at the end"


@pytest.mark.parametrize("policy", ["timer", "roster"])
def test_a_log_of_some_holds_what_the_whole_one_says_of_them(tmp_path, policy):
    """Also where another FLS takes something up between the queue and the handler."""
    chosen = frozenset((3, 17, 30))
    (tmp_path / "all").mkdir()
    _, everybody = traced(tmp_path / "all", **{"thaw.policy": policy})
    _, records = traced(tmp_path, chosen, **{"thaw.policy": policy})
    assert records[0]["fids"] == [3, 17, 30]
    assert records[1:] == [r for r in everybody[1:] if r.get("fid") in chosen or r["is"] == "end"]


def test_tracing_changes_nothing(rough):
    plan = make_plan(load_config(None, (), **ROUGH))
    with VirtualEngine(plan) as engine:
        assert engine.run(UNWATCHED).extra["trace_sha256"] == rough[0].extra["trace_sha256"]


def test_a_full_disk_ends_the_run_and_says_so(tmp_path, monkeypatch):
    calls = []

    def full(fd, data):
        calls.append(len(data))
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(files, "write_bytes", full)
    plan = make_plan(load_config(None, (), **{**ROUGH, "duration_s": 60}))
    tracer = Tracer(plan)
    tracer.open(Stream(tmp_path / "trace.jsonl.gz"))
    with VirtualEngine(plan, [tracer]) as engine:
        result = engine.run(UNWATCHED)
    tracer.close(result)
    assert result.status == "failed"
    assert "trace.jsonl.gz: No space left on device" in result.message
    assert result.emulated_s < 60
    assert len(calls) == 1


@pytest.mark.parametrize("text", ["", "0", "31", "1-", "4-2", "1,,2", "x", "1-31", "1e1", "٣", "-1", "1 2"])
def test_fids_that_are_none(text):
    with pytest.raises(BadInput, match=r"trace-fids: .* 1 to 30, as 17,40-60"):
        fids_named(text, 30)
