import io
import shutil

import click
import pytest
from click.testing import CliRunner

from swarmer.commands.replay import command
from swarmer.errors import BadInput, RunFailed
from swarmer.observe import viewer
from swarmer.observe.saved_run import load
from swarmer.observe.terminal_player import play


def replay(*args):
    return CliRunner().invoke(command, list(map(str, args)), standalone_mode=False, catch_exceptions=False)


def test_piped_terminal_replay_is_a_few_pictures_without_codes(finished_run):
    text = replay(finished_run, "--terminal").output
    assert text.count("40/40 lit") == 4
    assert "\x1b" not in text
    assert max(map(len, text.splitlines())) < 80


def test_playing_ends_and_gives_the_terminal_back(finished_run):
    out, now = io.StringIO(), [0.0]
    play(
        load(finished_run).timeline,
        out,
        2.0,
        80,
        24,
        lambda: now[0],
        lambda s: now.__setitem__(0, now[0] + s),
    )
    assert 4.0 <= now[0] <= 6.0  # 8 s at twice the speed, and a moment to look
    assert out.getvalue().endswith("\x1b[?25h\x1b[?1049l")
    frames = out.getvalue().split("\x1b[H")[1:]
    assert {frame.count("\n") for frame in frames} == {23}


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
    for line in (viewer.web_command((tmp_path,), 1, 2), viewer.native_command((tmp_path,), 1)):
        assert line[line.index("--bind") + 1] == "127.0.0.1"


def test_partial_recording_gets_a_name_the_viewer_takes(tmp_path):
    partial = tmp_path / "recording.rrd.partial"
    partial.write_bytes(b"x")
    with viewer.playable(partial) as file:
        assert (file.suffix, file.read_bytes()) == (".rrd", b"x")
    assert not file.exists()
    assert partial.exists()
