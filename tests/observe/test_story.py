"""Records of an event log as lines: the sentences, and what is quiet."""

import pytest

from swarmer.observe.story import scenes

A17, BA17 = ["Available", "17", 0, False, 0], ["BusyAnchor", "17", 0, False, 2]
BL17, BL4 = ["BusyLocalizing", "17", 0, False, 0], ["BusyLocalizing", "4", 0, True, 0]
W9 = ["Waiting", "9", 1, False, 0]


def record(what, /, t_s=0.412, fid=17, **more):
    return {"t": t_s, "fid": fid, "is": what, **more}


def handled(event, before, after=None, **more):
    return record("handled", event=event, before=before, **({"after": after} if after else {}), **more)


def sent(kind, to, number, **more):
    return record("sent", message=f"17.0#{number}", kind=kind, to=to, xi="17", **more)


def got(event, sender, xi, after, **more):
    """A datagram that FLS 17 handled while Available."""
    return handled(event, A17, after, cause=f"{sender}#1", xi=xi, **more)


def told(*records, points=760):
    return [scene.line(points) for scene in scenes(records)]


def test_a_pairing_its_measurement_and_its_flight_are_one_line():
    lines = told(
        handled("ACCEPT", A17, BL17, cause="4.0#9", xi="4"),
        sent("ACK", "4", 30),
        handled("measured", BL17, BL4, cause="4.0#9"),
        record("flew", cells=1.8249, until=0.6028, asked=[1, 1, 1]),
    )
    assert lines == [
        "    0.4120 s   17  Available -> BusyLocalizing  xi 17->4     "
        "ACCEPT from 4 (xi 4) [4.0#9], lower: 4 anchors; ACK to 4 [17.0#30]; flies 1.82 cells, until 0.6028 s"
    ]


def test_what_is_sent_later_or_by_another_is_no_part_of_it():
    first = handled("landed", BL4, ["Available", "4", 0, False, 0])
    assert len(told(first, sent("FIN", "4", 31))) == 1
    assert len(told(first, sent("FIN", "4", 31) | {"t": 0.5})) == 2
    assert len(told(first, sent("FIN", "4", 31) | {"fid": 18})) == 2
    assert len(told(first, handled("challenge due", A17))) == 2


@pytest.mark.parametrize(
    ("one", "words"),
    [
        (got("ACK", "20.0", "20", BA17), "ACK from 20 (xi 20) [20.0#1], lower: 17 anchors; 2 leases"),
        (got("ACK", "3.1", "3.1", BA17, joins=True), "ACK from 3 (xi 3.1) [3.1#1], a newcomer: 17 anchors; 2 leases"),
        (got("ACCEPT", "20.0", "20", BL17), "ACCEPT from 20 (xi 20) [20.0#1]: 20 anchors"),
        (got("ACCEPT", "9.0", "17.1", BL17), "ACCEPT from 9 (xi 17.1) [9.0#1]: 9 anchors"),
        (got("THAW", "0.0", "0", W9, epoch=1), "THAW from the engine [0.0#1]; epoch 0->1"),
        (got("MERGE", "8.0", "17", None, kind="MERGE(4)", why="ignored"), "MERGE(4) from 8 (xi 17) [8.0#1]; ignored"),
        (handled("landed", ["Deploying", "17", 0, True, 0], A17), "landed: lit"),
        (handled("landed", BL4, A17, judged=["8.0#1", "9.0#2"]), "landed; judges what waited: 8.0#1, 9.0#2"),
        (sent("INIT", "all", 5, copies=0), "INIT to all [17.0#5], lost at the sender"),
        (sent("INIT", "all", 5, copies=2), "INIT to all [17.0#5], 2 copies"),
        (record("heard", message="8.0#3", kind="ACK", fate="own"), "ACK from 8 [8.0#3]: from its own swarm"),
        (record("made", incarnation=2), "takes the place of its predecessor, incarnation 2"),
        (record("ended", how="departed"), "departed to charge"),
    ],
)  # fmt: skip
def test_the_words(one, words):
    (line,) = told(one, points=60)
    assert line[line.index("17") :].split("  ")[-1].strip() == words


@pytest.mark.parametrize(
    ("quiet", "one"),
    [
        (True, handled("challenge due", A17, timers=["challenge due 0.9000"])),
        (True, handled("INIT", A17, cause="9.0#1", xi="9")),
        (True, record("heard", message="8.0#3", kind="INIT", fate="noted")),
        (True, record("heard", message="8.0#3", kind="MERGE(4)", fate="address")),
        (False, record("heard", message="8.0#3", kind="ACK", fate="lost")),
        (False, record("heard", message="8.0#3", kind="ACK", fate="answered")),
        (False, handled("FIN", A17, cause="9.0#1", xi="9", why="ignored")),
        (False, handled("SET_WAITING", A17, W9, cause="9.0#1", xi="9")),
        (False, record("made", incarnation=0)),
    ],
)
def test_what_has_no_effect_is_quiet(quiet, one):
    (scene,) = scenes([one])
    assert scene.quiet is quiet
    (scene,) = scenes([one, sent("ACK", "9", 1)])
    assert not scene.quiet
