"""Runs are given to the machines of a cluster: so many to each as fit, again elsewhere if a machine is lost.

This file knows no Ray. What it needs of one is a `Crew`, so all of it is tested without.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Iterator
from typing import Any, Protocol

from swarmer.engines.ray_session import Node
from swarmer.errors import BadInput, RunFailed
from swarmer.experiments.needs import Needs, Room
from swarmer.experiments.one_run import Outcome
from swarmer.experiments.runs import Run

LOOK_EVERY_S = 0.25
NODES_EVERY_S = 10.0
NO_NODES_S = 120.0  # a sweep waits for machines as long as this, once all are lost
TRIES = 3  # of a run whose machines are lost under it


class Lost(Exception):
    """The machine went, or what ran on it was ended from outside: not the run's fault. The text says which."""

    def __init__(self, text: str, machine_gone: bool = True) -> None:
        """machine_gone: the machine, and not what ran on it alone."""
        super().__init__(text)
        self.machine_gone = machine_gone


class Crew(Protocol):
    """The machines, and what works on them."""

    def nodes(self) -> list[Node]:
        """Those that are there now, and can be used."""

    def begin(self, run: Run, needs: Needs, node: Node) -> Hashable:
        """Begin a run on a machine; what to wait for."""

    def wait(self, begun: list[Any], limit_s: float) -> list[Any]:
        """Those that have ended, as soon as one has, or the limit is over."""

    def outcome(self, ended: Any, run: Run) -> Outcome:
        """How it ended; its directory is then in place. Raises Lost."""


class Ledger:
    """Which machine has how much room."""

    def __init__(self, nodes: Iterable[Node]) -> None:
        self.nodes: dict[str, Node] = {}
        self._at: dict[str, list[Needs]] = {}
        self._lost: set[str] = set()
        self.update(nodes)

    def update(self, nodes: Iterable[Node]) -> None:
        """These are the machines now. One that was lost is there for a while yet by what Ray says."""
        self.nodes = {node.id: node for node in nodes if node.id not in self._lost}
        for name in self.nodes:
            self._at.setdefault(name, [])

    def place(self, needs: Needs) -> Node | None:
        """The machine with the most free cores on which there is room; taken until `free`. None: not now."""
        free = [node for node in self.nodes.values() if self._room(node).fits(needs, self._at[node.id])]
        free = [node for node in free if could_carry(node, needs)]
        if not free:
            return None
        chosen = max(free, key=lambda node: node.cores - sum(one.cores for one in self._at[node.id]))
        self._at[chosen.id].append(needs)
        return chosen

    def free(self, node: Node, needs: Needs) -> None:
        """A run has left the machine."""
        self._at[node.id].remove(needs)

    def lose(self, node: Node) -> None:
        """Nothing more goes there: a machine that comes back has another id."""
        self._lost.add(node.id)
        self.nodes.pop(node.id, None)

    @staticmethod
    def _room(node: Node) -> Room:
        return Room(node.cores, node.memory_mb)


def could_carry(node: Node, needs: Needs) -> bool:
    """Has the machine enough when nothing else is on it?"""
    return needs.cores <= node.cores and needs.memory_mb <= node.memory_mb


def check_room(nodes: list[Node], runs: Iterable[Run]) -> None:
    """Raises BadInput if there is a run that no machine has room for."""
    for run in runs:
        if not any(could_carry(node, run.needs) for node in nodes):
            most = max(nodes, key=lambda node: (node.cores, node.memory_mb), default=None)
            has = (
                f"the largest node has {most.cores} cores and {most.memory_mb:,.0f} MB"
                if most
                else "no node has any"
            )
            raise BadInput.saying(
                f"--ray: too few slots: {run.path.as_posix()} needs {run.needs}, {has}; `needs` in the file says it"
            )


def at_once(nodes: list[Node], needs: Iterable[Needs]) -> int:
    """How many are at work at a time, at most."""
    ledger = Ledger(nodes)
    order = sorted(needs, key=lambda need: (need.machine, need.cores, need.memory_mb))
    for number, need in enumerate(order):
        if ledger.place(need) is None:
            return number
    return len(order)


def outcomes(
    runs: Iterable[Run],
    crew: Crew,
    started: Callable[[Run], None],
    tick: Callable[[], None],
    say: Callable[[str], None],
    clock: Callable[[], float] = time.monotonic,
) -> Iterator[tuple[Run, Outcome]]:
    """Make the runs, each where there is room, and give each as it ends.

    say: a line for people. clock: wall seconds. Raises RunFailed when there has been no machine for two minutes.
    """
    waiting, tries = deque((run, run.needs) for run in runs), dict[Any, int]()
    running: dict[Any, tuple[Run, Needs, Node]] = {}
    ledger = Ledger(crew.nodes())
    looked = alive = clock()
    while waiting or running:
        while waiting and (node := ledger.place(waiting[0][1])):
            run, needs = waiting.popleft()
            running[crew.begin(run, needs, node)] = (run, needs, node)
            started(run)
        tick()
        if running:
            ended = crew.wait(list(running), LOOK_EVERY_S)
        else:
            time.sleep(LOOK_EVERY_S)
            ended = []
        for handle in ended:
            run, needs, node = running.pop(handle)
            ledger.free(node, needs)
            try:
                yield run, crew.outcome(handle, run)
            except Lost as lost:
                if lost.machine_gone:
                    ledger.lose(node)
                tries[run.path] = tries.get(run.path, 0) + 1
                if tries[run.path] == TRIES:
                    yield run, Outcome("failed", f"its machine was lost {TRIES} times, the last: {lost}")
                else:
                    say(f"{run.path.as_posix()}: {lost}; it is made anew")
                    waiting.appendleft((run, needs))
        if clock() - looked >= NODES_EVERY_S or not (running or ledger.nodes):
            ledger.update(crew.nodes())
            looked = clock()
        if ledger.nodes or running:
            alive = clock()
        elif clock() - alive > NO_NODES_S:
            raise RunFailed("--ray: no node of the cluster is left; the same command goes on with the rest")
