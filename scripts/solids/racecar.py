"""The racing car: 11,894 lights, made from nothing but the numbers below.

An open-wheel car seen from above: L is across, H along from the tail to the nose, D up from the ground
towards the viewer. Hull, floor, wings, wheels, suspension, driver; what the surface does not take goes
into shells below it.
"""

from __future__ import annotations

import numpy as np

from solids.distances import (
    Array,
    Field,
    both_sides,
    drum,
    ellipsoid,
    filled,
    loft,
    melted,
    slab,
    union,
    without,
)
from solids.fields import boxed, capsules

COUNT = 11_894
BOX = (46.0, 95.0, 22.0)  # cells: length (across), height (along), depth (up)
ROOM = ((-24, -1, -1), (24, 96, 23))
SHELLS, SHELL_WEIGHT = (-1.15, -2.3, -3.45, -4.6), 0.95

# (H, middle L, half width, lowest D, highest D)
HULL = [
    (4, 0, 2.2, 3.0, 8.5), (10, 0, 2.8, 2.2, 10), (20, 0, 3.8, 1.2, 12), (30, 0, 5.4, 1, 13.5),
    (44, 0, 6.6, 1, 13.5), (57, 0, 6.2, 1, 12.5), (66, 0, 5.0, 1.6, 11), (76, 0, 3.9, 2.6, 9.2),
    (86, 0, 2.9, 4.2, 7.8), (93, 0, 2.0, 5.0, 6.9), (95, 0, 1.0, 5.5, 6.4),
]  # fmt: skip
COVER = [
    (6, 0, 0.8, 5, 10), (14, 0, 1.4, 6, 13), (26, 0, 2.2, 8, 16.8), (36, 0, 2.9, 9, 19.6), (44, 0, 3.0, 9, 20.6),
]  # fmt: skip
AIRBOX = [(40.5, 0, 2.0, 16.4, 19.5), (46, 0, 2.0, 16.4, 19.5)]
SIDEPOD = [
    (14, 4.4, 2.4, 1.2, 6.0), (24, 6.6, 4.6, 1.2, 7.8), (34, 9.2, 6.6, 1.2, 9.4), (44, 10.4, 7.2, 1.2, 10.4),
    (53, 10.8, 6.8, 1.4, 10.6), (56, 10.9, 6.2, 2.0, 10.0),
]  # fmt: skip
INTAKE = [(51, 11.6, 4.4, 3.4, 8.8), (60, 11.6, 4.4, 3.4, 8.8)]
COCKPIT = [(45.5, 0, 3.4, 8, 24), (49, 0, 4.4, 8, 24), (55, 0, 4.4, 8, 24), (62, 0, 2.2, 9.5, 24)]

FRONT_AXLE, REAR_AXLE = 73.6, 14.0  # H
FRONT_WHEEL = (7.0, 3.4, 19.6)  # radius, half width, middle L
REAR_WHEEL = (7.7, 4.3, 18.7)
SPOKES = 5
RIM = 0.66  # radius of the rim, as a share of the tyre's


def make() -> Array:
    """The car's points (11894, 3), display cells, lower corner at 0."""
    points = filled(_car(), ROOM, COUNT, levels=SHELLS, inner_weight=SHELL_WEIGHT, dark=both_sides(_dark()))
    return boxed(points, BOX)


def _car() -> Field:
    return both_sides(union(_body(), _floor(), _front_wing(), _rear_wing(), _wheels(), _rods(), _driver()))


def _body() -> Field:
    cover = without(loft(COVER, 2.2), loft(AIRBOX))
    pod = without(loft(SIDEPOD, 4.0), loft(INTAKE, 4.0))
    mirror = slab((8.0, 59.5, 13.6), (1.6, 0.7, 0.9))
    return union(without(union(loft(HULL, 2.8), cover, pod), loft(COCKPIT, 2.4)), mirror)


def _floor() -> Field:
    plate = slab((0, 39, 0.65), (17.6, 18, 0.65))
    behind = slab((0, 15, 0.65), (12.4, 12, 0.65))
    board = slab((17.2, 45, 1.4), (0.6, 9, 1.4))  # turning vane beside the floor
    return union(plate, behind, board)


def _front_wing() -> Field:
    main = slab((0, 91.7, 2.2), (22.4, 2.4, 0.6))
    flaps = [slab((13.4, 86.4, 3.4), (8.6, 1.4, 0.55)), slab((13.8, 82.7, 4.8), (8.2, 0.9, 0.55))]
    plate = slab((22.4, 88, 3.6), (0.6, 6.8, 3.4))
    pylon = slab((2.0, 90.6, 4.0), (0.55, 2.0, 1.8))
    return union(main, *flaps, plate, pylon)


def _rear_wing() -> Field:
    planes = [
        ((0, 5.4, 18.6), (15.2, 3.0, 0.6)),
        ((0, 1.6, 21.0), (15.2, 1.6, 0.6)),
        ((0, 4.6, 10.6), (15.2, 2.0, 0.55)),
    ]
    plate = slab((15.4, 4.9, 14.6), (0.6, 4.9, 7.4))
    mast = slab((1.4, 5.6, 14), (0.5, 1.8, 4.6))
    lamp = slab((0, 1.6, 6.4), (1.0, 1.6, 1.5))
    return union(*[slab(*plane) for plane in planes], plate, mast, lamp)


def _wheels() -> Field:
    return union(_wheel(FRONT_AXLE, *FRONT_WHEEL), _wheel(REAR_AXLE, *REAR_WHEEL))


def _wheel(axle: float, radius: float, half: float, middle: float) -> Field:
    """A tyre around a rim one can see through, with hub and spokes."""
    tyre = without(
        drum((middle, axle, radius), 0, radius, half, 0.8), drum((middle, axle, radius), 0, RIM * radius, 9)
    )
    turn = np.arange(SPOKES) * 2 * np.pi / SPOKES
    ends = np.column_stack([np.zeros(SPOKES), np.cos(turn), np.sin(turn)]) * (RIM + 0.04) * radius
    hub = np.array([middle + 0.7 * half, axle, radius])
    rows = np.hstack([np.tile([*hub, 0.6], (SPOKES, 1)), hub + ends, np.full((SPOKES, 1), 0.5)])
    return union(tyre, drum((middle, axle, radius), 0, 1.1, half), melted(rows, 0.1))


def _dark() -> Field:
    """Grooves of the tyres, joints of the nose and of the engine's cover, the visor, the air intake."""
    grooves = [
        _groove(axle, radius, middle + share * half)
        for axle, (radius, half, middle) in ((FRONT_AXLE, FRONT_WHEEL), (REAR_AXLE, REAR_WHEEL))
        for share in (-0.44, 0.0, 0.44)
    ]
    joints = [slab((0, height, 8), (half, 0.6, 9), 0.1) for height, half in ((69.5, 6.5), (32.0, 3.4))]
    visor = slab((0, 52.4, 14.6), (2.6, 0.9, 1.0))
    return union(*grooves, *joints, visor, loft([(44, 0, 2.2, 16.2, 19.7), (47, 0, 2.2, 16.2, 19.7)]))


def _groove(axle: float, radius: float, at: float) -> Field:
    return without(
        drum((at, axle, radius), 0, radius + 1, 0.55, 0.1), drum((at, axle, radius), 0, radius - 2.2, 3)
    )


def _rods() -> Field:
    """Wishbones, push rods, track rods and half shafts, as (L, H, D, radius) from the hull to the wheel."""
    front, rear = FRONT_WHEEL[2] - 2, REAR_WHEEL[2] - 2
    rods = []
    for inner, outer, axle in ((3.2, front, FRONT_AXLE), (3.0, rear, REAR_AXLE)):
        for reach in (-6.5, 5.5):
            rods += [[(inner, axle + reach, 4.0, 0.7), (outer, axle, 4.0, 0.7)]]
            rods += [[(inner, axle + reach, 8.6, 0.7), (outer, axle, 9.6, 0.7)]]
    rods += [[(3.2, FRONT_AXLE - 1.5, 9.0, 0.65), (front, FRONT_AXLE - 0.5, 4.6, 0.65)]]
    rods += [[(2.0, REAR_AXLE, 7.0, 0.9), (rear, REAR_AXLE, 7.4, 0.9)]]
    rods += [[(5.8, 59.5, 12.0, 0.55), (7.6, 59.5, 13.4, 0.55)]]
    return melted(capsules(*[np.array(rod) for rod in rods]), 0.2)


def _driver() -> Field:
    helmet = without(ellipsoid((0, 49.6, 13.6), (2.9, 3.4, 3.3)), slab((0, 53.2, 14.2), (2.6, 1.4, 0.8)))
    shoulders = ellipsoid((0, 49.5, 9.6), (4.4, 2.6, 2.2))
    wheel = slab((0, 56.6, 11.6), (2.2, 0.5, 1.3))
    halo = np.array(
        [
            (5.4, 45.5, 14.2, 0.8),
            (5.2, 50, 16.2, 0.8),
            (3.8, 55.5, 17.2, 0.8),
            (0, 58.6, 17.2, 0.8),
            (0, 62.6, 11.4, 0.7),
        ]
    )
    return union(helmet, shoulders, wheel, melted(capsules(halo), 0.3))
