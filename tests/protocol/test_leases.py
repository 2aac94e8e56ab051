from hypothesis import given
from hypothesis import strategies as st

from swarmer.protocol.leases import Leases


def test_a_lease_lasts_its_time_from_the_last_grant():
    leases = Leases(0.25)
    leases.grant(7, 1, 10.0)
    assert leases.next_expiry() == 10.25
    assert leases.expire(10.249) == []
    leases.grant(7, 1, 10.2)
    assert leases.next_expiry() == 10.2 + 0.25
    assert leases.expire(10.3) == []
    assert leases.expire(10.5) == [7]
    assert not leases
    assert leases.next_expiry() is None


def test_each_has_a_lease_of_its_own():
    leases = Leases(1.0)
    for now, fid in enumerate((5, 6, 7)):
        leases.grant(fid, fid, float(now))
    assert len(leases) == 3
    assert leases.release(6)
    assert not leases.release(6)
    assert leases.next_expiry() == 1.0
    assert leases.expire(3.0) == [5, 7]


def test_a_cancel_ends_only_what_its_challenge_began():
    leases = Leases(1.0)
    leases.grant(7, 100, 0.0)
    leases.grant(7, 200, 0.0)  # the two challenged each other at once
    assert not leases.cancel(7, 300)
    assert not leases.cancel(8, 100)
    assert not leases.cancel(7, 100)
    assert 7 in leases
    assert leases.cancel(7, 200)
    assert not leases
    leases.grant(7, 300, 0.0)
    assert not leases.cancel(7, 200), "forgotten with the lease"


grants = st.lists(st.tuples(st.integers(1, 5), st.integers(1, 3), st.floats(0.0, 10.0)), max_size=20)


@given(grants, st.floats(0.0, 12.0))
def test_what_is_live_is_what_was_granted_less_than_a_lease_ago(granted, now):
    leases, last = Leases(1.0), {}
    for fid, challenge, at in sorted(granted, key=lambda grant: grant[2]):
        leases.grant(fid, challenge, at)
        last[fid] = at
    over = leases.expire(now)
    assert sorted(over) == sorted(fid for fid, at in last.items() if at + 1.0 <= now)
    assert all((fid in leases) == (at + 1.0 > now) for fid, at in last.items())
    leases.clear()
    assert not len(leases)
    assert not leases.cancel(1, 1)
