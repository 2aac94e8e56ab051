"""What a witness of a run in virtual time gets to see."""

from collections import Counter

from virtual_runs import SMALL, Watcher, fly

from swarmer.config import load_config
from swarmer.engines.result import FATES, Witness
from swarmer.engines.virtual import VirtualEngine
from swarmer.errors import RunFailed
from swarmer.plan import make_plan
from swarmer.protocol.events import Fly, Received, Send


class Notary(Witness):
    """Counts all it is told."""

    def __init__(self):
        self.told = Counter()
        self.fates = Counter()
        self.order = []

    def made(self, fls, now_s):
        self.told["made"] += 1
        assert fls.alive
        assert not fls.lit

    def handled(self, fls, event, actions, cause, now_s):
        self.told["handled"] += 1
        self.told["to send"] += sum(type(action) is Send for action in actions)
        self.told["to fly"] += sum(type(action) is Fly for action in actions)
        assert (cause is not None) == isinstance(event, Received)
        assert fls.machine.now == now_s

    def sent(self, fls, message, stamp, copies, now_s):
        self.told["sent"] += 1
        self.told["lost"] += not copies
        assert message.sender == fls.fid

    def heard(self, fls, message, stamp, fate, now_s):
        self.fates[fate] += 1

    def flew(self, fls, asked, flight, now_s):
        self.told["flew"] += 1
        assert fls.flight is flight

    def ended(self, fls, how, now_s):
        self.told[how] += 1

    def finished(self, now_s):
        self.told["finished"] += 1

    def summary(self):
        return {"told": sum(self.told.values())}


def watched(*witnesses, **settings):
    plan = make_plan(load_config(None, (), **{**SMALL, **settings}))
    with VirtualEngine(plan, witnesses) as engine:
        return engine.run(Watcher())


def test_a_witness_is_told_all_that_the_counters_count():
    notary = Notary()
    faults = {"radio.loss": 0.1, "radio.duplicate": 0.1, "radio.delay_ms": 5, "failure.rate": 0.01}
    result = watched(notary, **faults)
    told, fates, counters = notary.told, notary.fates, result.counters
    assert set(fates) <= set(FATES)
    assert told["sent"] == counters["datagrams_sent"] == told["to send"] + fates["answered"]
    assert told["lost"] + fates["lost"] == counters["datagrams_lost"]
    judged = fates["queued"] + fates["answered"] + fates["noted"] + fates["dropped"]
    assert judged == counters["datagrams_delivered"]
    assert told["failed"] == counters["failures"] > 0
    assert told["made"] == SMALL["points"] + counters["replacements"]
    assert told["flew"] == told["to fly"] > 0
    assert told["finished"] == 1
    assert result.extra["told"] == sum(told.values())


def test_witnesses_change_nothing():
    faults = {"radio.loss": 0.1, "failure.rate": 0.01, "virtual.handling_ms": 1.0}
    one, two = Notary(), Notary()
    assert watched(one, two, **faults).extra["trace_sha256"] == fly(**faults)[0].extra["trace_sha256"]
    assert one.told == two.told
    assert one.fates == two.fates


def test_a_witness_that_objects_ends_the_run():
    class Objector(Notary):
        def handled(self, fls, event, actions, cause, now_s):
            super().handled(fls, event, actions, cause, now_s)
            if self.told["handled"] == 1000:
                raise RunFailed("enough")

    objector = Objector()
    result = watched(objector)
    assert (result.status, result.message) == ("failed", "enough")
    assert objector.told["handled"] == 1000
    assert not objector.told["finished"]
