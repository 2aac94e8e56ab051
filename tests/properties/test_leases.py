"""Leases against a model that keeps everything: any order of grants, releases, cancels and moments."""

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from swarmer.protocol.leases import Leases

LASTS_S = 0.25
FIDS, CHALLENGES = st.integers(1, 4), st.integers(1, 3)


class LeaseBook(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.leases, self.now = Leases(LASTS_S), 0.0
        self.granted: dict[int, float] = {}  # FID -> when last
        self.pairings: dict[int, set[int]] = {}

    def end(self, fid):
        del self.granted[fid], self.pairings[fid]

    @rule(seconds=st.sampled_from([0.0, 0.01, 0.125, 0.25, 1.0]))
    def wait(self, seconds):
        self.now += seconds

    @rule(fid=FIDS, challenge=CHALLENGES)
    def grant(self, fid, challenge):
        self.leases.grant(fid, challenge, self.now)
        self.granted[fid] = self.now
        self.pairings.setdefault(fid, set()).add(challenge)

    @rule(fid=FIDS)
    def release(self, fid):
        assert self.leases.release(fid) == (fid in self.granted)
        if fid in self.granted:
            self.end(fid)

    @rule(fid=FIDS, challenge=CHALLENGES)
    def cancel(self, fid, challenge):
        pairings = self.pairings.get(fid, set())
        last = pairings == {challenge}
        assert self.leases.cancel(fid, challenge) == last
        pairings.discard(challenge)
        if last:
            self.end(fid)

    @rule()
    def expire(self):
        over = {fid for fid, since in self.granted.items() if since + LASTS_S <= self.now}
        assert set(self.leases.expire(self.now)) == over
        for fid in over:
            self.end(fid)

    @rule()
    def clear(self):
        self.leases.clear()
        self.granted.clear()
        self.pairings.clear()

    @invariant()
    def same_as_the_model(self):
        ends = {fid: since + LASTS_S for fid, since in self.granted.items()}
        assert self.leases.ends() == ends
        assert len(self.leases) == len(ends)
        assert [fid in self.leases for fid in range(1, 5)] == [fid in ends for fid in range(1, 5)]
        assert self.leases.next_expiry() == min(ends.values(), default=None)


TestLeaseBook = LeaseBook.TestCase
TestLeaseBook.settings = settings(max_examples=150, stateful_step_count=40)
