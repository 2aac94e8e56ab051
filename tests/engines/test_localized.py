"""Who localized, as samples tell it."""

from itertools import pairwise

import numpy as np
import pytest
from virtual_runs import SMALL, Watcher

from swarmer.config import load_config
from swarmer.engines.localized import LocalizedWatch, take_localized
from swarmer.engines.result import Witness
from swarmer.engines.rounds import RoundsEngine
from swarmer.engines.virtual import VirtualEngine
from swarmer.physics.flight import Flight
from swarmer.plan import make_plan
from swarmer.state_machine import State
from swarmer.telemetry import Localization, _slot_dtype


class Flights(Witness):
    """Keeps every flight of a localizer."""

    def __init__(self):
        self.flown = []

    def flew(self, fls, asked, flight, now_s):
        if fls.machine.state is State.BUSY_LOCALIZING:
            self.flown.append(
                (fls.fid, fls.machine.anchor.sender, *np.float32([flight.start, flight.displacement]))
            )


def test_virtual_time_tells_each_flight_of_a_localizer_once():
    plan, flights, watcher = make_plan(load_config(engine="virtual", **SMALL)), Flights(), Watcher()
    with VirtualEngine(plan, [flights]) as engine:
        engine.run(watcher)
    told = [
        row for sample in watcher.samples if sample.localized for row in zip(*sample.localized, strict=True)
    ]
    assert len(told) > 100
    assert len(flights.flown) - len(told) in range(10), "those after the last sample"
    for (fid, anchor, start, vector), flown in zip(told, flights.flown, strict=False):
        assert (fid, anchor) == flown[:2]
        assert start.tolist() == flown[2].tolist()
        assert vector.tolist() == flown[3].tolist()


@pytest.mark.parametrize("settings", [{}, {"m": 2}, {"technique": "physical_movement"}])
def test_a_round_tells_where_each_localizing_fls_came_from_and_went(settings):
    plan, watcher = make_plan(load_config(engine="rounds", shape="sphere", points=60, **settings)), Watcher()
    with RoundsEngine(plan) as engine:
        engine.run(watcher)
    told = 0
    for before, after in pairwise(watcher.samples):
        if after.localized is None:
            continue
        fid, anchor, start, vector = after.localized
        assert len(set(fid.tolist())) == len(fid)
        np.testing.assert_allclose(start, before.position[fid - 1], rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(start + vector, after.position[fid - 1], rtol=1e-5, atol=1e-5)
        assert (after.swarm[fid - 1] == after.swarm[anchor - 1]).all()
        assert (
            after.state[anchor - 1] == State.BUSY_ANCHOR
        ).mean() > 0.5  # one may also localize in a later wave
        told += len(fid)
    assert told > 50
    assert watcher.samples[0].localized is None


def test_taking_empties_the_list():
    noted = [(3, 5, Flight((1.0, 2.0, 3.0), (0.5, 0.0, 0.0), 7.0, 0.1, 0.5))]
    localized = take_localized(noted)
    assert noted == []
    assert take_localized(noted) is None
    assert [column.tolist() for column in localized] == [[3], [5], [[1.0, 2.0, 3.0]], [[0.5, 0.0, 0.0]]]


def shown(*localizations):
    """What slots show: FID 1, 2, ... last localized so."""
    rows = np.zeros(len(localizations), _slot_dtype()["localization"])
    for at, one in enumerate(localizations):
        rows[at] = tuple(one)
    return rows


def test_a_slot_tells_a_localization_once():
    never = Localization(0, (0, 0, 0), (0, 0, 0), 0.0)
    first = Localization(5, (1, 2, 3), (0.5, 0, 0), 7.0)
    second = first._replace(begins_s=7.5)  # the same way once more
    watch = LocalizedWatch(2)
    assert watch.look(shown(never, never)) is None
    told = watch.look(shown(never, first))
    assert [column.tolist() for column in told] == [[2], [5], [[1.0, 2.0, 3.0]], [[0.5, 0.0, 0.0]]]
    assert watch.look(shown(never, first)) is None
    assert watch.look(shown(first, second)).fid.tolist() == [1, 2]
    assert watch.look(shown(never, second)) is None, "the successor of FLS 1 has not localized"
    assert watch.look(shown(first, second)).fid.tolist() == [1], "now it has, at whatever moment"
