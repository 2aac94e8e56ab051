"""`--live=web` in a real browser: the swarm is seen while it forms, nobody else is asked, and the end is told.

Pixels are read as for the replay. The bytes of a made run are fed by hand here, so that what is early stays so for as
long as the browser needs; a run of real processes is the last test's.
"""

import os
import signal
import subprocess
import sys
import time

import pytest
from viewer_pixels import EARLY, LATE, PATIENCE_S, apart, hues, swarm_view, until_seen

from swarmer.observe.live import open_viewer
from swarmer.observe.live_page import NOTE, OVER

pytestmark = pytest.mark.timeout(3 * PATIENCE_S)
HALF = 0.5  # of the recording's bytes


@pytest.fixture(scope="module")
def live(run):
    """(viewer, address, its bytes, how many of them are fed)."""
    data = (run / "recording.rrd").read_bytes()
    viewer = open_viewer("web", run.name)
    fed = int(HALF * len(data))
    viewer.feed(data[:fed])
    try:
        yield viewer, viewer.news()[0].split()[1], data, fed
        viewer.close()
        assert viewer._process.wait(30) == 0
    finally:
        viewer._process.kill()


def test_early_swarms_are_seen_before_the_rest_has_come_and_the_end_stays(visit, live, run):
    viewer, address, data, fed = live
    with visit(address) as seen:
        page = seen.page
        page.locator("#status").wait_for(state="hidden", timeout=1000 * PATIENCE_S)
        assert page.locator("#note").inner_text() == NOTE
        assert page.locator("h1").inner_text() == run.name
        until_seen(page, EARLY, lambda found: apart(found) >= 2)
        viewer.feed(data[fed:])
        viewer.close()
        page.locator("#note", has_text=OVER).wait_for(timeout=1000 * PATIENCE_S)
        assert viewer._process.wait(30) == 0
        until_seen(page, [LATE], lambda found: apart(found) == 1)
        assert not seen.left
        assert {url.removeprefix(address) for url in seen.asked} == {
            "", "page.css", "page.js", "re_viewer.js", "re_viewer_bg.wasm", "recording.rrd",
        }  # fmt: skip
        assert not [said for kind, said in seen.console if kind == "error"]
        assert not seen.errors


def test_a_run_of_processes_is_followed_and_leaves_nothing(visit, tmp_path):
    """Its window is closed in the middle and opened again; Ctrl-C ends it all."""
    command = [
        sys.executable, "-m", "swarmer", "run", "--shape", "random", "--points", "12", "--duration", "600",
        "--live=web", "--out", str(tmp_path / "run"),
    ]  # fmt: skip
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    ) as process:  # fmt: skip
        try:
            address = next(line.split()[1] for line in process.stdout if line.startswith("live: http"))
            with visit(address) as first:
                first.page.locator("#status", has_text="Loading").wait_for(timeout=1000 * PATIENCE_S)
            with visit(address) as seen:
                seen.page.locator("#status").wait_for(state="hidden", timeout=1000 * PATIENCE_S)
                end = time.monotonic() + PATIENCE_S
                while not hues(swarm_view(seen.page)):
                    assert time.monotonic() < end, "no FLS was seen"
                assert process.poll() is None
                process.send_signal(signal.SIGINT)
                seen.page.locator("#note", has_text=OVER).wait_for(timeout=1000 * PATIENCE_S)
                out, _ = process.communicate(timeout=60)
                assert not [said for kind, said in seen.console if kind == "error"]
                assert hues(swarm_view(seen.page)), "the last state stays"
            assert process.returncode == 130
            assert "the viewer" not in out
        finally:
            process.kill()
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)
