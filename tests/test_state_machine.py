"""The normative table of the protocol, line by line, as scenarios: given a state, an event; then a state and actions.

FLS 5 is the one under test; 8 and 9 are in its swarm (8 is a planned neighbour), 2 and 3 have lower Swarm-IDs, 6 and 7
higher ones. `tests/simulation/lone.py` says what the words mean.
"""

import math
from collections import Counter
from itertools import product

import pytest
from lone import BOUND_S, LAMBDA_S, LEASE_S, SHORT, Lone, given, happen, in_words, machine

from swarmer.messages import Kind, Swarm
from swarmer.plugins.signal_strength import SignalStrength
from swarmer.protocol.anchor_selection import STRATEGIES
from swarmer.protocol.events import (
    BatteryLow,
    Count,
    Due,
    Landed,
    Launch,
    Local,
    Measured,
    Received,
    Send,
    Timer,
)
from swarmer.state_machine import TABLE, ProtocolBug, State

# given | event -> state, Swarm-ID if it changes: actions | ignored
SCENARIOS = """
D flying             | INIT 7                -> D flying: | ignored
A                    | INIT 7                -> A: ACCEPT 7
A                    | INIT 3                -> A: ACCEPT 3
A                    | INIT 3 joins          -> A: ACCEPT 3
A                    | INIT 8                -> A: NEIGHBOUR 8
A                    | INIT 9                -> A:
BA                   | INIT 7                -> BA: ACCEPT 7
BA                   | INIT 3                -> BA:
BA                   | INIT 3 joins          -> BA: ACCEPT 3
BA                   | INIT 8                -> BA: NEIGHBOUR 8
BA, M 2              | INIT 7                -> BA:
BA, M 2              | INIT 3 joins          -> BA: ACCEPT 3
BA, M 2              | INIT 6                -> BA: ACCEPT 6
BL                   | INIT 7                -> BL:
BL                   | INIT 3 joins          -> BL:
BL                   | INIT 8                -> BL: NEIGHBOUR 8
BL flying            | INIT 7                -> BL flying: | ignored
Wa                   | INIT 7                -> W: ACCEPT 7
Wa                   | INIT 3                -> W:
Wa                   | INIT 3 joins          -> W: ACCEPT 3
Wa                   | INIT 8                -> W: NEIGHBOUR 8
Wl                   | INIT 7                -> W:
Wl                   | INIT 3 joins          -> W:
Wl                   | INIT 8                -> W: NEIGHBOUR 8
W flying             | INIT 7                -> W flying: | ignored
newcomer BL          | INIT 7                -> BL:

D flying             | ACCEPT 7              -> D flying: | ignored
A, tick              | ACCEPT 7              -> BA: ACK 7, SET_WAITING(a) swarm 5
A, tick              | ACCEPT 3              -> BL: ACK 3, SET_WAITING(l) swarm 5, measure
A, tick              | ACCEPT 3 joins        -> BA: ACK 3, SET_WAITING(a) swarm 5
newcomer A, tick     | ACCEPT 7              -> BL: ACK 7, SET_WAITING(l) swarm 5, measure
newcomer A, tick     | ACCEPT 7 joins        -> BA: ACK 7, SET_WAITING(a) swarm 5
newcomer A, tick     | ACCEPT 3 joins        -> BL: ACK 3, SET_WAITING(l) swarm 5, measure
A, tick              | ACCEPT 7 old          -> A: CANCEL 7
A, tick              | ACCEPT 7 same         -> A: CANCEL 7
A, tick, tick        | ACCEPT 7 old          -> A: CANCEL 7
A                    | ACCEPT 7              -> A: CANCEL 7
A, tick, ACCEPT 7    | ACCEPT 6              -> BA: ACK 6
A, tick, ACCEPT 7    | ACCEPT 3              -> BA: CANCEL 3
A, tick, ACCEPT 7    | ACCEPT 6 old          -> BA: CANCEL 6
A, tick, ACCEPT 7    | ACCEPT 6 same         -> BA: CANCEL 6
A, tick, ACCEPT 7    | ACCEPT 3 joins        -> BA: ACK 3
A, M 2, tick, ACCEPT 7 | ACCEPT 6            -> BA: CANCEL 6
A, tick, ACCEPT 7, FIN 7 | ACCEPT 6          -> A: CANCEL 6
A, tick, SET_WAITING 8, SET_AVAILABLE 8 | ACCEPT 7 -> A: CANCEL 7
A, tick, INIT 6, SET_WAITING 8 (a), ACK 6 | ACCEPT 7 -> BA: CANCEL 7
BL                   | ACCEPT 7              -> BL: CANCEL 7
BL flying            | ACCEPT 7              -> BL flying: CANCEL 7 | ignored
Wa                   | ACCEPT 7              -> W: CANCEL 7
Wl                   | ACCEPT 7              -> W: CANCEL 7
W flying             | ACCEPT 7              -> W flying: CANCEL 7 | ignored

D flying             | ACK 7                 -> D flying: | ignored
A, INIT 7            | ACK 7                 -> BA: SET_WAITING(a) swarm 5
A, INIT 3            | ACK 3                 -> BL: SET_WAITING(l) swarm 5, measure
A, INIT 3 joins      | ACK 3 joins           -> BA: SET_WAITING(a) swarm 5
newcomer A, INIT 7   | ACK 7                 -> BL: SET_WAITING(l) swarm 5, measure
A                    | ACK 7                 -> A: CANCEL 7
A, INIT 7            | ACK 7 old             -> A: CANCEL 7
A, INIT 7            | ACK 7 same            -> A: CANCEL 7
A, INIT 7, ACK 7, FIN 7 | ACK 7              -> A: CANCEL 7
A, INIT 7, later 0.24 | ACK 7                -> BA: SET_WAITING(a) swarm 5
A, INIT 7, later 0.26 | ACK 7                -> A: CANCEL 7
A, INIT 7, CANCEL 7  | ACK 7                 -> A: CANCEL 7
A, INIT 7, CANCEL 7 old | ACK 7              -> BA: SET_WAITING(a) swarm 5
BA, INIT 7           | ACK 7                 -> BA:
BA                   | ACK 7                 -> BA: CANCEL 7
BA, INIT 3 joins     | ACK 3 joins           -> BA:
A, INIT 3, INIT 7, ACK 7 | ACK 3             -> BA: CANCEL 3
A, M 2, INIT 6, INIT 7, ACK 7 | ACK 6        -> BA: CANCEL 6
BL                   | ACK 7                 -> BL: CANCEL 7
BL flying            | ACK 7                 -> BL flying: CANCEL 7 | ignored
Wa, INIT 7           | ACK 7                 -> BA: SET_WAITING(a) swarm 5
Wa                   | ACK 7                 -> W: CANCEL 7
A, INIT 3, SET_WAITING 8 (a) | ACK 3         -> W: CANCEL 3
A, INIT 7, SET_WAITING 8 (l) | ACK 7         -> W: CANCEL 7
Wl                   | ACK 7                 -> W: CANCEL 7
W flying             | ACK 7                 -> W flying: CANCEL 7 | ignored

A                    | FIN 6                 -> A:
BA                   | FIN 6                 -> A: SET_AVAILABLE swarm 5
BA                   | FIN 7                 -> BA:
BA, INIT 7, ACK 7    | FIN 6                 -> BA:
BA, INIT 7, ACK 7, FIN 6 | FIN 7             -> A: SET_AVAILABLE swarm 5
BL                   | FIN 6                 -> BL: | ignored
Wa                   | FIN 6                 -> W:
A, INIT 7, FIN 7     | ACK 7                 -> A: CANCEL 7
A, INIT 7, FIN 7 old | ACK 7                 -> BA: SET_WAITING(a) swarm 5
BA, INIT 7, FIN 7    | ACK 7                 -> BA: CANCEL 7
Wa, INIT 7, FIN 7    | ACK 7                 -> W: CANCEL 7

D flying             | SET_WAITING 8         -> D flying: | ignored
A                    | SET_WAITING 8 (a)     -> W:
A                    | SET_WAITING 8 others  -> A: | ignored
BA                   | SET_WAITING 8         -> BA: | ignored
BL                   | SET_WAITING 8         -> BL: | ignored
BL flying            | SET_WAITING 8         -> BL flying:
Wa                   | SET_WAITING 9         -> W:
Wa, SET_WAITING 9 (l) | INIT 7               -> W:
Wa, SET_WAITING 9 (l), SET_AVAILABLE 9 | INIT 7 -> W: ACCEPT 7

A                    | SET_AVAILABLE 8       -> A:
BA                   | SET_AVAILABLE 8       -> BA: | ignored
BL                   | SET_AVAILABLE 8       -> BL: | ignored
Wa                   | SET_AVAILABLE 8       -> A:
Wl                   | SET_AVAILABLE 8       -> A:
Wl                   | SET_AVAILABLE 9       -> W:
Wl, SET_WAITING 9    | SET_AVAILABLE 8       -> W:
Wl, SET_WAITING 9, SET_AVAILABLE 8 | SET_AVAILABLE 9 -> A:
Wl                   | SET_AVAILABLE 8 others -> W: | ignored

A                    | FOLLOW 8              -> W flying: fly
Wl                   | FOLLOW 8              -> W flying: fly
BA                   | FOLLOW 8              -> BA: | ignored
BL                   | FOLLOW 8              -> BL: | ignored
W flying             | FOLLOW 8              -> W flying:
A                    | FOLLOW 8 others       -> A: | ignored
A                    | MERGE 8 to 4          -> A ξ4:
Wl                   | MERGE 8 to 4          -> A ξ4:
BA                   | MERGE 8 to 4          -> BA ξ4:
BL                   | MERGE 8 to 4          -> BL: | ignored
A                    | MERGE 8 to 4 others   -> A: | ignored
A                    | FOLLOW_MERGE 8 to 4   -> W flying ξ4: fly
Wl                   | FOLLOW_MERGE 8 to 4   -> W flying ξ4: fly
Wl                   | FOLLOW_MERGE 8 to 4 others -> W: | ignored
BA                   | FOLLOW_MERGE 8 to 4   -> BA: | ignored
BL                   | FOLLOW_MERGE 8 to 4   -> BL: | ignored
W flying             | FOLLOW_MERGE 8 to 4   -> W flying:
D flying             | FOLLOW_MERGE 8 to 4   -> D flying: | ignored

A                    | RENEW 7               -> A: CANCEL 7
BA                   | RENEW 6               -> BA:
BA                   | RENEW 7               -> BA:
BA                   | RENEW 3               -> BA: CANCEL 3
BA                   | RENEW 3 joins         -> BA:
BA, M 2              | RENEW 7               -> BA: CANCEL 7
BL                   | RENEW 7               -> BL: CANCEL 7
BL flying            | RENEW 7               -> BL flying: CANCEL 7
Wl                   | RENEW 7               -> W: CANCEL 7
W flying             | RENEW 7               -> W flying: CANCEL 7

BA                   | CANCEL 6              -> A: SET_AVAILABLE swarm 5
BA                   | CANCEL 7              -> BA:
BA                   | CANCEL 6 old          -> BA:
BL                   | CANCEL 2              -> A: SET_AVAILABLE swarm 5
BL                   | CANCEL 2 old          -> BL:
BL                   | CANCEL 7              -> BL:
BL flying            | CANCEL 2              -> BL flying:
Wl                   | CANCEL 7              -> W: | ignored

BL                   | measured 1            -> BL flying ξ2: FOLLOW_MERGE(2) swarm 5, fly
BL                   | measured 0.0009       -> A ξ2: MERGE(2) swarm 5, FIN 2
BL flying            | landed                -> A: FIN 2
D flying             | landed                -> A:
W flying             | landed                -> A:
A                    | tick                  -> A: INIT all
BA                   | tick                  -> BA:
BL                   | tick                  -> BL:
Wl                   | tick                  -> W:
Wl                   | bound                 -> A:
BA                   | lease                 -> A: SET_AVAILABLE swarm 5
BL                   | renew                 -> BL: RENEW 2
BL flying            | renew                 -> BL flying: RENEW 2
D flying             | thaw                  -> D flying:
A                    | thaw                  -> A: THAW all
BA                   | thaw                  -> A: THAW all
BL                   | thaw                  -> A: THAW all
BL flying            | thaw                  -> W flying ξ5: THAW all
Wl                   | thaw                  -> A: THAW all
W flying             | thaw                  -> W flying: THAW all

BL flying, SET_WAITING 8 | landed            -> W: FIN 2
BL flying, SET_WAITING 8, MERGE 8 to 1 | landed -> A ξ1: FIN 2
W flying, FOLLOW_MERGE 8 to 4 | landed       -> W flying ξ4: fly
W flying, MERGE 8 to 4, SET_WAITING 8 others | landed -> A ξ4: | ignored
W flying, FOLLOW 8, SET_WAITING 8, landed | landed -> W:
W flying, FOLLOW_MERGE 8 to 4, thaw | landed -> A:
"""  # fmt: skip


def scenarios():
    found = []
    for line in SCENARIOS.strip().splitlines():
        if line:
            start, _, rest = line.partition("|")
            event, _, result = rest.partition("->")
            found.append(
                pytest.param(start.strip(), event.strip(), result.strip(), id=" ".join(line.split()))
            )
    return found


@pytest.mark.parametrize(("start", "event", "result"), scenarios())
def test_scenario(start, event, result):
    lone = given(start)
    xi, ignored = lone.m.swarm.xi, lone.count(Count.IGNORED)
    actions = happen(lone, event)
    state = lone.state if lone.m.swarm.xi == xi else f"{lone.state} ξ{lone.m.swarm.xi}"
    shown = f"{state}: {', '.join(in_words(actions))}".strip()
    if lone.count(Count.IGNORED) > ignored:
        shown += " | ignored"
    assert shown == result


D, A, BA, BL, W = State
NORMATIVE = {  # the spec's table: in which states an event has a rule
    Kind.CHALLENGE_INIT: {A, BA, BL, W},
    Kind.CHALLENGE_ACCEPT: {A, BA, BL, W},
    Kind.CHALLENGE_ACK: {A, BA, BL, W},
    Kind.CHALLENGE_FIN: {A, BA, W},  # in A and W of a pairing whose ACK it has overtaken (rule 7)
    Kind.SET_WAITING: {A, W},
    Kind.SET_AVAILABLE: {W, A},  # in A it only tells the size (rule 4)
    Kind.FOLLOW: {A, W},
    Kind.MERGE: {A, W, BA},
    Kind.FOLLOW_MERGE: {A, W},
    Kind.LEASE_RENEW: {A, BA, BL, W},
    Kind.LEASE_CANCEL: {BA, BL, A},
    Kind.THAW: {A, BA, BL, W},  # D adopts the epoch before the table
    Kind.LEAVE: {A, BA, BL, W},
    Kind.COUNT: {A, BA, BL, W},
    Kind.ROLL_CALL: {A, BA, BL, W},
    Kind.THAW_ANNOUNCE: {A, BA, BL, W},
    Kind.THAW_ABORT: {A, BA, BL, W},
    Local.LAUNCH: {D},
    Local.MEASURED: {BL},
    Local.LANDED: {D, BL, W},
    Local.CHALLENGE_DUE: {A, BA, BL, W},
    Local.BOUND_OVER: {W},
    Local.LEASE_OVER: {BA},
    Local.RENEW_DUE: {BL},
    Local.THAW_DUE: {D, A, BA, BL, W},
    Local.REPORT_DUE: {A, BA, BL, W},
    Local.BATTERY_LOW: {D, A, BA, BL, W},
    Local.NEW_SHAPE: {D, A, BA, BL, W},
}


def test_the_code_has_rules_exactly_where_the_table_has():
    for event in [*Kind, *Local]:
        with_rule = {state for state in State if event in TABLE[state]}
        assert with_rule == NORMATIVE.get(event, set()), event


@pytest.mark.parametrize("state", ["D", "A", "BA", "BL", "Wl"])
@pytest.mark.parametrize("kind", [kind for kind in Kind if kind != Kind.NEIGHBOUR])
def test_what_is_not_listed_changes_nothing_and_is_counted(state, kind):
    lone = given(state)
    if lone.m.state in NORMATIVE.get(kind, set()):
        return
    before, ignored = lone.m.view(), lone.count(Count.IGNORED)
    assert lone.feed(Received(lone.message(f"{kind.name} 8" if kind.name in SWARM_NAMES else "NEIGHBOUR 8")
                              ._replace(kind=kind))) == []  # fmt: skip
    assert lone.m.view() == before
    assert lone.count(Count.IGNORED) == ignored + 1


SWARM_NAMES = {"SET_WAITING", "SET_AVAILABLE", "FOLLOW", "MERGE", "FOLLOW_MERGE"}


@pytest.mark.parametrize("event", [event for event in Local if event not in (Local.MEASURED, Local.LAUNCH)])
@pytest.mark.parametrize("state", ["D", "A", "BA", "BL", "Wl"])
def test_what_only_a_wrong_engine_can_send_raises(state, event):
    lone = given(state)
    if lone.m.state in NORMATIVE[event]:
        return
    before = lone.m.view()
    with pytest.raises(ProtocolBug):
        lone.feed(Landed() if event == Local.LANDED else Due(Timer(event - Local.CHALLENGE_DUE)))
    assert lone.m.view() == before


# -- times -----------------------------------------------------------------------------------------------------------


def test_an_anchor_is_free_when_the_lease_is_over_and_not_before():
    lone = given("BA").later(0.1)
    lone.hear("RENEW 6")
    assert lone.armed[Timer.LEASE] == pytest.approx(0.1 + LEASE_S)
    lone.due(Timer.LEASE)
    assert (lone.state, lone.count(Count.LEASES_EXPIRED)) == ("A", 1)
    assert Timer.LEASE not in lone.armed


def test_each_localizer_has_a_lease_of_its_own():
    lone = given("BA").later(0.1)
    happen(lone, "INIT 7")
    happen(lone, "ACK 7")
    lone.due(Timer.LEASE)
    assert (lone.now, lone.state) == (LEASE_S, "BA")
    assert lone.armed[Timer.LEASE] == pytest.approx(0.1 + LEASE_S)
    lone.due(Timer.LEASE)
    assert lone.state == "A"


def test_the_margin_lengthens_what_the_anchor_holds_only():
    lone = given("BA", lease_margin_s=0.1)
    assert lone.armed[Timer.LEASE] == pytest.approx(LEASE_S + 0.1)
    assert given("BL", lease_margin_s=0.1).armed[Timer.RENEW] == pytest.approx(LEASE_S / 2)


def test_a_localizer_renews_every_half_lease_until_it_is_done():
    lone = given("BL flying")
    for turn in range(1, 6):
        assert in_words(lone.due(Timer.RENEW)) == ["RENEW 2"]
        assert lone.now == pytest.approx(turn * LEASE_S / 2)
    lone.feed(Landed())
    assert Timer.RENEW not in lone.armed


def test_waiting_is_bounded_from_the_last_set_waiting():
    lone = given("Wl").later(0.4)
    lone.hear("SET_WAITING 9")
    assert lone.armed[Timer.BOUND] == pytest.approx(0.4 + BOUND_S)
    lone.due(Timer.BOUND)
    assert lone.state == "A"


@pytest.mark.parametrize("leaving", ["SET_AVAILABLE 8", "MERGE 8 to 4", "FOLLOW_MERGE 8 to 4", "thaw"])
def test_the_bound_ends_with_waiting(leaving):
    lone = given("Wl")
    happen(lone, leaving)
    assert Timer.BOUND not in lone.armed


def test_ticks_run_free_whatever_the_state():
    """λ·U[0.5, 1.5] from tick to tick, the first within λ of the landing (rule 2)."""
    lone = given("A")
    assert 0.0 <= lone.armed[Timer.CHALLENGE] <= LAMBDA_S
    last, gaps = None, []
    for _ in range(400):
        lone.due(Timer.CHALLENGE)
        gaps.append(lone.now - last if last is not None else LAMBDA_S)
        last = lone.now
        happen(lone, "SET_WAITING 8")
        lone.due(Timer.BOUND) if lone.armed[Timer.BOUND] < lone.armed[Timer.CHALLENGE] else None
    assert all(gap + 1e-9 >= 0.5 * LAMBDA_S and gap <= 1.5 * LAMBDA_S + 1e-9 for gap in gaps)
    assert sum(gaps) / len(gaps) == pytest.approx(LAMBDA_S, rel=0.05)


def test_a_late_process_ticks_as_often():
    lone = given("A")
    lone.due(Timer.CHALLENGE)
    due = lone.armed[Timer.CHALLENGE]
    lone.now = due + 0.2
    lone.due(Timer.CHALLENGE)
    assert lone.armed[Timer.CHALLENGE] <= due + 1.5 * LAMBDA_S


# -- challenges ------------------------------------------------------------------------------------------------------


def challenge(lone):
    """The INIT of the next tick, or None."""
    sent = [a.message for a in lone.due(Timer.CHALLENGE) if isinstance(a, Send)]
    return sent[0] if sent else None


def test_the_range_grows_while_nobody_takes_the_challenge():
    lone = given("A", range_max=22.0)
    assert [challenge(lone).range for _ in range(4)] == [10.0, 15.0, 20.0, 22.0]
    happen(lone, "ACCEPT 7")
    happen(lone, "FIN 7")
    assert [challenge(lone).range for _ in range(2)] == [22.0, 22.0]
    happen(lone, "THAW 7 epoch 1")
    assert challenge(lone).range == 10.0


def test_a_taker_that_came_later_counts_too():
    lone = given("A, tick, INIT 6, ACK 6")
    assert in_words(happen(lone, "ACCEPT 7")) == ["ACK 7"]
    happen(lone, "FIN 6")
    happen(lone, "FIN 7")
    assert challenge(lone).range == 10.0


def test_every_challenge_has_an_id_of_its_own():
    mine = [challenge(lone).challenge for lone in [given("A")] for _ in range(50)]
    assert len(set(mine)) == 50
    ids = set()
    for fid in range(1, 300):
        for incarnation in (0, 1):
            m = machine(fid=fid, incarnation=incarnation)
            m.handle(Launch((0.0, 0.0, 0.0)), 0.0)
            m.handle(Landed(), 0.0)
            for turn in range(20):
                m.handle(Due(Timer.CHALLENGE), float(turn))
                ids.add(m.challenge)
    assert len(ids) == 299 * 2 * 20
    assert all(0 < number < 2**32 for number in ids)


def test_who_is_r_complete_only_probes():
    lone = given("A")
    for fid in (3, 7):
        lone.hear(f"NEIGHBOUR {fid} same")
    assert challenge(lone) is not None, "8 was not heard yet"
    lone.hear("NEIGHBOUR 8")
    assert lone.m.complete
    assert [bool(challenge(lone)) for _ in range(16)] == ([False] * 7 + [True]) * 2
    lone.hear("NEIGHBOUR 7")
    assert challenge(lone) is not None


def test_hearsay_is_not_believed():
    """A FOLLOW_MERGE says where its swarm goes, not that a neighbour has gone there."""
    lone = given("A, SET_WAITING 8, FOLLOW_MERGE 8 to 4")
    assert lone.m.beliefs.of(3) is None
    assert lone.m.beliefs.of(8) == Swarm(5, 0), "what 8 said of itself"


def test_accepts_keep_their_distance():
    lone = given("A, INIT 7", accept_gap_s=0.02)
    assert in_words(lone.hear("INIT 6")) == []
    assert in_words(lone.later(0.021).hear("INIT 6")) == ["ACCEPT 6"]


# -- pairing: both ends -----------------------------------------------------------------------------------------------

RULES = [(name, join) for name in STRATEGIES for join in ("newcomer", "all", "off")]


def meet(challenger, acceptor, between=()):
    """INIT, ACCEPT, then what happens to the acceptor, then ACK and what the acceptor sends. All messages reach."""
    init = challenge(challenger)
    accepts = [a.message for a in acceptor.feed(Received(init)) if isinstance(a, Send)]
    if not accepts:
        return None
    acks = [a.message for a in challenger.feed(Received(accepts[0])) if isinstance(a, Send)]
    for step in between:
        happen(acceptor, step)
    assert acks[0].kind == Kind.CHALLENGE_ACK
    answers = [a.message for a in acceptor.feed(Received(acks[0])) if isinstance(a, Send)]
    for answer in answers:
        if answer.kind == Kind.LEASE_CANCEL:
            challenger.feed(Received(answer))
    return challenger.state, acceptor.state


BEFORE = ("", "INIT 60, ACK 60", "INIT 2 joins, ACK 2 joins", "SET_WAITING 8 (a)")
BETWEEN = ("", "FIN 60", "INIT 70, ACK 70", "INIT 3 joins, ACK 3 joins, FIN 3", "SET_AVAILABLE 8")


@pytest.mark.parametrize(("strategy", "join"), RULES)
def test_of_two_that_pair_one_anchors_and_one_localizes(strategy, join):
    """Whatever happens to the acceptor between its ACCEPT and the ACK: nobody anchors alone, or chases the other."""
    changes = {"anchors": STRATEGIES[strategy], "busy_join": join}
    outcomes = Counter()
    for other, newcomers, before, between in product(
        (1, 4, 6, 50), product((0, 1), repeat=2), BEFORE, BETWEEN
    ):
        case = f"{other} challenges, newcomers {newcomers}, before: {before}, between: {between}"
        acceptor = given(("newcomer " if newcomers[0] else "") + "A", **changes)
        challenger = Lone(newcomers[1], fid=other, **changes).lit()
        for step in filter(None, before.split(", ")):
            happen(acceptor, step)
        if acceptor.state == "BL":
            continue
        pair = meet(challenger, acceptor, list(filter(None, between.split(", "))))
        if pair is None or acceptor.m.swarm != Swarm(5, newcomers[0]):
            continue
        anchors = (acceptor.m.fid in challenger.m.leases, other in acceptor.m.leases)
        localizes = tuple(
            end.m.state == State.BUSY_LOCALIZING and end.m.anchor.sender == partner.m.fid
            for end, partner in ((challenger, acceptor), (acceptor, challenger))
        )
        assert anchors == localizes[::-1], case
        assert not all(anchors), case
        if join == "newcomer" and any(anchors) and sum(newcomers) == 1:
            assert anchors == ((True, False) if newcomers[0] else (False, True)), (
                f"{case}: a newcomer anchors"
            )
        outcomes[anchors] += 1
    assert outcomes[True, False] + outcomes[False, True] > 10, outcomes


def test_two_that_challenge_each_other_at_once_pair_once_and_it_lasts():
    """Each accepts the other's challenge. One of the two pairings is cancelled; the lease of the other one stands."""
    low, high = given("A"), Lone(fid=7).lit()

    def answers(end, message):
        return [a.message for a in end.feed(Received(message)) if isinstance(a, Send) and a.message.to == 0]

    init_low, init_high = challenge(low), challenge(high)
    (accept_high,) = answers(high, init_low)
    (accept_low,) = answers(low, init_high)
    (ack_high,) = answers(high, accept_low)
    (ack_low,) = answers(low, accept_high)
    (cancel_high,) = answers(high, ack_low)
    assert (high.state, low.state) == ("BL", "BA")
    assert answers(low, ack_high) == []
    assert answers(low, cancel_high) == []
    assert (high.state, low.state) == ("BL", "BA"), "the CANCEL was about the other challenge"
    assert 7 in low.m.leases
    # and in the other order: the acceptance reaches one that localizes already
    low, high = given("A"), Lone(fid=7).lit()
    init_low, init_high = challenge(low), challenge(high)
    (accept_high,) = answers(high, init_low)
    (accept_low,) = answers(low, init_high)
    (ack_low,) = answers(low, accept_high)
    answers(high, ack_low)
    (cancel_high,) = answers(high, accept_low)
    assert cancel_high.kind == Kind.LEASE_CANCEL
    answers(low, cancel_high)
    assert (high.state, low.state) == ("BL", "BA")


def test_a_busy_acceptor_does_not_make_a_lower_challenger_localize():
    """Swarm-IDs decide, whatever happened since the INIT: ξ must not rise in an epoch (`busy_join: all` excepted)."""
    assert in_words(happen(given("A, tick"), "ACCEPT 7 busy"))[0] == "ACK 7"
    assert given("A, tick, ACCEPT 7 busy").state == "BA"
    assert given("A, tick, ACCEPT 7 busy", busy_join="all").state == "BL"
    assert in_words(happen(given("BA", busy_join="all"), "INIT 3")) == ["ACCEPT 3"]


# -- sizes -----------------------------------------------------------------------------------------------------------


def sizes(actions):
    return {Kind(a.message.kind).name: a.message.size for a in actions if isinstance(a, Send)}


def test_sizes_add_up():
    lone = given("A, INIT 2 size 4, ACK 2 size 4")
    assert sizes(happen(lone, "measured 1")) == {"FOLLOW_MERGE": 5}
    assert sizes(happen(lone, "landed")) == {"CHALLENGE_FIN": 1}
    assert lone.m.size == 5
    assert sizes(happen(lone, "thaw")) == {"THAW": 1}
    anchor = given("BA")
    assert sizes(happen(anchor, "FIN 6 size 3")) == {"SET_AVAILABLE": 4}
    assert given("BA, CANCEL 6 size 3").m.size == 1
    assert given("Wa, SET_AVAILABLE 8 size 9").m.size == 9
    assert given("A, SET_AVAILABLE 8 size 9").m.size == 9
    assert given("A, MERGE 8 to 4 size 6").m.size == 6
    assert given("A, FOLLOW_MERGE 8 to 4 size 6").m.size == 6


def test_a_size_stays_on_the_wire():
    most = 2**32 - 1
    lone = given(f"A, INIT 2 size {most}, ACK 2 size {most}, measured 1")
    assert lone.m.size == most
    assert given(f"BA, FIN 6 size {most}").m.size == most


# -- thaws and epochs -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("state", ["A", "BA", "BL", "BL flying", "Wa", "Wl", "W flying"])
@pytest.mark.parametrize("word", ["THAW", "NEIGHBOUR"])
def test_whoever_hears_a_higher_epoch_thaws_once(state, word):
    lone = given(f"{state}")
    lone.hear("NEIGHBOUR 3")
    lone.later(0.01)
    happen(lone, f"{word} 7 epoch 2")
    m = lone.m
    assert (m.epoch, m.swarm, m.size, m.reach) == (2, Swarm(5, 0), 1, 10.0)
    assert not any((m.leases, m.holders, m.accepts, m.anchor, m.pending))
    assert lone.state == ("W flying" if "flying" in state else "A")
    assert m.beliefs.of(3) is None
    assert (m.beliefs.of(7) is None) == (word == "THAW")
    assert sorted(lone.armed) == [Timer.CHALLENGE, Timer.THAW]
    assert lone.now <= lone.armed[Timer.CHALLENGE] <= lone.now + LAMBDA_S
    assert lone.now + 10.0 <= lone.armed[Timer.THAW] <= lone.now + 20.0
    armed = dict(lone.armed)
    for copy in ("THAW 7 epoch 2", "THAW 3 epoch 2", "later 1.0", "THAW 7 epoch 2"):
        assert happen(lone, copy) == []
    assert (lone.count(Count.THAWS_OBEYED), lone.armed) == (1, armed)
    if "flying" in state:
        assert in_words(lone.feed(Landed())) == [], "no FIN: the anchor has thawed, too"
        assert lone.state == "A"


def test_who_is_deploying_adopts_the_epoch_and_stays_dark():
    lone = given("D flying")
    assert happen(lone, "THAW 7 epoch 4") == []
    assert (lone.state, lone.m.epoch, lone.count(Count.THAWS_OBEYED)) == ("D flying", 4, 0)
    assert happen(lone, "INIT 7 epoch 2") == []
    happen(lone, "NEIGHBOUR 3")
    happen(lone, "THAW 7 epoch 5")
    assert lone.m.beliefs.of(3) is None
    lone.feed(Landed())
    assert challenge(lone).epoch == 5


def test_the_own_thaw_names_the_next_epoch_and_the_new_swarm_id():
    lone = given("BL flying")
    (thaw,) = [a.message for a in lone.due(Timer.THAW) if isinstance(a, Send)]
    assert (thaw.epoch, thaw.swarm, thaw.size) == (1, Swarm(5, 0), 1)
    assert lone.count(Count.THAWS_STARTED) == lone.count(Count.THAWS_OBEYED) == 1


def test_an_older_epoch_is_dropped_and_told_once_per_lambda():
    lone = given("A, THAW 7 epoch 3, INIT 6 epoch 3")
    assert in_words(lone.hear("INIT 7 epoch 2")) == ["THAW 7"]
    assert lone.m.beliefs.of(7) is None
    assert in_words(lone.later(LAMBDA_S - 0.01).hear("INIT 7 epoch 2")) == []
    assert in_words(lone.hear("THAW 3 epoch 1")) == ["THAW 3"], "each sender is told"
    assert in_words(lone.later(0.02).hear("ACCEPT 7 epoch 2")) == ["THAW 7"]
    assert lone.count(Count.STALE) == 4
    assert lone.hear("THAW 0 epoch 1") == [], "the engine is not told"


def test_the_last_epoch_stays_on_the_wire():
    lone = given(f"A, THAW 7 epoch {2**32 - 1}, thaw")
    assert lone.m.epoch == 2**32 - 1


def test_without_epochs_a_thaw_is_obeyed_at_most_once_per_lambda_and_repeated_by_chance():
    repeats = 0
    for seed in range(200):
        lone = Lone(epochs=False, thaw_repeat=0.5, seed=seed).lit()
        repeats += "THAW all" in in_words(lone.hear("THAW 7 epoch 9"))
        assert lone.hear("THAW 3") == []
        assert (lone.m.epoch, lone.count(Count.THAWS_OBEYED)) == (0, 1)
        lone.later(LAMBDA_S).hear("THAW 7")
        assert lone.count(Count.THAWS_OBEYED) == 2
    assert 70 < repeats < 130


def test_a_datagram_of_oneself_is_nobodys():
    """A predecessor's, a forged one, or an echo."""
    lone = given("A")
    assert lone.feed(Received(lone.message("INIT 5 newer"))) == []
    assert lone.feed(Received(lone.message("THAW 5 epoch 9"))) == []
    assert lone.m.epoch == 0


# -- the authors' program ----------------------------------------------------------------------------------------------


def test_with_ticks_waiting_ends_at_the_next_one():
    lone = given("Wl", waiting_ends_at_tick=True, waiting_bound_s=math.inf)
    lone.due(Timer.CHALLENGE)
    assert lone.state == "A"
    flying = given("W flying", waiting_ends_at_tick=True)
    flying.due(Timer.CHALLENGE)
    assert flying.state == "W flying"


def test_every_entry_to_available_may_challenge():
    lone = Lone(challenge_on_available=True)
    lone.feed(Launch((0.0, 0.0, 0.0)))
    assert in_words(lone.feed(Landed())) == ["INIT all"]
    for step, said in [
        ("SET_WAITING 8", []), ("SET_AVAILABLE 8", ["INIT all"]), ("MERGE 8 to 4", []), ("FOLLOW 8", ["fly"]),
        ("landed", ["INIT all"]), ("SET_AVAILABLE 8", []),
    ]:  # fmt: skip
        assert in_words(happen(lone, step)) == said, step
    for fid in (3, 7, 8):
        lone.hear(f"NEIGHBOUR {fid} same")
    happen(lone, "SET_WAITING 8")
    assert in_words(happen(lone, "SET_AVAILABLE 8")) == [], (
        "R-Complete: its policy would not at a tick either"
    )


# -- localizing, leaving -----------------------------------------------------------------------------------------------


def test_v_is_what_the_technique_says_of_measurement_and_ground_truth():
    lone = given("BL")
    assert isinstance(lone.m.settings.localizer, SignalStrength)
    actions = lone.feed(Measured((23.0, 1.0, -2.0)))  # the anchor, FLS 2, should be seen at (20, 0, 0)
    (merge, fly) = [a for a in actions if in_words([a])]
    assert merge.message.vector == fly.vector == (3.0, 1.0, -2.0)


def test_a_measurement_that_nobody_waits_for_any_more():
    for state in ("A", "BA", "Wl", "BL flying", "W flying"):
        lone = given(state)
        before = lone.m.view()
        assert lone.feed(Measured((1.0, 1.0, 1.0))) == []
        assert lone.m.view() == before


@pytest.mark.parametrize(
    ("state", "said"),
    [
        ("D", ["depart"]),
        ("A", ["LEAVE 3", "LEAVE 7", "LEAVE 8", "depart"]),
        ("BA", ["LEAVE 3", "LEAVE 7", "LEAVE 8", "SET_AVAILABLE swarm 5", "depart"]),
        ("BL", ["LEAVE 3", "LEAVE 7", "LEAVE 8", "SET_AVAILABLE swarm 5", "depart"]),
        ("Wl", ["LEAVE 3", "LEAVE 7", "LEAVE 8", "depart"]),
    ],
)
def test_who_leaves_says_so_and_is_gone(state, said):
    lone = given(state)
    assert in_words(lone.feed(BatteryLow())) == said
    assert lone.armed == {}
    assert lone.hear("INIT 7") == []
    assert lone.feed(Landed()) == []


def test_who_flies_lands_before_it_leaves():
    lone = given("BL flying")
    assert lone.feed(BatteryLow()) == []
    assert in_words(lone.feed(Landed())) == ["FIN 2", "LEAVE 3", "LEAVE 7", "LEAVE 8", "depart"]
    follower = given("W flying, FOLLOW 8")
    follower.feed(BatteryLow())
    assert in_words(follower.feed(Landed())) == ["fly"], "what it owes its swarm first"
    assert in_words(follower.feed(Landed()))[-1] == "depart"


def test_who_has_left_is_no_neighbour_to_believe():
    lone = given("A, NEIGHBOUR 3, LEAVE 3")
    assert lone.m.beliefs.of(3) is None


def test_only_so_many_swarm_messages_wait_for_a_landing():
    lone = given("W flying")
    for _ in range(70):
        lone.hear("SET_WAITING 8")
    assert len(lone.m.pending) == 64
    assert lone.count(Count.IGNORED) == 6


def test_the_view_is_what_the_network_thread_may_know():
    assert SHORT[given("BA").m.state] == "BA"
    assert given("BA").m.view() == (True, 0, False, False, True, Swarm(5, 0), 1)
    assert given("Wa").m.view().anchoring
    assert not given("Wa, SET_WAITING 9 (l)").m.view().anchoring
    assert given("BL flying").m.view() == (True, 0, True, False, False, Swarm(2, 0), 2)
    assert not given("D").m.view().awake
