"""The pages tell the truth about the code, as far as a program can check it."""

import json
import os
import re
import subprocess
import sys
from importlib import util
from pathlib import Path

import numpy as np
import pytest

from swarmer.cli import COMMANDS, load
from swarmer.config import setting_facts
from swarmer.engines.result import RunResult
from swarmer.observe.progress import Progress
from swarmer.observe.summary import make_summary
from swarmer.shapes.catalogue import CATALOGUE

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
PAGES = [*sorted(DOCS.rglob("*.md")), ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md"]
FILE = re.compile(r"`((?:[\w-]+/)*[\w-]+\.(?:py|yaml|toml|xyz|cff))`")
NOT_SETTINGS = {"py", "rrd", "fate", "heard", "csv"}  # a file, or a function of radio.py
BETWEEN_TICKS = re.compile(r"`([a-z_]+\.[a-z_]+)(?:: [^`]*)?`")


def named(path):
    return path.relative_to(ROOT).as_posix()


def drawing():
    spec = util.spec_from_file_location("protocol_table", DOCS / "protocol_table.py")
    module = util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_every_file_that_a_page_names_is_there(page):
    """As a path from the checkout, from the package, or beside the file named before it in brackets."""
    here = {path.name for path in ROOT.glob("swarmer/**/*.py")} | {"config.yaml", "experiment.yaml"}
    for name in FILE.findall(page.read_text("utf-8")):
        there = (ROOT / name).exists() or (ROOT / "swarmer" / name).exists()
        assert there or ("/" not in name and name in here) or "NAME" in name, name


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_every_setting_that_a_page_names_is_one(page):
    facts = {setting.name for setting in setting_facts()}
    groups = {name.partition(".")[0] for name in facts if "." in name}
    for name in BETWEEN_TICKS.findall(page.read_text("utf-8")):
        group, _, field = name.partition(".")
        if group in groups and field not in NOT_SETTINGS:
            assert name in facts


def test_the_table_on_the_page_is_described():
    table = drawing()
    assert sorted(table.named()) == sorted(table.WORDS), "WORDS of docs/protocol_table.py"
    for numbers, words in table.WORDS.values():
        assert words.endswith((".", ")"))
        assert all(1 <= int(number) <= 15 for number in numbers.split(","))
    page = (DOCS / "protocol.md").read_text("utf-8")
    assert all(f"**{number}. " in page for number in range(1, 16))


def test_the_picture_has_a_way_for_every_transition():
    table = drawing()
    assert set(table.transitions()) == set(table.WAYS)
    assert table.picture_svg().count("<line") == len(table.WAYS)


def test_the_table_is_whole():
    table = drawing()
    html = table.table_html()
    rules = sum(len(row) for row in table.TABLE.values())
    assert html.count("<a href=") == rules
    assert all(f'id="{name}"' in table.rules_html() for name in table.named())


def test_the_readme_says_what_is_not_there():
    text = (ROOT / "README.md").read_text("utf-8")
    missing = text[text.index("## What is here") : text.index("## More")]
    for name in CATALOGUE:
        assert f"`{name}`" in missing, f"{name} is in the catalogue: README says so"
    for engine in next(setting.words for setting in setting_facts() if setting.name == "engine"):
        assert f"`{engine}`" in missing, f"{engine} is an engine: README says so"


def test_the_readme_does_not_miss_what_is_there():
    text = (ROOT / "README.md").read_text("utf-8")
    not_yet = text[text.index("- **Not yet**") : text.index("## More")]
    options = {option for name in COMMANDS for one in load(name).params for option in one.opts}
    named = set(re.findall(r"`([\w-]+)`", not_yet))
    assert named
    assert not named & ({*COMMANDS} | options)


def test_the_page_on_reading_a_run_says_what_is_unfaithful_with_either_engine():
    page = (DOCS / "reading-a-run.md").read_text("utf-8")
    trusted = " ".join(page[page.index("## First") : page.index("## Then")].split())
    assert "the machine was too slow" in trusted
    assert "FLSs themselves were given more than they could handle" in trusted


def test_every_name_of_the_summary_is_explained():
    summary = make_summary(
        Progress.of(np.zeros((2, 3)) + [[0], [2]]), RunResult("process", "done", 1.0, 1.0), "cube", 2, 1
    )
    page = (DOCS / "reading-a-run.md").read_text("utf-8")
    plain = {"format", "engine", "shape", "points", "seed"}  # say what they are
    missing = [name for name in summary if name not in plain and f"`{name}`" not in page]
    assert not missing, json.dumps(missing)


@pytest.mark.slow
def test_the_pages_build(tmp_path):
    pytest.importorskip("mkdocs")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", tmp_path / "site"],
        cwd=ROOT, capture_output=True, text=True, timeout=110, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "class Damped" in re.sub("<[^>]*>", "", (tmp_path / "site" / "plugins.html").read_text("utf-8"))
    pages = {path.name: path.read_text("utf-8") for path in (tmp_path / "site").glob("*.html")}
    pictures = {"protocol.html": 1, "in-pictures.html": 4, "five-runs.html": 15}
    for name, count in pictures.items():
        assert len(re.findall("<svg viewBox=.{0,80}role=", pages[name])) == count, name
    for name, page in pages.items():
        assert not re.search("<!-- (?:protocol|explained|five|file|gallery|invariants)", page), name
