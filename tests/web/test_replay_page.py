"""`swarmer replay --web` in a real browser: the swarm is drawn, time can be scrubbed, and nobody else is asked.

The viewer draws on a canvas, so what it shows is read from the pixels. Software draws it here, some frames a second:
every wait is for what must be seen, as long as PATIENCE_S.
"""

import colorsys
import io
import os
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

PATIENCE_S = 120
EARLY, LATE = (0.08, 0.11, 0.14, 0.18, 0.23), 0.985  # where on the line of time, as parts of it
LINE = SimpleNamespace(left=330, right=1072, above_bottom=14)  # of time in the viewer's panel, CSS pixels
TITLE, LEFT_SHARE = 66, 0.58  # below the top of the canvas the 3D view begins; its part of the width
HUES = 24
LIGHT, VIVID = (
    60,
    45,
)  # of 255: brightness and spread of channels from which a pixel belongs to a coloured point

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


def swarm_view(page):
    """(H, W, 3) pixels of the 3D view."""
    box = page.locator("#viewer").bounding_box()
    clip = {
        "x": box["x"], "y": box["y"] + TITLE, "width": LEFT_SHARE * box["width"],
        "height": box["height"] - TITLE - 40,
    }  # fmt: skip
    png = page.screenshot(clip=clip, timeout=1000 * PATIENCE_S)
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(np.int16)


def hues(picture):
    """The hues of coloured points, of HUES round the circle: those that have a good part of the coloured pixels."""
    flat = picture.reshape(-1, 3)
    vivid = flat[(flat.max(axis=1) > LIGHT) & (np.ptp(flat, axis=1) > VIVID)]
    colours, counts = np.unique(vivid // 8 * 8, axis=0, return_counts=True)
    found = np.zeros(HUES)
    for colour, count in zip(colours / 255, counts, strict=True):
        found[int(colorsys.rgb_to_hls(*colour)[0] * HUES) % HUES] += count
    return [] if found.sum() < 30 else [i for i in range(HUES) if found[i] > 0.08 * found.sum()]


def apart(found):
    """How many groups of neighbouring hues there are: what one colour gives, at the edge of its points, is one."""
    return sum((hue - 1) % HUES not in found for hue in found) or len(found)


def go_to(page, share):
    """Click on the line of time."""
    box = page.locator("#viewer").bounding_box()
    x = LINE.left + share * (LINE.right - LINE.left)
    page.mouse.click(box["x"] + x, box["y"] + box["height"] - LINE.above_bottom)
    page.wait_for_timeout(1500)


def until_seen(page, shares, enough):
    """Go to the moments by turns until one shows enough; the recording may still be loading."""
    end, seen = time.monotonic() + PATIENCE_S, []
    while time.monotonic() < end:
        for share in shares:
            go_to(page, share)
            found = hues(swarm_view(page))
            if enough(found):
                return share
            seen.append((share, found))
    pytest.fail(f"never seen: {seen[-6:]}")


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
