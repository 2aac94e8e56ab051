"""Where an FLS is while it flies: a trapezoid velocity profile (SwarMer, section 2).

Accelerate, cruise, brake to zero exactly at the end; short flights never reach the top speed. A flight is data, so
whoever holds it can tell the position at any moment and nobody needs to publish it step by step.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

Vec3 = tuple[float, float, float]


class Velocity(NamedTuple):
    """Top speed in cells/s, acceleration and braking in cells/s²; all above 0."""

    speed: float
    acceleration: float
    braking: float


class Flight(NamedTuple):
    """A straight flight: from `start` by `displacement` (display cells), beginning at emulated second `begins_s`."""

    start: Vec3
    displacement: Vec3
    begins_s: float
    duration_s: float
    length: float


def plan_flight(start: Vec3, displacement: Vec3, begins_s: float, velocity: Velocity) -> Flight:
    """The flight that a displacement takes under a velocity profile."""
    x, y, z = displacement
    length = sqrt(x * x + y * y + z * z)
    return Flight(start, displacement, begins_s, duration(length, velocity), length)


def way(here: Vec3, there: Vec3) -> Vec3:
    """The vector from one place to another."""
    return (there[0] - here[0], there[1] - here[1], there[2] - here[2])


def peak_speed(length: float, velocity: Velocity) -> float:
    """The highest speed reached on a way of `length` cells."""
    speed, a, b = velocity
    return min(speed, sqrt(2.0 * length * a * b / (a + b)))


def duration(length: float, velocity: Velocity) -> float:
    """Seconds for a way of `length` cells.

    >>> round(duration(1.0, Velocity(200.0, 200.0, 200.0)), 4)
    0.1414
    """
    peak = peak_speed(length, velocity)
    if peak == 0.0:
        return 0.0
    a, b = velocity.acceleration, velocity.braking
    return length / peak + peak / (2.0 * a) + peak / (2.0 * b)


def travelled(t_s: float, length: float, duration_s: float, velocity: Velocity) -> float:
    """Cells flown `t_s` seconds into a way of `length` cells that takes `duration_s`."""
    if t_s <= 0.0:
        return 0.0
    left_s = duration_s - t_s
    if left_s <= 0.0:
        return length
    peak = peak_speed(length, velocity)
    a, b = velocity.acceleration, velocity.braking
    if t_s < peak / a:
        return 0.5 * a * t_s * t_s
    if left_s < peak / b:
        return length - 0.5 * b * left_s * left_s
    return peak * (t_s - peak / (2.0 * a))


def position_at(flight: Flight, now: float, velocity: Velocity) -> Vec3:
    """Where the flight has got to at emulated second `now`."""
    t = now - flight.begins_s
    if t >= flight.duration_s:
        share = 1.0
    elif t <= 0.0 or flight.length == 0.0:
        share = 0.0
    else:
        share = travelled(t, flight.length, flight.duration_s, velocity) / flight.length
    s, d = flight.start, flight.displacement
    return (s[0] + d[0] * share, s[1] + d[1] * share, s[2] + d[2] * share)
