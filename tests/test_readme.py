"""Every command that README.md and the guide show is run, shortened, as a shell runs it, in a folder of its own."""

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
BLOCK = re.compile(r"^```sh\n(.*?)^```", re.MULTILINE | re.DOTALL)
PAGES = (
    "README.md",
    "docs/tour.md",
    "docs/getting-started.md",
    "docs/reading-a-report.md",
    "docs/sweeps.md",
    "docs/compare.md",
)
# The last one counts, so these shorten whatever the page says.
SHORTER = " --points 12 --duration 1.5 --time-scale 1"
SHORTER_SWEEP = " --seeds 2 --set points=12 --set duration_s=1.5"
WAIT_S = 60


def commands(page):
    """Every line of the page's shell blocks, in order."""
    text = (ROOT / page).read_text("utf-8")
    return [line for block in BLOCK.findall(text) for line in block.splitlines() if line.strip()]


def shell(command, place, **more):
    """Run it in `place`, with the commands of this Python first on the path, and without a display."""
    environment = {
        name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")
    }
    environment["PATH"] = f"{place / 'bin'}{os.pathsep}{environment.get('PATH', '')}"
    return subprocess.Popen(
        command, shell=True, cwd=place, env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        start_new_session=True, **more,
    )  # fmt: skip


def finished(command, place, statuses=(0,)):
    """Its output, once it has ended well."""
    with shell(command, place) as process:
        try:
            out, err = process.communicate(timeout=WAIT_S)
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
    assert process.returncode in statuses, f"{command}\n{out}{err}"
    assert "Traceback" not in err
    return out, err


def served(command, place):
    """A page is served until Ctrl-C: see it come, and end it."""
    with shell(command, place) as process:
        try:
            line = process.stdout.readline()
            assert line.startswith("open http://127.0.0.1:"), process.stderr.read()
        finally:
            os.killpg(process.pid, signal.SIGTERM)
            process.communicate(timeout=WAIT_S)


def refused_without_display(command, place):
    """The desktop viewer needs a display, and says what does not."""
    with shell(command, place) as process:
        _, err = process.communicate(timeout=WAIT_S)
    assert process.returncode == 1
    assert "--web" in err
    assert "--terminal" in err


def check(command, place):
    """Run one command of a page, as far as that goes without a screen."""
    if command.startswith("make "):
        subprocess.run(["make", "-n", *command.split()[1:]], cwd=ROOT, check=True, capture_output=True)
    elif command.startswith("swarmer replay --again"):
        out, _ = finished(command, place)
        assert out.startswith("the same run: ")
    elif command.startswith("swarmer replay") and "--web" in command:
        served(command, place)
    elif command.startswith("swarmer replay") and "--terminal" not in command:
        refused_without_display(command, place)
    elif command.startswith(("swarmer sweep", "swarmer compare")):
        out, _ = finished(command + SHORTER_SWEEP, place)
        assert "--dry-run" in command or (place / out.splitlines()[-1] / "results.csv").is_file()
    elif command.startswith("swarmer doctor"):
        # 1: this machine could not carry the dragon, which is an answer, too.
        finished(command, place, statuses=(0, 1))
    elif command.startswith("swarmer-run"):
        points = SHORTER if "helix" not in command else SHORTER.replace("--points 12", "--points 20")
        if "--engine virtual" in command:  # which has a time of its own
            points = points.replace("--time-scale 1", "")
        out, err = finished(command + points, place)
        assert (place / out.splitlines()[-1] / "summary.json").is_file()
        assert "done: " in err
    else:
        finished(command, place)


@pytest.fixture
def place(tmp_path):
    """A folder whose `bin` has this environment's commands."""
    (tmp_path / "bin").mkdir()
    for name in ("swarmer", "swarmer-run"):
        script = tmp_path / "bin" / name
        call = "main_run" if name == "swarmer-run" else "main"
        script.write_text(
            f"#!{sys.executable}\nimport sys\nfrom swarmer import cli\n"
            f"if __name__ == '__main__':\n    sys.argv[0] = {name!r}\n    cli.{call}()\n"
        )
        script.chmod(0o755)
    (tmp_path / "bin" / "python").symlink_to(sys.executable)
    return tmp_path


@pytest.mark.processes
@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize("page", PAGES)
def test_every_command_of_a_page_works(page, place):
    for command in commands(page):
        check(command, place)
    shutil.rmtree(place / "runs")  # nothing else was left behind but what a command names
    assert {path.name for path in place.iterdir()} <= {"bin", "helix.xyz", "half.xyz", "report.html"}


@pytest.mark.parametrize("page", PAGES)
def test_a_page_shows_commands_that_are_checked(page):
    """A command in a block of another kind would not be run."""
    assert len(commands(page)) >= 3
    text = BLOCK.sub("", (ROOT / page).read_text("utf-8"))
    for block in re.findall(r"^```(?:bash|shell|console)?\n", text, re.MULTILINE):
        assert block == "```\n"
    assert not re.findall(r"^    (?:swarmer|make|\$) ", text, re.MULTILINE)


def test_the_make_targets_of_the_house_are_there():
    for target in ("run", "test", "bench", "soak", "lint", "docs", "clean"):
        done = subprocess.run(["make", "-n", target], cwd=ROOT, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr


def test_every_link_of_the_readme_leads_somewhere():
    text = (ROOT / "README.md").read_text("utf-8")
    for target in re.findall(r"\]\(([^)#]+)", text):
        assert target.startswith("https://arxiv.org/") or (ROOT / target).exists(), target


def test_the_figures_stand_in_one_place():
    text = (ROOT / "README.md").read_text("utf-8")
    assert text.count("<!-- figures: begin") == text.count("<!-- figures: end") == 1
