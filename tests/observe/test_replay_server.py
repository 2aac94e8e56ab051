"""The page of the web replay: what it serves, to whom, and what it leaves when it ends."""

import http.client
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading

import pytest

from swarmer.errors import BadInput, RunFailed
from swarmer.observe import replay_server
from swarmer.observe.replay_server import bound_server, page_files, viewer_files

PATIENCE_S = 60


@pytest.fixture(scope="module")
def server(finished_run):
    with bound_server(finished_run / "recording.rrd", None) as server:
        server.files = {**page_files("a <script>alert(1)</script> & $name", '"it ended"'), **viewer_files()}
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def ask(server, path, method="GET", host=None):
    connection = http.client.HTTPConnection(*server.server_address, timeout=PATIENCE_S)
    connection.request(method, path, headers={"Host": host} if host else {})
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer, body


def test_the_viewer_and_the_recording_come_from_this_server(server, finished_run):
    assert server.server_address[0] == "127.0.0.1"
    answer, program = ask(server, "/re_viewer_bg.wasm")
    assert (answer.getheader("Content-Type"), program[:4]) == ("application/wasm", b"\0asm")
    assert b"wasm_bindgen" in ask(server, "/re_viewer.js")[1]
    assert ask(server, "/recording.rrd")[1] == (finished_run / "recording.rrd").read_bytes()
    answer, body = ask(server, "/recording.rrd", "HEAD")
    assert (int(answer.getheader("Content-Length")), body) == (
        (finished_run / "recording.rrd").stat().st_size,
        b"",
    )


def test_the_page_names_nobody_else(server):
    for name in ("/", "/page.js", "/page.css"):
        answer, body = ask(server, name)
        assert answer.status == 200
        assert not re.findall(r"//(?!www\.w3\.org/2000/svg)[\w-]+\.\w", body.decode())
        assert "connect-src 'self'" in answer.getheader("Content-Security-Policy")
        assert "default-src 'none'" in answer.getheader("Content-Security-Policy")


def test_names_with_markup_are_text(server):
    page = ask(server, "/")[1].decode()
    assert "<script>alert" not in page
    assert page.count("a &lt;script&gt;alert(1)&lt;/script&gt; &amp; $name") == 2
    assert "&quot;it ended&quot;" in page


@pytest.mark.parametrize("host", ["evil.example", "evil.example:9090", "127.0.0.1.evil.example:1", ""])
def test_a_foreign_name_for_this_machine_gets_nothing(server, host):
    assert ask(server, "/recording.rrd", host=host or " ")[0].status == 403


@pytest.mark.parametrize("host", ["localhost:8000", "127.0.0.1:1234"])
def test_another_port_of_a_tunnel_is_this_machine(server, host):
    assert ask(server, "/", host=host)[0].status == 200


@pytest.mark.parametrize(
    "path", ["/nothing", "/../conftest.py", "//etc/passwd", "/%2e%2e/x", "/__init__.py", "/recording.rrd/x"]
)
def test_nothing_else_is_there(server, path):
    assert ask(server, path)[0].status == 404


def test_a_taken_port_is_refused_if_it_was_asked_for_and_passed_over_if_not(finished_run, monkeypatch):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(BadInput, match=rf"port: {port} .*in use"):
            bound_server(finished_run, port)
        monkeypatch.setattr(replay_server, "WEB_PORT", port)
        with bound_server(finished_run, None) as server:
            assert server.server_address[1] != port


def test_a_program_that_serves_no_viewer_is_told(monkeypatch):
    monkeypatch.setattr(replay_server, "rerun_command", lambda: [sys.executable, "-c", "pass"])
    with pytest.raises(RunFailed, match="--terminal"):
        viewer_files()


@pytest.mark.processes
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("cut", [False, True])
def test_it_ends_without_a_trace(finished_run, tmp_path, number, cut):
    """No process and no temporary file; what was served was put together in one, of a cut recording what is whole."""
    run, room = shutil.copytree(finished_run, tmp_path / "run"), tmp_path / "room"
    room.mkdir()
    if cut:
        data = (run / "recording.rrd").read_bytes()
        (run / "recording.rrd.partial").write_bytes(data[: len(data) * 2 // 3])
        (run / "recording.rrd").unlink()
    with subprocess.Popen(
        [sys.executable, "-m", "swarmer", "replay", "--web", str(run)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        env={**os.environ, "TMPDIR": str(room)},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    ) as process:  # fmt: skip
        try:
            assert re.fullmatch(r"open http://127.0.0.1:\d+/\n", process.stdout.readline())
            assert len(list(room.iterdir())) == 1
            process.send_signal(number)
            _, err = process.communicate(timeout=PATIENCE_S)
        finally:
            process.kill()
    assert process.returncode == (0 if number == signal.SIGINT else 143)
    assert ("this is what is whole" in err) == cut
    assert "Traceback" not in err
    assert not list(room.iterdir())
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)  # nobody of its group is left
