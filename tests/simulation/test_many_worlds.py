"""Random settings and faults against the invariants: many small worlds, from seeds."""

from random import Random

import pytest
from invariants import Broken, Watch
from world import World

from swarmer.config import load_config


def settings(rng):
    drawn = {
        "m": rng.choice(["inf", 2]), "busy_join": rng.choice(["newcomer", "all", "off"]),
        "anchor": rng.choice(["lowest", "lowest", "largest", "smallest", "challenger", "random"]),
        "lambda_ms": rng.choice([50, 200, 500]), "lease_ms": rng.choice([20, 50, 250]), "epochs": rng.random() < 0.8,
        "thaw.repeat": rng.choice([0, 0.5]), "thaw.h_s": rng.uniform(0.5, 4.0), "epsilon_deg": rng.choice([0, 5, 30]),
        "challenge_policy": rng.choice(["r_complete", "decay"]), "waiting_ends": rng.choice(["bound", "bound", "tick"]),
        "lease_margin_ms": rng.choice([0, 100]), "sensing.sample_ms": rng.choice([0, 0, 20]),
    }  # fmt: skip
    if rng.random() < 0.2:
        drawn |= {"challenge_on_available": True, "accept_gap_ms": 20}
    if rng.random() < 0.5:
        drawn |= {"radio.loss": rng.choice([0.05, 0.3])}
    if rng.random() < 0.4:
        drawn |= {"radio.duplicate": 0.3}
    if rng.random() < 0.4:
        drawn |= {"radio.reorder": 0.3, "radio.reorder_ms": rng.choice([5, 200]), "radio.jitter_ms": 20}
        drawn |= {"radio.delay_ms": rng.choice([0, 20, 300])}
    return drawn


def play(seed, watch=Watch):
    rng = Random(f"world {seed}")
    config = load_config(None, [], shape="random", points=rng.randrange(2, 24), seed=seed, **settings(rng))
    world = World(config, rng.choice([(0.0, 0.0), (0.0005, 0.0015), (0.01, 0.05)]))
    watched = watch(world)
    for turn in range(1, 8):
        world.run(turn * 0.7)
        if rng.random() < 0.5:
            world.kill(rng.randrange(1, world.plan.size + 1))
        for fid, body in list(world.bodies.items()):
            if not body.alive and rng.random() < 0.6:
                world.replace(fid)
    return watched


@pytest.mark.parametrize("seed", range(1, 41))
def test_world(seed):
    play(seed)


@pytest.mark.slow
@pytest.mark.parametrize("block", range(10))
def test_many_worlds(block):
    for seed in range(1000 + 40 * block, 1000 + 40 * (block + 1)):
        try:
            play(seed)
        except Broken as broken:
            raise AssertionError(f"world {seed}") from broken
