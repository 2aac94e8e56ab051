"""`scripts/fuzz.py`, some thousands of inputs of it; by itself it runs the large counts."""

import runpy
from pathlib import Path

import pytest

from swarmer import messages
from swarmer.protocol.leases import Leases
from swarmer.state_machine import State

FUZZ = Path(__file__).parents[2] / "scripts" / "fuzz.py"
FEW = ["--decoder", "20000", "--mac", "5000", "--machine", "10000"]


@pytest.fixture
def main():
    return runpy.run_path(str(FUZZ))["main"]


def test_hostile_input_changes_nothing_and_raises_nothing(main, capsys):
    status = main(FEW)
    told = capsys.readouterr().out.splitlines()
    assert status == 0, told
    assert [line.split(" inputs")[0] for line in told] == ["decoder: 20,000", "mac: 5,000", "machine: 10,000"]
    assert all(state.name in told[2] for state in State)
    assert all(reason in told[0] for reason in ("size", "number", "kind", "sender", "well-formed"))


def test_a_decoder_that_takes_any_number_is_noticed(monkeypatch, capsys):
    monkeypatch.setattr(messages, "LARGEST", float("inf"))
    fuzz = runpy.run_path(str(FUZZ))
    fuzz["decoder"].__globals__["LARGEST"] = 1e9
    assert fuzz["main"]([*FEW[:2], "--mac", "0", "--machine", "0"]) == 1
    assert "decoder: FAILED with --seed 1" in capsys.readouterr().out


def test_a_signature_that_nobody_looks_at_is_noticed(main, monkeypatch, capsys):
    monkeypatch.setattr(messages, "_mac", lambda *_: bytes(messages.MAC_BYTES))
    assert main(["--decoder", "0", "--mac", "200", "--machine", "0"]) == 1
    assert "a forged datagram passed" in capsys.readouterr().out


def test_a_machine_that_forgets_a_lease_is_noticed(main, monkeypatch, capsys):
    monkeypatch.setattr(Leases, "__len__", lambda leases: 0)
    assert main(["--decoder", "0", "--mac", "0", "--machine", "4000"]) == 1
    assert "machine: FAILED" in capsys.readouterr().out
