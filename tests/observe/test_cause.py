"""From symptom to cause: where HD rose, whose vector was flown, and what `cause.html` says of it."""

import json
import re
import shutil
import signal
from html import unescape

import numpy as np
import pytest
from click.testing import CliRunner

from swarmer.cli import load
from swarmer.errors import BadInput
from swarmer.observe.cause import cause_of
from swarmer.observe.cause_page import write_cause
from swarmer.observe.kept_scenes import KeptScenes, Moment
from swarmer.observe.moves import UNHEARD, Moves
from swarmer.observe.report import write_report
from swarmer.observe.rises import rises
from swarmer.observe.saved_run import SavedRun
from swarmer.observe.saved_run import load as load_run
from swarmer.observe.saved_timeline import SavedTimeline
from swarmer.observe.story import scenes
from swarmer.observe.trace_file import TraceFile

TRUTH = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0], [4, 4, 0]], dtype=float)


def timeline(*errors, lit=None):
    """FLSs of a square, (T, 4, 3) beside their points, a sample each tenth of a second."""
    position = (TRUTH + np.array(errors)).astype(np.float32)
    lit = np.ones(position.shape[:2], bool) if lit is None else np.array(lit, bool)
    hd = []
    for place, on in zip(position.astype(float), lit, strict=True):
        error = place[on] - TRUTH[on]
        hd.append(np.linalg.norm(error - error.mean(axis=0), axis=1).max() if on.sum() > 1 else np.nan)
    count = len(position)
    zeros = np.zeros((count, 4))
    return SavedTimeline(
        0.1 * np.arange(count),
        TRUTH,
        position,
        zeros.astype(np.int32),
        zeros.astype(np.int8),
        lit,
        np.array(hd),
    )


def apart(*cells):
    """Each FLS this far to the right of its point."""
    return [[one, 0, 0] for one in cells]


def test_a_rise_names_who_is_off_for_it():
    found, in_all = rises(timeline(apart(0, 0, 0, 0), apart(0, 0.4, 0, 0), apart(0, 0, 0, 0)))
    assert in_all == 1
    (rise,) = found
    assert (rise.from_s, rise.to_s) == pytest.approx((0.0, 0.1))
    assert (rise.before_cells, rise.after_cells) == pytest.approx((0.0, 0.3))
    (off, *others) = rise.off
    assert (off.fid, off.after_cells, off.flown_cells) == (2, pytest.approx(0.3), pytest.approx(0.4))
    assert rise.moved == 1
    assert all(one.after_cells < off.after_cells for one in others)


def test_growth_over_several_samples_is_one_rise_and_the_largest_factor_is_first():
    found, in_all = rises(
        timeline(
            apart(0, 1, 0, 0), apart(0, 1.1, 0, 0), apart(0, 1.2, 0, 0), apart(0, 0.1, 0, 0), apart(0, 0.4, 0, 0),
            apart(0, 0.401, 0, 0), apart(0, 0.1, 0, 0), apart(0, 0.101, 0, 0),
        )
    )  # fmt: skip
    assert [round(rise.factor, 2) for rise in found] == [4.01, 1.2]  # and by 1 % is none
    assert in_all == 2
    assert found[1].to_s - found[1].from_s == pytest.approx(0.2)
    assert len(rises(timeline(*(apart(0, i % 2 + 1, 0, 0) for i in range(40))), most=3)[0]) == 3


def test_what_was_before_all_had_been_lit_is_no_rise():
    lit = [[1, 1, 0, 0], [1, 1, 0, 0], [1, 1, 1, 1], [1, 1, 1, 0]]
    found, _ = rises(timeline(*[apart(0, 0.1, 0, 0), apart(0, 0.9, 0, 0)] * 2, lit=lit))
    assert [(rise.from_s, rise.to_s) for rise in found] == [(pytest.approx(0.2), pytest.approx(0.3))]
    assert rises(timeline(apart(0, 0, 0, 0)))[0] == []


def test_who_has_no_point_in_a_shape_is_not_off_for_it():
    """FLS 4 joins for the second shape and FLS 1 leaves then: the first may not be waited for, nor the other blamed."""
    lit = [[1, 1, 1, 0], [1, 1, 1, 0], [1, 1, 1, 1], [1, 1, 1, 1]]
    saved = timeline(
        apart(0, 0.1, 0, 0), apart(0, 0.9, 0, 0), apart(9, 0.1, 0, 0), apart(9, 0, 0, 0.9), lit=lit
    )
    first, second = TRUTH.copy(), TRUTH.copy()
    first[3], second[0] = np.nan, np.nan
    saved.truth_at_s, saved.truths = np.array([0.0, 0.15]), np.stack([first, second])
    saved.hd_cells = np.array([0.07, 0.6, 0.07, 0.6])  # of those who have a point
    found, _ = rises(saved)
    assert sorted(round(rise.to_s, 2) for rise in found) == [0.1, 0.3]
    worst = {round(rise.to_s, 2): rise.off[0].fid for rise in found}
    assert worst == {0.1: 2, 0.3: 4}


# -- moves -----------------------------------------------------------------------------------------------------------


def made(fid, state, xi):
    return {"t": 0.0, "fid": fid, "is": "handled", "event": "landed", "before": ["Deploying", "1", 0, True, 0],
            "after": [state, xi, 0, False, 0]}  # fmt: skip


def sent(t_s, fid, name, kind, swarm, **more):
    return {"t": t_s, "fid": fid, "is": "sent", "message": name, "kind": kind, "to": f"swarm {swarm}", "xi": "1",
            "event": "measured", "cause": "1.0#8", **more}  # fmt: skip


def flew(t_s, fid, cells=0.5):
    return {"t": t_s, "fid": fid, "is": "flew", "cells": cells, "until": t_s + 0.05, "asked": [0, 0, 0]}


def took(t_s, fid, name, why="", **more):
    waiting = ["Waiting", "1", 0, True, 0]
    reason = {"why": why} if why else {"after": waiting}
    return {"t": t_s, "fid": fid, "is": "handled", "event": "FOLLOW_MERGE", "before": ["Waiting", "2", 0, False, 0],
            "cause": name, "xi": "1", **reason, **more}  # fmt: skip


def gathered(*records):
    log = Moves()
    for record in records:
        log.add(record)
    return log


# 2 localizes against 1 and tells its swarm; 3 follows, 4 loses the datagram, 5 is busy, 6 hears nothing.
STORY = [
    made(1, "Available", "1"), *(made(fid, "Waiting", "2") for fid in (2, 3, 4, 5, 6)), made(7, "Available", "7"),
    sent(0.03, 2, "2.0#5", "FOLLOW_MERGE(1)", "2"), flew(0.03, 2, 0.9),
    took(0.031, 3, "2.0#5"), flew(0.031, 3, 0.8),
    {"t": 0.031, "fid": 4, "is": "heard", "message": "2.0#5", "kind": "FOLLOW_MERGE(1)", "fate": "lost"},
    took(0.032, 5, "2.0#5", "ignored"),
]  # fmt: skip


def test_a_move_knows_who_flew_it_and_why_others_did_not():
    (move,) = gathered(*STORY).moves.values()
    assert (move.localizer, move.anchor, move.swarm) == (2, 1, "2")
    assert move.flown_by == [2, 3]
    assert move.missed() == {4: "lost at the receiver", 5: "ignored in Waiting", 6: UNHEARD}
    (move,) = gathered(*STORY[:7], STORY[7] | {"copies": 0}).moves.values()
    assert set(move.missed().values()) == {"lost at the sender"}


def test_a_vector_that_waited_for_a_landing_is_flown_when_that_has_come():
    late = took(0.05, 5, "5.0#1", "") | {"event": "landed", "judged": ["2.0#5", "9.0#9"]}
    log = gathered(*STORY[:-1], took(0.032, 5, "2.0#5", "waits for the landing"), late, flew(0.05, 5))
    (move,) = log.moves.values()
    assert move.flown_by == [2, 3, 5]
    (flight,) = log.flights[5]
    assert flight.move is move


def test_the_words_for_a_rise():
    moved = timeline(apart(0, 0, 0, 0), apart(0.3, 1.2, 0.6, 0))
    (rise,) = rises(moved)[0]
    cause = cause_of(rise, gathered(*STORY))
    text = " ".join(cause.sentences)
    assert (
        "FLS 2 is 0.675 cells off (0 before): it localized against FLS 1, 0 cells off itself, at 0.0300 s and flew "
        "0.900 cells" in text
    )
    assert "FLS 4 is 0.525 cells off" in text
    assert "did not fly the vector of FLS 2 [2.0#5]: lost at the receiver." in text
    assert "FLS 4 of its swarm did not fly it: lost at the receiver." in text
    assert cause.moves[0].message == "2.0#5"
    assert {1, 2, 4} <= set(cause.moment.cast)
    assert cause.moment.from_s <= 0.03 <= cause.moment.to_s


def test_an_fls_that_took_anothers_place_is_named_for_what_it_is():
    lit = [[1, 1, 1, 1], [1, 1, 1, 0], [1, 1, 1, 1]]
    (rise,) = rises(timeline(apart(0, 0, 0, 0), apart(0, 0, 0, 0), apart(0, 0, 0, 1), lit=lit))[0]
    log = gathered(
        made(4, "Available", "4"),
        {"t": 0.05, "fid": 4, "is": "ended", "how": "failed"},
        {"t": 0.05, "fid": 4, "is": "made", "incarnation": 1},
        made(4, "Available", "4.1") | {"t": 0.15},
    )
    (sentence,) = cause_of(rise, log).sentences
    assert sentence == (
        "FLS 4 is 0.750 cells off (dark before): it failed at 0.0500 s, was replaced, and its incarnation 1 landed "
        "at 0.1500 s, as far off as dead reckoning left it."
    )


# -- what a page holds -----------------------------------------------------------------------------------------------


def test_lives_are_dropped_from_the_last_when_room_is_short():
    all_of_it = list(scenes([*STORY, *(made(fid, "Available", "7") for fid in range(8, 20))]))
    kept = KeptScenes(19, [(0.03, 0.04)], [5], room=10_000)
    few = KeptScenes(19, [(0.03, 0.04)], [5], room=600)
    for scene in all_of_it:
        kept.add(scene)
        few.add(scene)
    assert kept.whole == list(range(1, 20))
    assert 5 in few.whole
    assert len(few.whole) < 8
    rows = few.rows([Moment((4,), 0.03, 0.04)])
    assert {row.fid for row in rows} <= {*few.whole, 4}
    assert any(row.fid == 4 and "lost at the receiver" in row.line for row in rows)
    assert len(rows) == len({row.number for row in rows})


# -- the page --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def traced(tmp_path_factory):
    """A run in virtual time with losses, failures and a log, under a name that is no name."""
    path = tmp_path_factory.mktemp("cause") / "<script>x&"
    before = signal.getsignal(signal.SIGINT)
    done = CliRunner().invoke(
        load("run"),
        ["--engine", "virtual", "--shape", "sphere", "--points", "40", "--duration", "6", "--seed", "7", "--trace",
         "--set", "radio.loss=0.1", "--set", "failure.rate=0.02", "--set", "thaw.policy=timer", "--no-recording",
         "--out", str(path)],
    )  # fmt: skip
    signal.signal(signal.SIGINT, before)
    assert done.exit_code == 0, done.output
    write_report([path])
    return path


def part_of(run, report):
    """What a report under this name would say of why HD rose."""
    saved = run if isinstance(run, SavedRun) else load_run(run)
    return write_cause(saved, report, lambda out: None).html


def data_of(page):
    return json.loads(page.partition('id="data">')[2].partition("</script>")[0])


def test_the_page_tells_what_explain_tells(traced):
    page = (traced / "cause.html").read_text("utf-8")
    found, in_all = rises(load_run(traced).timeline)
    assert in_all >= 2
    data = data_of(page)
    assert len(data["rises"]) == len(found)
    trace = TraceFile(traced)
    told = [scene.line(40) for scene in scenes(trace.records()) if not scene.quiet]
    assert [row[2] for row in data["rows"]] == told
    assert data["whole"] == list(range(1, 41))
    commands = re.findall(r"The same in a terminal: <code>(.*?)</code>", page)
    for number, (rise, command) in enumerate(zip(data["rises"], commands, strict=True), 1):
        options = unescape(command).partition("--fls ")[2].split()
        said = CliRunner().invoke(load("explain"), [str(traced), "--fls", *options]).output.splitlines()
        shown = unescape(
            page.partition(f"id=rise-{number}")[2].partition("<pre tabindex=0>")[2].partition("</pre>")[0]
        )
        assert set(shown.splitlines()) <= set(said), number
        assert rise["cast"]


def test_names_are_text_and_nothing_is_asked_of_the_network(traced):
    for name in ("cause.html", "report.html"):
        page = (traced / name).read_text("utf-8")
        assert "<script>x&" not in page
        assert not re.search(r"(?:src|href)=.?(?:https?:)?//", page)
    page = (traced / "cause.html").read_text("utf-8")
    assert "&lt;script&gt;x&amp;" in page
    assert "default-src 'none'" in page
    assert page.count("</script>") == 3


def test_the_report_leads_to_the_page(traced):
    part = (
        (traced / "report.html")
        .read_text("utf-8")
        .partition('<section id="cause"')[2]
        .partition("</section>")[0]
    )
    links = re.findall(r'href="cause\.html#(rise-\d)"', part)
    page = (traced / "cause.html").read_text("utf-8")
    assert links
    assert all(f"<details id={link}" in page for link in links)


def test_a_report_elsewhere_has_its_page_beside_it_and_replaces_nothing_foreign(traced, tmp_path):
    out = tmp_path / "one.html"
    assert 'href="one-cause.html' in part_of(traced, out)
    assert (tmp_path / "one-cause.html").is_file()
    (tmp_path / "one-cause.html").write_text("mine")
    with pytest.raises(BadInput, match="a file is there that is no report"):
        write_report([traced], out)


def test_a_run_without_a_log_says_how_to_make_one(traced, tmp_path):
    run = shutil.copytree(traced, tmp_path / "run")
    for name in ("trace.jsonl.gz", "cause.html", "report.html"):
        (run / name).unlink()
    part = (
        write_report([run]).read_text("utf-8").partition('<section id="cause"')[2].partition("</section>")[0]
    )
    assert "--engine virtual --trace" in part
    assert not (run / "cause.html").exists()


@pytest.mark.parametrize("spoil", ["none", "cut", "few"])
def test_a_log_that_is_not_whole_is_told_as_far_as_it_is(traced, tmp_path, spoil):
    run = shutil.copytree(traced, tmp_path / "run")
    (run / "cause.html").unlink()
    log = run / "trace.jsonl.gz"
    data = log.read_bytes()
    log.write_bytes(b"no log" if spoil == "none" else data[: len(data) // 2])
    if spoil == "few":
        (run / "timeline.npz").unlink()
    part = part_of(run, run / "report.html")
    if spoil == "none":
        assert "an event log that can be read" in unescape(part)
        assert not (run / "cause.html").exists()
        return
    page = (run / "cause.html").read_text("utf-8")
    assert "this is what is whole" in page
    assert len(data_of(page)["rows"]) > 100
    assert ("HD never rose" in page) == (spoil == "few")


def test_reading_ends_where_the_story_ends(traced, tmp_path):
    """Beyond --to nothing is read, be it damaged or not, also where the FLSs asked for have nothing there."""
    run = shutil.copytree(traced, tmp_path / "run")
    seen = []
    trace = TraceFile(run)
    whole = trace.lines
    trace.lines = lambda: (seen.append(line) or line for line in whole())
    list(trace.records(frozenset([3]), to_s=0.4))
    last = [json.loads(line)["t"] for line in seen[-2:]]
    assert last[0] <= 0.4 < last[1] < 0.5


def test_without_a_log_the_moments_are_still_told(tmp_path):
    saved = timeline(apart(0, 0, 0, 0), apart(0, 0.4, 0, 0), apart(0, 0, 0, 0))
    run = SavedRun(tmp_path, timeline=saved)
    said = part_of(run, tmp_path / "report.html")
    assert "HD rose once by more than 5%; most, in proportion:" in said
    assert "<li>0.10 s: HD 0 to 0.300 cells, 3e+03 times as large. FLS 2 is 0.300 cells off.</li>" in said
    assert "no event log" in said
    run.summary["engine"] = "rounds"
    assert "<li>round 0: HD" in part_of(run, tmp_path / "report.html")
    run.timeline = timeline(apart(0, 0, 0, 0))
    assert "HD never rose by more than 5%" in part_of(run, tmp_path / "report.html")
