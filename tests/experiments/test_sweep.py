"""Sweeps: every run once, whatever ends them in between, and each the run that it is by hand."""

import csv
import errno
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from helpers import children, gone, wait_for

from swarmer.errors import BadInput, RunFailed
from swarmer.experiments import sweep as sweeps
from swarmer.experiments.board import Board
from swarmer.experiments.experiment import read_experiment
from swarmer.experiments.one_run import perform
from swarmer.experiments.pool import DIED, Pool
from swarmer.experiments.results import Results
from swarmer.experiments.runs import expand
from swarmer.experiments.sweep_directory import as_file, home_of
from swarmer.observe import files

SWEEP = "from swarmer import cli; import sys; sys.argv[0] = 'swarmer'; cli.main()"
TINY = "base: {engine: virtual, shape: sphere, points: 12, duration_s: 2}\ngrid: {radio.loss: [0, 0.1]}\nseeds: 2\n"
LONG = "base: {engine: virtual, shape: sphere, points: 30, duration_s: 10, lambda_ms: 60}\nseeds: 12\n"


def start(*arguments, cwd, **more):
    """Start `swarmer sweep`, with Ctrl-C as a terminal has it."""
    return subprocess.Popen(
        [sys.executable, "-c", SWEEP, "sweep", *map(str, arguments)],
        cwd=cwd, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler), **more,
    )  # fmt: skip


def swept(*arguments, cwd, status=0):
    """A sweep to its end; stdout and stderr."""
    process = start(*arguments, cwd=cwd)
    out, err = process.communicate(timeout=100)
    assert process.returncode == status, err
    assert "Traceback" not in err
    return out, err


def rows(out):
    with (out / "results.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def summaries(out):
    return sorted(out.glob("**/summary.json"))


def traces(out):
    """What happened in each run, to the last event."""
    return {
        str(path.parent.relative_to(out)): json.loads(path.read_text())["trace_sha256"]
        for path in summaries(out)
    }


class Quiet(Board):
    def say(self, line):
        pass


def in_process(file, out, jobs=1):
    experiment = read_experiment(str(file))
    return sweeps.sweep(experiment, expand(experiment), out, sweeps.ThisMachine(jobs), Quiet())


def test_a_sweep_leaves_a_directory_for_each_run_and_one_table(write, tmp_path):
    out, _ = swept(write(TINY), "--out", "o", "--jobs", "2", cwd=tmp_path)
    assert out.splitlines()[-1] == "o"
    assert "radio.loss" in out.splitlines()[0]
    table = rows(tmp_path / "o")
    assert list(table[0])[:3] == ["radio.loss", "seed", "format"]
    assert list(table[0])[-1] == "run"
    columns = (tmp_path / "o" / "results.csv").read_text().splitlines()[0].split(",")
    assert len(set(columns)) == len(columns)
    assert [(row["radio.loss"], row["seed"]) for row in table] == [
        ("0", "1"),
        ("0", "2"),
        ("0.1", "1"),
        ("0.1", "2"),
    ]
    for row in table:
        run = tmp_path / "o" / row["run"]
        summary = json.loads((run / "summary.json").read_text())
        assert float(row["hd_cells"]) == summary["hd_cells"]
        for limit, time_s in summary["time_to_hd_s"].items():
            at = row[f"time_to_hd_s.{limit}"]
            assert at == "" if time_s is None else float(at) == time_s
        assert row["suggested_time_scale"] == ""
        assert float(row["timer_late_ms.p99"]) == summary["timer_late_ms"]["p99"]
        assert row["faithful"] == "true"
        assert {"wall_s", "events", "thaws", "datagrams_sent", "trace_sha256"} <= set(row)
        assert not (run / "recording.rrd").exists()
        assert (run / "timeline.npz").exists()


def test_a_run_is_the_same_by_hand_and_however_many_run_at_once(write, tmp_path):
    file = write(TINY)
    in_process(file, tmp_path / "one", jobs=1)
    in_process(file, tmp_path / "three", jobs=3)
    assert len(traces(tmp_path / "one")) == 4
    assert traces(tmp_path / "one") == traces(tmp_path / "three")
    by_hand = ["--engine", "virtual", "--shape", "sphere", "--points", "12", "--duration", "2", "--seed", "2"]
    by_hand += ["--set", "radio.loss=0.1", "--json"]
    done = subprocess.run(
        [sys.executable, "-c", "from swarmer import cli; cli.main_run()", *by_hand],
        cwd=tmp_path, capture_output=True, text=True, timeout=60, env={**os.environ, "PYTHONHASHSEED": "5"},
    )  # fmt: skip
    assert json.loads(done.stdout)["trace_sha256"] == traces(tmp_path / "one")["radio.loss=0.1/seed-2"]


@pytest.mark.slow
def test_killed_and_started_again_it_makes_what_is_missing_and_repeats_nothing(write, tmp_path):
    file, out = write(LONG), tmp_path / "o"
    process = start(file, "--out", out, "--jobs", "2", cwd=tmp_path)
    wait_for(lambda: len(summaries(out)) >= 3, 60, 0.01)
    workers = children(process.pid)
    assert workers
    process.kill()
    _, err = process.communicate()
    wait_for(lambda: gone(workers))
    assert "resource_tracker" not in err
    there = {path: path.stat().st_mtime_ns for path in summaries(out)}
    assert 3 <= len(there) < 12
    assert len(rows(out)) <= len(there)  # the table follows the runs, which are what counts
    _, err = swept(file, "--out", out, "--jobs", "2", cwd=tmp_path)
    assert f"12 runs, {len(there)} of them finished already" in err
    assert {path: path.stat().st_mtime_ns for path in there} == there
    assert [row["seed"] for row in rows(out)] == [str(seed) for seed in range(1, 13)]
    assert {row["status"] for row in rows(out)} == {"done"}
    before = {path: path.stat().st_mtime_ns for path in summaries(out)}
    _, err = swept(file, "--out", out, cwd=tmp_path)
    assert "nothing is missing" in err
    assert {path: path.stat().st_mtime_ns for path in summaries(out)} == before
    assert not list(out.glob("**/*.partial"))


@pytest.mark.slow
@pytest.mark.parametrize("whole_group", [False, True], ids=["the sweep alone", "as a terminal does it"])
def test_ctrl_c_ends_it_in_good_order(whole_group, write, tmp_path):
    """Two runs are finished soon, two never would be."""
    file = write(
        "base: {engine: virtual, shape: sphere, points: 30, lambda_ms: 60}\n"
        "grid: {duration_s: [0.5, 100000]}\nseeds: 2\n"
    )
    out = tmp_path / "o"
    process = start(file, "--out", out, "--jobs", "2", cwd=tmp_path, start_new_session=True)
    wait_for(lambda: len(summaries(out)) == 2, 60, 0.01)
    workers = children(process.pid)
    if whole_group:
        os.killpg(process.pid, signal.SIGINT)
    else:
        process.send_signal(signal.SIGINT)
    said, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert said == f"{out}\n"
    assert "Traceback" not in err
    assert err.splitlines()[-1] == "interrupted"
    assert "the same command goes on with the rest" in err
    wait_for(lambda: gone(workers))
    assert [(row["duration_s"], row["status"]) for row in rows(out)] == [("0.5", "done")] * 2
    assert not list(out.glob("**/results.csv.tmp"))


def test_half_runs_and_failed_ones_are_made_anew(write, tmp_path):
    file, out = write(TINY), tmp_path / "o"
    in_process(file, out)
    whole = traces(out)
    failed, half, kept = (out / name for name in list(whole)[:3])
    spoilt = json.loads((failed / "summary.json").read_text()) | {
        "status": "interrupted",
        "trace_sha256": "?",
    }
    (failed / "summary.json").write_text(json.dumps(spoilt))
    (half / "summary.json").write_text('{"status": "done"}')
    (half / "events.csv").rename(half / "events.csv.partial")
    (out / "results.csv").unlink()
    before = (kept / "summary.json").stat().st_mtime_ns
    ended = in_process(file, out)
    assert (ended.total, ended.made, ended.failures) == (4, 2, [])
    assert traces(out) == whole
    assert (kept / "summary.json").stat().st_mtime_ns == before
    assert len(rows(out)) == 4


def test_a_failed_run_has_a_row_and_ends_with_1_and_is_made_anew(write, tmp_path):
    (tmp_path / "o" / "radio.loss=0" / "seed-2").mkdir(parents=True)
    (tmp_path / "o" / "experiment.yaml").write_text("# The experiment x, by swarmer 0.1.0\n")
    strange = tmp_path / "o" / "radio.loss=0" / "seed-2" / "thesis.tex"
    strange.touch()
    _, err = swept(write(TINY), "--out", "o", cwd=tmp_path, status=1)
    assert "error: 1 of 4 runs failed, the first radio.loss=0/seed-2 (out: " in err
    lines = [line for line in err.splitlines() if "ETA" not in line]  # how far it is, on a slow machine
    assert len(lines) == 3  # planned, the failure as it happened, the error
    assert [row["status"] for row in rows(tmp_path / "o")] == ["done", "failed", "done", "done"]
    assert "thesis.tex" in rows(tmp_path / "o")[1]["message"]
    assert strange.exists()
    strange.unlink()
    swept(write(TINY), "--out", "o", cwd=tmp_path)
    assert [row["status"] for row in rows(tmp_path / "o")] == ["done"] * 4


def test_more_seeds_and_values_are_only_made_besides(write, tmp_path):
    in_process(write(TINY), tmp_path / "o")
    more = write(TINY.replace("[0, 0.1]", "[0, 0.1, 0.2]").replace("seeds: 2", "seeds: 3"))
    assert in_process(more, tmp_path / "o").made == 9 - 4
    assert len(rows(tmp_path / "o")) == 9


@pytest.mark.parametrize(
    "faults",
    ["{faults.random: [0, 3]}", "{faults.file: [null, storm.yaml]}",
     "{faults.schedule: [[], [{at: 0.5, what: kill, where: {share: 0.2}}]]}"],
    ids=["drawn", "of a file", "listed"],
)  # fmt: skip
def test_a_sweep_over_faults_is_taken_up_again(faults, write, tmp_path, monkeypatch):
    """A run writes down which faults its settings came to mean."""
    monkeypatch.chdir(tmp_path)
    storm = tmp_path / "storm.yaml"
    storm.write_text("faults: [{at: 0.5, for: 1, what: loss, p: 0.5, where: all}]\n")
    file = write(TINY.replace("{radio.loss: [0, 0.1]}", faults))
    assert in_process(file, tmp_path / "o").made == 4
    assert in_process(file, tmp_path / "o").made == 0
    if "file" in faults:
        storm.write_text("faults: [{at: 0.5, for: 1, what: loss, p: 0.6, where: all}]\n")
        with pytest.raises(BadInput, match=r"faults.schedule was .*p: 0.5.*, is .*p: 0.6"):
            in_process(file, tmp_path / "o")


def test_what_is_not_in_the_file_any_more_stays_and_is_told(write, tmp_path):
    in_process(write(TINY), tmp_path / "o")
    _, err = swept(write(TINY.replace("seeds: 2", "seeds: [2]")), "--out", "o", cwd=tmp_path)
    assert "the experiment has changed: seeds was [1, 2], is [2]" in err
    assert "2 runs there are not of this experiment" in err
    assert len(summaries(tmp_path / "o")) == 4
    assert len(rows(tmp_path / "o")) == 2


def test_other_settings_in_the_same_directory_are_refused_by_name(write, tmp_path):
    in_process(write(TINY), tmp_path / "o")
    before = (tmp_path / "o" / "results.csv").read_bytes()
    with pytest.raises(BadInput, match=r"duration_s was 2, is 3 \(runs: 4\)"):
        in_process(write(TINY.replace("duration_s: 2", "duration_s: 3")), tmp_path / "o")
    assert (tmp_path / "o" / "results.csv").read_bytes() == before


@pytest.mark.parametrize("seed_too", [False, True], ids=["points", "a mesh"])
def test_other_points_under_the_same_name_are_refused(seed_too, write, tmp_path, monkeypatch):
    """Of a mesh every seed has other points, and these are no change."""
    monkeypatch.chdir(tmp_path)
    if seed_too:
        name, more = "mine.off", ", points: 8"
        text = "OFF\n4 4 0\n0 0 0\n9 0 0\n0 9 0\n0 0 9\n3 0 1 2\n3 0 1 3\n3 0 2 3\n3 1 2 3\n"
    else:
        name, more = "mine.xyz", ""
        text = "".join(f"{at} {at * at % 7} 0\n" for at in range(8))
    Path(name).write_text(text)
    file = write(f"base: {{engine: virtual, shape: {name}, duration_s: 0.5{more}}}\nseeds: 2")
    in_process(file, Path("o"))
    assert in_process(file, Path("o")).made == 0
    Path(name).write_text(text.replace("0 0 9\n", "0 0 5\n") if seed_too else text + "3 9 4\n")
    with pytest.raises(BadInput, match=rf"{name} has other points by now \(runs: 2\); choose another"):
        in_process(write(file.read_text().replace("seeds: 2", "seeds: 3")), Path("o"))
    assert len(summaries(Path("o"))) == 2


@pytest.mark.parametrize("whole", [False, True], ids=["as named", "as a full path"])
def test_a_file_of_points_is_the_same_by_its_full_path(whole, write, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("mine.xyz").write_text("".join(f"{at} {at * at % 7} 0\n" for at in range(8)))
    file = write("base: {engine: virtual, shape: mine.xyz, duration_s: 0.5}")
    in_process(file, Path("o"))
    manifest = Path("o/seed-1/manifest.json")
    data = json.loads(manifest.read_text())
    data["settings"]["shape"] = str(tmp_path.resolve() / "mine.xyz") if whole else "mine.xyz"
    manifest.write_text(json.dumps(data))
    assert in_process(file, Path("o")).made == 0


def test_the_experiment_that_is_written_down_is_the_same_experiment(write, tmp_path):
    file = write(
        TINY + "blocks:\n- {}\n- base: {extends: paper, points: 14}\n  grid: {thaw.policy: ['off', timer]}\n"
    )
    in_process(file, tmp_path / "o")
    written = expand(read_experiment(str(tmp_path / "o" / "experiment.yaml")))
    assert written == expand(read_experiment(str(file)))


def test_a_directory_of_someone_else_is_refused(write, tmp_path):
    for place in (tmp_path, write(TINY), Path("/proc/x")):
        with pytest.raises(BadInput, match="out: "):
            in_process(write(TINY), place)


@pytest.mark.parametrize("name", ["results.csv", "experiment.yaml"])
def test_a_file_of_someone_else_that_is_called_like_ours_is_not_overwritten(name, write, tmp_path):
    (tmp_path / "o").mkdir()
    (tmp_path / "o" / name).write_text("mine\n")
    with pytest.raises(BadInput, match=rf"it holds other files \({name}\)"):
        in_process(write(TINY), tmp_path / "o")
    assert (tmp_path / "o" / name).read_text() == "mine\n"


@pytest.mark.parametrize(
    "text",
    ["a,b\n1,2\n", "", "\0\1", "PK\x03\x04", "seed,run\n" + "x" * 200_000],
    ids=["columns", "empty", "bytes", "zip", "an endless cell"],
)
def test_a_table_of_another_format_is_refused_and_stays(text, write, tmp_path):
    in_process(write(TINY), tmp_path / "o")
    (tmp_path / "o" / "results.csv").write_text(text)
    with pytest.raises(BadInput, match=r"results.csv: is not a table of runs.*; choose another directory"):
        in_process(write(TINY.replace("seeds: 2", "seeds: 3")), tmp_path / "o")
    assert (tmp_path / "o" / "results.csv").read_text() == text
    assert len(summaries(tmp_path / "o")) == 4


def test_a_sweep_that_was_killed_with_its_first_breath_is_taken_up(write, tmp_path):
    (tmp_path / "o").mkdir()
    (tmp_path / "o" / "experiment.yaml.tmp").touch()
    assert in_process(write(TINY), tmp_path / "o").made == 4


def test_the_file_of_a_sweep_stands_for_that_sweep(write, tmp_path):
    in_process(write(TINY, "mine.yaml"), tmp_path / "runs" / "o")
    out, err = swept("runs/o/experiment.yaml", "--seeds", "3", cwd=tmp_path)
    assert "mine: 6 runs, 4 of them finished already" in err
    assert out.splitlines()[-1] == "runs/o"
    assert (tmp_path / "runs" / "o" / "experiment.yaml").read_text().startswith("# The experiment mine, ")


def test_a_copy_of_a_sweeps_file_stands_for_itself(write, tmp_path):
    copy = write(as_file(read_experiment(str(write(TINY, "mine.yaml")))), "experiment.yaml")
    experiment = read_experiment(str(copy))
    assert home_of(experiment, copy) == (experiment, Path("runs/experiment"))
    (tmp_path / "results.csv").touch()
    assert home_of(experiment, copy)[0].name == "mine"
    assert home_of(experiment, copy)[1] == tmp_path
    assert home_of(experiment, write(copy.read_text(), "other.yaml"))[1] == Path("runs/experiment")


@pytest.mark.parametrize("failed", [0, 2])
def test_the_columns_are_the_same_whichever_run_failed(failed, write, tmp_path):
    runs = expand(read_experiment(str(write(TINY))))
    results = Results(tmp_path / "results.csv", runs, ["radio.loss"])
    for number, run in enumerate(runs):
        whole = {"format": 1, "status": "done", "message": None, "thaws": 2}
        results.add(run, None if number == failed else whole, DIED)
    results.write()
    assert list(rows(tmp_path)[0]) == ["radio.loss", "seed", "format", "status", "message", "thaws", "run"]
    assert rows(tmp_path)[failed]["message"] == DIED


def test_two_sweeps_do_not_share_a_directory(write, tmp_path):
    file, out = write(LONG), tmp_path / "o"
    process = start(file, "--out", out, cwd=tmp_path)
    wait_for((out / "results.csv").exists)
    with pytest.raises(BadInput, match="another sweep is writing there"):
        in_process(file, out)
    process.kill()
    process.communicate()


def test_a_worker_that_is_killed_takes_one_run_with_it(write, tmp_path):
    runs = expand(read_experiment(str(write(LONG.replace("seeds: 12", "seeds: 4")))))
    killed, outcomes = [], []

    def kill_one():
        """As soon as the first run is under way."""
        if not killed and (tmp_path / runs[0].path / "manifest.json").exists():
            killed.append(pool._slots[0].process.pid)
            os.kill(killed[0], signal.SIGKILL)

    with Pool(2, tmp_path) as pool:
        for run, outcome in pool.outcomes(runs, lambda run: None, kill_one):
            outcomes.append((run.config.seed, outcome.status, outcome.message))
    assert killed
    assert len([status for _, status, _ in outcomes if status == "done"]) == 3
    assert [message for _, status, message in outcomes if status == "failed"] == [DIED]


def test_a_worker_that_dies_between_two_runs_is_replaced(write, tmp_path):
    runs = expand(read_experiment(str(write(TINY))))
    with Pool(1, tmp_path) as pool:
        first = list(pool.outcomes(runs[:1], lambda run: None, lambda: None))
        worker = pool._slots[0].process
        worker.kill()
        wait_for(lambda: not worker.is_alive())
        second = list(pool.outcomes(runs[1:2], lambda run: None, lambda: None))
    assert [outcome.status for _, outcome in first + second] == ["done", "done"]


@pytest.fixture
def full_disk(monkeypatch):
    def refuse(fd, data):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(files, "write_bytes", refuse)


def test_a_full_disk_is_known_from_other_failures(full_disk, write, tmp_path):
    outcome = perform(expand(read_experiment(str(write(TINY))))[0].config, tmp_path / "run")
    assert outcome.status == "failed"
    assert outcome.disk_full
    assert "No space left on device" in outcome.message


def test_a_full_disk_ends_the_sweep(write, tmp_path, monkeypatch):
    class FullPool(Pool):
        def outcomes(self, runs, started, tick, fits):
            yield runs[0], sweeps.Outcome("failed", "cannot write x: No space left on device", disk_full=True)
            raise AssertionError("went on")

    monkeypatch.setattr(sweeps, "Pool", FullPool)
    with pytest.raises(RunFailed, match="No space left"):
        in_process(write(TINY), tmp_path / "o")


def test_a_fault_of_ours_is_the_failure_of_one_run(write, tmp_path, monkeypatch):
    config = expand(read_experiment(str(write(TINY))))[0].config
    monkeypatch.setattr("swarmer.plan.make_plan", lambda config: 1 / 0)
    outcome = perform(config, tmp_path / "run")
    assert outcome.status == "failed"
    assert outcome.message.startswith("ZeroDivisionError: division by zero (test_sweep.py:")


@pytest.mark.processes
@pytest.mark.slow
def test_runs_of_processes_are_made_alone_and_last(write, tmp_path):
    file = write(
        "base: {shape: sphere, points: 8, duration_s: 1.5, time_scale: auto}\n"
        "grid: {engine: [process, virtual]}\nseeds: 2\n"
    )
    running, most = set(), {}

    class Watch(Quiet):
        def started(self, run):
            running.add(run.path)
            most[run.path] = len(running)

        def ended(self, run, outcome):
            running.discard(run.path)

    experiment = read_experiment(str(file))
    ended = sweeps.sweep(experiment, expand(experiment), tmp_path / "o", sweeps.ThisMachine(2), Watch())
    assert not ended.failures
    assert list(map(str, most)) == [
        "engine=virtual/seed-1", "engine=virtual/seed-2", "engine=process/seed-1", "engine=process/seed-2",
    ]  # fmt: skip
    assert [most[Path(f"engine=process/seed-{seed}")] for seed in (1, 2)] == [1, 1]
    assert max(most.values()) == 2
