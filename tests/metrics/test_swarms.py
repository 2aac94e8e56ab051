import numpy as np

from swarmer.metrics.swarms import SwarmStatistics, swarm_statistics

IDS = np.array([1, 1, 3, 4], np.int32)


def test_dark_flss_belong_to_no_swarm():
    assert swarm_statistics(IDS, np.array([True, True, True, False])) == SwarmStatistics(2, 1, 2, False)


def test_one_swarm_of_some_is_not_single():
    assert not swarm_statistics(IDS, np.array([True, True, False, False])).single
    assert swarm_statistics(np.ones(4, np.int32), np.ones(4, bool)).single


def test_the_swarm_of_a_successor_is_another_one():
    replaced = np.array([1, 0, 0, 0], np.int32)
    assert swarm_statistics(np.ones(4, np.int32), np.ones(4, bool), replaced) == SwarmStatistics(
        2, 1, 3, False
    )
    assert swarm_statistics(np.ones(4, np.int32), np.ones(4, bool), np.ones(4, np.int32)).single
    assert not swarm_statistics(np.ones(4, np.int32), np.array([False, True, True, True]), replaced).single


def test_nobody_lit():
    assert swarm_statistics(IDS, np.zeros(4, bool)) == SwarmStatistics(0, 0, 0, False)
