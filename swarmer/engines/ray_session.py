"""A Ray to work on: one started here, or one that runs; the same Python, Ray and swarmer on every node of it.

Ray waits long, and without a word, for what is not there. So an address is looked at first: whether anything listens,
then, in a process that can be ended, whether it is a Ray that takes us.
"""

from __future__ import annotations

import contextlib
import logging
import os
import re
import signal
import socket
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from types import ModuleType
from typing import Any, NamedTuple

from swarmer.errors import BadInput, RunFailed, shown

LOCAL, AUTO, CLIENT = "local", "auto", "ray://"
INSTALL = "pip install 'swarmer[cluster]'"
CONNECT_S = 5.0
PROBE_S = 60.0  # a Ray on a busy machine takes some ten seconds to let us in
LOOK_S = 120.0  # for a node to start its first process and import what there is
STORE_BYTES = 400_000_000  # of a Ray started here: what runs leave is small
QUIET = {"RAY_USAGE_STATS_ENABLED": "0"}  # it tells its makers nothing, unless the user wants that
TEXT_LENGTH = 300
OTHER_VERSION = re.compile(
    r"Version mismatch: .*Ray: (\S+) Python: (\S+) This process .*Ray: (\S+) Python: (\S+)"
)
UNREACHED = "Failed to connect to Ray cluster"  # so Ray says, too, where a token is missing
TOKEN = "; if the cluster has a token: RAY_AUTH_MODE=token, and RAY_AUTH_TOKEN or ~/.ray/auth_token must be its own"


class Node(NamedTuple):
    """A machine of a cluster, or what Ray takes for one."""

    id: str
    name: str  # its address
    cores: int
    memory_mb: float


class Versions(NamedTuple):
    """What must be alike everywhere, or the runs of one table are not."""

    python: str
    ray: str
    swarmer: str
    sources: str  # a hash: two checkouts of one version may differ


def load_ray() -> ModuleType:
    """The library. Raises BadInput where it is not installed."""
    try:
        import ray
    except ImportError:
        raise BadInput.saying(f"ray: is not installed; {INSTALL}") from None
    return ray


@contextlib.contextmanager
def session(address: str, cores: int | None = None) -> Iterator[ModuleType]:
    """Ray, connected, until the end of the context; a Ray that was started for it ends with it.

    address: `local` starts one with so many `cores` (None: all of this machine's), `auto` is that which this machine is
    part of, else HOST:PORT. Raises BadInput for an address where no Ray takes us, in bounded time; RunFailed.
    """
    os.environ.update({name: os.environ.get(name, value) for name, value in QUIET.items()})
    ray = load_ray()
    if address != LOCAL:
        check_address(address)
        probe(address)
    asked: dict[str, Any] = {"address": address, "log_to_driver": False, "logging_level": logging.ERROR}
    if address == LOCAL:
        asked |= {"include_dashboard": False, "object_store_memory": STORE_BYTES, "num_cpus": cores}
    try:
        with _own_signals(), _hushed():
            ray.init(**asked)
    except Exception as error:
        raise refused(address, error) from None
    try:
        yield ray
    finally:
        ray.shutdown()


def check_address(address: str) -> None:
    """Raises BadInput for what is no address, and for one at which nothing listens."""
    if address == AUTO:
        return
    if address.startswith(CLIENT):
        allowed = f"HOST:PORT or {AUTO}, on a machine of the cluster; a Ray client's address does not do"
        raise BadInput("--ray", address, allowed)
    host, _, port = address.rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise BadInput("--ray", address, f"HOST:PORT, such as head:6379, or {AUTO}")
    try:
        socket.create_connection((host.strip("[]"), int(port)), CONNECT_S).close()
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise BadInput.saying(f"--ray: nothing answers at {shown(address)}: {reason}") from None


def probe(address: str, limit_s: float = PROBE_S) -> None:
    """Connect from a process of its own. Raises BadInput if that fails, or takes longer than `limit_s`."""
    code = f"from swarmer.engines.ray_session import first_contact; first_contact({address!r})"
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        text=True, start_new_session=True,
    )  # fmt: skip
    try:
        said, _ = process.communicate(timeout=limit_s)
    except subprocess.TimeoutExpired:
        raise BadInput.saying(
            f"--ray: no Ray has answered at {shown(address)} within {limit_s:g} s; is it one, is this machine part of "
            "it, and is RAY_AUTH_TOKEN that of the cluster?"
        ) from None
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    lines = [line for line in said.splitlines() if line.startswith(HEARD)]
    if not lines or lines[-1] != HEARD:
        raise refused(address, lines[-1].removeprefix(HEARD) if lines else "it ended without a word")


HEARD = "heard:"


def first_contact(address: str) -> None:
    """In the process of `probe`: say what came of connecting."""
    import ray

    try:
        ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
    except Exception as error:
        said = _one_line(error)
    else:
        said = ""
    sys.stdout.write(f"{HEARD}{said}\n")
    sys.stdout.flush()


def refused(address: str, error: Exception | str) -> BadInput:
    """The line for a Ray that does not take us."""
    if address == AUTO and (isinstance(error, ConnectionError) or "Could not find any running" in str(error)):
        return BadInput.saying(
            f"--ray: no Ray runs on this machine; `ray start --head` starts one, and without {AUTO} we do"
        )
    text = _one_line(error)
    if other := OTHER_VERSION.search(text):
        theirs, ours = (
            f"Ray {ray} with Python {python}" for ray, python in (other.groups()[:2], other.groups()[2:])
        )
        here = "on this machine" if address == AUTO else f"at {shown(address)}"
        return BadInput.saying(
            f"--ray: the cluster {here} has {theirs}, and this machine {ours}; they must be the same"
        )
    where = "cannot be started here" if address == LOCAL else f"at {shown(address)} does not take us"
    token = TOKEN if UNREACHED in text else ""
    return BadInput.saying(f"--ray: Ray {where}: {text}{token}")


def _one_line(error: Exception | str) -> str:
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= TEXT_LENGTH else f"{text[:TEXT_LENGTH]} ..."


@contextlib.contextmanager
def _own_signals() -> Iterator[None]:
    """Ray answers SIGTERM in its own way; who ends us is answered in ours."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.getsignal(number) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def _hushed() -> Iterator[None]:
    """What Ray's own libraries write to stderr as they start is for its makers; what goes wrong is raised."""
    sys.stderr.flush()
    kept = os.dup(2)
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def nodes(ray: ModuleType) -> list[Node]:
    """The machines of the cluster that are alive and have a core to give."""
    found = []
    for one in ray.nodes():
        resources: Mapping[str, float] = one["Resources"]
        if one["Alive"] and resources.get("CPU", 0) >= 1:
            memory = resources.get("memory", 0) / 1e6
            found.append(Node(one["NodeID"], one["NodeManagerAddress"], int(resources["CPU"]), memory))
    addresses = Counter(node.name for node in found)  # several nodes on one machine have one
    return [
        node if addresses[node.name] == 1 else node._replace(name=f"{node.name} ({node.id[:6]})")
        for node in found
    ]


def on_node(ray: ModuleType, node: str) -> Any:
    """The strategy that places a task or an actor on the node with this id, and nowhere else."""
    return ray.util.scheduling_strategies.NodeAffinitySchedulingStrategy(node, soft=False)


def check_versions(ray: ModuleType, those: list[Node]) -> list[Node]:
    """Those of the nodes that have what this machine has; a node that has just died is left out.

    Raises BadInput naming the first node whose Python, Ray or swarmer is another, RunFailed for one that is dumb.
    """
    look = ray.remote(num_cpus=0, max_retries=0)(_looker())
    asked = [look.options(scheduling_strategy=on_node(ray, node.id)).remote() for node in those]
    ours = Versions(*_looker()())
    there, errors = [], ray.exceptions
    for node, answer in zip(those, asked, strict=True):
        try:
            theirs = Versions(*ray.get(answer, timeout=LOOK_S))
        except (errors.TaskUnschedulableError, errors.NodeDiedError, errors.LocalRayletDiedError):
            continue  # Ray takes some seconds to say that a machine is dead
        except Exception as error:
            raise RunFailed(
                f"node {node.name} of the Ray cluster does not answer: {_one_line(error)}"
            ) from None
        check_same(node.name, ours, theirs)
        there.append(node)
    return there


def check_same(name: str, ours: Versions, theirs: Versions) -> None:
    """Raises BadInput if a node has another version of what makes a run."""
    for what, here, there in zip(("Python", "Ray", "swarmer"), ours, theirs, strict=False):
        if here != there:
            has = f"has {what} {there}" if there else f"has no {what}"
            raise BadInput.saying(f"--ray: node {name} {has}, and this machine {here}; they must be the same")
    if ours.sources != theirs.sources:
        raise BadInput.saying(
            f"--ray: node {name} has other sources of swarmer {ours.swarmer} than this machine; install the same there"
        )


def _looker() -> Callable[[], tuple[str, str, str, str]]:
    """A function that tells its node's versions. It travels whole: the node may have no swarmer, or another."""

    def look() -> tuple[str, str, str, str]:
        import importlib.util
        import platform

        import ray

        python, its_ray = ".".join(platform.python_version_tuple()[:2]), ray.__version__
        spec = importlib.util.find_spec("swarmer")
        if spec is None or spec.origin is None:
            return python, its_ray, "", ""
        try:
            sources = importlib.import_module("swarmer.engines.sources").sources_sha256()
        except (ImportError, OSError):
            sources = "unknown"  # those of another version
        return python, its_ray, importlib.import_module("swarmer").__version__, sources

    return look
