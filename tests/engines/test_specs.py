"""What a dispatcher is told arrives as it was meant."""

import json
import socket

import numpy as np
import pytest

from swarmer.config import load_config
from swarmer.engines.dispatcher import Dispatcher
from swarmer.engines.specs import NEAR_MAX, fls_spec, run_spec, setup
from swarmer.plan import make_plan


def told(**settings):
    plan = make_plan(load_config(None, shape="random", points=80, **settings))
    data = json.loads(json.dumps(setup(plan, 7, 20_001, b"key")))
    return plan, run_spec(data["run"]), [fls_spec(row) for row in data["fls"]], data


def test_there_and_back():
    plan, run, flss, data = told(seed=9)
    assert (run.run, run.seed, run.key, run.wires.port) == (7, 9, b"key", 20_001)
    assert run.rules == plan.rules
    assert data["replace"] is True
    assert [spec.fid for spec in flss] == list(range(1, 81))
    for spec, point, neighbours in zip(flss, plan.cloud.points, plan.neighbours.neighbours, strict=True):
        assert spec.truth == tuple(point)
        assert spec.neighbours == neighbours
        assert len(spec.near) == min(NEAR_MAX, 79)
        assert spec.near[0] in neighbours
        # Every planned neighbour is within the first challenge's range.
        far = max(float(np.linalg.norm(plan.cloud.points[n - 1] - point)) for n in neighbours)
        assert spec.reach == pytest.approx(far)


def test_each_from_the_nearest_dispatcher_at_its_rate():
    stations = ((0.0, 0.0, 0.0), (30.0, 0.0, 0.0))
    _, _, flss, _ = told(**{"deploy.dispatchers": stations, "deploy.rate_per_s": 4.0})
    for spec in flss:
        other = stations[1] if spec.origin == stations[0] else stations[0]
        assert spec.origin in stations
        assert np.linalg.norm(np.subtract(spec.origin, spec.truth)) <= np.linalg.norm(
            np.subtract(other, spec.truth)
        )
    for station in stations:
        times = [spec.launch_at_s for spec in flss if spec.origin == station]
        assert times == [i / 4.0 for i in range(len(times))]
    assert len({spec.origin for spec in flss}) == 2


def test_commands_that_come_with_the_setup_are_not_lost():
    """Ctrl-C right after the start: `stop` is in the same read as the setup."""
    _, _, _, data = told()
    ours, theirs = socket.socketpair()

    with ours, theirs:
        ours.sendall(json.dumps(data).encode() + b'\n{"command": "stop"}\n')
        dispatcher = Dispatcher.__new__(Dispatcher)
        dispatcher.control, dispatcher._unread = theirs, b""
        assert json.loads(dispatcher._line())["run"]["run"] == 7
        assert dispatcher._unread == b'{"command": "stop"}\n'
        assert dispatcher._command() is False
        ours.close()
        assert dispatcher._line() == b""
