"""Real processes over real UDP: small, few and patient, for these machines may be busy."""

import json
import math

import numpy as np
import pytest
from helpers import events, run, small, start

from swarmer.config import load_config

# Names that CONTRACT.md promises of a network engine.
PROMISED = [
    "format",
    "engine",
    "shape",
    "points",
    "seed",
    "status",
    "emulated_s",
    "wall_s",
    "hd_cells",
    "hd_min_cells",
    "hd_absolute_cells",
    "time_to_hd_s",
    "first_single_swarm_s",
    "single_swarm_count",
    "thaws",
    "swarms_last",
    "lit_share",
    "launch_s",
    "distance_cells_mean",
    "localizations",
    "anchorings",
    "leases_expired",
    "datagrams_sent",
    "datagrams_delivered",
    "datagrams_lost",
    "bytes_sent",
    "bytes_delivered",
    "failures",
    "replacements",
    "processes",
    "memory_mb_per_fls",
    "timer_late_ms",
    "handled_late_ms",
    "time_scale",
    "faithful",
    "suggested_time_scale",
]


@pytest.mark.parametrize("loop", ["single", "threads", "asyncio"])
def test_a_swarm_localizes_whatever_the_loop(tmp_path, loop):
    summary = small(tmp_path, "--set", f"fls_loop={loop}", duration=8)
    assert set(PROMISED) <= summary.keys()
    assert summary["status"] == "done"
    assert summary["engine"] == "process"
    assert summary["lit_share"] == 1
    assert summary["processes"] == summary["points"] == 16
    assert summary["first_single_swarm_s"] is not None
    assert summary["hd_min_cells"] < 1.0
    assert summary["localizations"] >= 15
    assert summary["rejected"] == 0
    # Nothing is lost on this radio; a datagram to several is delivered several times.
    assert summary["datagrams_lost"] == 0
    assert summary["bytes_sent"] == 154 * summary["datagrams_sent"]


def test_the_run_directory_is_whole_and_runs_again(tmp_path):
    summary = small(tmp_path, "--seed", "5", points=12, duration=2)
    names = {path.name for path in summary["dir"].iterdir()}
    assert names == {
        "config.yaml", "manifest.json", "timeline.npz", "events.csv", "summary.json", "log.txt",
    }  # fmt: skip
    with np.load(summary["dir"] / "timeline.npz") as timeline:
        totals = dict(zip(timeline["series_name"].tolist(), timeline["series"][-1], strict=True))
        for way in (
            "sent",
            "delivered",
        ):  # each of 12 FLSs may have been between two counts when it was looked at
            by_kind = sum(total for name, total in totals.items() if name.startswith(f"{way}_"))
            assert abs(by_kind - totals[f"datagrams_{way}"]) <= 24
            assert by_kind > 0
        flown = timeline["flown_cells"].sum(axis=0)
        np.testing.assert_allclose(flown, [totals["localizing_cells"], totals["following_cells"]], rtol=1e-9)
        times, count = len(timeline["t_s"]), 12
        assert timeline["truth"].shape == (count, 3)
        assert timeline["position"].shape == (times, count, 3)
        for name in ("swarm", "state", "lit"):
            assert timeline[name].shape == (times, count)
        assert timeline["hd_cells"].shape == (times,)
        assert times >= 15
    again = load_config(summary["dir"] / "config.yaml")
    assert (
        again.flat()
        == load_config(
            None, shape="random", points=12, duration_s=2, seed=5, **{"recording.enabled": False}
        ).flat()
    )


def test_a_flight_is_seen_as_motion(tmp_path):
    """Deployment takes about a second: the samples in between show FLSs on their way, not jumps."""
    summary = small(tmp_path, "--set", "recording.rate_hz=20", points=12, duration=2)
    with np.load(summary["dir"] / "timeline.npz") as timeline:
        lit, position, truth = timeline["lit"], timeline["position"], timeline["truth"]
    dark = position[~lit.any(axis=1)]
    way = np.linalg.norm(dark, axis=2) / np.linalg.norm(truth, axis=1)
    assert ((way > 0.05) & (way < 0.95)).sum() > 10
    assert (np.diff(way, axis=0) > -1e-6).all()


def test_loss_is_drawn_and_counted(tmp_path):
    summary = small(tmp_path, "--set", "radio.loss=0.2", duration=6)
    assert summary["datagrams_lost"] > 0
    share = summary["datagrams_lost"] / (summary["datagrams_delivered"] + summary["datagrams_lost"])
    assert 0.1 < share < 0.5
    assert summary["localizations"] > 5


def test_delay_and_duplicates_and_reordering(tmp_path):
    rules = ("radio.delay_ms=10", "radio.jitter_ms=5", "radio.duplicate=0.3", "radio.reorder=0.2")
    summary = small(tmp_path, *(word for rule in rules for word in ("--set", rule)), duration=6)
    assert summary["localizations"] > 5
    assert summary["hd_min_cells"] < 1.0


def test_a_sensor_that_takes_its_time_measures_its_anchor(tmp_path):
    """While samples are taken others speak; whoever measured to them instead would fly anywhere."""
    rules = ("sensing.samples=3", "sensing.sample_ms=20", "sensing.model=uniform", "sensing.error_percent=1")
    summary = small(tmp_path, *(word for rule in rules for word in ("--set", rule)), duration=8)
    assert summary["localizations"] > 5
    assert summary["hd_min_cells"] < 1.0


def test_signed_datagrams_are_believed(tmp_path):
    summary = small(tmp_path, "--set", "radio.mac=true")
    assert summary["localizations"] > 5
    assert summary["bytes_sent"] == 162 * summary["datagrams_sent"]
    assert summary["rejected"] == 0


@pytest.mark.parametrize("carrier", ["unicast", "broadcast"])
@pytest.mark.parametrize("kernel_filter", ["auto", "off"])
def test_every_carrier_carries(tmp_path, carrier, kernel_filter):
    summary = small(
        tmp_path, "--set", f"radio.carrier={carrier}", "--set", f"radio.kernel_filter={kernel_filter}"
    )
    assert summary["first_single_swarm_s"] is not None
    assert summary["localizations"] > 5


def test_failures_are_replaced_and_lit_again(tmp_path):
    summary = small(tmp_path, "--set", "failure.rate=0.1", points=20, duration=8)
    assert summary["failures"] > 0
    assert summary["replacements"] == summary["failures"]
    kinds = [event["kind"] for event in events(summary["dir"])]
    assert kinds.count("failure") == summary["failures"]


def test_batteries_run_low_and_a_standby_takes_over(tmp_path):
    summary = small(tmp_path, "--set", "failure.battery_s=3", points=10, duration=7)
    kinds = [event["kind"] for event in events(summary["dir"])]
    assert kinds.count("departure") >= 10
    assert kinds.count("replacement") >= 10


def test_centralized_thaws_at_one_swarm(tmp_path):
    summary = small(tmp_path, "--set", "thaw.policy=centralized", duration=6)
    assert summary["thaws"] >= 2
    assert summary["single_swarm_count"] >= summary["thaws_at_one_swarm"] >= 2


@pytest.mark.parametrize("policy", ["roster", "census", "corner"])
def test_the_flss_find_one_swarm_by_themselves(tmp_path, policy):
    """By the clock there would be no thaw before second 16."""
    rules = (f"thaw.policy={policy}", "thaw.rest_below_cells=0")
    summary = small(tmp_path, *(word for rule in rules for word in ("--set", rule)), duration=6)
    assert summary["thaws"] >= 1
    assert summary["thawed_flss"] >= summary["points"] - 1
    assert summary["hd_cells"] < 0.5
    how = summary["thaws_at_one_swarm"] + summary["wrong_thaws"] + summary["thaws_by_clock"]
    assert summary["thaws"] - 2 <= how <= summary["thaws"], "one may not have reached all at the end"
    if policy == "roster":  # which never errs where nobody is lost and Swarm-IDs only fall
        assert summary["single_swarm_count"] >= summary["thaws_at_one_swarm"] >= 1
        assert summary["first_single_swarm_s"] < summary["emulated_s"]
        assert (summary["wrong_thaws"], summary["thaws_by_clock"]) == (0, 0)


def test_where_nobody_counts_thaws_nobody_tells_how_they_began(tmp_path):
    summary = small(tmp_path, "--config", "paper", "--set", "thaw.h_s=1", duration=4)
    assert summary["thaws"] >= 1
    assert summary["thaws_at_one_swarm"] is summary["thaws_by_clock"] is None


@pytest.mark.parametrize("preset", ["paper", "authors_code"])
def test_the_presets_run(tmp_path, preset):
    summary = small(tmp_path, "--config", preset, duration=6)
    assert summary["localizations"] > 5


def test_until_hd_ends_early(tmp_path):
    summary = small(tmp_path, "--until-hd", "2", duration=30)
    assert summary["hd_cells"] < 2
    assert summary["emulated_s"] < 25


def test_a_random_start_is_in_the_display(tmp_path):
    summary = small(tmp_path, "--set", "deploy.start=random", duration=3)
    with np.load(summary["dir"] / "timeline.npz") as timeline:
        first, truth = timeline["position"][0], timeline["truth"]
    assert (first >= truth.min(axis=0) - 1e-5).all()
    assert (first <= truth.max(axis=0) + 1e-5).all()
    assert np.linalg.norm(first - truth, axis=1).min() > 0


def test_a_launch_rate_keeps_flss_waiting(tmp_path):
    summary = small(tmp_path, "--set", "deploy.rate_per_s=8", duration=4)
    assert summary["lit_share"] == 1
    assert summary["all_lit_s"] > 15 / 8


def test_two_runs_at_once_do_not_hear_each_other(tmp_path):
    outs = [tmp_path / "a", tmp_path / "b"]
    arguments = ["--shape", "random", "--points", "12", "--duration", "4", "--no-recording", "--json"]
    both = [
        start(*arguments, "--seed", str(i), "--out", str(out), cwd=tmp_path) for i, out in enumerate(outs)
    ]
    for process in both:
        out, err = process.communicate(timeout=90)
        assert process.returncode == 0, err
        summary = json.loads(out)
        assert summary["rejected"] == 0
        assert summary["localizations"] > 5


def test_your_own_file_runs(tmp_path):
    cloud = tmp_path / "mine.csv"
    cloud.write_text("".join(f"{x},{y},0\n" for x in range(0, 12, 3) for y in range(0, 12, 3)))
    done = run("--shape", str(cloud), "--duration", "3", "--no-recording", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert summary["points"] == 16
    assert summary["shape"] == "mine"
    assert math.isfinite(summary["hd_cells"])


def test_the_other_rules_in_processes(tmp_path):
    """Physical Movement's two legs, sizes in messages, a challenge at every tick, FLSs that begin anywhere."""
    rules = (
        "technique=physical_movement",
        "anchor=largest",
        "challenge_policy=always",
        "deploy.start=random",
    )
    summary = small(
        tmp_path, *(word for rule in rules for word in ("--set", rule)), "--seed", "3", duration=5
    )
    assert summary["localizations"] > 5
    assert summary["lit_share"] == 1
    assert summary["all_lit_s"] < 1
    assert summary["distance_cells_mean"] > 5


def test_a_swarm_becomes_the_next_shape(tmp_path):
    """12 processes, 16 from second 4 on; and the other way round with a thaw policy that counts."""
    summary = small(
        tmp_path, "--then", "cube", "--at", "4", "--set", "transition.points=16", points=12, duration=9
    )
    assert (summary["points"], summary["next_points"], summary["joins"]) == (12, 16, 4)
    assert summary["lit_share"] == 1
    assert summary["next_time_to_hd_s"]["1"] is not None
    with np.load(summary["dir"] / "timeline.npz") as timeline:
        before = timeline["lit"][timeline["t_s"] < 4]
        assert not before[:, 12:].any(), "who joins waits in the dark"
        error = np.linalg.norm(timeline["position"][-1] - timeline["truths"][1], axis=1)
    assert error.max() < 3


def test_an_oracle_makes_the_display_stand_where_it_should(tmp_path):
    summary = small(tmp_path, "--set", "oracle.count=2", points=12, duration=6)
    assert summary["hd_absolute_cells"] < 0.2
    assert summary["time_to_hd_absolute_s"]["1"] is not None


def test_standbys_take_over_the_lights_of_who_charges(tmp_path):
    rules = ("battery.light_s=5", "battery.charge_s=1", "battery.standby_group=1")
    summary = small(tmp_path, *(word for rule in rules for word in ("--set", rule)), points=8, duration=8)
    assert summary["departures"] >= 8
    assert summary["replacements"] >= summary["departures"] - 1
    assert summary["illumination_mean"] > 0.9
