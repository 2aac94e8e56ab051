"""What rerun's viewer shows in a browser, read from its pixels: it draws on a canvas.

Software draws it here, some frames a second: every wait is for what must be seen, as long as PATIENCE_S.
"""

import colorsys
import io
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
