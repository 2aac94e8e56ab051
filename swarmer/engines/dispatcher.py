"""The dispatcher: a small process of its own that forks the FLSs and looks after them (sections 2 and 6).

It is started as `python -m swarmer.engines.dispatcher CONTROL_FD MEMORY_FD`, so it has no threads and nothing heavy in
memory, whoever uses the engine: a fork then costs a few milliseconds and 2 MB. It reads one line of JSON that says what
to launch, then commands, and writes a line of JSON for whatever happens. When the engine goes away, by whatever death,
the control socket closes, and the dispatcher ends every FLS; should it die itself, the kernel ends them.

No event loop here: a forked child would inherit it.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import json
import os
import resource
import selectors
import signal
import socket
import sys
import time
import traceback
from typing import Any

from swarmer.engines.fault_events import event_of
from swarmer.engines.limits import die_first
from swarmer.engines.process_faults import BEATS_EVERY_S, Hand, Watch
from swarmer.engines.specs import fls_spec, run_spec
from swarmer.engines.warm_up import SPECIALISE, TOUCH, warm_up
from swarmer.errors import PluginFailed
from swarmer.faults import Turn
from swarmer.fls import NEVER
from swarmer.fls_loops import LOOPS
from swarmer.fls_process import DEPARTED_EXIT, PLUGIN_EXIT, Fls, RunSpec
from swarmer.fls_spec import FlsSpec, successor
from swarmer.plan import make_velocity
from swarmer.radio_faults import part_of
from swarmer.standbys import Standbys
from swarmer.telemetry import Clock, Life, Phase, SharedMemory, Slot

PR_SET_PDEATHSIG = 1
STOP_GRACE_S = 2.0  # an FLS that has not ended by itself after this is killed
FORKS_AT_ONCE = 16  # then the control socket is looked at
WORDS_LENGTH = 1000
FAULTS_EVERY_S = (
    0.05  # wall seconds: how long a change of phase or scale may stay unnoticed while faults are to come
)


class Dispatcher:
    """Forks, watches, replaces, ends."""

    def __init__(self, control: socket.socket, memory_fd: int) -> None:
        self.control = control
        self._unread = b""
        setup = json.loads(self._line())
        self.run = run_spec(setup["run"])
        self.specs = {spec.fid: spec for spec in map(fls_spec, setup["fls"])}
        self.replace: bool = setup["replace"]
        rules = self.run.rules
        self.batteries = any(rules.battery[:2])
        self.standbys = Standbys(
            list(self.specs.values()), make_velocity(rules), rules.charge_s, rules.change_s
        )
        self.shared = SharedMemory(self.run.rules.count, memory_fd)
        self.clock = Clock(self.shared)
        self.children: dict[int, int] = {}  # pid -> FID
        self.pids: dict[int, int] = {}  # FID -> pid
        self.hand = Hand(self.run.faults, self.run.seed, self.pids, self.shared.directory(), self._tell_turn)
        self.watch = Watch(self.run.hang_s, self.pids)
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._pid = os.getpid()
        self._wake_r, self._wake_w = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self._words_r, self._words_w = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)  # the last words of an FLS
        signal.signal(signal.SIGCHLD, lambda *_: None)
        signal.set_wakeup_fd(self._wake_w, warn_on_full_buffer=False)
        # A terminal's Ctrl-C is the engine's business; it tells us what to do.
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)

    def serve(self) -> None:
        """Launch everybody, then watch until told to stop or the engine is gone."""
        waiting = [self.specs[fid] for fid in sorted(self.specs)]
        waiting.reverse()
        try:
            warm_up(self.run, waiting[-1], SPECIALISE)
        except PluginFailed as failure:
            self._tell("plugin_failed", text=str(failure))
            return
        for fault in self.run.faults.of_the_air():
            part_of(fault.where)  # once for all that are forked
        gc.collect()
        gc.freeze()
        with selectors.DefaultSelector() as selector:
            selector.register(self.control, selectors.EVENT_READ, "control")
            selector.register(self._wake_r, selectors.EVENT_READ, "child")
            while True:
                for _ in range(min(FORKS_AT_ONCE, len(waiting))):
                    if not self._launch(waiting.pop()):
                        return
                if b"\n" in self._unread and not self._command():
                    return
                if not self._strike():
                    return
                for key, _ in selector.select(0 if waiting else self._patience_s()):
                    if key.data == "child":
                        os.read(self._wake_r, 65536)
                        self._reap()
                    elif not self._command():
                        return

    def _line(self) -> bytes:
        """The next line from the engine; empty if the engine is gone."""
        parts = [self._unread]
        while b"\n" not in parts[-1]:
            try:
                parts.append(self.control.recv(1 << 20))
            except ConnectionError:
                return b""
            if not parts[-1]:
                return b""
        line, _, self._unread = b"".join(parts).partition(b"\n")
        return line

    def _command(self) -> bool:
        """Obey one line; False: end."""
        line = self._line()
        if not line:
            return False
        said = json.loads(line)
        if said["command"] == "adopt":
            return self._adopt([fls_spec(row) for row in said["fls"]])
        return said["command"] != "stop"

    def _adopt(self, specs: list[FlsSpec]) -> bool:
        """Have these FLSs, too, whose host is gone: launch who replaces them; False if that cannot be."""
        self.specs.update((spec.fid, spec) for spec in specs)
        self.clock.refresh()
        dark = self.hand.dark
        return all(self._replace(spec.fid) for spec in specs if self.replace and spec.fid not in dark)

    def _strike(self) -> bool:
        """Do what the fault schedule has for now, and end who hangs; False if a replacement cannot be launched."""
        if self.hand.due_s() == NEVER and not self.watch.hang_s:
            return True
        now = self.clock.now()
        if self.clock.phase != Phase.GO:
            return True
        for pid in self.watch.given_up(now, self.clock.scale, lambda fid: Slot(self.shared, fid).beats()):
            self.hand.kill(pid)
        if self.hand.due_s() <= now:
            back = self.hand.act(now, self.clock.scale)
            launched = [self._replace(fid) for fid in back if fid in self.specs]
            return all(launched)
        return True

    def _patience_s(self) -> float | None:
        """Wall seconds until there may be something to do by itself; None: never."""
        due_s = self.hand.due_s()
        if due_s == NEVER:
            return BEATS_EVERY_S if self.watch.hang_s else None
        if self.clock.phase != Phase.GO:
            return FAULTS_EVERY_S
        return min(max(self.clock.wall_until(due_s), 0.0), FAULTS_EVERY_S)

    def _launch(self, spec: FlsSpec) -> bool:
        try:
            pid = os.fork()
        except OSError as error:
            self._tell("fork_failed", fid=spec.fid, text=error.strerror, running=len(self.children))
            return False
        if pid == 0:
            self._become(spec)
        self.children[pid] = spec.fid
        self.pids[spec.fid] = pid
        return True

    def _become(self, spec: FlsSpec) -> None:
        """The child: be that FLS and end with it."""
        status = 1
        try:
            self._libc.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
            if os.getppid() != self._pid:  # it was gone before it could be followed
                return
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            self.control.close()
            os.close(self._wake_r)
            os.close(self._wake_w)
            gc.disable()  # an FLS makes no cycles; collections would only touch, and so copy, shared pages
            die_first()
            settle(self.run.cpus, spec.fid)
            warm_up(self.run, spec, TOUCH)
            status = run_fls(self.run, spec, self.shared)
        except PluginFailed as failure:
            status = PLUGIN_EXIT
            os.write(self._words_w, f"{failure}\n".encode()[:WORDS_LENGTH])
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            os._exit(status)

    def _reap(self) -> None:
        while True:
            try:
                pid, status = os.waitpid(-1, os.WNOHANG)
            except ChildProcessError:
                return
            if pid == 0:
                return
            fid = self.children.pop(pid)
            del self.pids[fid]
            self._ended(fid, pid, os.waitstatus_to_exitcode(status))

    def _ended(self, fid: int, pid: int, code: int) -> None:
        self.clock.refresh()
        if self.clock.phase == Phase.STOP:
            return
        slot = Slot(self.shared, fid)
        failed = pid in self.hand.struck or slot.life() == Life.FAILING
        self.hand.struck.discard(pid)
        slot.live(Life.ENDED)
        self.shared.directory()[fid - 1] = 0  # nobody listens there any more
        if code == PLUGIN_EXIT:
            with contextlib.suppress(BlockingIOError):  # another's words have been read with the first one's
                words = os.read(self._words_r, 65536).decode(errors="replace")
                self._tell("plugin_failed", text=words.partition("\n")[0])
            return
        kind = "failed" if failed else "departed" if code == DEPARTED_EXIT else "died"
        self._tell(kind, fid=fid, code=code, t_s=self.clock.now())
        charges = kind == "departed" and self.batteries  # that is no failure: it comes back
        if charges or (self.replace and fid not in self.hand.dark) or self.hand.calm:
            self._replace(fid, charges)

    def _replace(self, fid: int, charges: bool = False) -> bool:
        """Launch the successor of an FLS that has gone dark, if its point is still there; False if that cannot be."""
        if self.clock.phase != Phase.GO:
            return True
        spec = successor(self.specs[fid], self.clock.now(), self.run.rules.change_s)
        if spec is None:
            return True
        if charges:  # it is relieved, or comes back (rule 13)
            spec = self.standbys.relieved(spec, self.clock.now())
        self.specs[fid] = spec
        if not self._launch(spec):
            return False
        self._tell("replaced", fid=fid, incarnation=spec.incarnation, t_s=self.clock.now())
        return True

    def end(self) -> None:
        """End every FLS: they are asked by the control page, then killed. Returns when none is left."""
        self.clock.set(Phase.STOP, self.clock.scale)
        self.hand.let_go()
        deadline = time.monotonic() + STOP_GRACE_S
        while self.children and time.monotonic() < deadline:
            self._reap()
            time.sleep(0.01)
        for pid in self.children:
            os.kill(pid, signal.SIGKILL)
        while self.children:
            pid, _ = os.waitpid(-1, 0)
            self.children.pop(pid, None)
        self._tell("ended")

    def _tell_turn(self, turn: Turn) -> None:
        told = event_of(turn)
        self._tell(told.kind, fid=told.fid, text=told.text, t_s=self.clock.now())

    def _tell(self, event: str, **facts: Any) -> None:
        try:
            self.control.sendall(json.dumps({"event": event, **facts}).encode() + b"\n")
        except OSError:  # the engine is gone; we end soon
            pass


def run_fls(run: RunSpec, spec: FlsSpec, shared: SharedMemory) -> int:
    """Be one FLS until the run, or its life, ends; its exit status."""
    fls = Fls(run, spec, shared)
    fls.start()
    LOOPS[run.loop](fls)
    fls.close()
    return fls.exit_status or 0


def settle(cpus: tuple[int, ...], fid: int) -> None:
    """Stay on one core, and do not preempt others on waking: hundreds are woken at once."""
    try:
        if cpus:
            os.sched_setaffinity(0, {cpus[fid % len(cpus)]})
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    except OSError:  # only for speed
        pass


def main() -> None:
    control_fd, memory_fd = map(int, sys.argv[1:3])
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard if soft < hard else soft, hard))
    dispatcher = Dispatcher(socket.socket(fileno=control_fd), memory_fd)
    try:
        dispatcher.serve()
    finally:
        dispatcher.end()


if __name__ == "__main__":
    main()
