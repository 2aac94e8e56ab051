"""Who is let in, and with what line the others are refused: no FLS is started before all hosts are there and fit."""

import asyncio
import contextlib
import json
import time

import pytest

import swarmer
from swarmer.config import load_config
from swarmer.engines.cluster.channel import shake_hands
from swarmer.engines.cluster.engine import ClusterEngine
from swarmer.engines.cluster.hosts import Gathering
from swarmer.engines.cluster.launch import Commands
from swarmer.engines.sources import sources_sha256
from swarmer.errors import BadInput
from swarmer.plan import make_plan

HELLO = {"is": "hello", "version": swarmer.__version__, "sources": sources_sha256(), "cores": 1}


class Agents:
    """A launcher whose agents are coroutines: `behave(name, reader, writer, key)`."""

    setting, patience_s = "cluster.hosts", 3.0

    def __init__(self, names, behave):
        self.names, self.behave, self.ended_ones = names, behave, []
        self.tasks = []

    def address(self):
        return "127.0.0.1"

    def start(self, name, orders):
        told = json.loads(orders)
        assert told["name"] == name

        async def live():
            with contextlib.suppress(ConnectionError):
                ends = await asyncio.open_connection(told["address"], told["port"])
                await self.behave(name, *ends, bytes.fromhex(told["key"]))

        self.tasks.append(asyncio.ensure_future(live()))
        return Launched(self, name)

    def close(self):
        pass


class Launched:
    def __init__(self, agents, name):
        self.agents, self.name = agents, name

    def ended(self):
        return False

    def last_words(self):
        return ""

    def end(self):
        self.agents.ended_ones.append(self.name)


def gather(behave, names=("a", "b"), reserve=False, **settings):
    agents = Agents(list(names), behave)

    async def run():
        cluster = load_config(**{f"cluster.{name}": value for name, value in settings.items()}).cluster
        gathering = Gathering(cluster, agents, agents.names)
        try:
            hosts = await gathering.gather()
            if reserve:
                await gathering.reserve(hosts, 0)
            return hosts
        except BadInput:
            gathering.end()
            raise
        finally:
            for task in agents.tasks:
                task.cancel()

    return agents, run()


async def good(name, reader, writer, key, ahead_s=0.0, slow_s=0.0, cannot="", **other):
    channel = await shake_hands(reader, writer, key, engine=False)
    channel.say(HELLO | {"name": name} | other)
    while True:
        said, _ = await channel.hear()
        if said["do"] == "reserve":
            channel.say({"is": "reserved", "text": cannot})
            continue
        await asyncio.sleep(slow_s)
        channel.say({
            "is": "pong", "asked": said["asked"], "monotonic": time.monotonic() + 77, "wall": time.time() + ahead_s,
        })  # fmt: skip


def refused(behave, **settings):
    agents, gathering = gather(behave, **settings)
    with pytest.raises(BadInput) as caught:
        asyncio.run(gathering)
    assert set(agents.ended_ones) == set(agents.names), "none is left"
    return str(caught.value)


def test_all_hosts_in_the_order_of_their_names():
    agents, gathering = gather(good, names=("z", "a", "m"))
    hosts = asyncio.run(gathering)
    assert [host.name for host in hosts] == ["z", "a", "m"]
    assert all(abs(host.offset.offset_s - 77) <= host.offset.bound_s for host in hosts)
    assert agents.ended_ones == []


def test_another_version():
    async def behave(name, *ends):
        await good(name, *ends, version="0.0.9" if name == "b" else swarmer.__version__)

    assert refused(behave) == (
        f"cluster.hosts: b has swarmer 0.0.9, this is {swarmer.__version__}; the same everywhere"
    )


def test_other_sources():
    async def behave(name, *ends):
        await good(name, *ends, **({"sources": "other"} if name == "b" else {}))

    assert refused(behave) == (
        f"cluster.hosts: b has other sources of swarmer {swarmer.__version__} than this machine; install the same there"
    )


def test_a_clock_that_is_apart():
    async def behave(name, *ends):
        await good(name, *ends, ahead_s=90.0 if name == "b" else 0.0)

    assert refused(behave).startswith(
        "cluster.clocks_apart_s: the clock of b is 90 s ahead of this one's, and 1 is"
    )


def test_a_network_that_is_slow():
    async def behave(name, *ends):
        await good(name, *ends, slow_s=0.03)

    assert refused(behave).startswith("cluster.clock_bound_ms: the clock of a is known to 1")


def test_a_host_that_does_not_call():
    async def behave(name, reader, writer, key):
        if name == "a":
            await good(name, reader, writer, key)
        writer.close()

    line = refused(behave)
    assert line == "cluster.hosts: b: no call from there in 3 s; is it up, and can it reach cluster.listen?"


def test_a_host_that_cannot_take_its_part():
    async def behave(name, *ends):
        await good(name, *ends, cannot="points: 9 is not allowed; at most 8" if name == "b" else "")

    assert refused(behave, reserve=True) == (
        "cluster.hosts: b cannot take its part: points: 9 is not allowed; at most 8"
    )


def test_a_host_that_falls_silent():
    async def behave(name, reader, writer, key):
        talk = asyncio.create_task(good(name, reader, writer, key))
        await asyncio.sleep(0.5)
        talk.cancel()
        writer.close()

    async def run():
        agents = Agents(["a"], behave)
        gathering = Gathering(load_config().cluster, agents, agents.names)
        hosts = await gathering.gather()
        await asyncio.sleep(0.7)
        await gathering.reserve(hosts, 0)

    with pytest.raises(BadInput, match=r"cluster\.hosts: a cannot take its part: it fell silent"):
        asyncio.run(run())


def test_strangers_are_left_standing():
    """One without the key, one that says nothing of ours, one of a name that is none: the run begins."""

    async def behave(name, reader, writer, key):
        for stranger in ("key", "web", "name"):
            ends = await asyncio.open_connection(*writer.get_extra_info("peername"))
            if stranger == "web":
                ends[1].write(b"GET / HTTP/1.1\r\n\r\n" * 4)
                continue
            channel = await shake_hands(*ends, b"q" * 32 if stranger == "key" else key, engine=False)
            channel.say(HELLO | {"name": "nobody" if stranger == "name" else name, "version": "9"})
        await good(name, reader, writer, key)

    _, gathering = gather(behave)
    assert [host.hello["version"] for host in asyncio.run(gathering)] == [swarmer.__version__] * 2


def test_of_two_that_call_by_one_name_the_first_is_heard():
    async def behave(name, reader, writer, key):
        if name == "b":
            await asyncio.sleep(0.5)
            await good(name, reader, writer, key)
        first = asyncio.create_task(good(name, reader, writer, key))
        await asyncio.sleep(0.2)
        ends = await asyncio.open_connection(*writer.get_extra_info("peername"))
        await good(name, *ends, key, version="9")
        await first

    _, gathering = gather(behave)
    assert [host.hello["version"] for host in asyncio.run(gathering)] == [swarmer.__version__] * 2


def engine_refused(**settings):
    config = load_config(engine="cluster", shape="random", points=4, **settings)
    with pytest.raises(BadInput) as caught:
        ClusterEngine(make_plan(config))
    return str(caught.value)


@pytest.mark.parametrize(
    ("launch", "said"),
    [
        ("false", "cluster.hosts: a: the agent ended at once"),
        ("sh -c 'echo no route to {host} >&2; exit 255'", "cluster.hosts: a: no route to a"),
        ("nosuchcommand {host}", "cluster.launch: nosuchcommand: No such file or directory"),
    ],
)
def test_a_host_that_is_not_reached(launch, said):
    settings = {"cluster.hosts": "a,b", "cluster.launch": launch, "cluster.listen": "127.0.0.1"}
    assert engine_refused(**settings) == said


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"cluster.hosts": "a, ,b"}, "cluster.hosts: 'a, ,b' is not allowed; names with commas between, as a,b,c"),
        ({"cluster.hosts": "-oProxyCommand=x"}, "cluster.hosts: '-oProxyCommand=x' is not allowed; names"),
        ({"cluster.hosts": ",".join("abcde")}, "cluster.hosts: 5 hosts are more than the 4 FLSs of the run"),
        ({"cluster.hosts": "a", "cluster.listen": "203.0.113.9"}, "cluster.listen: '203.0.113.9' is not allowed"),
        ({"cluster.hosts": "a", "cluster.listen": "::1"}, "cluster.listen: '::1' is not allowed; Address family"),
        ({"cluster.hosts": "::1"}, "cluster.hosts: ::1 is no name on this network, nor an IPv4 address"),
        ({"cluster.hosts": "no.such.host.invalid"}, "cluster.hosts: no.such.host.invalid is no name on"),
        (
            {"cluster.hosts": "localhost", "battery.flight_s": 9, "battery.standby_group": 2},
            "battery.standby_group: 2 is not for the engine cluster",
        ),
        (
            {"cluster.hosts": "localhost", "faults.schedule": [{"at": 1, "what": "kill", "where": {"swarm_of": 2}}]},
            "faults: a fault that strikes a swarm is not for the engine cluster",
        ),
        (
            {"cluster.hosts": "localhost", "cluster.python": "/no/python"},
            "cluster.python: /no/python: No such file or directory",
        ),
        (
            {"cluster.hosts": "localhost,localhost", "radio.port": 31991},
            "cluster.hosts: localhost-2 cannot take its part: radio.port: 31991 is not allowed; UDP port 31991",
        ),
        (
            {"cluster.hosts": "localhost,localhost", "cluster.flss_per_host": 1},
            "cluster.flss_per_host: 1 on each of 2 hosts are too few for the 4 FLSs of the run: localhost-1 would",
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_is_said_in_one_line(settings, said):
    assert engine_refused(**settings).startswith(said)


def test_hosts_by_name():
    names = Commands(load_config(**{"cluster.hosts": "localhost, localhost,x@far"}).cluster).names
    assert names == ["localhost-1", "localhost-2", "x@far"]
