"""`swarmer replay --again`: a run in virtual time is the same once more, or one line says why not."""

import json
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner

from swarmer.cli import load
from swarmer.commands import run as run_command
from swarmer.commands.again import run_again
from swarmer.config import load_config
from swarmer.errors import BadInput, RunFailed


@pytest.fixture(scope="module", autouse=True)
def ctrl_c_as_before():
    """A run in this process ignores Ctrl-C in the end, since a command is over then; pytest is not."""
    before = signal.getsignal(signal.SIGINT)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A run directory of a small rough run, by the command."""
    path = tmp_path_factory.mktemp("again") / "run"
    options = ["--shape", "sphere", "--points", "12", "--duration", "4", "--set", "radio.loss=0.1"]
    done = CliRunner().invoke(
        load("run"),
        ["--engine", "virtual", *options, "--no-recording", "--out", str(path)],
        standalone_mode=False,
    )
    assert done.exception is None, done.output
    return path


@pytest.fixture
def run(made, tmp_path):
    """A copy that a test may spoil."""
    copy = tmp_path / "run"
    copy.mkdir()
    for file in made.iterdir():
        (copy / file.name).write_bytes(file.read_bytes())
    return copy


def spoil(path: Path, **changes):
    data = json.loads(path.read_text())
    path.write_text(json.dumps(data | changes))


def test_it_is_the_same_in_another_process_and_directory(run, tmp_path):
    code = "from swarmer import cli; cli.main()"
    done = subprocess.run(
        [sys.executable, "-c", code, "replay", "--again", str(run)],
        cwd=tmp_path, env={"PYTHONHASHSEED": "7"}, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert json.loads((run / "summary.json").read_text())["trace_sha256"] in done.stdout
    assert {path.name for path in tmp_path.iterdir()} == {"run"}


def test_another_trace_is_a_failure_that_shows_both(run):
    spoil(run / "summary.json", trace_sha256="0" * 64)
    with pytest.raises(RunFailed, match=r"then .* trace 0000.* now .* events"):
        run_again(run)


def test_changed_settings_are_named_with_what_they_were(run):
    settings = yaml.safe_load((run / "config.yaml").read_text())
    settings["seed"] = 9
    settings["radio"]["loss"] = 0
    (run / "config.yaml").write_text(yaml.safe_dump(settings))
    with pytest.raises(BadInput, match=r"radio.loss was 0.1, is the default, seed was the default, is 9"):
        run_again(run)


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"engine": "process"}, "process is never twice the same"),
        ({"engine": "rounds"}, "rounds has no events to compare"),
        ({"status": "interrupted"}, "came to its end"),
        ({"format": 99}, "this one's is 99"),
        ({"status": None}, "came to its end; of this one nobody knows"),
        ({"format": None}, "this one's is not known"),
        ({"trace_sha256": None}, "nothing to compare with: its summary.json has no events and trace_sha256"),
        ({"events": None}, "nothing to compare with"),
    ],
)
def test_what_cannot_be_repeated_is_refused(run, changes, line):
    spoil(run / "summary.json", **changes)
    with pytest.raises(BadInput, match=line):
        run_again(run)


def test_a_manifest_of_another_format_is_refused(run):
    for version in (2, None):
        spoil(run / "manifest.json", format=version)
        with pytest.raises(BadInput, match=f"manifest.json of format 1; this one's is {version}"):
            run_again(run)


def test_a_run_without_a_summary_is_refused(run):
    (run / "summary.json").unlink()
    with pytest.raises(BadInput, match="no summary"):
        run_again(run)


def test_another_count_of_events_is_a_failure(run):
    events = json.loads((run / "summary.json").read_text())["events"]
    spoil(run / "summary.json", events=events + 1)
    with pytest.raises(RunFailed, match=f"then {events + 1:,} events, .* now {events:,} events"):
        run_again(run)


def test_a_failure_names_what_is_not_as_it_was(run):
    spoil(run / "summary.json", trace_sha256="0" * 64)
    spoil(run / "manifest.json", python="3.9.1", libraries={"numpy": "1.0", "rich": "0.1"})
    with pytest.raises(RunFailed) as failed:
        run_again(run)
    assert re.search(
        r"; since then python was 3.9.1, is 3\.\d+\.\d+, numpy was 1.0, is [\d.]+$", str(failed.value)
    )


def test_without_a_manifest_it_is_said_what_is_not_known(run, capsys):
    (run / "manifest.json").unlink()
    run_again(run)
    told = capsys.readouterr()
    assert "the same run" in told.out
    assert "cannot tell whether settings and versions are as they were" in told.err
    assert "None" not in told.err


def test_without_settings_it_is_refused(run):
    (run / "config.yaml").unlink()
    with pytest.raises(BadInput, match=r"its settings are not known: it has no config\.yaml"):
        run_again(run)


def test_another_version_is_said(run, capsys):
    spoil(run / "manifest.json", swarmer="0.0.9")
    run_again(run)
    assert "0.0.9" in capsys.readouterr().err


@pytest.fixture
def helix_run(tmp_path, monkeypatch):
    """A run of a file that was named from where it lies, and that file."""
    place = tmp_path / "clouds"
    place.mkdir()
    monkeypatch.chdir(place)
    file = place / "helix.xyz"
    file.write_text("".join(f"{i % 5 * 2} {i // 5 * 2} {i % 3}\n" for i in range(20)))
    settings = load_config(
        None, ["engine=virtual", "duration_s=1", "recording.enabled=false"], shape="helix.xyz"
    )
    assert run_command.run(settings, tmp_path / "run", live=None, as_json=False) == 0
    monkeypatch.chdir("/")
    return tmp_path / "run", file


def test_a_file_is_found_again_from_every_directory(helix_run, capsys):
    run, file = helix_run
    run_again(run)
    assert "the same run" in capsys.readouterr().out
    settings = load_config(str(run / "config.yaml"))
    assert settings.shape == str(file)
    assert run_command.run(settings, run.parent / "anew", None, False, str(run / "config.yaml")) == 0
    assert "note" not in capsys.readouterr().err


def test_a_file_with_other_points_is_told(helix_run, capsys):
    run, file = helix_run
    file.write_text(file.read_text().replace("8 6 1", "8 6 1.5"))
    with pytest.raises(BadInput, match=r"its shape as it was: .*helix.xyz has other points by now"):
        run_again(run)
    source = str(run / "config.yaml")
    assert run_command.run(load_config(source), run.parent / "anew", None, False, source) == 0
    told = capsys.readouterr().err
    assert f"note: not the shape of the run in {run}: {file} has other points by now" in told
    assert run_command.run(load_config(source, ["seed=7"]), run.parent / "other", None, False, source) == 0
    assert "note" not in capsys.readouterr().err  # other settings may have other points


def test_a_file_that_is_gone_is_told(helix_run):
    run, file = helix_run
    file.unlink()
    with pytest.raises(BadInput, match=r"helix.xyz.*: no such file"):
        run_again(run)


def test_an_older_manifest_proves_nothing(helix_run, capsys):
    run, file = helix_run
    manifest = json.loads((run / "manifest.json").read_text())
    del manifest["points_sha256"]
    (run / "manifest.json").write_text(json.dumps(manifest))
    file.write_text(file.read_text().replace("8 6 1", "8 6 1.5"))
    with pytest.raises(RunFailed, match="not the same run"):
        run_again(run)
