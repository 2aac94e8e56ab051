"""The radio's rules: who hears a datagram, what becomes of it on the way, and that none is taken twice."""

from collections import Counter
from itertools import pairwise
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmer.messages import NO_SWARM, Kind, Message, Stamp, Swarm, To
from swarmer.radio import LOST, Ears, End, EndRules, Grid, ReplayWindow, dead_link, fate, heard
from swarmer.streams import stream

# -- fate ------------------------------------------------------------------------------------------------------------


def fates(rules, count=20_000, seed=1):
    rng = Random(seed)
    return [fate(rules, rng) for _ in range(count)]


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 1.0])
def test_so_many_are_lost_and_so_many_come_twice(share):
    drawn = fates(EndRules(loss=share))
    assert sum(copies == LOST for copies in drawn) / len(drawn) == pytest.approx(share, abs=0.01)
    assert {copies for copies in drawn if copies} <= {(0.0,)}
    doubled = fates(EndRules(duplicate=share))
    assert sum(len(copies) == 2 for copies in doubled) / len(doubled) == pytest.approx(share, abs=0.01)


def test_delay_jitter_and_being_held_back():
    drawn = [copies[0] for copies in fates(EndRules(delay_s=0.1, jitter_s=0.02))]
    assert 0.08 <= min(drawn) < 0.081
    assert 0.119 < max(drawn) <= 0.12
    assert sum(drawn) / len(drawn) == pytest.approx(0.1, abs=0.001)
    assert min(copies[0] for copies in fates(EndRules(delay_s=0.01, jitter_s=0.05))) == 0.0, (
        "no datagram is early"
    )
    held = Counter(copies[0] for copies in fates(EndRules(reorder=0.25, reorder_s=0.005)))
    assert set(held) == {0.0, 0.005}
    assert held[0.005] / 20_000 == pytest.approx(0.25, abs=0.01)


def test_faults_are_independent():
    drawn = fates(EndRules(loss=0.5, duplicate=0.5, reorder=0.5, reorder_s=1.0))
    seen = Counter((len(copies), copies[0] if copies else None) for copies in drawn)
    for case, share in {
        (0, None): 0.5,
        (1, 0.0): 0.125,
        (1, 1.0): 0.125,
        (2, 0.0): 0.125,
        (2, 1.0): 0.125,
    }.items():
        assert seen[case] / len(drawn) == pytest.approx(share, abs=0.012)


shares = st.floats(0.0, 1.0)


@given(st.builds(EndRules, shares, shares, shares, shares, shares, shares), st.integers(0, 2**32))
def test_every_call_draws_equally_often(rules, seed):
    """So one fault turned on does not change another's draws."""
    mine, plain = Random(seed), Random(seed)
    fate(rules, mine)
    fate(EndRules(), plain)
    assert mine.getstate() == plain.getstate()


def test_loss_takes_away_and_changes_nothing_else():
    rules = EndRules(duplicate=0.3, reorder=0.3, reorder_s=0.01, delay_s=0.05, jitter_s=0.05)
    whole, thinned = fates(rules), fates(rules._replace(loss=0.4))
    assert all(thin in (LOST, full) for full, thin in zip(whole, thinned, strict=True))


def test_a_perfect_end_says_so():
    assert EndRules().perfect
    for name in ("loss", "duplicate", "reorder", "delay_s", "jitter_s"):
        assert not EndRules(**{name: 0.1}).perfect


# -- bursts and dead links ---------------------------------------------------------------------------------------------


def losses(rules, count=40_000, seed=1):
    """Which of so many datagrams are lost."""
    end = End(rules, lambda purpose: stream(seed, purpose), "sender")
    return [end.copies() == LOST for _ in range(count)]


def runs_of(lost):
    """How long each run of losses was."""
    text = "".join("x" if one else "." for one in lost)
    return [len(run) for run in text.split(".") if run]


@pytest.mark.parametrize(("loss", "burst"), [(0.05, 4), (0.3, 10), (0.6, 3), (0.9, 1), (1.0, 5), (0.0, 5)])
def test_bursts_lose_as_much_in_the_long_run_and_in_longer_runs(loss, burst):
    lost = losses(EndRules(loss=loss, burst=burst))
    assert sum(lost) / len(lost) == pytest.approx(loss, abs=0.03)
    if 0.0 < loss < 0.5:
        runs = runs_of(lost)
        assert sum(runs) / len(runs) == pytest.approx(burst, rel=0.1)
        alone = runs_of(losses(EndRules(loss=loss)))
        assert sum(alone) / len(alone) < 1.6


def test_within_a_burst_some_may_get_through():
    lost = losses(EndRules(loss=0.2, burst=20, burst_loss=0.5))
    assert sum(lost) / len(lost) == pytest.approx(0.2, abs=0.02)
    # Of two datagrams in a row the second is lost half the time if the first was: the burst goes on.
    after = [second for first, second in pairwise(lost) if first]
    assert sum(after) / len(after) == pytest.approx(0.5 * 0.95 + 0.05 * 0.2, abs=0.03)


def test_bursts_change_nothing_else():
    rules = EndRules(duplicate=0.3, reorder=0.3, reorder_s=0.01, loss=0.2)
    ends = [End(one, lambda purpose: stream(1, purpose), "x") for one in (rules, rules._replace(burst=8))]
    plain, bursty = ([end.copies() for _ in range(2000)] for end in ends)
    both = [(one, two) for one, two in zip(plain, bursty, strict=True) if LOST not in (one, two)]
    assert len(both) > 1000
    assert all(one == two for one, two in both)


def test_a_share_of_links_is_dead_each_direction_by_itself():
    pairs = [(a, b) for a in range(1, 61) for b in range(1, 61) if a != b]
    dead = {pair for pair in pairs if dead_link(7, *pair, 0.2)}
    assert len(dead) / len(pairs) == pytest.approx(0.2, abs=0.02)
    both = sum((b, a) in dead for a, b in dead)
    assert both / len(dead) == pytest.approx(0.2, abs=0.05), "one direction tells nothing of the other"
    assert dead < {pair for pair in pairs if dead_link(7, *pair, 0.4)}, "more of them, and the same ones"
    assert dead != {pair for pair in pairs if dead_link(8, *pair, 0.2)}
    assert not any(dead_link(7, *pair, 0.0) for pair in pairs)
    assert all(dead_link(7, *pair, 1.0) for pair in pairs)


# -- the replay window -----------------------------------------------------------------------------------------------


class Remembers:
    """The window's rule in plain words: keep everything, ask whether it was there."""

    def __init__(self, window):
        self.window, self.of = window, {}

    def fresh(self, sender, incarnation, number):
        known, newest, seen = self.of.get(sender, (-1, None, set()))
        if incarnation > known:
            self.of[sender] = (incarnation, number, {number})
            return True
        behind = (newest - number) % 2**32
        if behind >= 2**31:  # it is newer
            self.of[sender] = (known, number, seen | {number})
            return incarnation == known
        if incarnation < known or behind > self.window or number in seen:
            return False
        seen.add(number)
        return True


steps = st.tuples(st.integers(1, 2), st.integers(0, 2), st.integers(-80, 80))


@given(st.lists(steps, max_size=60), st.sampled_from([64, 0, 3]), st.sampled_from([100, 2**32 - 50, 0]))
def test_the_window_agrees_with_one_that_remembers_everything(walk, window, start):
    mine, model = ReplayWindow(window), Remembers(window)
    number = start
    for sender, incarnation, step in walk:
        number = (number + step) % 2**32
        known = model.of.get(sender)
        if known and incarnation < known[0]:
            assert not mine.fresh(sender, incarnation, number)
            continue
        assert mine.fresh(sender, incarnation, number) == model.fresh(sender, incarnation, number)


def test_the_window_is_64_wide():
    window = ReplayWindow()
    assert window.fresh(1, 0, 100)
    assert window.fresh(1, 0, 36)
    assert not window.fresh(1, 0, 36)
    assert not window.fresh(1, 0, 35)
    assert window.fresh(1, 0, 1000)
    assert window.fresh(1, 0, 999)
    assert not window.fresh(1, 0, 100)


def test_the_papers_rule_takes_only_what_is_newer():
    window = ReplayWindow(0)
    assert [window.fresh(1, 0, number) for number in (5, 4, 5, 6, 9, 7)] == [
        True,
        False,
        False,
        True,
        True,
        False,
    ]


def test_numbers_wrap_at_32_bits_and_none_is_lost_or_doubled():
    window = ReplayWindow()
    numbers = [number % 2**32 for number in range(2**32 - 50, 2**32 + 50)]
    assert all(window.fresh(1, 0, number) for number in numbers)
    assert not any(window.fresh(1, 0, number) for number in numbers)


def test_a_predecessor_is_never_heard_again():
    window = ReplayWindow()
    assert window.fresh(1, 0, 5000)
    assert window.fresh(1, 1, 1), "a successor begins anew"
    assert not window.fresh(1, 0, 5001)
    assert window.fresh(2, 0, 5001), "senders have nothing to do with each other"


# -- who hears -------------------------------------------------------------------------------------------------------

EARS = Ears(run=1, fid=5, swarm=Swarm(4, 0), truth=(0.0, 0.0, 0.0), neighbours=frozenset({8}))
DARK = EARS._replace(swarm=NO_SWARM)


def refusal(ears=EARS, run=1, origin=(0.0, 0.0, 0.0), here=None, **changes):
    message = Message(Kind.MERGE, 7, 0, 0, Swarm(7, 0), 1, (3.0, 4.0, 0.0), To.ALL)._replace(**changes)
    return heard(message, Stamp(run, 1, origin, 0.0), ears, 10, here)


def test_another_runs_datagrams_are_none():
    assert refusal(run=2) == "run"
    assert refusal() is None


def test_only_the_fids_of_the_run_and_never_oneself():
    assert refusal(sender=5) == "sender"
    assert refusal(sender=11) == "sender"
    assert refusal(sender=10) is None
    assert refusal(sender=0, kind=Kind.THAW) is None


def test_it_is_for_one_for_a_swarm_or_for_all():
    assert refusal(to=To.FLS, addressee=Swarm(5, 0)) is None
    assert refusal(to=To.FLS, addressee=Swarm(6, 0)) == "address"
    assert refusal(to=To.FLS, addressee=Swarm(5, 0), ears=DARK) is None
    assert refusal(to=To.SWARM, addressee=Swarm(4, 0)) is None
    assert refusal(to=To.SWARM, addressee=Swarm(4, 1)) == "address", "a replaced owner's swarm is another"
    assert refusal(to=To.SWARM, addressee=Swarm(5, 0)) == "address"
    assert refusal(to=To.SWARM, addressee=NO_SWARM, ears=DARK) == "address"
    assert refusal(kind=Kind.THAW, ears=DARK) is None


def init(**changes):
    return refusal(**{"kind": Kind.CHALLENGE_INIT, "range": 5.0, **changes})


def test_a_challenge_reaches_as_far_as_its_range():
    assert init() is None
    assert init(range=4.999) == "range"
    assert refusal(range=1.0) is None, "all other messages go as far as there is"


def test_a_challenge_of_the_own_swarm_gets_no_further_unless_from_a_planned_neighbour():
    assert init(swarm=Swarm(4, 0)) == "own"
    assert init(swarm=Swarm(4, 0), sender=8) is None
    assert init(swarm=Swarm(4, 0), sender=8, range=1.0) == "range"
    assert init(swarm=Swarm(4, 1)) is None


def test_the_dark_hear_no_challenge():
    assert init(ears=DARK) == "address"


def test_the_authors_measure_ranges_between_positions():
    assert init(range=1.0, origin=(20.0, 0.0, 0.0), here=(20.5, 0.0, 0.0)) is None
    assert init(range=50.0, origin=(20.0, 0.0, 0.0), here=(90.0, 0.0, 0.0)) == "range"


# -- the kernel's grid -------------------------------------------------------------------------------------------------

cells = st.floats(-500.0, 500.0)
places = st.tuples(cells, cells, cells)


@given(places, places, st.floats(0.0, 2000.0))
def test_the_grid_never_drops_what_is_in_range(a, b, radius):
    grid = Grid.for_display(1800.0)
    far = sum((x - y) ** 2 for x, y in zip(a, b, strict=True)) ** 0.5
    steps2 = 0
    for x, y in zip(grid.of(a), grid.of(b), strict=True):
        step = (x - y) & 0xFFFFFFFF
        steps2 += min(step, 2**32 - step) ** 2
    assert steps2 < 2**32
    assert steps2 <= grid.reach2(radius) or far > radius
