"""`cause.html` in a browser: chosen, followed and moved about by keyboard alone, at any width, without a request."""

import subprocess
import sys

import pytest

RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa"]
pytestmark = pytest.mark.timeout(300)


@pytest.fixture(scope="module")
def address(browser, tmp_path_factory):
    """Of the page of a small run with losses and failures."""
    path = tmp_path_factory.mktemp("cause") / "run"
    options = [
        "--engine", "virtual", "--shape", "sphere", "--points", "40", "--duration", "6", "--seed", "7", "--trace",
        "--set", "radio.loss=0.1", "--set", "failure.rate=0.02", "--set", "thaw.policy=timer", "--no-recording",
        "--out", str(path),
    ]  # fmt: skip
    for command in (["run", *options], ["report", str(path)]):
        subprocess.run(
            [sys.executable, "-m", "swarmer", *command], check=True, capture_output=True, timeout=100
        )
    return (path / "cause.html").as_uri()


@pytest.fixture(params=[(1280, "light"), (390, "dark")], ids=str)
def page(visit, address, request):
    """The page, opened; at the end nothing was asked of the network and nothing complained."""
    width, scheme = request.param
    with visit(address, viewport={"width": width, "height": 900}, color_scheme=scheme) as seen:
        seen.page.set_default_timeout(20_000)
        yield seen.page
        assert seen.asked == [address]
        assert not seen.errors
        assert not [said for said in seen.console if said[0] in ("error", "warning")]


def test_moments_have_pictures_and_nothing_hangs_over(page):
    assert page.locator("#chooser").is_visible()
    assert page.locator("details[open] .talk svg rect").count() > 0
    assert page.locator("details .talk li").count() >= 2
    assert page.locator("#curve a").count() == page.locator("details").count() >= 2
    assert page.evaluate("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
    scrolls = page.locator(".scroll:has(#curve)").evaluate("box => box.scrollWidth > box.clientWidth")
    assert page.locator("figcaption .narrow").is_visible() == scrolls


def test_a_box_of_talk_says_that_it_scrolls_where_it_does(page):
    page.locator("#choice button").first.click()
    box = page.locator("#talk .talk")
    scrolls = box.evaluate("box => box.scrollWidth > box.clientWidth")
    page.evaluate("new Promise(requestAnimationFrame)")
    assert scrolls == (page.viewport_size["width"] < 600)
    assert page.locator("#talk .narrow").count() == scrolls
    if scrolls:
        assert "to the right" in page.locator("#talk .narrow").inner_text()


def test_a_moment_is_chosen_on_the_curve_by_keyboard(page):
    assert page.locator("#rise-2").get_attribute("open") is None
    page.locator("#curve a[href='#rise-2']").focus()
    page.keyboard.press("Enter")
    page.locator("#rise-2[open]").wait_for()


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


def test_everybody_can_read_it(page):
    """axe's rules of WCAG 2.1 A and AA, with everything unfolded and something chosen."""
    from axe_playwright_python.sync_playwright import Axe

    page.evaluate("document.querySelectorAll('details').forEach(part => { part.open = true; })")
    page.locator("#from").fill("0")
    page.locator("#from").press("Enter")
    page.locator("#talk li button").first.press("Enter")
    found = Axe().run(page, options={"runOnly": RULES}).response
    assert "color-contrast" in {rule["id"] for rule in found["passes"]}
    assert not {
        rule["id"]: [node["html"][:160] for node in rule["nodes"][:3]] for rule in found["violations"]
    }
