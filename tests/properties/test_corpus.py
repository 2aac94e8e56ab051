"""The inputs in tests/corpus, played again; `scripts/corpus.py` looks for more."""

import dis
import importlib.util
import sys
from pathlib import Path
from random import Random

import pytest

from swarmer import state_machine
from swarmer.messages import REASONS
from swarmer.protocol import anchoring, challenging, following, localizing, pairing, race
from swarmer.protocol.leases import Leases
from swarmer.state_machine import State

SCRIPTS = Path(__file__).parents[2] / "scripts"


@pytest.fixture(scope="module")
def corpus():
    sys.path.insert(0, str(SCRIPTS))
    try:
        spec = importlib.util.spec_from_file_location("corpus", SCRIPTS / "corpus.py")
        module = importlib.util.module_from_spec(spec)
        sys.modules["corpus"] = module
        spec.loader.exec_module(module)
        yield module
    finally:
        sys.path.remove(str(SCRIPTS))


def test_every_datagram_is_refused_or_is_what_it_says(corpus):
    datagrams, _ = corpus.KINDS
    fates = {word for data in corpus.kept(datagrams) for word in corpus.datagram(data).split()}
    assert set(REASONS) - {"mac"} <= fates, "mac: those with a key are all refused for it"
    assert {"heard", "address", "own", "queued", "noted", "answered", "dropped"} <= fates


def test_no_life_ends_a_machine(corpus):
    _, lives = corpus.KINDS
    states = {state for data in corpus.kept(lives) for state in corpus.life(data).split()}
    assert states == {state.name for state in State}


def test_it_is_small_and_goes_nearly_everywhere(corpus):
    files = [corpus.KEPT / f"{kind.name}.txt" for kind in corpus.KINDS]
    assert sum(file.stat().st_size for file in files) < 120_000
    assert sum(len(corpus.kept(kind)) for kind in corpus.KINDS) >= 100
    ways = corpus.Ways()
    taken = {way for kind in corpus.KINDS for data in corpus.kept(kind) for way in ways.of(kind.play, data)}
    lines = {(name, line) for _, name, _, line in taken}
    for module in (state_machine, anchoring, challenging, following, localizing, pairing, race):
        name = module.__file__.rpartition("swarmer/")[2]
        wanted = lines_of(module)
        gone = {line for place, line in lines if place == name} & wanted
        assert len(gone) >= 0.8 * len(wanted), (
            f"{name}: {sorted(wanted - gone)} are never reached: make the corpus anew"
        )


def lines_of(module):
    """The lines within functions of a module."""

    def of(code, inside):
        own = (
            {line for _, line in dis.findlinestarts(code) if line} - {code.co_firstlineno}
            if inside
            else set()
        )
        inner = [one for one in code.co_consts if hasattr(one, "co_code")]
        return own.union(*(of(one, inside or not is_class(one)) for one in inner))

    def is_class(code):
        return "__qualname__" in code.co_names

    source = Path(module.__file__)
    return of(compile(source.read_text("utf-8"), str(source), "exec"), False)


def test_a_machine_that_forgets_a_lease_is_noticed(corpus, monkeypatch):
    monkeypatch.setattr(Leases, "__len__", lambda leases: 0)
    lives = corpus.kept(corpus.KINDS[1])
    with pytest.raises(AssertionError):
        list(map(corpus.life, lives))


def test_more_are_looked_for_from_what_is_there(corpus, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(corpus, "KEPT", tmp_path)
    assert corpus.main(["--seconds", "0.3"]) == 0
    first = corpus.kept(corpus.KINDS[0])
    assert first
    assert corpus.main(["--seconds", "0.3", "--seed", "2"]) == 0
    assert corpus.kept(corpus.KINDS[0])
    assert "datagrams: " in capsys.readouterr().out


def test_choices_are_those_written_down(corpus):
    one, again = (corpus.Choices(bytes(range(60))) for _ in range(2))
    assert [one.choice("abcdef") for _ in range(5)] == [again.choice("abcdef") for _ in range(5)]
    with pytest.raises(corpus.Spent):
        corpus.Choices(b"").random()
    changed = corpus.changed(Random(1), b"abcdef", b"uvwxyz")
    assert changed != b"abcdef"
