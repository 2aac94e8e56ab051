"""The tables of what faults cost, from small sweeps."""

import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "scripts" / "faults_table.py"
SAMPLE_LAMBDAS = 0.25
BASE = "base: {engine: virtual, shape: random, points: 24, lambda_ms: 200, recording.rate_hz: 20, duration_s: %s}\n"


def swept(tmp_path, text):
    (tmp_path / "small.yaml").write_text(text)
    command = [sys.executable, "-m", "swarmer", "sweep", "small.yaml", "--jobs", "1", "--out", "out"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return tmp_path / "out"


def told(what, sweep, *more):
    done = subprocess.run([sys.executable, SCRIPT, what, sweep, *more], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return [[cell.strip() for cell in line.strip("| \n").split("|")] for line in done.stdout.splitlines()]


def test_the_map_of_loss(tmp_path):
    sweep = swept(
        tmp_path,
        BASE.replace(", lambda_ms: 200", "") % 4
        + "grid: {radio.loss: [0, 0.2], lambda_ms: [200, 500]}\nseeds: 2\n",
    )
    lines = told("map", sweep, "--picture", tmp_path / "map.svg")
    assert lines[0] == ["loss", "λ 200 ms", "λ 500 ms"]
    assert [line[0] for line in lines[2:]] == ["0 %", "20 %"]
    assert all(float(cell.split()[0]) >= 0 for line in lines[2:] for cell in line[1:])
    texts, _ = drawn(tmp_path / "map.svg")
    assert [text for text in texts if text.startswith("λ ")] == ["λ 200 ms", "λ 500 ms"]
    assert sorted(text for line in lines[2:] for text in (cell.split()[0] for cell in line[1:])) == sorted(
        texts[-4:]
    )


def drawn(path):
    """The texts of a picture, and its curves."""
    picture = ElementTree.fromstring(path.read_text("utf-8"))
    texts = [text.text for text in picture.iter("{http://www.w3.org/2000/svg}text")]
    return texts, list(picture.iter("{http://www.w3.org/2000/svg}polyline"))


def test_failures(tmp_path):
    sweep = swept(tmp_path, BASE % 8 + "grid: {failure.rate: [0, 0.03]}\nseeds: 2\n")
    head, _, none, some = told("failures", sweep, "--picture", tmp_path / "failures.svg")
    assert head[:3] == ["failures per FLS and s", "runs", "failures"]
    assert head[3:] == ["lit"], "it ends before the first moment of the table"
    assert (none[0], none[2], none[-1]) == ("0 %", "0", "100.0 %")
    assert some[0] == "3 %"
    assert float(some[2]) > 2
    assert 50 < float(some[-1].split()[0]) < 100
    texts, curves = drawn(tmp_path / "failures.svg")
    assert {"0 % per s", "3 % per s", "HD, cells", "lit"} <= set(texts)
    assert len(curves) == 4
    _, _, joins = told("joins", sweep)
    assert joins[:2] == ["3 %", "2"]
    assert 5 < int(joins[2]) < 30
    assert 0 < float(joins[3].split()[0]) <= float(joins[4]) < 10
    _, _, seen = told("joins_seen", sweep)
    assert abs(int(seen[2]) - int(joins[2])) <= 3, "one that is lit between two samples only is not seen"
    assert abs(float(seen[3].split()[0]) - float(joins[3].split()[0])) <= SAMPLE_LAMBDAS


def test_loss_at_an_end(tmp_path):
    blocks = (
        "blocks:\n  - base: {radio.loss_sender: 0.1}\n  - base: {radio.loss: 0.1, radio.burst: 5}\nseeds: 2\n"
    )
    head, _, sender, both = told("ends", swept(tmp_path, BASE % 8 + blocks))
    assert head[0] == "loss"
    assert sender[:2] == ["10 % at the sender", "2"]
    assert both[0] == "10 % at both ends, in bursts of 5"
    assert sender[-1] == both[-1] == "0"
    assert sender[2].endswith("(2/2)")


def test_a_partition(tmp_path):
    fault = "  faults.schedule: [{at: 0, for: 5, what: partition, axis: L}]"
    base = BASE.replace("base: {", "base:\n  ").replace("}\n", "").replace(", ", "\n  ") % 8
    sweep = swept(tmp_path, f"{base}\n{fault}\ngrid: {{thaw.policy: [off]}}\nseeds: 2\n")
    _, _, line = told("partition", sweep)
    assert line[0] == "`off`"
    parted, healed = (cell.split(" (") for cell in line[2:])
    assert parted[1] == healed[1] == "2/2)"
    assert 0 < float(parted[0].split()[0]) < 5
    assert 0 < float(healed[0].split()[0]) < 3


def test_what_strikes_flss(tmp_path):
    base = BASE.replace("base: {", "base:\n  ").replace("}\n", "").replace(", ", "\n  ") % 8
    dead = "{at: 0, for: 4.03, what: dead_sensor, where: {share: 0.5}}"
    kill = "{at: 4.03, what: kill, where: {swarm_of: 1}, for: 1}"
    blocks = "".join(f"  - base: {{faults.schedule: [{fault}]}}\n" for fault in (dead, kill))
    head, _, sensors, swarm = told("strikes", swept(tmp_path, f"{base}\nblocks:\n{blocks}seeds: 2\n"))
    assert head[2:5] == ["highest HD", "HD < 1 again, s", "HD < 0.1 again, s"]
    assert (sensors[0], sensors[-1]) == ("dead_sensor", "100.0 %")
    assert swarm[0] == "kill of a swarm"
    assert float(sensors[2].split()[0]) > 1
    assert 0 < float(sensors[3].split()[0]) <= float(sensors[4].split()[0]) < 4
    assert 1 < float(swarm[4].split()[0]) < 4
    assert 60 < float(swarm[-1].split()[0]) < 95


@pytest.mark.parametrize("what", ["map", "ends", "failures", "joins", "partition", "strikes"])
def test_no_sweep_is_one_line(tmp_path, what):
    done = subprocess.run([sys.executable, SCRIPT, what, tmp_path], capture_output=True, text=True)
    assert done.returncode == 1
    assert len(done.stderr.splitlines()) == 1
