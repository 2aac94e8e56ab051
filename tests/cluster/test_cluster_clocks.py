"""How far a host's clock is from ours: the offset and the bound of its error; who is too far off is refused."""

from random import Random

import pytest

from swarmer.config import load_config
from swarmer.engines.cluster.clocks import Exchange, Offset, estimate
from swarmer.engines.cluster.hosts import check_clock
from swarmer.errors import BadInput

AHEAD_S, WALL_S = 86_400.5, 3.25


def exchange(asked, there_s, back_s):
    """One whose ways took so long, with a host that is AHEAD_S and WALL_S ahead."""
    heard = asked + there_s + back_s
    wall = 1e9 + asked + there_s
    return Exchange(asked, asked + there_s + AHEAD_S, wall + WALL_S, heard, 1e9 + heard)


def test_equal_ways_give_the_offset_itself():
    found = estimate([exchange(10.0, 0.002, 0.002)])
    assert found.offset_s == pytest.approx(AHEAD_S, abs=1e-9)
    assert found.apart_s == pytest.approx(WALL_S, abs=1e-6)


def test_the_error_is_within_its_bound_however_unequal_the_ways():
    rng = Random(1)
    for _ in range(300):
        told = [exchange(rng.uniform(0, 100), rng.expovariate(200), rng.expovariate(2000)) for _ in range(8)]
        found = estimate(told)
        assert abs(found.offset_s - AHEAD_S) <= found.bound_s + 1e-9
        assert abs(found.apart_s - WALL_S) <= found.bound_s + 1e-6
        assert found.bound_s == min(one.heard - one.asked for one in told) / 2


def refused(offset, **settings):
    config = load_config(**{f"cluster.{name}": value for name, value in settings.items()})
    with pytest.raises(BadInput) as caught:
        check_clock(config.cluster, "b", offset)
    return str(caught.value)


def test_a_clock_that_is_too_far_off_is_refused():
    assert refused(Offset(5.0, 0.001, -2.5)) == (
        "cluster.clocks_apart_s: the clock of b is 2.5 s behind this one's, and 1 is allowed; have NTP set both"
    )
    assert "0.02 s ahead of this one's" in refused(Offset(5.0, 0.001, 0.02), clocks_apart_s=0.01)


def test_a_clock_that_cannot_be_read_well_is_refused():
    assert refused(Offset(5.0, 0.04, 0.1)) == (
        "cluster.clock_bound_ms: the clock of b is known to 40 ms only, and 10 is allowed; "
        "a network that answers sooner"
    )


def test_a_monotonic_clock_may_begin_anywhere():
    check_clock(load_config().cluster, "b", Offset(-1e6, 0.001, 0.2))
