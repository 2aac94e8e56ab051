"""What is told before a run: settings that nothing in it heeds. Those of rounds are in test_rounds_idle.py."""

import pytest

from swarmer.config import load_config
from swarmer.engines.notes import notes_on
from swarmer.plan import make_plan

HOSTS = {"cluster.hosts": "a,b"}
COMMAND = {"cluster.launch": "docker exec -i {host}", "cluster.python": "/usr/bin/python3"}


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (HOSTS | COMMAND, []),
        ({"cluster.nodes": 3, "cluster.address": "head:6379"}, []),
        (HOSTS | {"cluster.nodes": 3}, ["cluster.nodes: no effect with cluster.hosts, which names the hosts"]),
        (COMMAND, ["cluster.launch, cluster.python: no effect without cluster.hosts"]),
        ({"radio.loss": 0.1, "faults.schedule": [{"at": 70, "what": "kill", "where": [1]}]},
         ["faults: 1 of 1 faults never begin: the end of the run comes at 60 s, the first of them would at 70 s"]),
        ({"rounds.order": "fid"}, ["rounds.order: fid has no effect with the engine cluster; only rounds has it"]),
    ],
)  # fmt: skip
def test_hosts_are_named_or_given_by_ray(settings, said):
    config = load_config(engine="cluster", shape="random", points=4, **settings)
    plan = make_plan(config)
    assert notes_on(config, plan.rules, plan.faults, config.unlike()) == said
    if said and "faults" not in said[0]:
        assert notes_on(config, plan.rules, plan.faults, []) == [], "nobody asked for them"
