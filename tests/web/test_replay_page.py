"""`swarmer replay --web` in a real browser: the swarm is drawn, time can be scrubbed, and nobody else is asked.

What the viewer shows is read from the pixels (`viewer_pixels`).
"""

import io
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from PIL import Image
from viewer_pixels import EARLY, LATE, PATIENCE_S, apart, until_seen

pytestmark = pytest.mark.timeout(3 * PATIENCE_S)


@pytest.fixture(scope="module")
def address(run):
    with subprocess.Popen(
        [sys.executable, "-m", "swarmer", "replay", "--web", str(run)],
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, start_new_session=True,
    ) as server:  # fmt: skip
        try:
            line = server.stdout.readline()
            assert line.startswith("open http://127.0.0.1:"), line
            yield line.split()[1]
            server.send_signal(signal.SIGTERM)
            server.wait(30)
        finally:
            server.kill()
    with pytest.raises(ProcessLookupError):
        os.killpg(server.pid, 0)


@pytest.fixture(scope="module")
def replay(visit, address):
    """The page once the viewer has started, and paused."""
    with visit(address) as seen:
        seen.page.locator("#status").wait_for(state="hidden", timeout=1000 * PATIENCE_S)
        yield seen


def test_early_many_swarms_late_one_and_back(replay):
    """By the line of time, in both directions."""
    page = replay.page
    early = until_seen(page, EARLY, lambda found: apart(found) >= 2)
    until_seen(page, [LATE], lambda found: apart(found) == 1)
    until_seen(page, [early], lambda found: apart(found) >= 2)


def test_space_and_arrow_are_enough(replay):
    """The canvas has the focus from the start: the keyboard alone plays and steps."""
    page = replay.page
    assert page.evaluate("document.activeElement.closest('canvas, main, body').tagName") != "BODY"
    before = time_panel(page)
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        page.keyboard.press("ArrowRight")
        page.wait_for_timeout(1000)
        if not np.array_equal(before, time_panel(page)):
            return
    pytest.fail("the arrow did not move the time")


def time_panel(page):
    box = page.locator("#viewer").bounding_box()
    clip = {"x": box["x"] + 1085, "y": box["y"] + box["height"] - 28, "width": 180, "height": 26}
    return np.asarray(Image.open(io.BytesIO(page.screenshot(clip=clip, timeout=1000 * PATIENCE_S))))


def test_nobody_else_is_asked_and_nothing_goes_wrong(replay, address):
    assert not replay.left
    assert {url.removeprefix(address) for url in replay.asked} == {
        "", "page.css", "page.js", "re_viewer.js", "re_viewer_bg.wasm", "recording.rrd",
    }  # fmt: skip
    assert not [said for kind, said in replay.console if kind == "error"]
    assert not replay.errors


def test_names_with_markup_are_text(replay, run):
    assert replay.page.locator("h1").inner_text() == run.name
    assert replay.page.title() == run.name
    assert replay.page.locator("script:not([src])").count() == 0


def test_everybody_can_read_what_is_ours(replay):
    """axe's rules of WCAG 2.1 A and AA; the canvas is the viewer's."""
    from axe_playwright_python.sync_playwright import Axe

    rules = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa"]
    found = Axe().run(replay.page, options={"runOnly": rules}).response
    assert {rule["id"] for rule in found["passes"]} >= {"color-contrast", "html-has-lang", "meta-viewport"}
    assert not {rule["id"]: [node["html"] for node in rule["nodes"]] for rule in found["violations"]}


def test_a_browser_that_cannot_is_told_what_can(visit, address):
    """Without the viewer's program, as without WebAssembly, the page says what to do instead."""
    with visit(address) as seen:
        seen.page.route("**/re_viewer_bg.wasm", lambda route: route.fulfill(status=500))
        seen.page.reload()
        seen.page.locator("#status", has_text="--terminal").wait_for(timeout=1000 * PATIENCE_S)
