"""Worker processes of a sweep: each makes one run at a time, and the same process one after the other.

A worker is spawned: it begins with nothing of ours, no thread, no lock, no open file, and imports the libraries once
for all its runs. Each has a line of its own to the sweep, so when one dies it is known which run died with it, and the
others go on. A worker ends at once when the sweep does, however that ends: it listens to a pipe whose other end dies
with it. There is nothing but pipes between them, no semaphore that a killed sweep would leave behind.
"""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import wait
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from swarmer.experiments.one_run import Outcome, perform

if TYPE_CHECKING:
    from multiprocessing.connection import Connection
    from multiprocessing.context import SpawnProcess

    from swarmer.experiments.runs import Run

LOOK_EVERY_S = 0.25
DIED = "its process died; was it killed, or out of memory?"


Work = Callable[[Any, Path], Any]
Fits = Callable[[Any, list[Any]], bool]


def always(run: Any, beside: list[Any]) -> bool:
    """Any run may begin as soon as a worker is free."""
    return True


def make_run(run: Run, out: Path) -> Outcome:
    """Make one run of a sweep in the sweep's directory `out`."""
    return perform(run.config, out / run.path)


class Worker(NamedTuple):
    """A process that makes runs."""

    process: SpawnProcess
    line: Connection  # on which it gets runs and gives outcomes


class Pool:
    """Some workers. A context: leaving it ends them."""

    def __init__(self, jobs: int, out: Path, work: Work = make_run) -> None:
        """jobs: workers at a time. out: the sweep's directory, in which the runs have theirs.

        work: what a worker does with what it is given; a function at the top of a module.
        """
        self._jobs, self._out, self._does = jobs, out, work
        self._context = get_context("spawn")
        self._ear, self._mouth = self._context.Pipe(duplex=False)
        self._slots: list[Worker | None] = [None] * jobs

    def __enter__(self) -> Pool:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """End the workers: each as soon as it is idle, and if this is an emergency all of them at once."""
        if kind is not None:
            self._mouth.close()
        for slot in range(self._jobs):
            self._dismiss(slot)
        self._mouth.close()
        self._ear.close()

    def outcomes(
        self,
        runs: Iterable[Any],
        started: Callable[[Any], None],
        tick: Callable[[], None],
        fits: Fits = always,
    ) -> Iterator[tuple[Any, Any]]:
        """Make the runs, as many at a time as there are workers, and give each as it ends.

        started: told of a run that begins. tick: called several times a second. fits: may a run begin beside those
        that are at work? If not, it waits, and all behind it.
        """
        coming, free = iter(runs), deque(range(self._jobs))
        waiting = list(islice(coming, 1))  # the next one, if there is any
        running: dict[Any, tuple[int, Any]] = {}
        ended: list[tuple[Any, Any]] = []
        while waiting or running:
            begun = []
            while (
                waiting and free and fits(waiting[0], [run for _, run in running.values()])
            ):  # before anybody looks at what has ended: no worker waits for that
                slot, run = free.popleft(), waiting.pop()
                waiting = list(islice(coming, 1))
                running[self._begin(slot, run)] = (slot, run)
                begun.append(run)
            yield from ended
            for run in begun:
                started(run)
            tick()
            ended = []
            for line in wait(list(running), LOOK_EVERY_S):
                slot, run = running.pop(line)
                ended.append((run, self._outcome(line, slot)))
                free.append(slot)
        yield from ended

    def _begin(self, slot: int, run: Any) -> Connection:
        job = (run, self._out)
        worker = self._slots[slot] or self._hire(slot)
        try:
            worker.line.send(job)
        except OSError:  # it died between two runs
            self._dismiss(slot)
            worker = self._hire(slot)
            worker.line.send(job)
        return worker.line

    def _hire(self, slot: int) -> Worker:
        ours, theirs = self._context.Pipe()
        process = self._context.Process(target=_work, args=(theirs, self._ear, self._does))
        with _deaf():
            process.start()
        theirs.close()  # or nobody would see it die
        worker = self._slots[slot] = Worker(process, ours)
        return worker

    def _dismiss(self, slot: int) -> None:
        """Of a worker that has nothing to do, or is dead."""
        worker, self._slots[slot] = self._slots[slot], None
        if worker is not None:
            worker.line.close()
            worker.process.join()

    def _outcome(self, line: Any, slot: int) -> Any:
        try:
            outcome = line.recv()
        except (EOFError, OSError):
            self._dismiss(slot)
            return Outcome("failed", DIED)
        return outcome


@contextlib.contextmanager
def _deaf() -> Iterator[None]:
    """A process begun here ignores Ctrl-C from its first moment; this one answers it when the process has begun.

    Never is it lost: a worker of Ray is interrupted but once, and killed some seconds later.
    """
    if not hasattr(signal, "pthread_sigmask") or threading.current_thread() is not threading.main_thread():
        yield
        return
    heard: list[bool] = []
    resource_tracker.ensure_running()  # begun later it would lift the block again
    before = signal.signal(signal.SIGINT, lambda *_: heard.append(True))
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        signal.signal(signal.SIGINT, before)
        if heard:
            signal.raise_signal(signal.SIGINT)


def _work(line: Connection, ear: Connection, does: Work) -> None:
    """In the worker: make runs until the line is closed."""
    _listen(ear)
    with contextlib.suppress(EOFError, OSError, KeyboardInterrupt):
        while True:
            line.send(does(*line.recv()))


def _listen(ear: Connection) -> None:
    """In the worker: end with the sweep. Ctrl-C is the sweep's to answer, or the engine's while a run lives."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_end_with, args=(ear,), daemon=True).start()


def _end_with(ear: Any) -> None:
    try:
        ear.recv_bytes()
    except (EOFError, OSError):
        pass
    os._exit(1)
