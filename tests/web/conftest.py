"""A real browser for the tests of pages: Debian's Chromium, driven by Playwright, its drawing done in software.

Where there is no browser they are skipped, and the suite says so in capitals at its end. With SWARMER_NEEDS_BROWSER
set, as in CI, that is a failure: there they are never skipped.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import urlsplit

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
ARGUMENTS = [
    "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-background-networking",
    "--disable-component-update", "--disable-dev-shm-usage", "--no-first-run",
]  # fmt: skip
HERE = ("127.0.0.1", "localhost")
POINTS, SECONDS = 60, 15
MARKUP = "<script>alert(1)<script>"  # a name that must be shown as text


def pytest_collection_modifyitems(items):
    for item in items:
        if "/tests/web/" in item.path.as_posix():
            item.add_marker(pytest.mark.web)


def browser_path():
    """Where the browser is; without one the test is skipped, or fails where one is demanded."""
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    if path is None:
        missing("no browser: install Chromium (Debian: apt install chromium)")
    return path


def missing(why):
    if os.environ.get("SWARMER_NEEDS_BROWSER"):
        pytest.fail(f"{why}; SWARMER_NEEDS_BROWSER says that it must be here", pytrace=False)
    pytest.skip(why)


@pytest.fixture(scope="session")
def browser():
    """A browser for the whole session."""
    path = browser_path()
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        missing("Playwright is not installed: pip install -e .[dev]")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=ARGUMENTS)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def visit(browser):
    """A context manager that opens a page; it keeps what was asked for, what left this machine, what the console said.

    Settings are those of a browser context: viewport, color_scheme, ...
    """

    @contextlib.contextmanager
    def visit(address, **settings):
        context = browser.new_context(**{"viewport": {"width": 1280, "height": 800}, **settings})
        page = context.new_page()
        kept = SimpleNamespace(page=page, asked=[], left=[], console=[], errors=[])
        context.on("request", lambda request: kept.asked.append(request.url))
        context.route("**/*", lambda route: stay_here(route, kept))
        page.on("console", lambda message: kept.console.append((message.type, message.text)))
        page.on("pageerror", lambda error: kept.errors.append(str(error)))
        page.on("dialog", lambda dialog: (kept.errors.append(dialog.message), dialog.dismiss()))
        page.goto(address)
        try:
            yield kept
        finally:
            context.close()

    return visit


def stay_here(route, kept):
    """Nothing leaves this machine, whatever a page may want; what it wanted is kept."""
    parts = urlsplit(route.request.url)
    if parts.scheme in ("data", "blob", "file", "about") or parts.hostname in HERE:
        route.continue_()
    else:
        kept.left.append(route.request.url)
        route.abort()


@pytest.fixture(scope="session")
def run(tmp_path_factory):
    """A run that ends as one swarm, of a shape and in a directory with markup in their names; look, do not touch."""
    browser_path()  # no run is made for nothing
    place = tmp_path_factory.mktemp("pages")
    rng = np.random.default_rng(4)
    points = rng.normal(size=(POINTS, 3))
    points *= 20 / np.linalg.norm(points, axis=1, keepdims=True)
    np.savetxt(place / f"{MARKUP}.xyz", np.unique(np.rint(points + 30), axis=0))
    command = [
        sys.executable, "-m", "swarmer", "run", "--engine", "virtual", "--shape", str(place / f"{MARKUP}.xyz"),
        "--duration", str(SECONDS), "--seed", "1", "--out", str(place / f"{MARKUP} run"),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
    assert done.returncode == 0, done.stderr
    return place / f"{MARKUP} run"
