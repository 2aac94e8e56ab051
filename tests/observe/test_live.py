"""The live viewer: it gets what the file gets, and nothing that it does reaches the run."""

import contextlib
import os
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path

import pytest
from click.testing import CliRunner
from rrd_rows import blueprint, blueprint_ids, rows

from swarmer.commands.run import command
from swarmer.errors import BadInput, RunFailed
from swarmer.observe import live, live_page
from swarmer.observe.collector import Collector
from swarmer.observe.live import LiveViewer, check_way, open_viewer
from swarmer.observe.recording import Recording
from swarmer.observe.run_directory import RunDirectory
from swarmer.observe.viewer import HOST, native_command, serves_viewers

PLAYING, FOLLOWING = 2, 3  # of rerun's PlayState
COPY = """import os, sys
with open(sys.argv[1], "wb", 0) as file:
    while data := os.read(0, 65536):
        file.write(data)
"""
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

        def start(way, title):
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


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_the_launch_is_watched_in_our_layout(tmp_path, fake):
    """Before there is any sample."""
    shown = tmp_path / "shown"
    viewer = LiveViewer([sys.executable, "-c", COPY, str(shown)], [])
    recording = Recording(fake.plan(), None, viewer)
    states = None
    for _ in range(200):
        with contextlib.suppress(OSError, RuntimeError, ValueError, KeyError):  # it is being written
            (states,) = blueprint(shown)["TimePanelBlueprint:play_state"]
            break
        time.sleep(0.05)
    recording.close()
    assert states == [FOLLOWING]
    assert viewer._process.wait(10) == 0


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


def gone(pid):
    """True as soon as nothing runs under this number."""
    for _ in range(400):
        if not Path(f"/proc/{pid}/exe").exists():
            return True
        time.sleep(0.05)
    return False


def get(address, host=None):
    headers = {"Host": host} if host else {}
    with urllib.request.urlopen(urllib.request.Request(address, headers=headers), timeout=60) as answer:
        return answer.headers, answer.read()


def test_the_page_is_on_this_machine_alone_at_one_port_and_ends_with_the_run(monkeypatch, finished_run):
    monkeypatch.setattr(live, "display_available", lambda: False)
    monkeypatch.setattr(live, "serves_viewers", lambda port: False)
    data = (finished_run / "recording.rrd").read_bytes()
    with socket.create_server((HOST, 0)) as other:  # the usual port is somebody else's
        monkeypatch.setattr(live, "WEB_PORT", other.getsockname()[1])
        viewer = open_viewer("auto", "<script>x & y")
    page, tunnel = viewer.news()
    address = page.split()[1]
    port = int(address.rstrip("/").rpartition(":")[2])
    assert port != live.WEB_PORT
    assert f"ssh -L {port}:{HOST}:{port} " in tunnel
    viewer.feed(data[:5000])
    headers, body = get(address)
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert "connect-src 'self';" in headers["Content-Security-Policy"]
    assert b"<h1>&lt;script&gt;x &amp; y</h1>" in body
    assert listening(viewer._process.pid) == [("0100007F", port)]
    for foreign in (address, address + "recording.rrd"):
        with pytest.raises(urllib.error.HTTPError, match="403"):
            get(foreign, "evil.example")
    with urllib.request.urlopen(address + "recording.rrd", timeout=60) as grows:
        assert grows.read(5000) == data[:5000]
        viewer.feed(data[5000:])
        viewer.close()
        assert get(address + "recording.rrd")[1] == data, "also to who comes late"
        assert viewer._process.poll() is None, "one still reads"
        assert grows.read() == data[5000:]
    assert viewer._process.wait(20) == 0
    with pytest.raises(OSError, match="refused"):
        get(address)
    assert not viewer.news()


def test_a_reader_that_stops_does_not_hold_the_page_open(monkeypatch):
    monkeypatch.setattr(live_page, "GRACE_S", 0.2)
    recording = live_page.Growing()
    reader, writer = os.pipe()
    filler = threading.Thread(target=recording.fill, args=(reader,))
    filler.start()
    listening = socket.create_server((HOST, 0))
    with live_page.LiveServer(listening, recording) as server:
        serving = threading.Thread(target=server.serve_forever)
        serving.start()
        with urllib.request.urlopen(server.address + "recording.rrd", timeout=60):
            server.wait_until_quiet()
            assert server._answering == 1, "it was not waited for longer"
        server.shutdown()
        serving.join()
    os.close(writer)
    filler.join()
    os.close(reader)


def test_the_page_ends_also_when_the_run_is_killed():
    code = (
        "import time; from swarmer.observe import live; v = live.open_viewer('web', 'x'); "
        "print(v._process.pid, v.news()[0].split()[1], flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as run:
        pid, address = run.stdout.readline().split()
        assert get(address)[0]["Content-Type"].startswith("text/html")
        run.kill()
    assert gone(pid)


def test_a_page_that_cannot_be_kept_is_gone_and_the_run_is_told(monkeypatch):
    """There is no room for what came."""
    monkeypatch.setattr(live, "CLOSE_S", 60)
    code = "import tempfile; tempfile.tempdir = '/proc/1'; from swarmer.observe.live_page import main; main()"
    with socket.create_server((HOST, 0)) as page:
        command = [sys.executable, "-c", code, str(page.fileno()), "x"]
        viewer = LiveViewer(command, [], page=page)
    viewer._process.wait(60)
    viewer.feed(b"x" * 200_000)
    viewer.close()
    assert viewer.news() == ["live: the viewer is gone; the run goes on without it"]


def answers(port, wait_s):
    """True as soon as something listens on the port, False if nothing does for so long."""
    end = time.monotonic() + wait_s
    while time.monotonic() < end:
        with socket.socket() as probe:
            if probe.connect_ex((HOST, port)) == 0:
                return True
        time.sleep(0.1)
    return False


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
        open_viewer("desktop", "")
