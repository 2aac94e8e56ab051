"""What a Ray that is not there, or not ours, is answered with, without any."""

import os
import socket
import sys
import time

import pytest

from swarmer.engines import ray_session
from swarmer.engines.limits import children_of
from swarmer.engines.ray_session import (
    Versions,
    _looker,
    check_address,
    check_same,
    load_ray,
    probe,
    refused,
)
from swarmer.errors import BadInput


@pytest.fixture
def silent():
    """Something that listens and never says a word; its address."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield f"127.0.0.1:{listener.getsockname()[1]}"


@pytest.mark.parametrize(
    "address", ["head", "head:", ":6379", "head:port", "head:0", "head:70000", "x.yaml", ""]
)
def test_what_is_no_address_is_refused(address):
    with pytest.raises(BadInput, match="HOST:PORT"):
        check_address(address)


def test_a_clients_address_is_told_from_a_clusters():
    with pytest.raises(BadInput, match="on a machine of the cluster"):
        check_address("ray://head:10001")


def test_where_nothing_listens_is_told_at_once(silent):
    check_address(silent)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    with pytest.raises(BadInput, match=rf"nothing answers at '127\.0\.0\.1:{port}': Connection refused"):
        check_address(f"127.0.0.1:{port}")
    with pytest.raises(BadInput, match="nothing answers at"):
        check_address("no host:6379")


def test_what_listens_and_is_no_ray_is_given_up_in_bounded_time(silent):
    began, before = time.monotonic(), children_of(os.getpid())
    with pytest.raises(BadInput, match=r"no Ray has answered at '127\.0\.0\.1:\d+' within 0.5 s"):
        probe(silent, limit_s=0.5)
    assert time.monotonic() - began < 60  # Ray itself waits for minutes
    assert children_of(os.getpid()) == before


def test_what_ray_says_is_one_line():
    said = "Version mismatch: The cluster was started with:\n    Ray: 2.9.0\n    Python: 3.11.2\nThis process ..."
    line = str(refused("head:6379", RuntimeError(said)))
    assert line.startswith(
        "--ray: Ray at 'head:6379' does not take us: Version mismatch: The cluster was started with"
    )
    assert "\n" not in line
    assert len(str(refused("local", "x" * 5000))) < 500
    assert str(refused("head:1", "Failed to connect to Ray cluster at head:1")).endswith(
        "; is RAY_AUTH_TOKEN that of the cluster?"
    )
    assert "no Ray runs on this machine" in str(
        refused("auto", ConnectionError("Could not find any running Ray"))
    )


def test_without_ray_the_line_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(BadInput, match=r"ray: is not installed; pip install 'swarmer\[cluster\]'"):
        load_ray()


OURS = Versions("3.11", "2.60.0", "0.1.0", "abc")
OTHERS = {
    "python": ("3.12", r"node 10\.0\.0\.7 has Python 3\.12, and this machine 3\.11"),
    "ray": ("2.9.0", r"node 10\.0\.0\.7 has Ray 2\.9\.0, and this machine 2\.60\.0"),
    "swarmer": ("0.2.0", r"node 10\.0\.0\.7 has swarmer 0\.2\.0, and this machine 0\.1\.0"),
    "sources": ("other", r"node 10\.0\.0\.7 has other sources of swarmer 0\.1\.0"),
}


@pytest.mark.parametrize("what", OTHERS)
def test_a_node_with_another_version_is_refused_by_name(what):
    check_same("10.0.0.7", OURS, OURS)
    there, line = OTHERS[what]
    with pytest.raises(BadInput, match=line):
        check_same("10.0.0.7", OURS, OURS._replace(**{what: there}))


def test_a_node_without_swarmer_is_refused_by_name():
    with pytest.raises(BadInput, match=r"node 10\.0\.0\.7 has no swarmer"):
        check_same("10.0.0.7", OURS, OURS._replace(swarmer="", sources=""))


def test_the_look_at_a_machine_has_a_hash_of_the_sources():
    pytest.importorskip("ray")
    first, again = Versions(*_looker()()), Versions(*_looker()())
    assert first == again
    assert first.python == f"{sys.version_info.major}.{sys.version_info.minor}"
    assert len(first.sources) == 64
    assert ray_session.check_same("here", first, again) is None
