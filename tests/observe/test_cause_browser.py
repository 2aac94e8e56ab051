"""`cause.html` in a browser: chosen, followed and moved about by keyboard alone, at any width, without a request."""

import shutil
import signal
import warnings

import pytest
from click.testing import CliRunner

from swarmer.cli import load
from swarmer.observe.report import write_report

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@pytest.fixture(scope="module")
def browser():
    """A browser, where there is one."""
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        sync_playwright = None
    if BROWSER is None or sync_playwright is None:
        warnings.warn("NO BROWSER: the pictures of cause.html are not looked at here", stacklevel=1)
        pytest.skip("no browser, or no playwright: the pictures of cause.html are not looked at here")
    with sync_playwright() as play:
        started = play.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        yield started
        started.close()


@pytest.fixture(scope="module")
def page_file(tmp_path_factory):
    """The page of a small run with losses and failures."""
    path = tmp_path_factory.mktemp("cause") / "run"
    before = signal.getsignal(signal.SIGINT)
    done = CliRunner().invoke(
        load("run"),
        ["--engine", "virtual", "--shape", "sphere", "--points", "40", "--duration", "6", "--seed", "7", "--trace",
         "--set", "radio.loss=0.1", "--set", "failure.rate=0.02", "--set", "thaw.policy=timer", "--no-recording",
         "--out", str(path)],
    )  # fmt: skip
    signal.signal(signal.SIGINT, before)
    assert done.exit_code == 0, done.output
    write_report([path])
    return path / "cause.html"


@pytest.fixture(params=[(1280, "light"), (390, "dark")], ids=str)
def page(browser, page_file, request):
    """The page, opened; at the end nothing was asked of the network and nothing complained."""
    width, scheme = request.param
    opened = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
    opened.set_default_timeout(10_000)
    asked, complaints = [], []
    opened.on("request", lambda one: asked.append(one.url))
    opened.on("console", lambda one: complaints.append(one.text))
    opened.on("pageerror", lambda one: complaints.append(str(one)))
    opened.goto(page_file.as_uri())
    yield opened
    opened.close()
    assert complaints == []
    assert all(url.startswith("file:") for url in asked)
    assert len(asked) == 1


def test_moments_have_pictures_and_nothing_hangs_over(page):
    assert page.locator("#chooser").is_visible()
    assert page.locator("details[open] .talk svg rect").count() > 0
    assert page.locator("details .talk li").count() >= 2
    assert page.locator("#curve a").count() == page.locator("details").count() >= 2
    assert page.evaluate("document.documentElement.scrollWidth <= document.documentElement.clientWidth")


def test_a_moment_is_chosen_on_the_curve_by_keyboard(page):
    assert page.locator("#rise-2").get_attribute("open") is None
    page.locator("#curve a[href='#rise-2']").focus()
    page.keyboard.press("Enter")
    page.wait_for_function("document.querySelector('#rise-2').open")


def test_an_fls_and_seconds_are_chosen_by_keyboard(page):
    page.locator("#fls").focus()
    page.keyboard.press("Control+A")
    page.keyboard.type("7")
    page.keyboard.press("Tab")
    page.keyboard.press("Control+A")
    page.keyboard.type("0.5")
    page.keyboard.press("Tab")
    page.keyboard.press("Control+A")
    page.keyboard.type("1.5")
    page.keyboard.press("Enter")
    assert "events of FLS 7 and of those it talked with" in page.locator("#said").inner_text()
    lines = page.locator("#talk li").all_inner_texts()
    assert all(0.5 <= float(line.split()[0]) <= 1.5 for line in lines)
    assert any(line.split()[2] == "7" for line in lines)
    assert page.locator("#life svg").get_attribute("aria-label").startswith("FLS 7: ")
    before = page.locator("#from").input_value()
    page.locator("button", has_text="Later").press("Enter")
    assert float(page.locator("#from").input_value()) > float(before)
    page.locator("#fls").fill("41")
    page.keyboard.press("Enter")
    assert "FIDs of this run, 1 to 40" in page.locator("#said").inner_text()
    assert page.locator("#fls").get_attribute("aria-invalid") == "true"


def test_a_datagram_is_followed_from_its_id(page):
    page.locator("#fls").fill("7")
    page.locator("#from").fill("0")
    page.locator("#to").fill("5")
    page.keyboard.press("Enter")
    first = page.locator("#talk li button").first
    name = first.inner_text()
    first.press("Enter")
    assert f"name {name}" in page.locator("#heard").inner_text()
    assert all(name in line for line in page.locator("#followed li").all_inner_texts())
    assert page.locator("#talk path.lost").count() > 0


def test_words_stand_out_from_their_ground(page):
    """WCAG AA: 4.5 to 1 for what is written, of every text that is seen."""
    worst = page.evaluate(
        """() => {
          const light = (colour) => {
            const parts = colour.match(/[\\d.]+/g).slice(0, 3).map((part) => {
              const share = part / 255;
              return share <= 0.04045 ? share / 12.92 : ((share + 0.055) / 1.055) ** 2.4;
            });
            return 0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2];
          };
          const ground = (node) => {
            for (let at = node; at; at = at.parentElement) {
              const colour = getComputedStyle(at).backgroundColor;
              if (!/, 0\\)$/.test(colour)) return colour;
            }
            return "rgb(255, 255, 255)";
          };
          let worst = [21, ""];
          for (const node of document.querySelectorAll("main *")) {
            const own = [...node.childNodes].some((child) => child.nodeType === 3 && child.textContent.trim());
            if (!own || !node.getClientRects().length || node.closest("script")) continue;
            const style = getComputedStyle(node);
            const front = light(node.ownerSVGElement ? style.fill : style.color), back = light(ground(node));
            const ratio = (Math.max(front, back) + 0.05) / (Math.min(front, back) + 0.05);
            if (ratio < worst[0]) worst = [ratio, node.tagName + " " + node.textContent.slice(0, 40)];
          }
          return worst;
        }"""
    )
    assert worst[0] >= 4.5, worst
