import base64
import csv
import io
import json
import re
import shutil
from html.parser import HTMLParser
from itertools import pairwise

import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure

from swarmer.commands.report import command
from swarmer.errors import BadInput
from swarmer.observe import report
from swarmer.observe.report import make_report, write_report
from swarmer.observe.report_drawing import ROUNDS, SECONDS, logarithmic
from swarmer.observe.report_words import preset_of, settings, verdict
from swarmer.observe.saved_run import SavedRun, load

VOID = {"meta", "link", "br", "hr", "img", "input"}
FIGURES = (
    "hd",
    "swarms",
    "cycles",
    "sizes",
    "work",
    "states",
    "distance",
    "rate",
    "kinds",
    "fidelity",
    "clouds",
)


class Page(HTMLParser):
    """What a reader of the page's structure sees; HTML that is not well-formed fails."""

    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.open, self.tags, self.headings, self.words, self.fetched = [], [], [], [], []
        self.feed(text)
        self.close()
        assert not self.open, f"never closed: {self.open}"
        self.ids = [attrs["id"] for _, attrs in self.tags if attrs.get("id")]

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        self.tags.append((tag, attrs))
        self.fetched += [attrs[name] for name in ("src", "href", "xlink:href", "action") if attrs.get(name)]
        self.fetched += re.findall(r"url\(([^)]+)\)", " ".join(filter(None, attrs.values())))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        if tag in VOID:
            return
        while self.open and self.open[-1] != tag and self.open[-1] in ("option", "li", "p"):
            self.open.pop()
        assert self.open, f"</{tag}> without a beginning"
        assert self.open.pop() == tag

    def handle_data(self, data):
        where = self.open[-1] if self.open else ""
        if re.fullmatch("h[1-6]", where):
            self.headings.append((int(where[1]), data))
        if where not in ("script", "style"):
            self.words.append(data)

    def attributes(self, tag):
        return [attrs for name, attrs in self.tags if name == tag]

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())


def csv_data(page, key):
    """The data that a figure's link carries."""
    link = next(attrs for attrs in page.attributes("a") if attrs.get("download") == f"{key}.csv")
    return list(csv.reader(io.StringIO(base64.b64decode(link["href"].partition("base64,")[2]).decode())))


@pytest.fixture(scope="module")
def made(finished_run):
    """The report of the finished run: its text, and what a reader sees. Made once: drawing takes a second."""
    text = make_report([load(finished_run)])
    return text, Page(text)


def test_it_is_one_file_that_fetches_nothing(made):
    text, page = made
    assert all(one.startswith(("#", "data:")) for one in page.fetched), page.fetched
    policy = next(attrs["content"] for attrs in page.attributes("meta") if "http-equiv" in attrs)
    assert policy.startswith("default-src 'none'")
    assert "@import" not in text
    assert len(text) < 1_500_000
    assert "Not everything is there" not in text


def test_only_scripts_that_the_policy_names_are_there(made):
    import hashlib

    text, page = made
    scripts = re.findall(r"<script>(.*?)</script>", text, re.DOTALL)
    policy = next(attrs["content"] for attrs in page.attributes("meta") if "http-equiv" in attrs)
    allowed = re.findall(r"'sha256-([^']+)'", policy)
    assert [base64.b64encode(hashlib.sha256(one.encode()).digest()).decode() for one in scripts] == allowed
    assert len(scripts) == 2
    assert not re.search(r" on\w+=", re.sub(r"<script.*?</script>", "", text, flags=re.DOTALL))


def test_it_has_landmarks_headings_in_order_and_ids_once(made):
    _, page = made
    assert [len(page.attributes(tag)) for tag in ("header", "main", "footer", "nav", "h1")] == [1] * 5
    levels = [level for level, _ in page.headings]
    assert all(after <= before + 1 for before, after in pairwise(levels))
    assert sorted(set(page.ids)) == sorted(page.ids)
    targets = {one[1:] for one in page.fetched if one.startswith("#")}
    assert targets <= set(page.ids)


def test_every_figure_has_words_data_and_both_to_take_away(made):
    _, page = made
    figures = [attrs.get("id") for attrs in page.attributes("figure")]
    assert figures == ["scene", *FIGURES]
    svgs = page.attributes("svg")
    assert len(svgs) == len(FIGURES)
    assert all(attrs["role"] == "img" and len(attrs["aria-label"]) > 20 for attrs in svgs)
    assert [attrs["data-svg"] for attrs in page.attributes("button") if "data-svg" in attrs] == [*FIGURES]
    for key in FIGURES:
        rows = csv_data(page, key)
        assert len(rows) > 1
        assert {len(row) for row in rows} == {len(rows[0])}


def test_figures_take_their_colours_from_the_page(made):
    text, _ = made
    svg = re.search(r"<figure id=\"hd\".*?</svg>", text, re.DOTALL).group()
    assert "var(--c0)" in svg
    assert not re.search(r"#0[0-9a-f]{5}\b", svg)
    assert "<text" in svg, "text stays text"


def test_the_data_is_what_the_run_has(made, finished_run):
    _, page = made
    timeline = load(finished_run).timeline
    hd = csv_data(page, "hd")
    assert hd[0] == ["t_s", "hd_cells", "hd_absolute_cells"]
    shown = np.isfinite(timeline.hd_cells)
    np.testing.assert_allclose([float(row[1]) for row in hd[1:]], timeline.hd_cells[shown], rtol=1e-5)
    assert all(float(row[2]) >= 0.3 * float(row[1]) for row in hd[1:])
    states = csv_data(page, "states")
    assert {sum(map(int, row[1:])) for row in states[1:]} == {40}
    kinds = {row[0]: row[1:] for row in csv_data(page, "kinds")[1:]}
    assert kinds["CHALLENGE_INIT"] == ["4000", "8000", str(4000 * 154), str(8000 * 154)]
    rate = np.array([list(map(float, row)) for row in csv_data(page, "rate")[1:]])
    np.testing.assert_allclose(rate[:, 1:3].sum(axis=1), 900, rtol=1e-6)
    distance = csv_data(page, "distance")[-1]
    assert list(map(float, distance[1:])) == [12 * 40, 4 * 40, 40 * 40]
    sizes = csv_data(page, "sizes")
    assert sum(map(float, sizes[-1][1:])) == 40


def test_it_says_what_was_run_and_how_to_run_it_again(made):
    text, page = made
    for part in ("swarmer-run --shape ball", "# from its resolved settings", "numpy", "python", "duration_s"):
        assert part in text
    assert "75 settings as in the preset" not in page.text  # seed and duration differ
    assert re.search(r"\d+ settings as in the preset", page.text)
    assert re.search(r"<code>radio.loss</code></td><td class=value>0</td>", text)
    assert "No FLS failed" in page.text or "no FLS failed" in page.text


def test_the_same_run_gives_the_same_bytes(finished_run, tmp_path, quick):
    out = write_report([finished_run], tmp_path / "report.html")
    assert out.read_bytes() == write_report([finished_run], out).read_bytes()


def test_command_writes_beside_the_run_and_prints_where(finished_run, tmp_path, quick):
    run = shutil.copytree(finished_run, tmp_path / "run")
    done = CliRunner().invoke(command, [str(run)], standalone_mode=False)
    assert done.output.splitlines()[-1] == str(run / "report.html")
    assert (run / "report.html").exists()


def test_a_file_that_is_no_report_is_not_replaced(finished_run, tmp_path):
    (tmp_path / "mine.html").write_text("mine")
    with pytest.raises(BadInput, match="no report of ours"):
        write_report([finished_run], tmp_path / "mine.html")
    assert (tmp_path / "mine.html").read_text() == "mine"


@pytest.mark.parametrize("name", ["missing", "empty", "file"])
def test_what_is_no_run_directory_is_refused(tmp_path, name):
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").write_text("x")
    with pytest.raises(BadInput, match="run"):
        write_report([tmp_path / name])


EVIL = "<script>alert(1)</script>"


def test_text_from_the_run_is_text(finished_run, tmp_path):
    run = shutil.copytree(finished_run, tmp_path / "<script>.xyz")
    summary = json.loads((run / "summary.json").read_text())
    changed = {**summary, "shape": EVIL, "message": EVIL, EVIL: EVIL}
    (run / "summary.json").write_text(json.dumps(changed))
    (run / "config.yaml").write_text(f"'{EVIL}': '{EVIL}'\n")
    (run / "events.csv").write_text(f"t_s,kind,fid,text\n1,{EVIL},0,{EVIL}\n")
    text = write_report([run]).read_text()
    scripts = re.findall(r"<script[^>]*>", text)
    data = '<script type="application/octet-stream" id="scene-{}">'
    assert set(scripts) == {"<script>", data.format("data"), data.format("facts")}
    assert len(scripts) == 4
    assert "alert(1)" in Page(text).text


def test_labels_with_dollars_are_no_formulas(finished_run, tmp_path):
    one = shutil.copytree(finished_run, tmp_path / "a$b_{$")
    two = shutil.copytree(finished_run, tmp_path / "two")
    text = (two / "config.yaml").read_text()
    (two / "config.yaml").write_text(text.replace("technique: signal_strength", "technique: 'x$y^{$'"))
    assert "x$y^{$" in make_report([load(one), load(two)])


def test_a_run_without_series_says_which_figures_it_lacks(finished_run):
    run = load(finished_run)
    run.timeline.series, run.timeline.flown_cells = {}, None
    page = Page(make_report([run]))
    for title in (
        "Distance flown",
        "Datagrams and bytes per second",
        "Fidelity",
        "Localizations, anchorings, leases",
    ):
        assert f"{title}: " in page.text
    assert [attrs.get("id") for attrs in page.attributes("figure")] == [
        "scene", "hd", "swarms", "cycles", "sizes", "states", "clouds",
    ]  # fmt: skip


def test_the_faults_of_a_schedule_are_told_one_by_one(finished_run, quick):
    run = load(finished_run)
    fault = {"at": 1.5, "for": 2, "what": "cut", "where": {"half": "low", "axis": "L"}, "kinds": ["MERGE"]}
    run.config["faults"] = {"schedule": [fault] * 30}
    page = make_report([run])
    line = "at: 1.5, for: 2, what: cut, where: {half: low, axis: L}, kinds: [MERGE]"
    assert page.count(f"<li>{line}</li>") == 20
    assert "<li>and 10 more, in config.yaml</li>" in page


def test_failures_are_shown_where_there_are_some(finished_run, quick):
    from swarmer.engines.result import Event

    run = load(finished_run)
    run.timeline.lit[30:40, 3] = False
    run.events += [Event(3.0, "failure", 4, "went dark"), Event(4.0, "replacement", 4, "incarnation 1")]
    rows = csv_data(Page(make_report([run])), "failures")
    assert [row[2] for row in rows[1:]][29:41] == ["0", *["1"] * 10, "0"]


def test_a_short_formation_is_drawn_once_more(finished_run, quick):
    run = load(finished_run)
    assert "formation" not in Page(make_report([run])).ids
    run.summary["time_to_hd_s"] = {"1": 1.0, "0.1": 2.0, "0.01": None}
    rows = csv_data(Page(make_report([run])), "formation")
    assert (rows[0], rows[1][0], rows[-1][0]) == (["t_s", "hd_cells", "swarms"], "0.0", "2.5")


def test_a_newer_format_is_told(finished_run, tmp_path, quick):
    run = shutil.copytree(finished_run, tmp_path / "run")
    summary = json.loads((run / "summary.json").read_text())
    (run / "summary.json").write_text(json.dumps({**summary, "format": 7, "news": [1, 2]}))
    page = Page(make_report([load(run)]))
    assert "summary.json: format 7, newer than 1" in page.text
    assert "news" in page.text


def rounds_csv(count):
    """A line for each round, as the rounds engine writes it, with something unread in it."""
    titles = "round,swarms,hd_cells,localizing,anchors,group_mean,group_max,flight_min,flight_mean,flight_max"
    lines = [
        f"{i},9,{'' if i % 2 else 1.5},{2 * i},{i},1.5,3,0.1,{9 / (i + 1)},7,{i},{3 * i}"
        for i in range(count)
    ]
    return "\n".join([f"{titles},localizing_cells,swarm_cells", *lines]) + "\n"


def test_a_run_of_rounds_is_told_in_rounds(finished_run, tmp_path):
    run = load(shutil.copytree(finished_run, tmp_path / "run"))
    (run.path / "rounds.csv").write_text(rounds_csv(len(run.timeline.t_s)))
    nothing = dict.fromkeys(run.summary)
    run.summary = nothing | {
        "format": 1, "engine": "rounds", "shape": "ball", "points": 40, "seed": 1, "status": "done", "rounds": 21,
        "hd_cells": 0.05, "hd_min_cells": 0.05, "first_single_swarm_round": 5, "single_swarm_count": 4,
        "thaws_at_one_swarm": 3,
        "rounds_to_hd": {"1": 12, "0.1": 20, "0.09": 21, "0.01": None}, "time_to_hd_s": dict.fromkeys(("1", "0.1")),
    }  # fmt: skip
    run.timeline.series = {}
    page = Page(make_report([run]))
    assert "became one swarm in round 5 and came within 0.09 cells of the shape in round 21" in page.text
    assert "21 rounds" in page.text
    assert csv_data(page, "hd")[0][0] == "round"
    assert csv_data(page, "merging")[1] == ["1.0", "2.0", "1.0", "1.5", "3.0"]
    assert csv_data(page, "flights")[1] == ["1.0", "0.1", "4.5", "7.0"]
    last = len(run.timeline.t_s) - 1
    assert csv_data(page, "distance")[-1][1:] == [f"{last * (last + 1) / 2}", f"{3 * last * (last + 1) / 2}"]
    (run.path / "rounds.csv").write_text("round,\n1,x\n")
    assert "merging" not in Page(make_report([run])).ids
    assert " s " not in verdict(run)


VERDICTS = [
    (
        {"status": "failed", "emulated_s": 3.0, "points": 5},
        "The run failed at 3.0 s; by then the 5 FLSs had not become one swarm and had not all been lit",
    ),
    ({"status": "interrupted", "emulated_s": 3.0}, "interrupted at 3.0 s"),
    (
        {
            "status": "interrupted",
            "emulated_s": 9.0,
            "hd_min_cells": 0.5,
            "first_single_swarm_s": 2.0,
            "time_to_hd_s": {"1": 3.0},
        },
        "had become one swarm after 2.0 s and had come within 1 cell of the shape after 3.0 s",
    ),
    (
        {
            "hd_min_cells": 0.5,
            "hd_cells": 0.3,
            "time_to_hd_s": {"0.1": 3.0},
            "points": 60,
            "lit_share": 0.9,
            "failures": 82,
        },
        "never became one swarm, yet came within 0.1 cells of the shape after 3.0 s, but ended 0.300 cells away with "
        "54 of 60 lit; there were 82 failures",
    ),
    ({"engine": "virtual", "handled_late_ms": None}, "no message was handled, so nothing says whether"),
    (
        {"next_shape": "hat", "next_at_s": 8.0, "next_time_to_hd_s": None},
        "hat, which it was to become at 8.0 s, never",
    ),
    (
        {
            "next_shape": "hat",
            "next_at_s": 8.0,
            "next_time_to_hd_s": {"1": None},
            "hd_min_cells": 0.01,
            "hd_cells": 7.0,
            "time_to_hd_s": {"0.1": 3.0},
        },
        "of the shape after 3.0 s; hat, which it was to become from 8.0 s on, was not formed",
    ),
    (
        {
            "next_shape": "hat",
            "next_at_s": 8.0,
            "next_time_to_hd_s": {"1": 2.0},
            "hd_min_cells": 0.01,
            "hd_cells": 7.0,
        },
        "from 8.0 s on it became hat, within 1 cell 2.0 s later, but ended 7.00 cells away",
    ),
    ({"status": "done", "hd_min_cells": 3.21}, "HD was never below 1 cell, 3.21 at best"),
    ({"status": "done"}, "never all lit"),
    (
        {"hd_min_cells": 0.05, "hd_cells": 4.0, "time_to_hd_s": {"0.1": 7.0, "1": 3.0}},
        "but ended 4.00 cells away",
    ),
    (
        {"hd_min_cells": 0.05, "time_to_hd_s": {"0.1": 7.0}, "points": 100, "lit_share": 0.01},
        "after 7.0 s, but too few are lit at the end.",
    ),
    (
        {"hd_min_cells": 0.05, "time_to_hd_s": {"0.1": 7.0}, "points": 100, "lit_share": 1.0},
        "after 7.0 s; how far away it ended is not known.",
    ),
    ({"faithful": False, "engine": "process"}, "this machine was too slow, so do not trust the times"),
    ({"faithful": False, "engine": "virtual"}, "the FLSs could not keep up"),
    ({"faithful": True}, "the run can be trusted"),
    ({"invariant_violations": 2}, "2 broken invariants"),
    ({}, "Nothing is left"),
]


@pytest.mark.parametrize(("summary", "words"), VERDICTS)
def test_the_verdict_is_one_sentence(tmp_path, summary, words):
    run = SavedRun(tmp_path, summary=summary)
    said = verdict(run)
    assert words in said
    assert said.endswith(".")
    assert said.count(". ") == 0
    assert said[0].isupper()


def test_settings_are_compared_with_the_preset_of_the_command():
    assert preset_of("swarmer-run --config paper --shape hat") == "paper"
    assert preset_of('swarmer-run "') == "default"
    from swarmer.config import load_config

    config = load_config("paper", lambda_ms=123).model_dump(mode="json")
    changed = {row.name: (row.value, row.usual) for row in settings(config, "paper") if row.changed}
    assert changed == {"lambda_ms": (123, load_config("paper").lambda_ms)}
    assert len([row for row in settings(config, "default") if row.changed]) > 3


def test_every_figure_is_named_once():
    assert len(set(report.FIGURES)) == len(report.FIGURES) == 15
    assert SECONDS.column != ROUNDS.column


def test_a_run_that_said_nothing_has_no_radio_to_blame(finished_run):
    run = load(finished_run)
    run.timeline.series = {"datagrams_sent": np.zeros(len(run.timeline.t_s))}
    text = make_report([run])
    assert "Datagrams and bytes by kind: no datagram was sent" in text
    assert "Datagrams and bytes per second: no datagram was sent" in text
    run.timeline.series = {}
    assert "Datagrams and bytes per second: this engine has no radio" in make_report([run])


def test_a_report_for_a_directory_that_is_not_there_is_refused(finished_run, tmp_path):
    with pytest.raises(BadInput, match="a file in a directory that is there"):
        write_report([finished_run], tmp_path / "none" / "report.html")


def test_an_empty_list_of_events_is_told(finished_run, tmp_path):
    run = shutil.copytree(finished_run, tmp_path / "run")
    (run / "events.csv").write_text("")
    assert "events.csv: cannot be read (it is empty, without its line of titles)" in load(run).missing


def test_two_shapes_are_both_in_the_heading(finished_run):
    run = load(finished_run)
    run.summary |= {
        "next_shape": "hat", "next_points": 60, "next_at_s": 8.0, "next_time_to_hd_s": {"1": 2.0, "0.1": None}
    }  # fmt: skip
    page = make_report([run])
    assert ": 40 FLSs, then hat: 60 FLSs</h1>" in page
    assert "<b class=''>2.0 s</b><span>from the change until HD &lt; 1 of hat</span>" in page


@pytest.mark.parametrize(
    ("low", "high", "said"), [(2.1, 8.9, {"2", "5"}), (4, 6, {"4", "5", "6"}), (0.1, 9, {"1"})]
)
def test_a_logarithmic_axis_has_numbers_however_short(low, high, said):
    figure = Figure()
    axes = figure.subplots()
    logarithmic(axes)
    axes.plot([0, 1], [low, high])
    figure.canvas.draw()
    shown = {text.get_text() for text in [*axes.get_yticklabels(), *axes.get_yticklabels(minor=True)]}
    assert said <= shown
    assert low >= 1 or not {"2", "5"} & shown
