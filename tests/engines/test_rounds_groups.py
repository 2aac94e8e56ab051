"""Who localizes relative to whom: small cases by hand, and what holds in every round."""

import numpy as np
import pytest
from rounds_runs import in_rows

from swarmer.engines.rounds_groups import group_all, merged, pair_exact, pair_fast, select_anchors
from swarmer.engines.rounds_links import Links, Nearest, Swarms, challengers, live_links


def links_of(*lists):
    """Links of swarms of one FLS each."""
    starts = np.cumsum([0, *map(len, lists)])
    return Links(np.arange(len(lists)), starts, in_rows([end for one in lists for end in one]))


def agreed(groups):
    columns = (groups.localizer, groups.anchor, groups.swarm, groups.anchor_swarm, groups.wave)
    return [tuple(int(x) for x in row) for row in zip(*columns, strict=True)]


def selection(strategy, swarms):
    return select_anchors(strategy, swarms, np.random.default_rng(1), none_of(swarms))


def none_of(swarms):
    """No swarm is absolute."""
    return np.zeros(len(swarms), dtype=bool)


def absolute(swarms, *which):
    flags = none_of(swarms)
    flags[list(which)] = True
    return flags


SIX = Swarms.of_ids(np.arange(6))


def test_a_challenger_gathers_the_free_swarms_that_it_sees():
    """0 sees 1 and 2, the lowest anchors; 3 sees busy ones alone and joins the nearest, 2, after it; 4 gathers 5."""
    links = links_of([2, 1], [0], [0], [2, 0], [5], [4])
    groups = group_all(links, SIX, np.arange(6), selection("lowest", SIX))
    assert agreed(groups) == [(2, 0, 2, 0, 1), (1, 0, 1, 0, 1), (3, 2, 3, 2, 2), (5, 4, 5, 4, 1)]
    assert groups.busy_joins == 1
    assert merged(SIX, groups).tolist() == [0, 0, 0, 0, 4, 4]


def test_the_order_says_who_comes_first():
    links = links_of([1], [2], [1], [4], [3], [0])
    groups = group_all(links, SIX, in_rows([5, 2, 3, 0, 1, 4]), selection("lowest", SIX))
    assert agreed(groups) == [(5, 0, 5, 0, 1), (2, 1, 2, 1, 1), (4, 3, 4, 3, 1)]


def test_joins_stand_in_line_wave_after_wave():
    links = links_of([1], [0], [1], [2], [3], [4])
    groups = group_all(links, SIX, np.arange(6), selection("lowest", SIX))
    assert groups.wave.tolist() == [1, 2, 3, 4, 5]
    assert agreed(groups)[1:3] == [(2, 1, 2, 1, 2), (3, 2, 3, 2, 3)]  # 1 and 2 localize themselves
    assert groups.busy_joins == 4


def test_all_localize_relative_to_the_very_fls_that_was_seen():
    """The swarm {1, 4} is seen through 4 first: it anchors with 4, though 1 is seen, too."""
    swarms = Swarms.of_ids(in_rows([0, 1, 2, 3, 1]))
    links = Links(in_rows([0, 1, 2, 3]), in_rows([0, 3, 4, 5, 6]), in_rows([4, 1, 3, 0, 4, 0]))
    groups = group_all(links, swarms, np.arange(4), selection("largest", swarms))
    assert agreed(groups) == [(0, 4, 0, 1, 1), (3, 4, 3, 1, 1), (2, 4, 2, 1, 1)]


def test_who_anchors_by_each_strategy():
    xi = in_rows([0, 1, 1, 1, 4, 4, 6])  # sizes 1, 3, 2, 1
    swarms = Swarms.of_ids(xi)
    links = Links(in_rows([0, 1, 4, 6]), in_rows([0, 1, 2, 5, 6]), in_rows([1, 4, 0, 1, 6, 4]))
    order = in_rows([2, 0, 1, 3])  # the swarm of FLSs 4 and 5 sees all others
    found = {
        strategy: int(group_all(links, swarms, order, selection(strategy, swarms)).anchor_swarm[0])
        for strategy in ("lowest", "largest", "smallest", "challenger")
    }
    assert found == {"lowest": 0, "largest": 1, "smallest": 0, "challenger": 2}


def test_random_anchors_are_anybody():
    links = links_of([1, 2], [0], [0], [], [], [])
    seen = set()
    for seed in range(40):
        groups = group_all(
            links, SIX, np.arange(6), select_anchors("random", SIX, np.random.default_rng(seed), none_of(SIX))
        )
        seen.add(int(groups.anchor_swarm[0]))
    assert seen == {0, 1, 2}


def test_ties_of_size_go_to_the_lower_swarm_id():
    swarms = Swarms.of_ids(in_rows([0, 1, 1, 3, 3]))
    assert selection("largest", swarms).rank.tolist() == [2, 0, 1]
    assert selection("smallest", swarms).rank.tolist() == [0, 1, 2]


def test_pairs_follow_links_and_then_whoever_is_near():
    """0 takes 1, 2 takes 3; 4 and 5 saw busy ones alone, and take each other."""
    position = np.array([[x, 0.0, 0.0] for x in (0, 1, 2.1, 3, 4.5, 50)])
    links = live_links(Nearest(position, 1, 3), SIX)
    groups = pair_fast(links, position, SIX, selection("lowest", SIX))
    assert agreed(groups) == [(1, 0, 1, 0, 1), (3, 2, 3, 2, 1), (5, 4, 5, 4, 1)]


def test_with_an_odd_number_one_is_left_over():
    position = np.array([[x, 0.0, 0.0] for x in (0, 1, 2.5)])
    three = Swarms.of_ids(np.arange(3))
    for groups in (
        pair_fast(live_links(Nearest(position, 1, 3), three), position, three, selection("lowest", three)),
        pair_exact(position, three, none_of(three)),
    ):
        assert len(groups.swarm) == 1


def test_exact_pairs_by_position_and_the_one_whose_turn_it_is_localizes():
    position = np.array([[x, 0.0, 0.0] for x in (0, 9, 1, 8, 2.5, 7)])
    groups = pair_exact(position, SIX, none_of(SIX))
    assert agreed(groups) == [(0, 2, 0, 2, 1), (1, 3, 1, 3, 1), (4, 5, 4, 5, 1)]


def test_exact_pairs_with_the_nearest_fls_of_a_swarm_not_with_its_lowest():
    position = np.array([[0.0, 0, 0], [30, 0, 0], [1, 0, 0]])
    swarms = Swarms.of_ids(in_rows([0, 1, 1]))
    assert agreed(pair_exact(position, swarms, none_of(swarms))) == [(0, 2, 0, 1, 1)]


def plain_exact(position, swarms):
    """The same by the letter."""
    free, pairs = set(range(len(swarms))), []
    for swarm in range(len(swarms)):
        others = [row for row in range(len(position)) if swarms.of[row] in free - {swarm}]
        if swarm not in free or not others:
            continue
        row = int(swarms.members[swarms.starts[swarm]])
        apart = [float(((position[other] - position[row]) ** 2).sum()) for other in others]
        anchor = others[int(np.argmin(apart))]
        free -= {swarm, int(swarms.of[anchor])}
        pairs.append((row, anchor, swarm, int(swarms.of[anchor]), 1))
    return pairs


def test_exact_is_what_its_letter_says_of_many():
    rng = np.random.default_rng(9)
    position, group = rng.random((150, 3)), rng.integers(0, 90, 150)
    swarms = Swarms.of_ids(in_rows([np.flatnonzero(group == one)[0] for one in group]))
    assert agreed(pair_exact(position, swarms, none_of(swarms))) == plain_exact(position, swarms)


@pytest.mark.parametrize("seed", range(8))
def test_what_holds_in_every_round(seed):
    """A swarm moves at most once; whoever anchors in wave 1 stands; a merge is never a circle; something merges."""
    rng = np.random.default_rng(seed)
    position, group = rng.random((200, 3)), rng.integers(0, 200 // 2 ** (seed % 6 + 1), 200)
    swarms = Swarms.of_ids(in_rows([np.flatnonzero(group == one)[0] for one in group]))
    strategy = ["lowest", "largest", "smallest", "challenger", "random"][seed % 5]
    chosen = select_anchors(strategy, swarms, rng, none_of(swarms))
    sight = Nearest(position, 5, 3)
    everyone = group_all(challengers(sight, swarms), swarms, rng.permutation(len(swarms)), chosen)
    two = pair_fast(live_links(sight, swarms), position, swarms, chosen)
    for groups in (everyone, two):
        assert len(set(groups.swarm.tolist())) == len(groups.swarm)
        wave = dict(zip(groups.swarm.tolist(), groups.wave.tolist(), strict=True))
        for one in agreed(groups):
            assert one[4] == wave.get(one[3], 0) + 1
            assert swarms.of[one[0]] == one[2]
            assert swarms.of[one[1]] == one[3]
        after = merged(swarms, groups)
        assert len(np.unique(after)) == len(swarms) - len(groups.swarm)
        for name in np.unique(after):
            assert np.flatnonzero(after == name)[0] == name, "a swarm's id is its lowest FID"
    assert len(everyone.swarm) > 0
    assert len(two.swarm) == len(swarms) // 2


# -- oracles -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("strategy", ["lowest", "largest", "challenger", "random"])
def test_an_absolute_swarm_anchors_whatever_the_strategy(strategy):
    """0 sees 1, 2 and 3, of which 2 is absolute; 4 sees busy ones alone and joins the nearest, 1, after it."""
    links = links_of([1, 2, 3], [0], [0], [0], [1, 0], [4])
    chosen = select_anchors(strategy, SIX, np.random.default_rng(1), absolute(SIX, 2))
    groups = group_all(links, SIX, np.arange(6), chosen)
    assert agreed(groups)[:4] == [(0, 2, 0, 2, 1), (1, 2, 1, 2, 1), (3, 2, 3, 2, 1), (4, 1, 4, 1, 2)]


def test_of_two_absolute_swarms_nobody_measures():
    links = links_of([1, 2], [0], [0], [], [], [])
    flags = absolute(SIX, 0, 1)
    chosen = select_anchors("lowest", SIX, np.random.default_rng(1), flags)
    groups = group_all(links, SIX, np.arange(6), chosen)
    assert agreed(groups) == [(1, 0, 1, 0, 1), (2, 0, 2, 0, 1)]
    assert agreed(groups.measuring(flags)) == [(2, 0, 2, 0, 1)]
    assert groups.measuring(none_of(SIX)) is groups


def test_an_absolute_swarm_joins_busy_ones_only_if_they_come_to_stand_right():
    """1 gathers 0; 2 is absolute and sees these alone: it waits. 3 is, sees 4 and 5 busy, and 4 anchors as absolute."""
    links = links_of([], [0], [0, 1], [5, 4], [5], [])
    flags = absolute(SIX, 2, 3, 4)
    chosen = select_anchors("lowest", SIX, np.random.default_rng(1), flags)
    groups = group_all(links, SIX, in_rows([1, 2, 4, 3, 0, 5]), chosen)
    assert agreed(groups) == [(1, 0, 1, 0, 1), (5, 4, 5, 4, 1), (3, 5, 3, 5, 2)]
    assert groups.busy_joins == 1
    assert agreed(groups.measuring(flags)) == [(1, 0, 1, 0, 1), (5, 4, 5, 4, 1)]


@pytest.mark.parametrize("seed", range(6))
def test_no_absolute_swarm_is_ever_corrected_by_one_that_is_not(seed):
    rng = np.random.default_rng(seed)
    position, group = rng.random((200, 3)), rng.integers(0, 200 // 2 ** (seed % 4 + 1), 200)
    swarms = Swarms.of_ids(in_rows([np.flatnonzero(group == one)[0] for one in group]))
    flags = absolute(swarms, *rng.integers(0, len(swarms), 4).tolist())
    strategy = ["lowest", "largest", "smallest", "challenger", "random"][seed % 5]
    chosen = select_anchors(strategy, swarms, rng, flags)
    sight = Nearest(position, 5, 3)
    everyone = group_all(challengers(sight, swarms), swarms, rng.permutation(len(swarms)), chosen)
    pairs = pair_fast(live_links(sight, swarms), position, swarms, chosen)
    for groups in (everyone, pairs, pair_exact(position, swarms, flags)):
        anchor_of = dict(zip(groups.swarm.tolist(), groups.anchor_swarm.tolist(), strict=True))
        for swarm in np.flatnonzero(flags).tolist():
            while swarm in anchor_of:
                swarm = anchor_of[swarm]
            assert flags[swarm], "who stands at the end of the line stands right"
        assert len(groups.swarm) > 0
        assert len(np.unique(merged(swarms, groups))) == len(swarms) - len(groups.swarm)
