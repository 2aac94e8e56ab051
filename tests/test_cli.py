"""The command line: help without weight, errors of one line, exit statuses."""

import errno
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import click
import pytest

from swarmer import __version__, cli
from swarmer.config import setting_facts
from swarmer.errors import BadInput, RunFailed
from swarmer.settings import as_yaml

HEAVY = ["matplotlib", "numpy", "pydantic", "rerun", "scipy", "trimesh"]
NOT_SETTINGS = {
    "set",
    "config",
    "out",
    "live",
    "no-recording",
    "check",
    "trace",
    "trace-fids",
    "json",
    "version",
    "help",
    "dedupe",
}
UNITS = ("ms", "s", "deg", "cells")


def swarmer(*arguments, program="main", **more):
    """Run a command in a process of its own, whatever the environment has on its path."""
    code = f"import sys; from swarmer import cli; sys.argv[0] = 'swarmer'; cli.{program}()"
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "timeout": 60} | more,
    )


def loaded_by(code):
    """Which heavy libraries a piece of code imports."""
    probe = f"import sys, contextlib, io\nwith contextlib.redirect_stdout(io.StringIO()):\n  {code}\n"
    probe += f"print(*sorted(set({HEAVY}) & sys.modules.keys()))"
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_the_list_of_commands():
    done = swarmer("--help")
    assert done.returncode == 0
    for name, lazy in cli.COMMANDS.items():
        assert re.search(rf"^  {name} +{re.escape(lazy.help)}$", done.stdout, re.MULTILINE)
    assert swarmer("-h").stdout == done.stdout


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_every_command_has_help_and_version(name):
    done = swarmer(name, "--help")
    assert done.returncode == 0, done.stderr
    assert swarmer(name, "-h").stdout == done.stdout
    assert swarmer(name, "--version").stdout == f"swarmer {__version__}\n"
    command = cli.load(name)
    assert command.help
    for parameter in command.params:
        assert isinstance(parameter, click.Argument) or getattr(parameter, "help", None), parameter.name


@pytest.mark.parametrize("code", ["from swarmer import cli; cli.load('run')", "import swarmer.fls_process"])
def test_what_starts_often_loads_nothing_heavy(code):
    assert loaded_by(code) == []


@pytest.mark.parametrize("name", ["swarmer", *cli.COMMANDS])
def test_help_loads_nothing_heavy(name):
    command = "cli.swarmer" if name == "swarmer" else f"cli.load({name!r})"
    assert loaded_by(f"from swarmer import cli; {command}.main(['--help'], standalone_mode=False)") == []


def test_help_of_run_is_quick():
    """0.3 s is what a user may wait; what counts here is processor time, so that a busy machine is no failure."""
    code = "from swarmer import cli; cli.load('run').main(['--help'], standalone_mode=False)"
    best = min(cpu_seconds(code) for _ in range(5))
    assert best < 0.3


def cpu_seconds(code):
    before = os.times()
    subprocess.run([sys.executable, "-c", code], stdout=subprocess.DEVNULL, check=True)
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system


def setting_of(option):
    """The setting that an option of `run` stands for: --lambda is lambda_ms, --rounds is rounds.max_rounds."""
    name = option.removeprefix("--").replace("-", "_")
    facts = {fact.name: fact for fact in setting_facts()}
    name = {"then": "transition.shape", "at": "transition.at"}.get(name, name)
    names = [name, *(f"{name}_{unit}" for unit in UNITS), f"{name}.max_{name}"]
    return next((facts[one] for one in names if one in facts), None)


def test_the_options_of_run_say_the_defaults_of_the_settings():
    command = cli.load("run")
    shown = 0
    for parameter in command.params:
        option = next(opt for opt in parameter.opts if opt.startswith("--"))
        if option.removeprefix("--") in NOT_SETTINGS:
            continue
        setting = setting_of(option)
        assert setting is not None, f"{option} is no setting; name it in NOT_SETTINGS if it should be none"
        if isinstance(parameter.default, str | int | float):
            assert setting.checked(parameter.default) == setting.default
        said = re.search(r"[(\[;]\s*default:? ([^)\];,]+)", parameter.help or "")
        if said and setting.default is not None:
            assert said.group(1).split()[0] == as_yaml(setting.default), option
            shown += 1
    assert shown >= 4


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["nope"], "error: no command 'nope'; see `swarmer --help`"),
        (["reporte"], "error: no command 'reporte'; did you mean 'report'?; see `swarmer --help`"),
        (["--nope"], "error: No such option '--nope'; see `swarmer --help`"),
    ],
)
def test_a_wrong_command_line_ends_with_one_line_and_2(arguments, line):
    done = swarmer(*arguments)
    assert (done.returncode, done.stdout, done.stderr) == (2, "", f"{line}\n")


def test_a_wrong_option_of_run_ends_with_one_line_and_2():
    done = swarmer("--nope", program="main_run")
    assert done.returncode == 2
    assert done.stderr.startswith("error: No such option '--nope'")
    assert done.stderr.count("\n") == 1


def test_a_wrong_setting_ends_with_one_line_and_2(tmp_path):
    done = swarmer("--set", "lease_ms=-5", "--out", str(tmp_path / "run"), program="main_run", cwd=tmp_path)
    assert done.stderr == "error: lease_ms: -5 is out of range; milliseconds, 1 to 60000 (default 250)\n"
    assert done.returncode == 2
    assert list(tmp_path.iterdir()) == []


def test_a_directory_that_is_taken_is_refused_before_anything_is_planned(tmp_path):
    (tmp_path / "summary.json").write_text("{}")
    taken = ["--out", str(tmp_path)]
    for more in ([], ["--shape", str(tmp_path / "no such file.xyz")]):
        done = swarmer("--engine", "virtual", *taken, *more, program="main_run", cwd=tmp_path)
        assert (done.returncode, done.stdout) == (2, "")
        assert re.fullmatch(r"error: out: .*a finished run is there; .*\n", done.stderr)


def test_what_a_killed_run_left_is_replaced_and_that_is_said(tmp_path):
    out = tmp_path / "run"
    out.mkdir()
    (out / "events.csv.partial").write_text("t_s,kind,fid,text\n")
    small = [
        "--engine",
        "rounds",
        "--shape",
        "butterfly",
        "--points",
        "20",
        "--rounds",
        "3",
        "--no-recording",
    ]
    done = swarmer(*small, "--out", "run", program="main_run", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "note: run held what a run that was cut off had left; it is replaced\n" in done.stderr
    assert not (out / "events.csv.partial").exists()


def raising(error):
    def action():
        raise error

    return action


@pytest.mark.parametrize(("neighbours", "told"), [("nearest", True), ("connected", False)])
def test_a_shape_in_parts_that_never_meet_is_told_before_the_run(neighbours, told, tmp_path, capsys):
    from swarmer.commands.run import tell_plan
    from swarmer.config import load_config
    from swarmer.plan import make_plan

    parts = [(x + far, y, 0) for far in (0, 50) for x in (0, 2) for y in (0, 2)]
    cloud = tmp_path / "parts.xyz"
    cloud.write_text("\n".join(" ".join(map(str, point)) for point in parts))
    tell_plan(make_plan(load_config(None, (), shape=str(cloud), eta=2, neighbours=neighbours)))
    err = capsys.readouterr().err
    assert "2 components" in err
    assert ("may stay a swarm of its own" in err) == told
    assert ("joined by 1 link," in err) != told


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (BadInput("seed", "x", "a number"), 2, "error: seed: 'x' is not allowed; a number\n"),
        (RunFailed("too many FLSs died"), 1, "error: too many FLSs died\n"),
        (KeyboardInterrupt(), 130, "interrupted\n"),
        (click.Abort(), 130, "interrupted\n"),
        (click.BadParameter("no"), 2, "error: Invalid value: no\n"),
        (
            OSError(errno.ENOSPC, "No space left on device", "runs/x"),
            1,
            "error: runs/x: No space left on device\n",
        ),
    ],
)
def test_how_a_command_ends(error, status, line, capsys):
    with pytest.raises(SystemExit) as ended:
        cli.leave(raising(error))
    assert ended.value.code == status
    assert capsys.readouterr().err == line


@pytest.mark.parametrize("error", [ValueError("a bug"), BrokenPipeError(errno.EPIPE, "a pipe of the run")])
def test_a_bug_keeps_its_traceback(error, monkeypatch):
    with Path(os.devnull).open("w") as nowhere:
        monkeypatch.setattr(sys, "stdout", nowhere)
        with pytest.raises(type(error)):
            cli.leave(raising(error))


def test_the_status_that_a_command_returns_is_the_exit_status():
    for returned, status in ((None, 0), (0, 0), (1, 1), ("text", 0)):
        with pytest.raises(SystemExit) as ended:
            cli.leave(lambda returned=returned: returned)
        assert ended.value.code == status


def test_a_reader_that_has_seen_enough_is_no_error():
    code = "import click; from swarmer import cli\ncli.leave(lambda: [click.echo('x' * 999) for _ in range(9999)])"
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        process.stdout.readline()
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait(30) == 0


def test_an_output_that_is_full_is_named():
    with open("/dev/full", "w") as full:
        done = swarmer("shapes", stdout=full)
    assert (done.returncode, done.stderr) == (1, "error: stdout: No space left on device\n")


def test_interrupted_says_so_and_ends_with_130():
    code = (
        "import signal, time; from swarmer import cli\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background is born deaf to it\n"
        "cli.leave(lambda: [print('go', flush=True), time.sleep(60)])"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        process.stdout.readline()
        started = time.monotonic()
        process.send_signal(signal.SIGINT)
        assert process.stderr.read() == b"interrupted\n"
        assert process.wait(30) == 130
    assert time.monotonic() - started < 30


def test_a_shell_can_complete():
    done = swarmer(env={**os.environ, "_SWARMER_COMPLETE": "bash_source"})
    assert "complete" in done.stdout


def test_the_end_of_a_command_does_not_search_through_what_is_left():
    """After a run whose FLSs were given far too much that took seconds, in which the command seemed to hang."""
    code = (
        "class Left:\n"
        "    def __init__(self): self.me = self\n"
        "    def __del__(self): print('searched')\n"
        "import gc, sys; gc.disable(); Left()\n"
        "from swarmer import cli; sys.argv[:] = ['swarmer', '--version']; {}\n"
    )
    for call, told in (("cli.main()", False), ("pass", True)):
        done = subprocess.run(
            [sys.executable, "-c", code.format(call)], capture_output=True, text=True, timeout=60, check=True
        )
        assert ("searched" in done.stdout) == told
