"""The skateboard: 1727 lights, made from nothing but the numbers below.

It stands on its tail, leaning, wheels to the viewer. In its own frame a point is (along, across, off):
nose at +, from the middle, off the deck's underside with trucks and wheels at +. Lines come first:
both edges of the deck, wheels, base plates, bolts; the sheets get what is left as blue noise.
"""

from __future__ import annotations

import numpy as np

from solids.fields import Array, boxed, drawn_on_sheets, evenly, spread

COUNT = 1727
BOX = (32.0, 95.0, 19.0)  # cells: length, height, depth
GAP = 1.27  # cells, between any two lights before the fit to the box
LEAN = np.radians(4.0)  # in the plane of length and height

HALF_LENGTH, HALF_WIDTH = 47.4, 13.7
ROUND_FROM = 31.0  # along: from here on the outline rounds off
KICK_FROM = 30.0  # along: where nose and tail begin to bend
KICK = 5.0  # cells, by which their ends lie off the middle
CONCAVE = 0.9  # cells, by which the long edges rise
THICK = 1.35  # of the deck

TRUCKS = (-22.5, 22.5)  # along
AXLE = 8.0  # off the deck
PLATE = (6.4, 4.2, 1.4)  # half length, half width, height of the base plate
BUSHING = [(1.4, 3.6), (3.0, 2.6), (3.6, 3.1), (5.2, 3.1), (5.8, 2.2), (7.0, 1.8)]  # off, radius
HANGER = 2.6  # radius in the middle; 1 cell at the wheels
WHEEL = [(8.6, 2.2), (8.6, 4.0), (9.2, 4.7), (12.8, 4.7), (13.4, 4.0), (13.4, 2.2)]  # across, radius
RINGS = [(9.0, 4.5), (13.0, 4.5), (13.4, 2.0)]  # across, radius, of a wheel's lines
CIRCLE = np.linspace(0, 2 * np.pi, 73)


def make() -> Array:
    """The skateboard's points (1727, 3), display cells, lower corner at 0."""
    sheets = [_deck(), *[sheet for at in TRUCKS for sheet in _truck(at)]]
    candidates = drawn_on_sheets(sheets, 60_000, seed=COUNT)
    _, across, off = candidates.T
    weight = np.where(off > 0.1, 0.9, 1.0)
    weight[(off > 0.1) & (np.abs(across) >= WHEEL[0][0])] = 0.7  # wheels: their rings say enough
    points = spread(np.vstack(_lines()), candidates, weight, COUNT, GAP)
    return boxed(_stood_up(points), BOX)


def _stood_up(own: Array) -> Array:
    """From the board's frame to (L, H, D)."""
    along, across, off = own.T
    length = across * np.cos(LEAN) + along * np.sin(LEAN)
    height = along * np.cos(LEAN) - across * np.sin(LEAN)
    return np.column_stack([length, height, off])


def _half_width(along: Array) -> Array:
    """Of the deck: straight sides, ends a little fuller than an ellipse."""
    end = np.clip((np.abs(along) - ROUND_FROM) / (HALF_LENGTH - ROUND_FROM), 0, 1)
    return np.asarray(HALF_WIDTH * np.sqrt(np.maximum(1 - end**2.3, 0)))


def _bent(along: Array, across: Array, off: float = 0.0) -> Array:
    """(N, 3) on the deck, its underside at `off` 0: nose and tail kicked, the long edges risen."""
    bend = np.clip((np.abs(along) - KICK_FROM) / (HALF_LENGTH - KICK_FROM), 0, 1)
    risen = KICK * bend**1.5 + CONCAVE * (across / HALF_WIDTH) ** 2 * (1 - bend)
    return np.column_stack([along, across, off - risen])


def _deck() -> Array:
    ends = HALF_LENGTH * np.sin(np.linspace(-np.pi / 2, np.pi / 2, 181))  # finer towards nose and tail
    along, share = np.meshgrid(ends, np.linspace(-1, 1, 41), indexing="ij")
    across = share * _half_width(along)
    return _bent(along.ravel(), across.ravel()).reshape(181, 41, 3)


def _truck(at: float) -> list[Array]:
    """Base plate, bushing, hanger and two wheels."""
    across = np.linspace(-WHEEL[0][0], WHEEL[0][0], 25)
    bulge = 1.0 + (HANGER - 1.0) * np.cos(across / WHEEL[0][0] * np.pi / 2) ** 2
    hanger = _ring(at, across[:, None], bulge[:, None])
    wheel = np.array(WHEEL)
    wheels = [_ring(at, side * wheel[:, :1], wheel[:, 1:]) for side in (-1, 1)]
    off, radius = np.array(BUSHING).T[:, :, None]
    bushing = np.stack(
        np.broadcast_arrays(at + radius * np.cos(CIRCLE), radius * np.sin(CIRCLE), off), axis=-1
    )
    length, width, height = PLATE
    plate = np.array([[(at + x, y, height) for y in (-width, width)] for x in (-length, length)])
    return [plate, bushing, hanger, *wheels]


def _ring(at: float, across: Array | float, radius: Array | float) -> Array:
    """Circles (..., 73, 3) around the axle of the truck at `at`."""
    around = at + radius * np.cos(CIRCLE), across, AXLE + radius * np.sin(CIRCLE)
    return np.stack(np.broadcast_arrays(*around), axis=-1)


def _lines() -> list[Array]:
    """The lines the eye looks for, most important first: where two meet, the first keeps its points."""
    along = HALF_LENGTH * np.sin(np.linspace(-np.pi / 2, np.pi / 2, 361))
    half = np.column_stack([along, _half_width(along)])
    outline = np.vstack([half, half[::-1] * (1, -1)])
    rims = [evenly(_bent(outline[:, 0], outline[:, 1], off), 1.4)[:-1] for off in (0.0, -THICK)]
    return [*rims, *[line for at in TRUCKS for line in _truck_lines(at)]]


def _truck_lines(at: float) -> list[Array]:
    """Of each wheel two rims, hub and nut; the base plate's edge and its four bolts."""
    rings = [
        evenly(_ring(at, side * across, radius), 1.36)[:-1] for side in (-1, 1) for across, radius in RINGS
    ]
    nuts = np.array([[at, side * 13.7, AXLE] for side in (-1, 1)])
    length, width, height = PLATE
    corners = [(-length, -width), (length, -width), (length, width), (-length, width), (-length, -width)]
    plate = evenly(np.array([(at + x, y, height) for x, y in corners]), 1.4)[:-1]
    bolts = np.array([[at + x, y, height] for x in (-4.6, 4.6) for y in (-2.4, 2.4)])
    return [*rings, nuts, plate, bolts]
