"""`swarmer explain`: from a symptom to its cause, in the words of docs/explain.md; and what it refuses."""

import errno
import gzip
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import zlib
from collections import Counter
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from swarmer.cli import load
from swarmer.errors import BadInput, RunFailed
from swarmer.observe import trace_file
from swarmer.observe.scenario import COMMANDS, first_difference, parse
from swarmer.observe.stage import play

SCENARIOS = Path(__file__).parent / "scenarios"
PAGE = Path(__file__).parents[1] / "docs" / "explain.md"
ID = re.compile(r"\[(\d+\.\d+#\d+)\]")


def run_command(name, *arguments):
    done = CliRunner().invoke(load(name), list(map(str, arguments)), standalone_mode=False)
    if done.exception is not None:
        raise done.exception
    return done


def explain(*arguments):
    return run_command("explain", *arguments).stdout.splitlines()


@pytest.fixture(scope="module", autouse=True)
def ctrl_c_as_before():
    """A run in this process ignores Ctrl-C in the end, since a command is over then; pytest is not."""
    before = signal.getsignal(signal.SIGINT)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A run with losses, failures and thaws, and its log."""
    path = tmp_path_factory.mktemp("explain") / "run"
    run_command(
        "run", "--engine", "virtual", "--shape", "sphere", "--points", "30", "--duration", "9", "--seed", "7",
        "--trace", "--set", "radio.loss=0.05", "--set", "failure.rate=0.01", "--set", "thaw.policy=timer",
        "--no-recording", "--out", path,
    )  # fmt: skip
    return path


@pytest.fixture
def run(made, tmp_path):
    """A copy that a test may spoil."""
    return Path(shutil.copytree(made, tmp_path / "run"))


def records(path):
    with gzip.open(path / "trace.jsonl.gz", "rt") as file:
        return [json.loads(line) for line in file]


def rewrite(path, lines):
    with gzip.open(path / "trace.jsonl.gz", "wt") as file:
        file.writelines(line if isinstance(line, str) else json.dumps(line) + "\n" for line in lines)


def test_the_story_of_an_fls(made):
    lines = explain(made, "--fls", 17, "--from", 0, "--to", 3)
    *story, left_out = lines
    assert re.fullmatch(r"[\d,]+ events without effect left out; --all tells them", left_out)
    line = re.compile(r" {4}[ \d]\d?\.\d{4} s  17  .{27}  (xi [\d.]+(->[\d.]+)? *|  ).*\S")
    times = [float(told.split()[0]) for told in story]
    assert all(line.fullmatch(told) for told in story), story
    assert times == sorted(times)
    assert times[-1] <= 3
    assert "landed: lit" in "\n".join(story)
    everything = explain(made, "--fls", 17, "--from", 0, "--to", 3, "--all")
    assert len(everything) == len(story) + int(left_out.split()[0].replace(",", ""))
    assert set(story) < set(everything)


def test_a_pairing_is_told_with_its_reason_and_what_came_of_it(made):
    story = "\n".join(explain(made, "--from", 0, "--to", 3))
    paired = re.search(
        r"^.* s +(\d+)  Available -> BusyLocalizing  xi (\d+)->(\d+) +(ACCEPT|ACK) from (\d+) \(xi \3\) "
        r"\[\5\.\d#\d+\], lower: \5 anchors; .*SET_WAITING\(l\) to swarm \2 \[\1\.0#\d+\].*; "
        r"FOLLOW_MERGE\(\3\) to swarm \2 \[\1\.0#\d+\].*; flies \d+\.\d\d cells, until [\d.]+ s$",
        story,
        re.MULTILINE,
    )
    assert paired
    assert int(paired[3]) < int(paired[2])


def test_a_window_of_all_flss_is_what_each_of_them_tells(made):
    together = explain(made, "--from", 2, "--to", 2.2, "--all")
    apart = [
        line
        for fid in range(1, 31)
        for line in explain(made, "--fls", fid, "--from", 2, "--to", 2.2, "--all")
    ]
    assert sorted(together) == sorted(line for line in apart if line != "nothing happened in these seconds")
    assert len(together) > 20


def test_every_id_in_a_story_leads_on(made):
    """From an effect to its cause, by what stands in brackets, back to something that no datagram caused."""
    story = explain(made, "--from", 0, "--to", 3)
    found = next(line for line in story if "FOLLOW_MERGE" in line and "-> Waiting" in line)
    ids, steps = ID.findall(found), 0
    while ids and steps < 20:
        first, *told = explain(made, "--message", ids[0])
        assert f"[{ids[0]}]" in first
        steps += 1
        because = next((line for line in told if "  because" in line), "")
        ids = ID.findall(because)
    assert steps >= 3, "the merge, the measurement's pairing, the acceptance, ..."
    assert "challenge due" in because


def test_the_life_of_a_datagram(made):
    sent = [r for r in records(made) if r.get("is") == "sent" and r["kind"].startswith("FOLLOW_MERGE(")]
    times = Counter(r.get("cause") for r in records(made) if "xi" in r)
    of_swarm = max(sent, key=lambda record: times[record["message"]])
    lines = explain(made, "--message", of_swarm["message"])
    assert lines[0].endswith(f"sent {of_swarm['kind']} to {of_swarm['to']} [{of_swarm['message']}]")
    about = [r for r in records(made) if of_swarm["message"] in (r.get("message"), r.get("cause"))]
    about.remove(of_swarm)
    heard = [r for r in about if r["is"] == "heard" or "xi" in r]
    assert sum(map(int, re.findall(r"(\d+) [a-z]", lines[2]))) == len(heard) > 0
    assert all(any(f"{r['t']:.4f} s  {r['fid']:>2}  " in line for line in lines[3:]) for r in heard)


def test_a_life_in_numbers(made):
    lines = explain(made, "--fls", "17")
    mine = [r for r in records(made) if r.get("fid") == 17]
    text = "\n".join(lines)
    assert lines[0] == "FLS 17"
    assert "landed and lit" in text
    assert f"{sum(r['is'] == 'sent' and r['kind'] == 'NEIGHBOUR' for r in mine)} NEIGHBOUR" in text
    assert f"{sum('xi' in r and r['is'] == 'handled' for r in mine)} handled" in text
    epochs = [line for line in lines if re.match(r" +\d +\d+\.\d{4} s +\d", line)]
    flights = sum(r["is"] == "flew" for r in mine)
    assert sum(int(line.split()[-2]) for line in epochs) == flights
    several = explain(made, "--fls", "17,20-22")
    assert [line for line in several if line.startswith("FLS ")] == ["FLS 17", "FLS 20", "FLS 21", "FLS 22"]
    assert several[: len(lines)] == lines


def test_all_datagrams_by_kind(made):
    head, titles, *rows, hint = explain(made)
    assert head == "sphere, 30 FLSs, seed 7"
    sent = {row.split()[0]: int(row.split()[1].replace(",", "")) for row in rows}
    assert sum(sent.values()) == json.loads((made / "summary.json").read_text())["datagrams_sent"]
    assert titles.split()[:2] == ["sent", "handled"]
    assert "--message ID" in hint


def test_records_as_they_are(made):
    told = [json.loads(line) for line in explain(made, "--fls", 17, "--to", 3, "--json")]
    assert told == [r for r in records(made) if r.get("fid") == 17 and r["t"] <= 3]


def test_a_log_that_was_cut_is_told_as_far_as_it_is_whole(run):
    whole = explain(run, "--fls", 17, "--from", 0, "--all")
    path = run / "trace.jsonl.gz"
    data = path.read_bytes()
    path.unlink()
    partial = run / "trace.jsonl.gz.partial"
    lengths = []
    for share in (0.3, 0.6, 0.999, 1.0):
        partial.write_bytes(data[: int(len(data) * share)])
        done = run_command("explain", run, "--fls", 17, "--from", 0, "--all")
        told = done.stdout.splitlines()
        assert told[:-1] == whole[: len(told) - 1]  # of the last event not all may be there
        lengths.append(len(told))
        assert "this is what is whole" in done.stderr
    assert lengths == sorted(lengths)
    assert 5 < lengths[0] < lengths[-1] == len(whole)


@pytest.mark.parametrize("spoil", ["cut", "changed", "a line cut"])
def test_a_whole_file_that_is_not_whole_is_told(run, spoil):
    path = run / "trace.jsonl.gz"
    data = path.read_bytes()
    if spoil == "cut":
        path.write_bytes(data[: len(data) // 2])
    elif spoil == "changed":
        path.write_bytes(data[: len(data) // 2] + bytes(64) + data[len(data) // 2 + 64 :])
    else:
        rewrite(run, [json.dumps(record) + "\n" for record in records(run)][:-1] + ['{"t":'])
    done = run_command("explain", run, "--fls", 17, "--from", 0)
    assert ("trace.jsonl.gz is damaged; what is told may lack lines" in done.stderr) == (spoil == "changed")
    assert ("this is what is whole" in done.stderr) == (spoil != "changed")
    assert len(done.stdout.splitlines()) > 10


def test_one_byte_that_is_not_what_it_was_is_told(run):
    path = run / "trace.jsonl.gz"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0x10
    path.write_bytes(bytes(data))
    for options in ([], ["--fls", 17], ["--message", "3.0#1"], ["--from", 0]):
        told = run_command("explain", run, *options).stderr
        assert "trace.jsonl.gz is damaged" in told
        assert "the run ended before" not in told


def test_a_damaged_log_loses_what_is_damaged(run):
    lines = [json.dumps(record) + "\n" for record in records(run)]
    whole = explain(run, "--fls", 17, "--from", 0, "--all")
    strange = [
        "garbage\n", "[]\n", "\n", "{}\n", '{"t":0,"fid":17,"is":"handled"}\n',
        '{"t":"x","fid":17,"is":"made","incarnation":0}\n',
        '{"t":0,"fid":17,"is":"handled","event":"ACK","xi":"a","cause":"1.0#1","before":[1,2,3,4,5]}\n',
        '{"t":0,"fid":17,"is":"heard","message":7,"kind":"INIT","fate":"lost"}\n',
        '{"t":1e999,"fid":17,"is":"ended","how":"x"}\n',
        '{"t":0,"fid":17,"is":"ended","how":"\\u001b[31m"}\n', "[" * 5000 + "\n",
    ]  # fmt: skip
    strange += ['{"t":0,"fid":1,"is":"born"}\n', '{"t":0,"fid":1,"is":"made"\n', lines[0]]
    rewrite(run, [lines[0], *strange, *lines[1:]])
    note = f"note: {len(strange)} lines of trace.jsonl.gz cannot be read and are left out\n"
    done = run_command("explain", run, "--fls", 17, "--from", 0, "--all")
    assert (done.stdout.splitlines(), done.stderr) == (whole, note)
    for options in ([], ["--fls", 17], ["--from", 0, "--json"]):
        done = run_command("explain", run, *options)
        assert done.stdout
        assert done.stderr == note, options
    assert "cannot be read" in run_command("explain", run, "--message", "3.0#1").stderr
    rewrite(run, [*lines, '{"t":0,"fid":31,"is":"ended","how":"failed"}\n'])
    assert "note: 1 line of trace.jsonl.gz" in run_command("explain", run).stderr, "there is no FLS 31"
    rewrite(run, [*lines[:5], "[1]\n", *lines[5:]])
    assert (
        "note: 1 line of trace.jsonl.gz cannot be read and is left out" in run_command("explain", run).stderr
    )


def test_what_cannot_be_opened_is_told_in_the_words_of_the_system(run, monkeypatch):
    path = run / "trace.jsonl.gz"
    path.unlink()
    path.mkdir()
    with pytest.raises(BadInput, match=r"its trace.jsonl.gz: Is a directory"):
        explain(run)
    path.rmdir()
    os.mkfifo(path)  # and nobody ever writes into it
    with pytest.raises(BadInput, match=r"its trace.jsonl.gz: not a file"):
        explain(run)
    path.unlink()
    path.write_bytes(b"")

    def refused(*_):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(Path, "open", refused)  # for root, no mode of a file would do it
    with pytest.raises(BadInput, match=r"its trace.jsonl.gz: Permission denied"):
        explain(run)


@pytest.mark.parametrize(
    "changes",
    [{"points": -3}, {"points": 0}, {"points": 10**12}, {"points": "30"}, {"points": True},
     {"seed": -1}, {"fids": [0]}, {"fids": [31]}, {"fids": "ab"}],
    ids=str,
)  # fmt: skip
def test_a_header_that_cannot_be_is_refused(run, changes):
    header, *rest = records(run)
    rewrite(run, [header | changes, *rest])
    with pytest.raises(BadInput, match=r"an event log that can be read; its trace.jsonl.gz is none"):
        explain(run)


def test_a_log_of_nothing_is_not_read_to_its_end(run, monkeypatch):
    monkeypatch.setattr(trace_file, "MOST_STRANGE", 50)
    first, *rest = [json.dumps(record) + "\n" for record in records(run)]
    rewrite(run, [first, *rest[:5], *["{}\n"] * 50, *rest[5:9]])
    assert "50 lines" in run_command("explain", run, "--from", 0).stderr
    rewrite(run, [first, *rest[:5], *["{}\n"] * 5000, "[]\n", *rest[5:]])
    done = run_command("explain", run, "--from", 0, "--json")
    assert "is damaged" in done.stderr
    assert len(done.stdout.splitlines()) == 5


def test_markup_in_a_path_is_text(made, tmp_path):
    odd = tmp_path / "[bold]x[" / "run"
    shutil.copytree(made, odd)
    assert explain(odd, "--fls", 3, "--to", 1)
    (odd / "trace.jsonl.gz").unlink()
    with pytest.raises(BadInput, match=r"\[bold\]"):
        explain(odd, "--fls", 3)


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (["--fls", "31"], "fls: '31' is not allowed; FIDs of this run, 1 to 30"),
        (["--fls", "0"], "fls: '0'"),
        (["--fls", "a"], "fls: 'a'"),
        (["--fls", "1-9"], "fls: '9 FLSs' is not allowed; at most 8"),
        (["--fls", "3", "--from", "4", "--to", "3"], "from: 4.0 is not allowed; a second not after --to, 3"),
        (["--from", "-1"], "from: -1.0 is not allowed; an emulated second"),
        (["--to", "nan"], "to: nan is not allowed"),
        (["--message", "17"], "message: '17' is not allowed; the id of a datagram, FID.incarnation#number"),
        (["--message", "17.0#99999"], "message: '17.0#99999' is not allowed; the id of a datagram in this log"),
    ],
)  # fmt: skip
def test_what_cannot_be_told_is_refused(made, options, line):
    with pytest.raises(BadInput) as refused:
        explain(made, *options)
    assert str(refused.value).startswith(line)


@pytest.mark.parametrize(
    "options",
    [
        ["--message", "3.0#1", "--fls", "3"], ["--message", "3.0#1", "--to", "3"], ["--from", "x"],
        ["--all"], ["--all", "--fls", "3"], ["--all", "--message", "3.0#1"], ["--all", "--from", "1", "--json"],
    ],
)  # fmt: skip
def test_options_that_do_not_go_together(made, options):
    with pytest.raises(click.UsageError):
        explain(made, *options)


def test_what_is_no_log_is_refused(run, tmp_path):
    path = run / "trace.jsonl.gz"
    header = records(run)[0]
    for content, line in [
        (b"", "an event log that can be read; its trace.jsonl.gz is none"),
        (b"plain text", "an event log that can be read"),
        (gzip.compress(b"[]\n"), "an event log that can be read"),
        (gzip.compress(b"x" * (3 << 20)), "an event log that can be read"),
        (zlib.compress(b"{}\n"), "an event log that can be read"),
        (
            gzip.compress(json.dumps(header | {"swarmer_trace": 2}).encode() + b"\n"),
            "of format 1; this one's is 2",
        ),
    ]:
        path.write_bytes(content)
        with pytest.raises(BadInput, match=line):
            explain(run, "--fls", 3)
    path.unlink()
    with pytest.raises(
        BadInput, match="it has no event log; `swarmer-run --engine virtual --trace` writes one"
    ):
        explain(run)
    for nowhere in (tmp_path / "nothing", Path(__file__)):
        with pytest.raises(BadInput, match="run: "):
            explain(nowhere)


def test_a_log_of_some_flss_says_who_was_left_out(tmp_path):
    path = tmp_path / "some"
    run_command(
        "run", "--engine", "virtual", "--shape", "sphere", "--points", "12", "--duration", "3", "--trace-fids", "2,5-6",
        "--no-recording", "--out", path,
    )  # fmt: skip
    assert explain(path)[0] == "sphere, 12 FLSs, seed 1; logged: 3 of them"
    assert explain(path, "--fls", "5-6")
    with pytest.raises(BadInput, match="an FLS that was logged; --trace-fids of this run left out 3"):
        explain(path, "--fls", "2-3")
    foreign = next(
        name
        for r in records(path)[1:]
        for name in [r.get("cause", "")]
        if name and name.split(".")[0] not in "256"
    )
    assert explain(path, "--message", foreign)[0] == f"{foreign}  sent by an FLS whose records were not kept"


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (["--trace"], "trace: the engine process keeps no event log; --engine virtual does"),
        (["--engine", "process", "--trace-fids", "3"], "trace: the engine process keeps no event log"),
        (["--engine", "virtual", "--shape", "dragon", "--trace-fids", "761"], "trace-fids: '761' is not allowed"),
    ],
)  # fmt: skip
def test_a_log_that_cannot_be_is_refused_before_anything_is_written(options, line, tmp_path):
    with pytest.raises(BadInput) as refused:
        run_command("run", *options, "--out", tmp_path / "run")
    assert str(refused.value).startswith(line)
    assert not list(tmp_path.iterdir())


def test_a_scenario_is_played(tmp_path):
    path = SCENARIOS / "late_ack.txt"
    text = path.read_text("utf-8")
    assert run_command("explain", "--scenario", path).stdout == text
    other = tmp_path / "other.txt"
    other.write_text(text.replace("2 => 1 CANCEL", "2 => 1 FIN"))
    with pytest.raises(
        RunFailed, match=r"other.txt, line \d+: it says `2 => 1 FIN`, and what came is `2 => 1 CANCEL`"
    ):
        explain("--scenario", other)
    other.write_text(text.replace("tick 1", "tock 1"))
    with pytest.raises(BadInput, match=r"scenario: other.txt, line 5, column 1: no command 'tock'"):
        explain("--scenario", other)
    for more in (
        [tmp_path],
        ["--fls", 3],
        ["--json"],
        ["--all"],
        ["--from", 0],
        ["--to", 0],
        ["--message", "1.0#1"],
    ):
        with pytest.raises(click.UsageError, match="played alone"):
            explain("--scenario", path, *more)
    with pytest.raises(click.UsageError, match="whose story"):
        explain()


def test_the_page_names_every_option_and_every_command_of_a_scenario():
    page = PAGE.read_text("utf-8")
    for parameter in load("explain").params:
        for option in parameter.opts:
            assert option in page or option in ("run", "--help", "-h", "--version"), option
    for command in COMMANDS:
        assert re.search(rf"`{command}\b", page), command


def test_the_scenario_on_the_page_is_one_and_gives_what_it_says():
    page = PAGE.read_text("utf-8")
    (text,) = re.findall(r"```text\n(# Rule.*?)```", page, re.DOTALL)
    scenario = parse(text, "page")
    assert not first_difference(scenario, play(scenario))


def test_the_example_on_the_page_is_what_its_commands_print(tmp_path, request):
    """`pytest --rewrite-scenarios` writes down what comes instead; then read whether the text between still says it."""
    page = PAGE.read_text("utf-8")
    (run,) = re.findall(r"^    (swarmer-run .*)$", page, re.MULTILINE)
    shown = re.compile(r"^(    (swarmer explain .*)\n\n```text\n)[^`]*```$", re.MULTILINE)
    script = "from swarmer import cli; import sys; sys.argv[:] = sys.argv[1:]; getattr(cli, {!r})()"
    shell = "".join(
        f'{name}() {{ {shlex.quote(sys.executable)} -c {shlex.quote(script.format(main))} {name} "$@"; }}\n'
        for name, main in (("swarmer", "main"), ("swarmer_run", "main_run"))
    )

    def printed(command):
        command = command.replace("swarmer-run", "swarmer_run")  # no name of a function of every shell
        done = subprocess.run(
            ["sh", "-c", shell + command], cwd=tmp_path, capture_output=True, text=True, timeout=60
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert printed(run + " --no-recording").strip() == "runs/traced"
    assert len(shown.findall(page)) == 3
    now = shown.sub(lambda found: f"{found[1]}{printed(found[2])}```", page)
    if request.config.getoption("--rewrite-scenarios"):
        PAGE.write_text(now, encoding="utf-8")
    else:
        assert now == page
