"""The live viewer: it gets what the file gets, and nothing that it does reaches the run."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from pathlib import Path

import pytest
from click.testing import CliRunner
from rrd_rows import blueprint, blueprint_ids, rows

from swarmer.commands.run import command
from swarmer.errors import BadInput, RunFailed
from swarmer.observe import live
from swarmer.observe.collector import Collector
from swarmer.observe.live import LiveViewer, check_way, open_viewer
from swarmer.observe.run_directory import RunDirectory
from swarmer.observe.viewer import HOST, answers, native_command, serves_viewers, web_address

PLAYING, FOLLOWING = 2, 3  # of rerun's PlayState
COPY = "import shutil, sys; shutil.copyfileobj(sys.stdin.buffer, open(sys.argv[1], 'wb'))"
SLEEP = [sys.executable, "-c", "import time; time.sleep(60)"]


class Lines:
    """In the place of the panel."""

    def __init__(self):
        self.lines = []

    def say(self, line):
        self.lines.append(line)

    def __getattr__(self, name):
        return lambda *_: None


@pytest.fixture
def collector(tmp_path, fake):
    def make(way, **settings):
        directory = RunDirectory.create(tmp_path / "run", "ball", 1, ["swarmer-run"])
        panel = Lines()
        one = Collector(directory, panel, way)
        one.finish(fake.feed(one, fake.plan(**settings), 2.0))
        return one, panel.lines

    return make


@pytest.fixture
def viewer_of(monkeypatch):
    """Let `open_viewer` start this command."""

    def use(command, **more):
        made = []

        def start(way):
            made.append(LiveViewer(command, ["live: here"], **more))
            return made[-1]

        monkeypatch.setattr(live, "open_viewer", start)
        return made

    return use


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_the_viewer_gets_what_the_file_gets(tmp_path, collector, viewer_of):
    made = viewer_of([sys.executable, "-c", COPY, str(tmp_path / "shown")])
    one, lines = collector("auto")
    assert made[0]._process.wait(10) == 0
    assert one.failure is None
    shown, file = (tmp_path / "shown").read_bytes(), (tmp_path / "run" / "recording.rrd").read_bytes()
    assert file.startswith(shown)
    (tmp_path / "cut.rrd").write_bytes(shown)
    assert len(rows(tmp_path / "cut.rrd", "swarms", "Scalars:scalars")) == 21, "to the last sample"
    assert lines == ["live: here"]
    # Live it follows the run. What comes after that is for the file alone: another blueprint, which plays it.
    assert [value[0] for value in blueprint(tmp_path / "cut.rrd")["TimePanelBlueprint:play_state"]] == [
        FOLLOWING
    ]
    last = blueprint(tmp_path / "run" / "recording.rrd", blueprint_ids(tmp_path / "cut.rrd"))
    assert [value[0] for value in last["TimePanelBlueprint:play_state"]] == [PLAYING]


def test_virtual_time_is_played_live(tmp_path, collector, viewer_of):
    made = viewer_of([sys.executable, "-c", COPY, str(tmp_path / "shown")])
    collector("auto", engine="virtual")
    assert made[0]._process.wait(10) == 0
    assert (tmp_path / "shown").read_bytes() == (tmp_path / "run" / "recording.rrd").read_bytes()
    (shown,) = blueprint(tmp_path / "shown")["TimePanelBlueprint:play_state"]
    assert shown == [PLAYING]


def test_a_viewer_without_a_file(tmp_path, collector, viewer_of):
    made = viewer_of([sys.executable, "-c", COPY, str(tmp_path / "shown")])
    collector("auto", recording={"enabled": False})
    made[0]._process.wait(10)
    assert (tmp_path / "shown").stat().st_size > 10_000
    assert not list((tmp_path / "run").glob("recording*"))


def test_a_viewer_that_is_killed_is_told_and_the_run_goes_on(tmp_path, collector, viewer_of):
    made = viewer_of([sys.executable, "-c", "import sys; sys.stdin.buffer.read(1000)"])
    one, lines = collector("auto")
    made[0]._process.wait(10)
    made[0].feed(b"x" * 200_000)
    made[0]._thread.join(10)
    assert one.failure is None
    assert (tmp_path / "run" / "recording.rrd").exists()
    assert [*lines, *made[0].news()][-1] == "live: the viewer is gone; the run goes on without it"


def test_a_window_that_cannot_open_is_told_at_the_end(collector, viewer_of):
    """There may be a display and no driver that draws on it."""
    viewer_of(
        [sys.executable, "-c", "import sys, time; sys.stdin.close(); time.sleep(0.2); sys.exit(3)"],
        stays=True,
    )
    _, lines = collector("desktop")
    assert lines[0] == "live: here"
    assert lines[1] in (
        "live: the viewer is gone; the run goes on without it; --live=web makes a page",
        "live: the viewer has ended with status 3; --live=web makes a page",
    )


def test_a_viewer_that_never_reads_neither_stops_the_run_nor_fills_the_memory(monkeypatch):
    monkeypatch.setattr(live, "HELD_MAX", 1 << 20)
    monkeypatch.setattr(live, "CLOSE_S", 0.1)
    viewer = LiveViewer(SLEEP, [])
    try:
        for _ in range(40):
            viewer.feed(bytes(100_000))
        assert viewer.news() == ["live: the viewer does not keep up; the run goes on without it"]
        assert not viewer._queue
        viewer.close()
    finally:
        viewer._process.kill()
        viewer._process.wait()


def test_nobody_at_the_port_is_a_warning(tmp_path, collector):
    with socket.socket() as taken:
        taken.bind((HOST, 0))
        port = taken.getsockname()[1]
        one, lines = collector(str(port))
    assert lines == [f"warning: no viewer listens at {HOST}:{port}; the run goes on"]
    assert one.failure is None
    assert (tmp_path / "run" / "recording.rrd").exists()
    assert "no viewer listens" in (tmp_path / "run" / "log.txt").read_text()


def test_no_display_is_a_warning_that_says_what_would_do(monkeypatch, collector):
    monkeypatch.setattr(live, "display_available", lambda: False)
    _, (line,) = collector("desktop")
    assert line == "warning: no display for a viewer; --live=web makes a page of it; the run goes on"


@pytest.mark.parametrize("way", ["", "screen", "0", "65536", "-1", "9876x", "AUTO"])
def test_other_ways_are_bad_input(way):
    with pytest.raises(BadInput, match="live"):
        check_way(way)


def test_the_option_takes_a_way_or_none(tmp_path):
    def run(*arguments):
        return CliRunner().invoke(command, [*arguments, "--lambda", "x"], standalone_mode=False).exception

    with pytest.raises(BadInput, match="lambda_ms"):  # which is read first
        raise run("--live")
    done = CliRunner().invoke(
        command,
        ["--shape", "random", "--out", str(tmp_path / "run"), "--live=sideways"],
        standalone_mode=False,
    )
    assert str(done.exception) == (
        "live: 'sideways' is not allowed; one of auto, desktop, web, or the port of a viewer on this machine, "
        "1 to 65535"
    )
    assert not (tmp_path / "run").exists()


def test_a_port_is_no_viewer_because_something_listens():
    with socket.socket() as server:
        server.bind((HOST, 0))
        server.listen()
        port = server.getsockname()[1]
        assert not serves_viewers(port, 0.2), "it says nothing"

        def answer():
            with server.accept()[0] as client:
                client.recv(100)
                client.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")

        thread = threading.Thread(target=answer)
        server.accept()[0].close()
        thread.start()
        assert not serves_viewers(port)
        thread.join()
    assert not serves_viewers(port)


def listening(pid):
    """(address, port) of every TCP socket that a process and its children listen on."""
    inodes = set()
    for fd in Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(OSError):
            inodes.add(str(fd.readlink()))
    found = []
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            cells = line.split()
            if cells[3] == "0A" and f"socket:[{cells[9]}]" in inodes:
                address, port = cells[1].split(":")
                found.append((address, int(port, 16)))
    return found


def child_of(pid):
    for _ in range(100):
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        if children:
            return int(children[0])
        time.sleep(0.05)
    raise AssertionError("no child")


def test_the_page_is_served_on_this_machine_alone_and_ends_with_the_run(monkeypatch, finished_run):
    monkeypatch.setattr(live, "display_available", lambda: False)
    monkeypatch.setattr(live, "serves_viewers", lambda port: False)
    with socket.socket() as one, socket.socket() as two:  # the usual ports are somebody else's
        for other, name in ((one, "GRPC_PORT"), (two, "WEB_PORT")):
            other.bind((HOST, 0))
            monkeypatch.setattr(live, name, other.getsockname()[1])
        viewer = open_viewer("auto")
    page, tunnel = viewer.news()
    address = page.split()[1]
    port, grpc = (
        int(address.split(mark)[1].split("/")[0]) for mark in (f"//{HOST}:", "=rerun%2Bhttp://127.0.0.1:")
    )
    assert address == web_address(grpc, port)
    assert {port, grpc}.isdisjoint({live.GRPC_PORT, live.WEB_PORT})
    assert f"ssh -L {port}:{HOST}:{port} -L {grpc}:{HOST}:{grpc} " in tunnel
    viewer.feed((finished_run / "recording.rrd").read_bytes()[:-100])
    assert answers(port, 20)
    assert answers(grpc, 20)
    with urllib.request.urlopen(address, timeout=10) as answer:
        assert b"rerun" in answer.read().lower()
    assert serves_viewers(grpc)
    server = child_of(viewer._process.pid)
    assert sorted(listening(server)) == sorted([("0100007F", port), ("0100007F", grpc)])
    viewer.close()
    viewer._process.wait(5)
    assert not Path(f"/proc/{server}").exists()


def test_the_page_ends_also_when_the_run_is_killed(tmp_path):
    code = (
        "import time, sys; from swarmer.observe import live; live.display_available = lambda: False; "
        "v = live.open_viewer('web'); print(v._process.pid, flush=True); time.sleep(60)"
    )
    run = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    keeper = int(run.stdout.readline())
    server = child_of(keeper)
    run.kill()
    run.wait()
    run.stdout.close()
    for _ in range(100):
        if not any(Path(f"/proc/{pid}/exe").exists() for pid in (keeper, server)):
            return
        time.sleep(0.05)
    for pid in (server, keeper):
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    raise AssertionError("it is still there")


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_a_viewer_that_is_there_is_used(tmp_path, collector):
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        port = probe.getsockname()[1]
    command = [*native_command((), port), "--save", str(tmp_path / "seen.rrd")]
    there = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        assert answers(port, 20)
        one, lines = collector(str(port))
        assert lines == [f"live: in the viewer at {HOST}:{port}"]
        assert one.failure is None
        seen = []
        for _ in range(100):
            with contextlib.suppress(RuntimeError, ValueError):  # it is being written
                seen = rows(tmp_path / "seen.rrd", "swarms", "Scalars:scalars")
            if len(seen) == 21:
                break
            time.sleep(0.1)
        assert len(seen) == 21
    finally:
        there.kill()
        there.wait()


def test_what_cannot_be_started_is_one_line(monkeypatch):
    monkeypatch.setattr(live, "display_available", lambda: True)
    monkeypatch.setattr(live, "native_command", lambda files, port: ["/does/not/exist"])
    with pytest.raises(RunFailed, match="did not start"):
        open_viewer("desktop")
