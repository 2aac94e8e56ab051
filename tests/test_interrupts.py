"""Ctrl-C while a command still imports: one line, status 130, whatever is being imported."""

import contextlib
import os
import signal
import subprocess
import sys

import pytest

from swarmer.interrupts import at_once, ends_at_once, in_order

SLOW = "import time; print('go', flush=True); time.sleep(60)\n"


def interrupted_when_it_says_go(arguments, number=signal.SIGINT, **more):
    """Status, stdout and stderr of a Python that gets a Ctrl-C as soon as it has written a line; or another signal."""
    with subprocess.Popen(
        [sys.executable, *arguments],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        # a job in the background is born deaf to Ctrl-C
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler), **more,
    ) as process:  # fmt: skip
        assert process.stdout.readline() == "go\n"
        process.send_signal(number)
        out, err = process.communicate(timeout=30)
    return process.returncode, out, err


@pytest.mark.parametrize("program", ["main", "main_run"])
def test_within_the_first_imports_of_a_command(program, tmp_path):
    """click stands for all that is imported before the command line takes over."""
    (tmp_path / "click.py").write_text(SLOW)
    code = f"from swarmer.__main__ import {program}; {program}()"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    assert interrupted_when_it_says_go(["-c", code], env=environment) == (130, "", "interrupted\n")


@pytest.mark.parametrize(
    "command",
    [["shapes", "make", "a.xyz"], ["run", "--engine", "virtual"], ["report", "run"], ["sweep", "liveness"]],
)
def test_within_the_imports_of_a_library(command, tmp_path):
    (tmp_path / "numpy.py").write_text(SLOW)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    found = interrupted_when_it_says_go(["-m", "swarmer", *command], env=environment, cwd=tmp_path)
    assert found == (130, "", "interrupted\n")
    assert [path.name for path in tmp_path.iterdir() if path.name != "__pycache__"] == ["numpy.py"]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_kill_and_a_closed_terminal_are_the_same_to_a_run_that_is_planned(number, tmp_path):
    (tmp_path / "numpy.py").write_text(SLOW)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    arguments = ["-m", "swarmer", "run", "--engine", "virtual"]
    found = interrupted_when_it_says_go(arguments, number, env=environment, cwd=tmp_path)
    assert found == (130, "", "interrupted\n")


def test_where_python_would_lose_it():
    """An exception of a finalizer is dropped; a process that is gone is gone."""
    code = (
        "from swarmer.interrupts import ends_at_once\n"
        "class Slow:\n"
        f"    def __del__(self): {SLOW.strip()}\n"
        "with ends_at_once():\n"
        "    slow = Slow(); del slow\n"
        "    print('went on')\n"
    )
    assert interrupted_when_it_says_go(["-c", code]) == (130, "", "interrupted\n")


def test_afterwards_and_where_others_listen_nothing_is_changed():
    before = signal.getsignal(signal.SIGINT)
    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        with contextlib.suppress(ValueError), ends_at_once():
            assert signal.getsignal(signal.SIGINT) is not signal.default_int_handler
            raise ValueError("whatever")
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        at_once()
        in_order()
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_what_must_not_be_left_half_done_is_not(number):
    """An ending waits until there is somebody to finish what was begun."""
    code = f"""
import os
from swarmer.interrupts import endings_wait, endings_over
with endings_wait() as let_them_come:
    os.kill(os.getpid(), {int(number)})
    print("begun")
    try:
        let_them_come()
        print("not reached")
    except KeyboardInterrupt:
        endings_over()
        os.kill(os.getpid(), {int(number)})
        print("written")
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, preexec_fn=hearing)
    assert (done.returncode, done.stdout, done.stderr) == (0, "begun\nwritten\n", "")


def hearing():
    """As a terminal has it, and not as a job in the background."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def test_who_is_deaf_to_hanging_up_stays_so():
    code = """
import os, signal
from swarmer.interrupts import endings_wait
with endings_wait() as let_them_come:
    os.kill(os.getpid(), signal.SIGHUP)
    let_them_come()
print("alive")
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN),
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, "alive\n")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_an_ending_that_a_library_swallows_is_told_to_the_engine(number):
    code = f"""
import os
from swarmer.engines.stopping import told_to_stop
from swarmer.interrupts import endings_wait, one_was_lost
class Swallows:
    def __del__(self): os.kill(os.getpid(), {int(number)})
with endings_wait() as let_them_come:
    let_them_come()
    swallows = Swallows(); del swallows
    with told_to_stop(lambda: print("told")):
        print("goes on")
assert not one_was_lost()
with told_to_stop(lambda: print("not told again")):
    pass
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, preexec_fn=hearing)
    assert (done.returncode, done.stdout) == (0, "told\ngoes on\n")
    assert "KeyboardInterrupt" in done.stderr, "it was swallowed"
