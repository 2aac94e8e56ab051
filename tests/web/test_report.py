"""The report in a real browser: it draws, asks nobody, can be read by everybody, and used with the keyboard alone."""

import json
import shutil
import subprocess
import sys

import pytest

REACHABLE = "a[href], button, summary, input, select, textarea, [tabindex]:not([tabindex='-1'])"
RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa"]
PHONE = {"width": 390, "height": 844}

pytestmark = pytest.mark.timeout(300)


@pytest.fixture(scope="module")
def report(run, tmp_path_factory):
    """The address of the report of one run."""
    path = tmp_path_factory.mktemp("report") / "report.html"
    command = [sys.executable, "-m", "swarmer", "report", str(run), "--out", str(path)]
    subprocess.run(command, check=True, capture_output=True, timeout=100)
    return path.as_uri()


def unfolded(page):
    """Everything that can be unfolded, unfolded."""
    page.evaluate("document.querySelectorAll('details').forEach(part => { part.open = true; })")


def test_figures_are_drawn_and_nobody_is_asked(visit, report):
    with visit(report) as seen:
        figures = seen.page.locator("figure svg")
        assert figures.count() >= 3
        for figure in figures.all():
            figure.scroll_into_view_if_needed()
            box = figure.bounding_box()
            assert box["width"] > 200
            assert box["height"] > 80
            assert figure.locator("path, use, circle, line").count() > 5
        seen.page.wait_for_load_state("networkidle")
        assert seen.asked == [report]
        assert not seen.left
        assert not [said for said in seen.console if said[0] in ("error", "warning")]
        assert not seen.errors


@pytest.mark.parametrize("width", [1280, 390])
def test_the_view_in_space_holds_the_whole_shape(visit, report, width):
    """At the end all stand near their points: nothing is drawn at the edges, and something near two of them."""
    with visit(report, viewport={"width": width, "height": 800}) as seen:
        seen.page.wait_for_selector("#scene[data-ready]")
        margins = seen.page.evaluate(
            """async () => {
              for (let frame = 0; frame < 2; frame++) await new Promise(requestAnimationFrame);  // it is drawn in one
              const canvas = document.querySelector("#scene canvas"), {width, height} = canvas;
              const pixels = canvas.getContext("2d").getImageData(0, 0, width, height).data;
              let [left, right, top, bottom] = [width, 0, height, 0];
              for (let y = 0; y < height; y++) for (let x = 0; x < width; x++)
                if (pixels[4 * (y * width + x) + 2] > 90) {
                  left = Math.min(left, x); right = Math.max(right, x);
                  top = Math.min(top, y); bottom = Math.max(bottom, y);
                }
              return [left / width, 1 - right / width, top / height, 1 - bottom / height];
            }"""
        )
        assert min(margins) > 0.005
        assert min(margins[0] + margins[1], margins[2] + margins[3]) < 0.4, margins


def test_names_with_markup_are_text(visit, report, run):
    with visit(report) as seen:
        assert run.name.split()[0] in seen.page.locator("body").inner_text()
        assert seen.page.locator("script", has_text="alert(1)").count() == 0
        assert not seen.errors


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
def test_everybody_can_read_it(visit, report, scheme, width):
    """axe's rules of WCAG 2.1 A and AA, contrast among them."""
    from axe_playwright_python.sync_playwright import Axe

    with visit(report, color_scheme=scheme, viewport={"width": width, "height": 800}) as seen:
        unfolded(seen.page)
        found = Axe().run(seen.page, options={"runOnly": RULES}).response
        assert {rule["id"] for rule in found["passes"]} >= {
            "color-contrast",
            "html-has-lang",
            "document-title",
        }
        assert not {
            rule["id"]: [node["html"][:160] for node in rule["nodes"][:3]] for rule in found["violations"]
        }


def test_the_keyboard_reaches_everything(visit, report):
    with visit(report) as seen:
        unfolded(seen.page)
        wanted = seen.page.evaluate(
            """selector => [...document.querySelectorAll(selector)]
              .filter(one => one.checkVisibility() && !one.disabled && !(one.type === 'radio' && !one.checked))
              .map((one, i) => (one.dataset.tested = i, i))""",
            REACHABLE,
        )
        reached = set()
        for _ in range(2 * len(wanted) + 20):
            seen.page.keyboard.press("Tab")
            reached.add(seen.page.evaluate("document.activeElement.dataset.tested ?? null"))
        assert {str(i) for i in wanted} <= reached
        assert wanted


def test_a_name_without_end_moves_nothing_sideways(visit, run, tmp_path):
    """A note of the report of two runs names their shapes in full."""
    for i in range(2):
        path = shutil.copytree(run, tmp_path / f"{i}{'x' * 100}")
        summary = json.loads((path / "summary.json").read_text())
        (path / "summary.json").write_text(json.dumps(summary | {"shape": str(i) + "x" * 200}))
    out = tmp_path / "report.html"
    command = [sys.executable, "-m", "swarmer", "report", *map(str, tmp_path.iterdir()), "--out", str(out)]
    subprocess.run(command, check=True, capture_output=True, timeout=100)
    with visit(out.as_uri(), viewport=PHONE) as seen:
        assert seen.page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]


def test_on_a_phone_nothing_moves_sideways(visit, report):
    with visit(report, viewport=PHONE, is_mobile=True, has_touch=True, device_scale_factor=2) as seen:
        unfolded(seen.page)
        assert seen.page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
        assert seen.page.evaluate("window.innerWidth") == PHONE["width"]  # nothing made the page zoom out
