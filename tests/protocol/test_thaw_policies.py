"""The thaw policies that listen: who reports to whom, what counts, what begins a thaw, and what must not."""

from __future__ import annotations

import pytest
from lone import LAMBDA_S, Lone, given, happen, in_words

from swarmer.messages import Kind, Swarm
from swarmer.protocol.census import Census
from swarmer.protocol.corner import Corner
from swarmer.protocol.events import Count, Send, ThawBegins, Timer
from swarmer.protocol.reports import Roll
from swarmer.protocol.roster import Roster

H_S, SPREAD, REST = 10.0, 2.0, 0.01
HEAD_START = ("NEIGHBOUR 3 same", "NEIGHBOUR 7 same", "NEIGHBOUR 8")  # FLS 5 is R-Complete


def roster(count=3, rest=REST, falls=True):
    return Roster(count, H_S, SPREAD, rest, falls)


def corner(count=760, is_one=False):
    return Corner(count, H_S, SPREAD, is_one)


def thawed(lone: Lone) -> bool:
    return lone.m.epoch > 0


def steps(lone: Lone, *words: str) -> list[str]:
    """All that others can notice of some steps."""
    return [said for step in words for said in in_words(happen(lone, step))]


def begins(actions) -> list[ThawBegins]:
    return [action for action in actions if isinstance(action, ThawBegins)]


def flown(actions) -> float:
    (count,) = [a.message for a in actions if isinstance(a, Send) and a.message.kind == Kind.COUNT]
    return count.vector[0]


# -- the clock behind each -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "policy", [roster(), Census(3, H_S, SPREAD), corner()], ids=["roster", "census", "corner"]
)
def test_nobody_waits_for_messages_for_ever(policy):
    lone = given("A", thaws=policy)
    assert 4 * H_S <= lone.armed[Timer.THAW] <= 4 * SPREAD * H_S
    (said,) = begins(lone.due(Timer.THAW))
    assert said == (Swarm(5, 0), 0, False)
    assert thawed(lone)


# -- roster ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("state", "step", "said"),
    [
        ("A", "FOLLOW_MERGE 8 to 4", ["fly", "COUNT 4"]),
        ("Wl", "MERGE 8 to 4", ["COUNT 4"]),
        ("BA", "MERGE 8 to 4", ["COUNT 4"]),
        ("BL", "measured 1", ["FOLLOW_MERGE(2) swarm 5", "fly", "COUNT 2"]),
        ("BL", "measured 0", ["MERGE(2) swarm 5", "FIN 2", "COUNT 2"]),
    ],
)
def test_who_joins_a_swarm_reports_to_its_owner_at_once(state, step, said):
    assert in_words(happen(given(state, thaws=roster()), step)) == said


def test_a_report_tells_the_longest_vector_of_this_epoch_the_present_one_too():
    lone = given("A", thaws=roster())
    assert flown(happen(lone, "FOLLOW_MERGE 8 to 4")) == 3.0  # V is (1, 2, 2)
    happen(lone, "landed")
    assert flown(happen(lone, "MERGE 8 to 3")) == 3.0
    happen(lone, "THAW 7 epoch 1")
    assert flown(happen(lone, "MERGE 8 to 4")) == 0.0, "not of the epoch before"


def test_the_way_to_the_first_point_is_no_correction():
    assert flown(happen(given("A", thaws=roster()), "MERGE 8 to 4")) == 0.0


@pytest.mark.parametrize("state", ["A", "BA", "Wa", "Wl", "W flying"])
def test_the_owner_thaws_when_all_have_reported(state):
    lone = given(state, thaws=roster())
    assert steps(lone, "COUNT 8 flew 1", "COUNT 8 flew 1") == [], "one FLS counts once"
    assert not thawed(lone)
    actions = happen(lone, "COUNT 9 flew 1")
    assert in_words(actions) == ["THAW all"]
    assert begins(actions) == [(Swarm(5, 0), 0, True)]
    assert lone.m.epoch == 1


def test_all_but_one_are_not_all():
    lone = given("A", thaws=roster(count=4))
    steps(lone, "COUNT 8 flew 1", "COUNT 9 flew 1", "later 5")
    assert not thawed(lone)


@pytest.mark.parametrize(
    "stale",
    [
        "COUNT 9 flew 1 epoch 0",  # of the epoch before
        "COUNT 7 flew 1",  # of another swarm
        "COUNT 9 flew 1 predecessor",  # of the swarm of FLS 5 before it was replaced, and it has not joined that
    ],
)
def test_what_is_not_of_this_very_swarm_never_counts(stale):
    lone = given("A, THAW 7 epoch 1", thaws=roster())
    message = lone.message(stale.removesuffix(" predecessor"))
    if stale.endswith("predecessor"):
        message = message._replace(swarm=Swarm(5, 1))
    happen(lone, "COUNT 8 flew 1")
    hear(lone, message)
    assert lone.m.epoch == 1
    happen(lone, "COUNT 9 flew 1")
    assert lone.m.epoch == 2, "and this one was all that was missing"


def hear(lone: Lone, message) -> list:
    from swarmer.protocol.events import Received

    return lone.feed(Received(message))


def test_a_report_of_the_epoch_before_is_forgotten_at_the_thaw():
    lone = given("A, COUNT 8 flew 1", thaws=roster())
    steps(lone, "THAW 7 epoch 1", "COUNT 9 flew 1")
    assert lone.m.epoch == 1
    happen(lone, "COUNT 8 flew 1")
    assert lone.m.epoch == 2


def test_an_older_incarnation_does_not_take_the_place_of_a_newer_one():
    lone = given("A", thaws=roster(count=4))
    message = lone.message("COUNT 8 flew 1")
    hear(lone, message._replace(incarnation=2))
    hear(lone, message._replace(incarnation=1, swarm=Swarm(4, 0)))  # late: "I am not in your swarm any more"
    steps(lone, "COUNT 9 flew 1")
    hear(lone, lone.message("COUNT 3 same flew 1"))
    assert thawed(lone)


def test_a_late_report_of_a_predecessor_changes_nothing():
    roll, lone = Roll(), given("A")
    roll.begin(Swarm(5, 0))
    message = lone.message("COUNT 8 flew 1")
    roll.hear(message._replace(incarnation=1))
    roll.hear(message._replace(vector=(7.0, 0.0, 0.0)))
    assert (len(roll), roll.longest) == (1, 1.0)
    roll.hear(message._replace(incarnation=2, vector=(3.0, 0.0, 0.0)))
    assert (len(roll), roll.longest) == (1, 3.0)


def test_who_leaves_is_struck_off():
    lone = given("A", thaws=roster())
    happen(lone, "COUNT 8 flew 1")
    hear(lone, lone.message("COUNT 8 flew 1")._replace(swarm=Swarm(4, 0)))
    happen(lone, "COUNT 9 flew 1")
    assert not thawed(lone)
    happen(lone, "COUNT 8 flew 1")
    assert thawed(lone)


@pytest.mark.parametrize(
    ("falls", "to", "said"),
    [(True, 3, ["COUNT 3"]), (True, 7, ["COUNT 7", "COUNT 4"]), (False, 3, ["COUNT 3", "COUNT 4"])],
)
def test_who_leaves_tells_so_where_swarm_ids_may_rise(falls, to, said):
    lone = given("A", thaws=roster(falls=falls))
    happen(lone, "MERGE 8 to 4")
    assert steps(lone, f"MERGE 8 to {to}") == said


def test_a_member_is_no_owner():
    lone = given("A, MERGE 8 to 4", thaws=roster())
    assert steps(lone, "COUNT 8 flew 1", "COUNT 9 flew 1") == []
    assert not thawed(lone)


def test_an_owner_that_has_joined_another_swarm_has_nobody_any_more():
    lone = given("A, COUNT 8 flew 1, MERGE 8 to 4", thaws=roster())
    happen(lone, "MERGE 8 to 5")
    assert lone.m.swarm == (5, 0)
    happen(lone, "COUNT 9 flew 1")
    assert not thawed(lone)


def test_the_owner_of_half_the_display_asks_who_is_missing():
    lone = given("A", thaws=roster(count=5))
    happen(lone, "COUNT 8 flew 1")
    assert lone.armed[Timer.REPORT] == pytest.approx(lone.now + LAMBDA_S), "two of five are not half"
    happen(lone, "COUNT 4 same flew 1")
    assert lone.armed[Timer.REPORT] == pytest.approx(lone.now + LAMBDA_S / 4)
    assert steps(lone, "report") == ["ROLL_CALL 1", "ROLL_CALL 2", "ROLL_CALL 3"]
    happen(lone, "COUNT 2 same flew 1")
    assert steps(lone, "report") == ["ROLL_CALL 1", "ROLL_CALL 3"]
    steps(lone, "COUNT 1 same flew 1")
    assert thawed(lone)
    assert Timer.REPORT not in lone.armed


def test_the_owner_of_less_than_half_asks_when_it_has_heard_of_nobody_for_a_while():
    """Or where half of the reports are lost, none would ever ask."""
    lone = given("A", thaws=roster(count=800))
    for fid in range(6, 104):
        hear(lone, lone.message("COUNT 8")._replace(sender=fid))
    assert Timer.REPORT not in lone.armed, "99 of 800 are less than an eighth"
    hear(lone, lone.message("COUNT 8")._replace(sender=104))
    assert lone.armed[Timer.REPORT] == pytest.approx(lone.now + LAMBDA_S)
    lone.later(0.6 * LAMBDA_S)
    hear(lone, lone.message("COUNT 8")._replace(sender=105))
    heard_s = lone.now
    assert steps(lone, "report") == [], "its swarm grows still"
    assert lone.armed[Timer.REPORT] == pytest.approx(heard_s + LAMBDA_S)
    assert len(steps(lone, "report")) == 100
    assert lone.armed[Timer.REPORT] == pytest.approx(lone.now + LAMBDA_S), "and not every λ/4"
    assert lone.armed[Timer.THAW] >= 4 * H_S, "it has not the clock of the policy timer"


def test_a_round_of_questions_is_bounded():
    lone = given("A", thaws=roster(count=400))
    for fid in range(6, 206):
        hear(lone, lone.message("COUNT 8")._replace(sender=fid))
    asked = steps(lone, "report")
    assert len(asked) == len(set(asked)) == 50
    assert set(asked).isdisjoint(f"ROLL_CALL {fid}" for fid in range(5, 206))
    assert set(steps(lone, "report")) != set(asked)


@pytest.mark.parametrize("state", ["A", "BA", "BL", "Wl", "W flying"])
def test_who_is_asked_answers_if_it_is_in_that_swarm(state):
    lone = given(state, thaws=roster())
    xi = lone.m.swarm.xi
    assert steps(lone, "ROLL_CALL 7") == [], "another swarm"
    assert steps(lone, "ROLL_CALL 9") == [], "not its owner"
    if state in ("A", "Wl"):
        happen(lone, "MERGE 8 to 4")
        assert steps(lone, "ROLL_CALL 4 same") == ["COUNT 4"]
    assert xi == 5


def test_a_replacement_inherits_the_swarm_of_its_predecessor_and_asks_for_its_list():
    lone = given("newcomer A", thaws=roster())
    hear(lone, lone.message("MERGE 8 to 5"))
    assert lone.m.swarm == Swarm(5, 0) != Swarm(5, lone.m.incarnation)
    assert steps(lone, "report") == ["ROLL_CALL 1", "ROLL_CALL 2", "ROLL_CALL 3"]
    steps(lone, "COUNT 8 flew 1", "COUNT 9 flew 1")
    assert thawed(lone)


def test_the_owner_of_half_the_display_has_the_clock_of_the_policy_timer():
    lone = given("A, later 2, COUNT 8 flew 1", thaws=roster(count=4))
    assert H_S <= lone.armed[Timer.THAW] <= SPREAD * H_S
    armed = lone.armed[Timer.THAW]
    happen(lone, "COUNT 8 flew 1")
    assert lone.armed[Timer.THAW] == armed, "once"
    happen(lone, "MERGE 8 to 4")
    assert lone.armed[Timer.THAW] >= 2 + 4 * H_S, "not the owner any more"


def test_a_display_that_has_come_to_rest_is_left_to_the_clock():
    lone = given("A", thaws=roster())
    for longest in (1.0, 0.2, 0.009):  # each formation corrects much less than the one before
        assert formation(lone, longest)
    assert not formation(lone, 0.0085), "little, and hardly less than before"
    assert lone.armed[Timer.THAW] <= lone.now + SPREAD * H_S
    assert begins(lone.due(Timer.THAW))[0].known is False
    assert not formation(lone, 0.0), "nobody has flown"


def test_what_has_far_to_go_does_not_rest():
    lone = given("A", thaws=roster())
    assert all(formation(lone, 0.5) for _ in range(5))


def test_a_newcomer_ends_the_rest():
    lone = given("A", thaws=roster())
    assert not formation(lone, 0.0)
    hear(lone, lone.message("COUNT 8")._replace(incarnation=1, vector=(2.0, 0.0, 0.0)))
    assert lone.m.epoch == 1


def test_the_own_flights_count_too():
    lone = given("BA", thaws=roster())
    lone.m.longest = 0.4  # as an owner by inheritance may have
    assert formation(lone, 0.0)


def formation(lone: Lone, longest: float) -> bool:
    """All report; does that begin a thaw?"""
    lone.later(0.1)
    epoch = lone.m.epoch
    for fid in (8, 9):
        hear(lone, lone.message(f"COUNT {fid}")._replace(vector=(longest, 0.0, 0.0)))
    return lone.m.epoch > epoch


# -- census ----------------------------------------------------------------------------------------------------------


def census(words="A", count=3):
    return given(words, thaws=Census(count, H_S, SPREAD))


def test_who_is_r_complete_reports_every_two_lambda():
    lone = census("A, MERGE 8 to 4")
    assert lone.armed[Timer.REPORT] <= 2 * LAMBDA_S
    assert steps(lone, "report") == []
    steps(lone, *HEAD_START)
    for _ in range(3):
        due = lone.armed[Timer.REPORT]
        assert steps(lone, "report") == ["COUNT 4"]
        assert lone.armed[Timer.REPORT] == pytest.approx(due + 2 * LAMBDA_S)
    happen(lone, "NEIGHBOUR 7")
    assert steps(lone, "report") == [], "not complete any more"


def test_the_census_needs_all_the_owner_too():
    lone = census()
    steps(lone, "COUNT 8", "COUNT 9", "COUNT 8", "report")
    assert not thawed(lone)
    steps(lone, *HEAD_START)
    actions = happen(lone, "report")
    assert "THAW all" in in_words(actions)
    assert begins(actions)[0].known
    assert lone.m.epoch == 1


def test_the_last_report_may_be_anothers():
    lone = census()
    steps(lone, *HEAD_START, "report", "COUNT 8")
    assert not thawed(lone), "off by one"
    happen(lone, "COUNT 9")
    assert thawed(lone)


@pytest.mark.parametrize("stale", ["COUNT 9 epoch 0", "COUNT 7"])
def test_the_census_takes_no_stale_report(stale):
    lone = census("A, THAW 7 epoch 1")
    steps(lone, *HEAD_START, "report", "COUNT 8", stale)
    assert lone.m.epoch == 1


def test_the_census_begins_anew_with_another_swarm_and_with_another_epoch():
    lone = census()
    steps(lone, "COUNT 8", "COUNT 9", "MERGE 8 to 4", "MERGE 8 to 5", *HEAD_START, "report")
    assert not thawed(lone)
    lone = census()
    steps(lone, "COUNT 8", "COUNT 9", "THAW 7 epoch 1", *HEAD_START, "report")
    assert lone.m.epoch == 1


# -- corner ----------------------------------------------------------------------------------------------------------


def test_a_corner_announces_when_it_has_been_r_complete_for_a_second_or_two():
    lone = given("A", thaws=corner(is_one=True))
    assert steps(lone, "report", "report") == []
    steps(lone, *HEAD_START)
    assert steps(lone, "report") == []
    assert lone.now + 1.0 <= lone.armed[Timer.REPORT] <= lone.now + 2.0
    assert steps(lone, "report") == ["THAW_ANNOUNCE all"]
    assert lone.now + 1.0 <= lone.armed[Timer.REPORT] <= lone.now + 2.0, "and again"
    happen(lone, "NEIGHBOUR 7")
    assert steps(lone, "report") == [], "it is not complete any more"


def test_others_announce_nothing():
    lone = given("A", thaws=corner())
    steps(lone, *HEAD_START)
    assert Timer.REPORT not in lone.armed


@pytest.mark.parametrize("state", ["A", "BA", "BL", "Wl", "W flying"])
def test_three_copies_within_two_seconds_are_a_thaw(state):
    lone = given(state, thaws=corner(count=10**9))
    assert steps(lone, "THAW_ANNOUNCE 8 of 3", "THAW_ANNOUNCE 9 of 3") == []
    assert not thawed(lone)
    actions = happen(lone, "THAW_ANNOUNCE 8 of 9")
    assert in_words(actions) == [], "the others have had the same copies"
    assert begins(actions) == [(Swarm(5, 0), 0, True)]
    assert lone.m.epoch == 1


def test_copies_grow_old():
    lone = given("A", thaws=corner(count=10**9))
    steps(lone, "THAW_ANNOUNCE 8 of 3", "THAW_ANNOUNCE 9 of 3", "later 2.1", "THAW_ANNOUNCE 8 of 3")
    assert not thawed(lone)


@pytest.mark.parametrize("between", ["MERGE 8 to 4", "THAW 7 epoch 1"])
def test_copies_are_of_one_swarm_of_one_epoch(between):
    lone = given("A", thaws=corner(count=10**9))
    steps(lone, "THAW_ANNOUNCE 8 of 3", "THAW_ANNOUNCE 9 of 3", between)
    epoch = lone.m.epoch
    steps(lone, "THAW_ANNOUNCE 8 of 3", "THAW_ANNOUNCE 9 of 3")
    assert lone.m.epoch == epoch
    steps(lone, "THAW_ANNOUNCE 8 of 9")
    assert lone.m.epoch == epoch + 1


def test_after_a_thaw_a_corner_waits_as_after_its_landing():
    lone = given("A", thaws=corner(is_one=True))
    steps(lone, *HEAD_START, "report", "THAW 7 epoch 1", *HEAD_START)
    assert steps(lone, "report") == [], "R-Complete again, but not for long"
    assert steps(lone, "report") == ["THAW_ANNOUNCE all"]


def test_an_abort_discards_the_copies():
    lone = given("A", thaws=corner(count=10**9))
    steps(lone, "THAW_ANNOUNCE 8 of 3", "THAW_ANNOUNCE 9 of 3", "THAW_ABORT 7", "THAW_ANNOUNCE 8 of 3")
    assert not thawed(lone)
    steps(lone, "THAW_ABORT 7 of 6", "THAW_ANNOUNCE 9 of 3", "THAW_ANNOUNCE 8 of 3")
    assert thawed(lone), "the abort of another swarm's announcement is not ours"


def test_an_aborted_corner_tries_again():
    lone = given("A", thaws=corner(is_one=True))
    steps(lone, *HEAD_START, "report")
    lone.later(0.9)
    happen(lone, "THAW_ABORT 6")
    assert lone.now + 1.0 <= lone.armed[Timer.REPORT] <= lone.now + 2.0
    assert steps(lone, "report") == ["THAW_ANNOUNCE all"]


def test_another_swarm_objects_and_counts_no_copy():
    lone = given("A", thaws=corner())
    actions = [a for _ in range(3) for a in happen(lone, "THAW_ANNOUNCE 7 of 7")]
    assert in_words(actions) == ["THAW_ABORT all"] * 3
    assert {a.message.other for a in actions if isinstance(a, Send)} == {Swarm(7, 0)}
    assert not thawed(lone)


def test_of_a_large_swarm_about_ten_object():
    said = 0
    for seed in range(200):
        lone = given("A", thaws=corner(), seed=seed)
        lone.m.size = 100
        said += len(steps(lone, "THAW_ANNOUNCE 7 of 7"))
    assert 8 < said < 36  # a tenth of 200


def test_about_ten_repeat_an_announcement_and_nobody_a_repetition():
    said = again = 0
    for seed in range(400):
        lone = given("A", thaws=corner(count=100), seed=seed)
        said += len(steps(lone, "THAW_ANNOUNCE 8 of 8"))
        again += len(steps(lone, "THAW_ANNOUNCE 9 of 8"))
    assert 20 < said < 65  # a tenth of 400
    assert again == 0


@pytest.mark.parametrize(("count", "copies"), [(2, 2), (3, 3), (5, 3)])
def test_few_flss_need_no_more_copies_than_they_are(count, copies):
    lone = given("A", thaws=corner(count=count))
    for _ in range(copies - 2):
        assert steps(lone, "THAW_ANNOUNCE 9 of 8") == []  # a repetition
    assert steps(lone, "THAW_ANNOUNCE 8 of 8") == ["THAW_ANNOUNCE all"], "its own copy is one"
    assert thawed(lone)


@pytest.mark.parametrize("word", ["THAW_ANNOUNCE 8 of 8 epoch 2", "THAW_ABORT 8 epoch 2"])
def test_late_copies_of_the_epoch_before_have_no_answer(word):
    """Hundreds would answer the ten that repeated."""
    lone = given("A, THAW 7 epoch 3", thaws=corner())
    assert steps(lone, word) == []
    assert lone.count(Count.STALE) == 1


# -- the policies that do not listen ---------------------------------------------------------------------------------


@pytest.mark.parametrize("word", ["COUNT 8", "ROLL_CALL 8", "THAW_ANNOUNCE 8 of 8", "THAW_ABORT 8"])
def test_with_a_timer_alone_these_messages_do_nothing(word):
    lone = given("A")
    assert [happen(lone, word) for _ in range(5)] == [[]] * 5
    assert not thawed(lone)
