from itertools import pairwise

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from swarmer.messages import Swarm
from swarmer.protocol.anchor_selection import STRATEGIES, Party, largest, lowest, random, smallest

swarms = st.builds(Swarm, st.integers(1, 50), st.integers(0, 2))
sizes = st.integers(1, 20)


@pytest.mark.parametrize("rule", STRATEGIES.values(), ids=STRATEGIES)
@given(swarms, swarms, sizes, sizes, st.integers(1, 2**32 - 1), st.booleans())
def test_of_two_ends_one_anchors(rule, mine, theirs, my_size, their_size, challenge, i_challenged):
    assume(mine != theirs)  # FLSs of one swarm do not pair
    me, other = Party(mine, my_size, i_challenged), Party(theirs, their_size, not i_challenged)
    assert rule(me, other, challenge) is not rule(other, me, challenge)


def party(xi, size=1, challenged=False, incarnation=0):
    return Party(Swarm(xi, incarnation), size, challenged)


def test_each_strategy_does_what_its_name_says():
    assert lowest(party(3), party(5), 1)
    assert lowest(party(3), party(3, incarnation=1), 1), "of equal ids the older incarnation"
    assert largest(party(5, size=9), party(3, size=2), 1)
    assert largest(party(3, size=2), party(5, size=2), 1), "ties: the lower"
    assert smallest(party(5, size=1), party(3, size=2), 1)
    assert smallest(party(3, size=2), party(5, size=2), 1)
    assert STRATEGIES["challenger"](party(5, challenged=True), party(3), 1)


def test_the_coin_is_fair_and_challenges_do_not_land_alike():
    tosses = [random(party(1, challenged=True), party(2), challenge) for challenge in range(1, 2001)]
    assert 0.45 < sum(tosses) / 2000 < 0.55
    runs = sum(a != b for a, b in pairwise(tosses))
    assert runs > 600
