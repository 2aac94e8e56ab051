"""The scenarios of tests/scenarios, each played on state machines; and what is no scenario."""

from pathlib import Path

import pytest

from swarmer.errors import BadInput
from swarmer.observe import stage
from swarmer.observe.scenario import COMMANDS, first_difference, parse, read
from swarmer.observe.stage import play

FILES = sorted((Path(__file__).parents[1] / "scenarios").glob("*.txt"))
PAIRING = """given 1 2 Available

tick 1
----
1 challenge due               Available
1 => all INIT

deliver
----
2 <= 1 INIT                   Available
2 => 1 ACCEPT
"""


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_scenario(path, request):
    """`pytest --rewrite-scenarios` writes down what comes instead: commit only what you understand."""
    scenario = read(path)
    given = play(scenario)
    if request.config.getoption("--rewrite-scenarios"):
        path.write_text(scenario.rewritten(given), encoding="utf-8")
        return
    assert not first_difference(scenario, given)
    assert scenario.rewritten(given) == path.read_text("utf-8"), (
        "written in another way than --rewrite-scenarios does"
    )


def test_there_are_scenarios_and_each_cites_its_rule():
    assert len(FILES) >= 30
    for path in FILES:
        head = path.read_text("utf-8").splitlines()[0]
        assert head.startswith(("# Rule", "# The table", "# M = 2", "# Section")), path.name


def test_every_command_and_every_kind_is_used():
    text = "\n".join(path.read_text("utf-8") for path in FILES)
    assert {name for name in COMMANDS if f"\n{name}" not in text} == set()
    kinds = (
        "INIT ACCEPT ACK FIN SET_WAITING SET_AVAILABLE MERGE FOLLOW_MERGE RENEW CANCEL THAW NEIGHBOUR LEAVE"
    )
    assert {kind for kind in kinds.split() if f" {kind}" not in text} == set()


def test_the_text_that_comes_of_a_scenario_is_itself():
    scenario = parse(PAIRING, "pairing")
    given = play(scenario)
    assert not first_difference(scenario, given)
    assert scenario.rewritten(given) == PAIRING


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("2 => 1 ACCEPT", "2 => 1 CANCEL", "line 11: it says `2 => 1 CANCEL`, and what came is `2 => 1 ACCEPT`"),
        ("2 => 1 ACCEPT\n", "", "line 11: it says `nothing more`, and what came is `2 => 1 ACCEPT`"),
        ("1 => all INIT\n", "1 => all INIT\n1 departs\n", "line 7: it says `1 departs`, and what came is `nothing"),
        ("given 1 2 Available", "given 1 2 Available xi=1", "line 10: it says `2 <= 1 INIT           "),
    ],
)  # fmt: skip
def test_a_difference_is_found_and_where(old, new, says):
    scenario = parse(PAIRING.replace(old, new), "pairing")
    assert first_difference(scenario, play(scenario)).startswith(says)


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("----\n", "line 1, column 1: no command stands before it"),
        ("given 1 Available\n\ndance 1\n----\n", "line 3, column 1: no command 'dance'"),
        ("given 1 Available\ntick 1\n", "line 2, column 1: what must come of it?"),
        ("given 1 Available\n", "line 1, column 1: nothing happens"),
        ("given 1 Asleep\nrun\n----\n", "line 1, column 9: no state 'Asleep'"),
        ("given Available\nrun\n----\n", "line 1, column 1: given FID"),
        ("given 1 Available size=3\nrun\n----\n", "line 1, column 19: given FID"),
        ("given 1 Available xi=two\nrun\n----\n", "line 1, column 22: 'two' is no whole number"),
        ("given 1 Available xi=0\nrun\n----\n", "line 1, column 22: '0' is no whole number from 1 to"),
        ("given 1 Available\nbattery 1\nland 1\n----\n", "line 3, column 6: no FLS 1 is there; it is gone"),
        ("given 1 Available xi\nrun\n----\n", "line 1, column 19: 'xi' needs a value, as xi="),
        ("given 1 BusyAnchor\nrun\n----\n", "line 1, column 9: FLS 1 cannot be BusyAnchor so; it would be Available"),
        ("given 1 Available flying\nrun\n----\n", "column 9: FLS 1 cannot be Available so"),
        ("given 4000 Available\nrun\n----\n", "column 7: '4000' is no whole number from 1 to 1000"),
        ("set m=3\ngiven 1 Available\nrun\n----\n", "line 1, column 5: m: 3"),
        ("given 1 Available\nset m=2\nrun\n----\n", "line 2, column 1: settings stand before"),
        ("given 1 Available\ntick 2\n----\n", "line 2, column 6: no FLS 2 is there"),
        ("given 1 Available\ntick 1 2\n----\n", "line 2, column 1: tick FID"),
        ("given 1 Available\nlease 1\n----\n", "line 2, column 1: FLS 1 waits for no such timer (lease over)"),
        ("given 1 Available\nfail 1\ntick 1\n----\n", "line 3, column 6: no FLS 1 is there; it is gone"),
        ("given 1 Available\nland 1\n----\n", "line 2, column 1: that cannot happen now"),
        ("given 1 Available\nmeasure 1 2\n----\n", "line 2, column 9: FLS 1 measures nothing now"),
        ("given 2 BusyLocalizing with=7\nrun\n----\n", "column 9: FLS 2 cannot be BusyLocalizing so; it would"),
        ("given 2 BusyLocalizing with=1\nmeasure 2 far\n----\n", "line 2, column 11: how long V is"),
        ("given 2 BusyLocalizing with=1\nmeasure 2 nan\n----\n", "line 2, column 11: how long V is"),
        ("given 1 Available\ndeliver\n----\n", "line 2, column 1: no such datagram is on the air"),
        ("given 1 Available\ndeliver HELLO\n----\n", "line 2, column 9: deliver [KIND]"),
        ("given 1 Available\ndeliver from\n----\n", "line 2, column 9: deliver [KIND]"),
        ("given 1 Available\nadvance 5\n----\n", "line 2, column 1: advance to=MS"),
        ("given 1 Available\nadvance to=9\n----\n\nadvance to=8\n----\n", "line 5, column 9: it is 9 ms already"),
        ("given 1 Available\nrun 3\n----\n", "line 2, column 5: run stands alone"),
        ("given 1 1 Available\nrun\n----\n", "line 1, column 9: FLS 1 is there already"),
        ("given 1 2 Available\ngiven 2 Available\nrun\n----\n", "line 2, column 7: FLS 2 is there already"),
        ("given 1 Available with=999\nrun\n----\n", "line 1, column 19: Available is owed to nobody"),
        ("given 1 Deploying with=2\nrun\n----\n", "line 1, column 19: Deploying is owed to nobody"),
        ("given 1 Available xi=2 xi=3\nrun\n----\n", "line 1, column 24: xi is said twice"),
        ("", "line 1, column 1: nothing happens"),
        ("# Rule 1, and no more\n\n", "line 1, column 1: nothing happens"),
    ],
)  # fmt: skip
def test_what_is_no_scenario_is_refused_with_line_and_column(text, where):
    with pytest.raises(BadInput) as refused:
        play(parse(text, "file.txt"))
    line = str(refused.value)
    assert line.startswith("scenario: file.txt, line ")
    assert where in line
    assert "\n" not in line


def test_a_file_that_is_no_text(tmp_path):
    (tmp_path / "bytes.txt").write_bytes(b"given \xff\n")
    for name in ("bytes.txt", "nothing.txt", "."):
        with pytest.raises(BadInput, match="a file of commands"):
            read(tmp_path / name)


def test_settings_that_go_together_may_stand_on_one_line():
    text = "set challenge_on_available=true accept_gap_ms=20\ngiven 1 2 Available\n\ntick 1\n----\n"
    assert play(parse(text, "gap"))
    with pytest.raises(BadInput, match="line 1, column 33: accept_gap_ms"):
        play(parse(text.replace("=20", "=-1"), "gap"))


def test_what_has_no_end_is_ended(monkeypatch):
    monkeypatch.setattr(stage, "DELIVERIES", 2)
    assert play(parse("given 1 2 Available\n\ntick 1\nrun\n----\n".replace("run", "deliver"), "short"))
    with pytest.raises(BadInput, match="line 4, column 1: there is no end of it: 2 datagrams"):
        play(parse("given 1 2 Available\n\ntick 1\nrun\n----\n", "long"))
