"""The page about shapes of one's own: its commands are run, and what it shows is what they print, numbers apart."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "own-shapes.md").read_text("utf-8")
NUMBER = re.compile(r"[\d.]+")
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    """What each command of the page printed, in its order; runs are other tests' business."""
    place = tmp_path_factory.mktemp("page")
    (place / "bin").mkdir()
    for name, words in {"python": "", "swarmer": "-m swarmer.cli"}.items():
        (place / "bin" / name).write_text(f"#!/bin/sh\nexec '{sys.executable}' {words} \"$@\"\n")
        (place / "bin" / name).chmod(0o755)
    lines = [line for kind, block in BLOCK.findall(PAGE) if kind == "sh" for line in block.splitlines()]
    found = {}
    for line in lines:
        if line.startswith("swarmer-run"):
            continue
        done = subprocess.run(
            f"PATH={place}/bin:$PATH; {line}",
            shell=True,
            cwd=place,
            capture_output=True,
            text=True,
            timeout=100,
        )
        assert done.returncode == 0, f"{line}\n{done.stderr}"
        found[line] = done.stdout
    return found


@pytest.mark.slow
@pytest.mark.parametrize("command", ["swarmer shapes make ring.stl", "swarmer shapes check skateboard"])
def test_what_the_page_shows_is_printed(printed, command):
    shown = next(
        block for kind, block in BLOCK.findall(PAGE)
        if kind == "text" and ("ring.stl" in block) == ("ring.stl" in command)
    )  # fmt: skip
    text = next(out for line, out in printed.items() if line.startswith(command))
    for told, expected in zip(text.splitlines(), shown.splitlines(), strict=True):
        if told.split()[0] not in ("memory", "time", "next"):  # the machine's own
            assert NUMBER.sub("#", told) == NUMBER.sub("#", expected)


@pytest.mark.slow
def test_every_command_of_the_page_ends_well(printed):
    assert len(printed) >= 9
    assert "400 points" in printed["swarmer shapes make word.png --points 400 --box 120x60"]
