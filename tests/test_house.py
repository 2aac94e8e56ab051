"""The house rules that a reader of a change should not have to check by eye."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
LINES_MAX = 450
ROOMS = ("swarmer", "scripts", "tests", "docs")
SOURCES = sorted(path for room in ROOMS for path in (ROOT / room).rglob("*.py"))
TEXTS = sorted(
    path
    for room in (*ROOMS, "configs", ".ci")
    for path in (ROOT / room).rglob("*")
    if path.suffix in (".py", ".md", ".yaml", ".yml", ".toml", ".cff", ".txt", ".sh", "") and path.is_file()
) + sorted(
    path for path in ROOT.iterdir() if path.suffix in (".md", ".toml", ".yml", ".yaml", ".txt", ".cff")
)
TEXTS = [path for path in TEXTS if "__pycache__" not in path.parts]
MACHINE_PATH = re.compile(r"(?<![\w.~])/(?:home|root|Users|work|mnt|media|opt|srv)/\w")
HOSTED = re.compile(
    r"https?://(?!localhost|127\.0\.0\.1|arxiv\.org|doi\.org|www\.w3\.org)[\w.-]+", re.IGNORECASE
)


def named(path):
    return path.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("path", SOURCES, ids=named)
def test_a_file_has_one_subject(path):
    count = len(path.read_text("utf-8").splitlines())
    limit = 2 * LINES_MAX if named(path).startswith("tests/") else LINES_MAX
    assert count <= limit, f"{count} lines; past {limit} a file has two subjects"


@pytest.mark.parametrize("path", [path for path in SOURCES if named(path).startswith("swarmer/")], ids=named)
def test_a_module_says_what_it_is(path):
    assert re.match(r'(#!.*\n)?r?"""\S|$', path.read_text("utf-8")), "no docstring at its top"


@pytest.mark.parametrize("path", TEXTS, ids=named)
def test_a_text_names_no_machine(path):
    if path == Path(__file__).resolve():
        return
    text = path.read_text("utf-8")
    assert not MACHINE_PATH.findall(text)
    assert not HOSTED.findall(text), "an address that the project does not need"
    assert "\r" not in text
    assert not re.search(r"[ \t]\n", text), "space at the end of a line"


def test_imports_point_one_way():
    tool = shutil.which("lint-imports", path=Path(sys.executable).parent)
    assert tool, "import-linter is missing: pip install -e .[dev]"
    done = subprocess.run([tool, "--no-logo"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_every_pin_is_a_plain_version():
    for line in (ROOT / "constraints.txt").read_text("utf-8").splitlines():
        assert line.startswith("#") or re.fullmatch(r"[\w.-]+==[\w.]+", line), line


def test_the_pins_cover_what_is_asked_for():
    asked = set(re.findall(r'"([\w-]+)>=', (ROOT / "pyproject.toml").read_text("utf-8"))) - {"hatchling"}
    pinned = set(re.findall(r"(?m)^([\w.-]+)==", (ROOT / "constraints.txt").read_text("utf-8")))
    assert {name.lower().replace("_", "-") for name in asked} <= {
        name.lower().replace("_", "-") for name in pinned
    }
