"""One run of a sweep on another machine: made there in a directory that lasts as long, its files sent back.

So no file system need be shared. A Ray worker has threads of its own, from which no FLS may be forked: the run is made
by a process of `Pool`, the same that makes runs on one machine, which lives as long as the worker.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

from swarmer.errors import SwarmerError
from swarmer.experiments.one_run import Outcome, perform
from swarmer.experiments.pool import Pool
from swarmer.observe.files import write_file
from swarmer.observe.run_directory import SUMMARY, hold, let_go

if TYPE_CHECKING:
    from typing import BinaryIO

    from swarmer.config import RunConfig
    from swarmer.plan import Plan

DESK = "swarmer-sweep-"  # a directory in the machine's temporary one: this, the worker's process id, a random rest
SENT_MB_MAX = 1000.0


class Errand(NamedTuple):
    """What is to be done."""

    config: RunConfig
    command: list[str]  # for the manifest
    plan: Plan | None = None  # where a file that lies with the sender is part of it


class Brought(NamedTuple):
    """What comes of it."""

    outcome: Outcome
    files: dict[str, bytes]  # of the run directory, by name


_pool: Pool | None = None


def do(errand: Errand) -> Brought:
    """In a worker: make the run and bring its files."""
    with _desk() as desk:
        path = desk / "run"
        outcome = _made(errand, path)
        files = [one for one in sorted(path.iterdir()) if one.is_file()] if path.is_dir() else []
        megabytes = sum(one.stat().st_size for one in files) / 1e6
        if megabytes > SENT_MB_MAX:
            message = (
                f"its files have {megabytes:,.0f} MB, and at most {SENT_MB_MAX:,.0f} are sent; record less"
            )
            return Brought(Outcome("failed", message), {})
        return Brought(outcome, {one.name: one.read_bytes() for one in files})


def put_down(brought: Brought, path: Path) -> None:
    """Write the files of a run that was made elsewhere; its summary last, for that is what marks it finished.

    Raises RunFailed.
    """
    from swarmer.observe.files import disk_errors
    from swarmer.observe.run_directory import check_out

    with disk_errors(path):
        (path / SUMMARY).unlink(missing_ok=True)
        for old in check_out(path):
            old.unlink()
        path.mkdir(parents=True, exist_ok=True)
    for name, data in sorted(brought.files.items(), key=lambda file: file[0] == SUMMARY):
        _write(path / Path(name).name, data)


def _write(path: Path, data: bytes) -> None:
    def fill(file: BinaryIO) -> None:
        file.write(data)

    write_file(path, fill)


def _made(errand: Errand, path: Path) -> Outcome:
    """The run, made by the worker's process; that ends at once if this is interrupted."""
    global _pool
    _pool = _pool or Pool(1, path.parent, work=_work)
    try:
        with _no_main():
            [(_, outcome)] = list(_pool.outcomes([(errand, path)], _nothing, _nothing))
    except BaseException:
        _pool.__exit__(*sys.exc_info())
        _pool = None
        raise
    return outcome


def _work(job: tuple[Errand, Path], _: Path) -> Outcome:
    """In the process."""
    errand, path = job
    sys.argv = list(errand.command)
    return perform(errand.config, path, errand.plan)


def _nothing(*_: Any) -> None:
    pass


@contextlib.contextmanager
def _no_main() -> Iterator[None]:
    """A process started here begins without the main module, which is Ray's."""
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


@contextlib.contextmanager
def _desk() -> Iterator[Path]:
    """A directory for one run. It has its name before it is there, so an interruption at any moment clears it."""
    clear_desks()
    desk = Path(tempfile.gettempdir(), f"{DESK}{os.getpid()}-{secrets.token_hex(8)}")
    lock = None
    try:
        desk.mkdir(mode=0o700)
        lock = hold(desk)
        yield desk
    finally:
        shutil.rmtree(desk, ignore_errors=True)
        let_go(lock)


def clear_desks() -> None:
    """Remove those that killed workers left on this machine, and none that a worker holds, of another container say."""
    for old in Path(tempfile.gettempdir()).glob(f"{DESK}*"):
        pid = old.name.removeprefix(DESK).partition("-")[0]
        if pid.isdigit() and not Path(f"/proc/{pid}").exists():
            with contextlib.suppress(SwarmerError):
                lock = hold(old)
                shutil.rmtree(old, ignore_errors=True)
                let_go(lock)
