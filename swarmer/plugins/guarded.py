"""What a technique answers is checked here: one that raises, or answers no vector, is named with its package.

Pure and without numpy: FLS processes may import this file.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from numbers import Real
from typing import Any

from swarmer.errors import RunFailed, shown
from swarmer.messages import Vec3
from swarmer.plugins import ENTRY_POINTS, Localizer


class BrokenTechnique(RunFailed):
    """A technique raised, or answered something that nobody can fly."""


def who_is(name: str) -> str:
    """'technique damped (package swarmer-damped)', as an error names it."""
    from importlib.metadata import entry_points

    found = [entry.dist.name for entry in entry_points(group=ENTRY_POINTS, name=name) if entry.dist]
    return f"technique {name} (package {found[0]})" if found else f"technique {name}"


def displacement_of(technique: Localizer, who: str, measured: Vec3, ground_truth: Vec3) -> Vec3:
    """What the technique says of one measurement. Raises BrokenTechnique."""
    try:
        answer = technique.displacement(measured, ground_truth)
    except Exception as error:
        raise broken(who, f"raised {type(error).__name__}: {' '.join(str(error).split())}") from error
    return vector_of(answer, who)


def vector_of(answer: object, who: str) -> Vec3:
    """The answer as a vector of three finite numbers. Raises BrokenTechnique.

    >>> vector_of([1, 2.5, 0], "technique mine")
    (1.0, 2.5, 0.0)
    """
    parts: Any = answer
    try:
        x, y, z = parts
        numbers = all(isinstance(part, Real) for part in (x, y, z))
    except (TypeError, ValueError):
        numbers = False
    if not numbers:
        raise broken(who, f"answered {shown(answer)}, not three numbers")
    vector = (float(x), float(y), float(z))
    if not all(isfinite(part) for part in vector):
        raise broken(who, f"answered {shown(answer)}; all three must be finite")
    return vector


def broken(who: str, what: str) -> BrokenTechnique:
    return BrokenTechnique(f"{who} {what}")


def legs_of(answer: object, who: str) -> Sequence[Vec3]:
    """The answer as flights one after the other. Raises BrokenTechnique."""
    if not isinstance(answer, Sequence) or not answer:
        raise broken(who, f"answered {shown(answer)}, not a sequence of legs")
    return [vector_of(leg, who) for leg in answer]
