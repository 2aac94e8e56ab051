"""Two engines, one truth: the same display, real processes over real UDP and virtual time, and the figures agree.

50 FLSs of the dragon for 8 emulated seconds, policy `roster`, 10 % loss: thaws, expired leases and lost datagrams all
occur. Six runs of processes, thirty in virtual time, and the intervals of the fifteen means in FIGURES overlap.

They are intervals of 99.9 %. Among 300 runs in virtual time, parted 4,000 times at random into six and thirty, any of
the fifteen was apart once in 4,000 times (with intervals of 95 % once in 8). What the machine does to real processes is
not in that, but three engines that are broken on purpose are told apart by the same six runs.
"""

import json

import pytest
from helpers import start
from mutants import MUTANTS

from swarmer.config import load_config
from swarmer.experiments.experiment import QUIET
from swarmer.experiments.one_run import perform
from swarmer.experiments.two_engines import compare, figures_of

SETTINGS = {
    "shape": "dragon",
    "points": 50,
    "duration_s": 8,
    "thaw.policy": "roster",
    "radio.loss": 0.1,
}
FIGURES = (
    "HD at 2 s, cells", "HD at 5 s, cells", "swarms at 2 s", "largest swarm at 2 s", "swarms at 3 s",
    "largest swarm at 3 s", "localizations", "anchorings", "leases_granted", "leases_expired", "datagrams_sent",
    "datagrams_delivered", "datagrams_lost", "handled", "distance_cells_mean",
)  # fmt: skip
LEVEL = 0.999
PROCESS_SEEDS, AT_A_TIME, ENOUGH = range(1, 7), 3, 5
VIRTUAL_SEEDS, BROKEN_SEEDS = range(101, 131), range(101, 113)

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(300),
]  # some 45 s on two cores that have other things to do


@pytest.fixture(scope="module")
def processes(tmp_path_factory):
    """What real processes did, of the runs in which this machine was quick enough to be believed."""
    where = tmp_path_factory.mktemp("processes")
    words = [word for name, value in SETTINGS.items() for word in ("--set", f"{name}={value}")]
    seeds = list(PROCESS_SEEDS)
    for at in range(0, len(seeds), AT_A_TIME):
        running = [
            start(*words, "--no-recording", "--seed", str(seed), "--out", str(where / f"{seed}"), cwd=where)
            for seed in seeds[at : at + AT_A_TIME]
        ]
        for process in running:
            _, err = process.communicate(timeout=200)
            assert process.returncode == 0, err
    believed = [
        where / f"{seed}"
        for seed in seeds
        if json.loads((where / f"{seed}" / "summary.json").read_text())["faithful"]
    ]
    if len(believed) < ENOUGH:
        pytest.skip(f"this machine is too busy: {len(believed)} of {len(seeds)} runs were faithful")
    return [figures_of(directory) for directory in believed]


def virtual(where, seeds, **settings):
    """The figures of runs in virtual time."""
    found = []
    for seed in seeds:
        config = load_config(None, (), **QUIET, **{**SETTINGS, **settings}, engine="virtual", seed=seed)
        outcome = perform(config, where / f"{seed}")
        assert outcome.status == "done", outcome
        found.append(figures_of(where / f"{seed}"))
    return found


def apart(one, other):
    """The comparisons whose intervals do not overlap."""
    return [found for found in compare(one, other, LEVEL) if found.quantity in FIGURES and found.apart]


def test_both_engines_tell_the_same(tmp_path, processes):
    found = virtual(tmp_path, VIRTUAL_SEEDS)
    assert set(FIGURES) <= set(found[0])
    assert apart(processes, found) == []


@pytest.mark.parametrize(
    ("settings", "seen"),
    [({"epsilon_deg": 0}, "HD at 2 s, cells"), ({"radio.loss": 0.3}, "datagrams_lost")],
    ids=["flights without error", "three times the loss"],
)
def test_an_engine_with_another_physics_is_told_apart(settings, seen, tmp_path, processes):
    assert seen in [found.quantity for found in apart(processes, virtual(tmp_path, BROKEN_SEEDS, **settings))]


def test_an_engine_whose_anchors_ignore_fin_is_told_apart(tmp_path, monkeypatch, processes):
    (mutant,) = (one for one in MUTANTS if one.name == "FIN ignored")
    mutant.apply(monkeypatch)
    assert "leases_expired" in [found.quantity for found in apart(processes, virtual(tmp_path, BROKEN_SEEDS))]
