"""A technique that breaks is named with its package."""

import math

import pytest

from swarmer.errors import RunFailed
from swarmer.plugins.guarded import displacement_of, legs_of, vector_of, who_is


class Answers:
    def __init__(self, answer):
        self.answer = answer

    def displacement(self, measured, ground_truth):
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        ((1.0, 2.0), "not three numbers"),
        (7, "not three numbers"),
        (None, "not three numbers"),
        ("abc", "not three numbers"),
        ((1.0, 2.0, math.nan), "finite"),
        ((1.0, math.inf, 0.0), "finite"),
        (ZeroDivisionError("division by\nzero"), "raised ZeroDivisionError: division by zero"),
    ],
)
def test_what_cannot_be_flown_is_refused_with_the_name(answer, said):
    with pytest.raises(RunFailed) as failed:
        displacement_of(Answers(answer), "technique mine (package my-own)", (1.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    line = str(failed.value)
    assert line.startswith("technique mine (package my-own) ")
    assert said in line
    assert "\n" not in line


def test_any_three_finite_numbers_are_a_vector():
    import numpy as np

    assert vector_of(np.array([1, 2, 3]), "x") == (1.0, 2.0, 3.0)
    assert legs_of([(1, 0, 0), [0, 2, 0]], "x") == [(1.0, 0.0, 0.0), (0.0, 2.0, 0.0)]


@pytest.mark.parametrize("answer", [[], None, 3, [(1.0, 2.0)]])
def test_legs_are_a_sequence_of_vectors(answer):
    with pytest.raises(RunFailed):
        legs_of(answer, "x")


def test_the_package_is_found_by_the_entry_point():
    assert who_is("signal_strength") == "technique signal_strength (package swarmer)"
    assert who_is("nowhere") == "technique nowhere"
