"""Shipped shapes made anew by the script that made them; for tests."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from swarmer.shapes.catalogue import load_shape
from swarmer.shapes.neighbours import neighbour_plan

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"


def assert_shipped(name, count, corner, gap, link):
    """Its count, box, least gap and longest planned link (cells), in one part."""
    cloud = load_shape(name)
    plan = neighbour_plan(cloud.points)
    assert len(cloud) == count
    np.testing.assert_allclose(cloud.points.min(axis=0), 3)
    np.testing.assert_allclose(cloud.points.max(axis=0), corner)
    assert plan.spacing_min_cells >= gap
    assert plan.components == 1
    assert plan.longest_link_cells < link
    assert cloud.licence == "MIT"


def remaking(test):
    """Mark a test that makes shapes anew: it takes long, and needs the extra `shapes`."""
    without = importlib.util.find_spec("manifold3d") is None
    return pytest.mark.slow(pytest.mark.skipif(without, reason="needs the extra `shapes`")(test))


def made_anew(name, monkeypatch):
    """The points (F, 3) that `scripts/make_pointclouds.py` would write, in display cells."""
    monkeypatch.syspath_prepend(SCRIPTS)
    spec = importlib.util.spec_from_file_location("make_pointclouds", SCRIPTS / "make_pointclouds.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    points = script.made(name)
    for module in [module for module in sys.modules if module.partition(".")[0] == "solids"]:
        del sys.modules[module]
    return points


def assert_made_anew(name, monkeypatch):
    np.testing.assert_allclose(made_anew(name, monkeypatch), load_shape(name).points, atol=0.002)
