import json
import os
import shutil
import signal
import subprocess
import sys
import time

import click
import pytest
from click.testing import CliRunner

from swarmer.commands.replay import command
from swarmer.errors import BadInput, RunFailed
from swarmer.observe import viewer


def replay(*args):
    return CliRunner().invoke(command, list(map(str, args)), standalone_mode=False, catch_exceptions=False)


def test_piped_terminal_replay_is_a_few_pictures_without_codes(finished_run):
    text = replay(finished_run, "--terminal").output
    assert text.count("40/40 lit") == 4
    assert "\x1b" not in text
    assert max(map(len, text.splitlines())) < 80


def test_missing_or_foreign_directories_are_bad_input(tmp_path):
    (tmp_path / "empty").mkdir()
    for path, way in (
        (tmp_path / "none", "--terminal"),
        (tmp_path / "empty", "--web"),
        (tmp_path / "empty", "--terminal"),
    ):
        with pytest.raises(BadInput, match="run"):
            replay(path, way)


def test_run_without_recording_points_to_the_terminal(finished_run, tmp_path):
    run = shutil.copytree(finished_run, tmp_path / "run")
    (run / "recording.rrd").unlink()
    with pytest.raises(BadInput, match="--terminal"):
        replay(run, "--web")


def test_without_a_display_it_says_what_to_use(finished_run, monkeypatch):
    monkeypatch.setattr(viewer, "display_available", lambda: False)
    with pytest.raises(RunFailed, match=r"--web.*--terminal"):
        replay(finished_run)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--again", "--speed", "3"], "--speed is of --terminal"),
        (["--again", "--port", "9000"], "--port is of --web"),
        (["--web", "--speed", "1"], "--speed is of --terminal"),
        (["--terminal", "--port", "9090"], "--port is of --web"),
        (["--speed", "2"], "--speed is of --terminal"),
    ],
)
def test_options_that_would_do_nothing_are_refused(finished_run, options, says):
    with pytest.raises(click.UsageError, match=says):
        replay(finished_run, *options)


def test_viewers_listen_on_this_machine_only(tmp_path):
    line = viewer.native_command((tmp_path,), 1)
    assert line[line.index("--bind") + 1] == "127.0.0.1"


@pytest.mark.parametrize(("cores", "threads"), [(1, 4), (2, 4), (16, 14), (None, 4)])
def test_a_window_is_not_kept_closed_by_who_reads_its_input(monkeypatch, cores, threads):
    """On a machine of few cores rerun has one thread of that kind, which reads until the run has ended."""
    monkeypatch.setattr(os, "cpu_count", lambda: cores)
    line = viewer.native_command((viewer.STDIN,), 1)
    assert line[line.index("--threads") + 1] == str(threads)


def test_a_run_of_a_later_format_is_shown_as_far_as_it_is_known(finished_run, tmp_path):
    for name in ("manifest.json", "summary.json"):
        run = shutil.copytree(finished_run, tmp_path / name)
        data = json.loads((run / name).read_text())
        (run / name).write_text(json.dumps({**data, "format": 2}))
        played = replay(run, "--terminal")
        assert f"note: {name}: format 2, newer than 1" in played.stderr
        assert "40/40 lit" in played.stdout


@pytest.mark.parametrize("left", [["timeline.npz"], ["timeline.npz", "events.csv"]])
def test_of_an_incomplete_run_what_is_there_is_played(finished_run, tmp_path, left):
    run = tmp_path / "run"
    run.mkdir()
    for name in left:
        shutil.copy(finished_run / name, run)
    assert "40/40 lit" in replay(run, "--terminal").output
    with pytest.raises(BadInput, match=r"no recording.*; try --terminal"):
        replay(run, "--web")


def test_where_nothing_can_be_played_nothing_is_promised(finished_run, tmp_path):
    shutil.copy(finished_run / "summary.json", tmp_path)
    for way in ("--web", "--terminal"):
        with pytest.raises(BadInput, match="nor anything else"):
            replay(tmp_path, way)


def test_the_desktop_viewer_ends_with_the_command(finished_run, tmp_path):
    """A viewer that stays open until it is ended, and takes its time; SIGTERM to the command ends it, too."""
    viewer = tmp_path / "viewer.py"
    viewer.write_text(
        "import pathlib, os, sys, time\n"
        "assert sys.argv[1:3] == ['--bind', '127.0.0.1'] and sys.argv[-1].endswith('recording.rrd'), sys.argv\n"
        f"pathlib.Path({str(tmp_path / 'pid')!r} + '-').write_text(str(os.getpid()))\n"
        f"os.rename({str(tmp_path / 'pid')!r} + '-', {str(tmp_path / 'pid')!r})\n"
        "time.sleep(60)\n"
    )
    code = (
        "import sys; from swarmer.observe import viewer; from swarmer import cli\n"
        f"viewer.rerun_command = lambda: [sys.executable, {str(viewer)!r}]\n"
        f"sys.argv = ['swarmer', 'replay', {str(finished_run)!r}]; cli.main()"
    )
    for number, status in ((signal.SIGTERM, 143), (signal.SIGINT, 130), (signal.SIGKILL, -signal.SIGKILL)):
        with subprocess.Popen(
            [sys.executable, "-c", code],
            env={**os.environ, "DISPLAY": ":99", "TMPDIR": str(tmp_path)},
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        ) as process:  # fmt: skip
            wait_for(lambda: (tmp_path / "pid").exists() or process.poll() is not None)
            process.send_signal(number)
            _, err = process.communicate(timeout=60)
        assert (process.returncode, "Traceback" in err) == (status, False), err
        pid = int((tmp_path / "pid").read_text())
        (tmp_path / "pid").unlink()
        wait_for(lambda: not alive(pid))  # noqa: B023 -- called at once


def wait_for(condition):
    end = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True
