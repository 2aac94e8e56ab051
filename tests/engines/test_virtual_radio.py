"""The radio in memory: whom a datagram reaches, when, and that a handler that is busy takes up the urgent first."""

from itertools import chain

import numpy as np
import pytest
from virtual_runs import fly

from swarmer.config import load_config
from swarmer.engines import virtual
from swarmer.engines.specs import fls_rows, fls_spec
from swarmer.engines.virtual_fls import Shared, VirtualFls
from swarmer.engines.virtual_radio import Air
from swarmer.engines.virtual_time import DATAGRAM, FREE, GROUP, SLOT, Agenda, Trace
from swarmer.fls import LAUNCH, NEVER
from swarmer.messages import NO_SWARM, Kind, Message, Stamp, Swarm, To
from swarmer.metrics.lateness import BUCKETS, bucket
from swarmer.plan import make_plan
from swarmer.protocol.events import Due, Landed, Received, Timer
from swarmer.streams import stream
from swarmer.telemetry import COUNTERS, Wire

POINTS = 120


def display(handling_s=0.0, latency_s=(0.001, 0.003), **settings):
    """All FLSs of a random cloud, lit and each its own swarm, with nothing on the agenda."""
    plan = make_plan(load_config(shape="random", points=POINTS, **settings))
    agenda = Agenda()
    air = Air(agenda, latency_s, plan.cloud.points, plan.rules)
    shared = Shared(
        1, plan.rules, agenda, air, lambda *_: None, handling_s, [0] * COUNTERS, [0] * BUCKETS, [0] * BUCKETS
    )
    flss = {spec.fid: VirtualFls(shared, spec) for spec in map(fls_spec, fls_rows(plan))}
    for fls in flss.values():
        fls.due[LAUNCH] = NEVER
        fls.feed(Landed())
    forget(agenda)
    return plan, shared, flss


def forget(agenda):
    """Strike out all that is to come."""
    agenda.heap.clear()
    agenda._far.clear()


def coming(agenda):
    """All that is to come, in order."""
    entries = [*agenda.heap, *chain.from_iterable(agenda._far.values())]
    return sorted(entry for entry in entries if entry[2] != SLOT)


def message(kind, sender=1, to=To.ALL, addressee=NO_SWARM, reach=1e9, swarm=None, challenge=0, epoch=0):
    return Message(
        int(kind), sender, 0, epoch, swarm or Swarm(sender, 0), 1, (0.0, 0.0, 0.0), int(to), addressee, 0, challenge,
        reach,
    )  # fmt: skip


def reached(shared, sender, what):
    """(second, FID) of everybody that a message is on its way to."""
    forget(shared.agenda)
    place = sender.flight.start
    shared.air.transmit(
        what._replace(truth=sender.spec.truth), Stamp(1, 1, place, 0.0), stream(1, "x"), sender
    )
    if not coming(shared.agenda):
        return []
    [(at, _, kind, fls, one, _two)] = coming(shared.agenda)
    if kind == DATAGRAM:
        return [(at, fls.fid)]
    assert kind == GROUP
    arrivals = [(second, fls.fid) for second, fls in one]
    assert [at for at, _ in arrivals] == sorted((at for at, _ in arrivals), reverse=True)
    assert arrivals[-1][0] == at
    return arrivals


def test_one_addressee():
    _, shared, flss = display()
    [(at, fid)] = reached(shared, flss[1], message(Kind.CHALLENGE_FIN, to=To.FLS, addressee=Swarm(7, 0)))
    assert fid == 7
    assert 0.001 <= at <= 0.003
    assert reached(shared, flss[7], message(Kind.CHALLENGE_FIN, 7, To.FLS, Swarm(7, 0))) == []
    shared.air.leave(flss[7])
    assert reached(shared, flss[1], message(Kind.CHALLENGE_FIN, to=To.FLS, addressee=Swarm(7, 0))) == []


def test_all_of_one_swarm_each_after_a_latency_of_its_own():
    _, shared, flss = display()
    for fid in (3, 4, 5):
        flss[fid].machine.swarm = Swarm(2, 0)
        flss[fid]._retune()
    arrivals = reached(shared, flss[4], message(Kind.SET_WAITING, 4, To.SWARM, Swarm(2, 0)))
    assert sorted(fid for _, fid in arrivals) == [2, 3, 5]
    assert len({at for at, _ in arrivals}) == 3
    assert all(0.001 <= at <= 0.003 for at, _ in arrivals)
    shared.air.leave(flss[3])
    arrivals = reached(shared, flss[4], message(Kind.SET_WAITING, 4, To.SWARM, Swarm(2, 0)))
    assert sorted(fid for _, fid in arrivals) == [2, 5]
    assert reached(shared, flss[4], message(Kind.SET_WAITING, 4, To.SWARM, Swarm(3, 0))) == []


def test_a_swarm_without_members_is_forgotten():
    _, shared, flss = display()
    assert len(shared.air.swarms) == POINTS
    for fls in flss.values():
        shared.air.leave(fls)
    assert shared.air.swarms == {}


def test_a_thaw_reaches_all_others():
    _, shared, flss = display()
    arrivals = reached(shared, flss[9], message(Kind.THAW, 9))
    assert sorted(fid for _, fid in arrivals) == [fid for fid in flss if fid != 9]


@pytest.mark.parametrize("reach", [0.5, 3.0, 8.0, 15.0, 1e6])
@pytest.mark.parametrize("measured", ["ground_truth", "estimated"])
def test_a_challenge_reaches_all_in_range_and_nobody_else(reach, measured):
    """Also where the table that came with the plan is too short, and is made longer."""
    plan, shared, flss = display(**{"range.measured": measured, "deploy.start": "random"})
    real = measured == "estimated"
    places = np.array([fls.flight.start for fls in flss.values()]) if real else plan.cloud.points
    for fid in (1, 50, POINTS):
        for wanted in (reach, reach / 2, 1.2 * reach):
            arrivals = reached(shared, flss[fid], message(Kind.CHALLENGE_INIT, fid, reach=wanted))
            far = np.linalg.norm(places - places[fid - 1], axis=1)
            inside = {int(row) + 1 for row in np.flatnonzero(far <= wanted)} - {fid}
            assert {other for _, other in arrivals} == inside


def test_a_challenge_of_the_own_swarm_reaches_only_planned_neighbours():
    plan, shared, flss = display()
    for fls in flss.values():
        fls.machine.swarm = Swarm(1, 0)
        fls._retune()
    arrivals = reached(shared, flss[1], message(Kind.CHALLENGE_INIT, swarm=Swarm(1, 0)))
    assert {fid for _, fid in arrivals} == set(plan.neighbours.neighbours[0])


def test_no_datagram_arrives_before_the_shortest_latency_or_after_the_longest(monkeypatch):
    ways = []

    class Tap(VirtualFls):
        def take(self, message, stamp):
            ways.append(self._agenda.now - stamp.sent_at)
            super().take(message, stamp)

    monkeypatch.setattr(virtual, "VirtualFls", Tap)
    fly(duration_s=6, **{"virtual.latency_min_ms": 2, "virtual.latency_max_ms": 3})
    assert len(ways) > 1000
    assert 0.002 - 1e-9 <= min(ways) < 0.0021
    assert 0.0029 < max(ways) <= 0.003 + 1e-9


def test_the_trace_is_of_every_number_in_its_place():
    def traced(*values):
        trace = Trace()
        trace.values += values
        trace.hash_values()
        trace.values += values
        return trace.sha256()

    assert traced(0.5, 1, 2) == traced(0.5, 1, 2)
    assert len({traced(0.5, 1, 2), traced(0.5, 2, 1), traced(0.5, 1), traced()}) == 4


# -- a handler that takes its time -----------------------------------------------------------------------------------


def busy(**settings):
    """A busy FLS among others, and what its machine is fed from now on."""
    _, shared, flss = display(0.010, **settings)
    fls, fed = flss[5], []
    handle, receive = fls.machine.handle, fls.machine.receive

    def received(message, now, noted):
        fed.append((round(now, 6), Received(message, noted)))
        return receive(message, now, noted)

    fls.machine.handle = lambda event, now: fed.append((round(now, 6), event)) or handle(event, now)
    fls.machine.receive = received
    return shared, fls, fed


def pass_time(shared, fls, until_s):
    """Wake the handler as the engine does."""
    agenda = shared.agenda
    while (entries := coming(agenda)) and entries[0][0] <= until_s:
        (at, _, what, whose, *_), rest = entries[0], entries[1:]
        forget(agenda)
        agenda.heap += rest
        agenda.now = at
        if what == FREE and whose is fls:
            fls.wake()
    agenda.now = until_s


def kinds(fed):
    return [
        Kind(event.message.kind).name if type(event) is Received else type(event).__name__ for _, event in fed
    ]


def test_while_it_is_busy_the_urgent_overtake():
    shared, fls, fed = busy()
    for number, (kind, to) in enumerate(
        [
            (Kind.CHALLENGE_ACCEPT, To.FLS),
            (Kind.LEASE_RENEW, To.FLS),
            (Kind.SET_AVAILABLE, To.SWARM),
            (Kind.THAW, To.ALL),
        ],
        1,
    ):
        addressee = {To.FLS: Swarm(5, 0), To.SWARM: Swarm(5, 0)}.get(to, NO_SWARM)
        fls.hear(
            message(kind, 1, to, addressee, epoch=int(kind == Kind.THAW)), Stamp(1, number, (0, 0, 0), 0.0)
        )
    fls.wait(0, 0.0)
    assert fls.look(0, 0.0)
    fls.fall_due(0)
    pass_time(shared, fls, 1.0)
    assert kinds(fed)[:4] == ["CHALLENGE_ACCEPT", "THAW", "SET_AVAILABLE", "LEASE_RENEW"]
    assert [at for at, _ in fed][:4] == [0.0, 0.01, 0.02, 0.03]
    assert sum(shared.handled_late) == 4
    # The tick that was due meanwhile was armed anew by the thaw, so it is not due any more.
    assert Due not in {type(event) for _, event in fed}


def test_a_timer_waits_for_the_handler_and_goes_before_what_is_less_urgent():
    shared, fls, fed = busy()
    for number, kind in enumerate((Kind.CHALLENGE_ACCEPT, Kind.LEASE_RENEW), 1):
        fls.hear(message(kind, 1, To.FLS, Swarm(5, 0)), Stamp(1, number, (0, 0, 0), 0.0))
    fls.wait(0, 0.0)
    assert fls.look(0, 0.0)
    fls.fall_due(0)
    pass_time(shared, fls, 1.0)
    assert kinds(fed) == ["CHALLENGE_ACCEPT", "Due", "LEASE_RENEW"]
    assert [at for at, _ in fed] == [0.0, 0.01, 0.01]
    assert sum(shared.timer_late) == 1


def test_a_timer_waits_for_a_busy_handler_for_which_nothing_else_waits():
    shared, fls, fed = busy()
    fls.hear(message(Kind.CHALLENGE_ACCEPT, 1, To.FLS, Swarm(5, 0)), Stamp(1, 1, (0, 0, 0), 0.0))
    shared.agenda.now = 0.004
    fls.wait(0, 0.004)
    assert fls.look(0, 0.004)
    fls.fall_due(0)
    assert kinds(fed) == ["CHALLENGE_ACCEPT"]
    pass_time(shared, fls, 1.0)
    assert fed[1] == (0.01, Due(Timer.CHALLENGE))
    assert [at for at, count in enumerate(shared.timer_late) if count] == [bucket(6.0)], (
        "6 ms late, and told so"
    )


def test_handlers_that_take_time_make_messages_late_and_the_swarm_forms_all_the_same():
    result, watcher = fly(duration_s=20, **{"virtual.handling_ms": 5})
    assert 0 < result.handled_late_ms.p50 <= result.handled_late_ms.p99 <= result.handled_late_ms.max
    assert result.timer_late_ms.max > 0
    assert watcher.progress.first_single_swarm_s is not None
    assert fly(duration_s=4, **{"virtual.handling_ms": 0})[0].handled_late_ms.max == 0


def test_a_datagram_that_comes_twice_acts_once():
    _, shared, flss = display(**{"radio.duplicate": 1e-9})
    challenge = message(Kind.CHALLENGE_INIT, sender=1, challenge=3)._replace(truth=flss[1].spec.truth)
    stamp = Stamp(1, 5, flss[1].flight.start, 0.0)
    for _ in range(2):
        flss[2].hear(challenge, stamp)
    assert (shared.counts[Wire.DELIVERED], shared.counts[Wire.REPLAYED]) == (1, 1)
