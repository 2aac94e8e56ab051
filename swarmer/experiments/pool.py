"""Worker processes of a sweep: each makes one run at a time, and the same process one after the other.

A worker is spawned: it begins with nothing of ours, no thread, no lock, no open file, and imports the libraries once
for all its runs. Each has an executor of its own, so when one dies it is known which run died with it, and the others
go on. A worker ends at once when the sweep does, however that ends: it listens to a pipe whose other end dies with it.
"""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarmer.experiments.one_run import Outcome, perform

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

    from swarmer.experiments.runs import Run

LOOK_EVERY_S = 0.25
DIED = "its process died; was it killed, or out of memory?"


class Pool:
    """Some workers. A context: leaving it ends them."""

    def __init__(self, jobs: int, out: Path) -> None:
        """jobs: workers at a time. out: the sweep's directory, in which the runs have theirs."""
        self._jobs, self._out = jobs, out
        self._context = get_context("spawn")
        self._ear, self._mouth = self._context.Pipe(duplex=False)
        self._slots: list[ProcessPoolExecutor | None] = [None] * jobs

    def __enter__(self) -> Pool:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """End the workers: those that are idle by a word, and if this is an emergency all of them at once."""
        if kind is not None:
            self._mouth.close()
        for slot in self._slots:
            if slot is not None:
                slot.shutdown(wait=True, cancel_futures=True)
        self._mouth.close()
        self._ear.close()

    def outcomes(
        self, runs: Iterable[Run], started: Callable[[Run], None], tick: Callable[[], None]
    ) -> Iterator[tuple[Run, Outcome]]:
        """Make the runs, as many at a time as there are workers, and give each as it ends.

        started: told of a run that begins. tick: called several times a second.
        """
        waiting, free = deque(runs), deque(range(self._jobs))
        running: dict[Future[Outcome], tuple[int, Run]] = {}
        ended: list[tuple[Run, Outcome]] = []
        while waiting or running:
            begun = []
            while waiting and free:  # before anybody looks at what has ended: no worker waits for that
                slot, run = free.popleft(), waiting.popleft()
                running[self._begin(slot, run)] = (slot, run)
                begun.append(run)
            yield from ended
            for run in begun:
                started(run)
            tick()
            ended = []
            for future in wait(running, timeout=LOOK_EVERY_S, return_when=FIRST_COMPLETED).done:
                slot, run = running.pop(future)
                ended.append((run, self._outcome(future, slot)))
                free.append(slot)
        yield from ended

    def _begin(self, slot: int, run: Run) -> Future[Outcome]:
        with _deaf():
            try:
                return self._worker(slot).submit(perform, run.config, self._out / run.path)
            except BrokenProcessPool:  # it died between two runs
                self._slots[slot] = None
                return self._worker(slot).submit(perform, run.config, self._out / run.path)

    def _worker(self, slot: int) -> ProcessPoolExecutor:
        worker = self._slots[slot] or ProcessPoolExecutor(1, self._context, _listen, (self._ear,))
        self._slots[slot] = worker
        return worker

    def _outcome(self, future: Future[Outcome], slot: int) -> Outcome:
        try:
            return future.result()
        except BrokenProcessPool:
            self._slots[slot] = None
            return Outcome("failed", DIED)


@contextlib.contextmanager
def _deaf() -> Iterator[None]:
    """A process begun here ignores Ctrl-C from its first moment, before any line of ours; this one hears it later."""
    if not hasattr(signal, "pthread_sigmask") or threading.current_thread() is not threading.main_thread():
        yield
        return
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


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
