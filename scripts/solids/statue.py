"""The statue: 22,375 lights, made from nothing but the numbers below.

A winged horse rears on a plinth: D is its length, forwards; H is up, L across. Body and head are tapered
capsules melted together, wings are fans of flat feathers in two rows; what the surface does not take goes
into shells below it.
"""

from __future__ import annotations

import numpy as np

from solids.distances import Array, Field, both_sides, drum, ellipsoid, filled, melted, slab, union
from solids.fields import boxed, capsules, smooth_curve

COUNT = 22_375
BOX = (63.0, 79.0, 95.0)  # cells: length (across), height, depth (along)
ROOM = ((-35, -4, -26), (35, 80, 76))
SHELLS, SHELL_WEIGHT = (-1.15, -2.3, -3.45, -4.6, -5.75, -6.9), 1.0

# (L, H, D, radius)
TRUNK = [
    (0, 33.5, 14.5, 6.4),
    (0, 36, 20, 7.8),
    (0, 40, 27, 7.2),
    (0, 44.5, 34, 7.8),
    (0, 49, 40, 8.0),
    (0, 52.5, 44.5, 6.0),
]
NECK = [(0, 50.5, 42, 7.0), (0, 58.5, 46.6, 5.2), (0, 65.5, 49, 4.0), (0, 70, 52.6, 3.3)]
HEAD = [(0, 70, 52.8, 3.4), (0, 68.6, 56.5, 3.3), (0, 65, 61, 2.4), (0, 61.4, 65, 2.0), (0, 60.2, 66.4, 2.0)]
JAW = [(0, 67, 54.6, 3.0), (0, 63.6, 59, 1.9), (0, 59.8, 63.4, 1.3)]
EAR = [(1.7, 72.4, 53.0, 1.6), (2.8, 76.4, 51.6, 0.8)]
HIND = [
    (4.2, 34.5, 15.5, 5.4),
    (6, 28.5, 24, 4.2),
    (6.6, 25, 20.5, 2.9),
    (7, 20.6, 12.4, 2.1),
    (7, 18.6, 12, 1.9),
    (7, 11.4, 15.2, 1.4),
    (7, 8.8, 17.4, 1.9),
]
STEP_APART = 5.0  # cells of D, by which the left hind leg stands before the right one
BENT = [
    (4.4, 47, 43, 4.4),
    (6, 43.5, 52, 3.0),
    (6.4, 46.5, 60.6, 2.1),
    (6.4, 45.4, 62.6, 2.2),
    (6.4, 39.5, 62.6, 1.25),
    (6.4, 36.6, 61, 1.7),
    (6.4, 35, 58.4, 2.1),
]
STRETCHED = [
    (-4.4, 47, 43, 4.4),
    (-6, 46.5, 52, 3.0),
    (-6.4, 53.4, 59.4, 2.1),
    (-6.4, 53.8, 61.6, 2.2),
    (-6.4, 50.6, 67.2, 1.25),
    (-6.4, 47.6, 69, 1.7),
    (-6.4, 45, 69.2, 2.1),
]
# (H, D, radius), and where the strands end beside that: (L, H, D)
TAIL = [(31.5, 9, 2.4), (37, 3, 2.2), (34.5, -5, 2.0), (26, -9, 1.8), (17, -13, 1.4), (12.5, -21, 0.6)]
STRANDS = [(-4.5, 0, 2), (-2.2, 2.5, -1), (0, -1, 1.5), (2.2, 1.5, -2), (4.5, -2.5, 0.5)]
LOCKS = 6  # of the mane
CREST = [(55, 37.4), (62, 43.2), (67.5, 45.6), (72, 48.6)]  # H, D

SHOULDER, WRIST = (5.0, 52.0, 37.0), (19.0, 69.0, 30.0)
TIP_FIRST, TIP_LAST = (31.5, 76.5, 0.0), (10.0, 42.0, 14.0)  # of the long feathers, the outermost first
BULGE = (3.0, 3.0, -14.0)  # how far the tips between them stand out
FEATHERS = 11


def make() -> Array:
    """The statue's points (22375, 3), display cells, lower corner at 0."""
    statue = union(_horse(), both_sides(_wing()), _plinth())
    dark = both_sides(_dark())
    return boxed(filled(statue, ROOM, COUNT, levels=SHELLS, inner_weight=SHELL_WEIGHT, dark=dark), BOX)


def _horse() -> Field:
    chains = [
        smooth_curve(chain, 4) for chain in (TRUNK, NECK, HEAD, JAW, BENT, STRETCHED, *_hind(), *_ears())
    ]
    hair = [smooth_curve(lock, 5) for lock in [*_tail(), *_mane()]]
    hooves = [drum((leg[-1, 0], 7.5, leg[-1, 2] + 1), 1, 2.4, 1.5) for leg in _hind()]
    return union(melted(capsules(*chains), 0.5), melted(capsules(*hair), 0.25), *hooves)


def _hind() -> list[Array]:
    """The right hind leg, and the left one, a step before it."""
    right = np.array(HIND)
    left = right * (-1, 1, 1, 1)
    left[:, 2] += STEP_APART * np.linspace(0, 1, len(left))
    return [right, left]


def _ears() -> list[Array]:
    return [np.array(EAR) * (side, 1, 1, 1) for side in (-1, 1)]


def _tail() -> list[Array]:
    """Strands that leave the dock as one and part towards their ends."""
    knots = np.array(TAIL)
    parted = np.linspace(0, 1, len(knots))[:, None] ** 1.5
    middle = np.column_stack([np.zeros(len(knots)), knots])
    return [middle + parted * np.array([*strand, 0.0]) for strand in STRANDS]


def _mane() -> list[Array]:
    """Locks from the crest of the neck, blown backwards, to the left and the right in turn."""
    crest = smooth_curve(CREST, 12)
    locks = []
    for number, (height, depth) in enumerate(crest[np.linspace(0, len(crest) - 1, LOCKS).astype(int)]):
        side = 1.2 if number % 2 else -1.2
        lock = [
            (0, 0, 1, 1.6),
            (side, 2.6, -4, 1.6),
            (1.8 * side, 2.2, -8.5, 1.2),
            (2.4 * side, -1.2, -12.5, 0.5),
        ]
        locks.append(np.array(lock) + (0, height, depth, 0))
    return locks


def _dark() -> Field:
    """Eye, nostril, the corner of the mouth."""
    mouth = melted(np.array([[1.9, 60.2, 63, 0.6, 1.9, 58.4, 66, 0.6]]), 0.1)
    return union(
        ellipsoid((3.0, 69.6, 57.2), (1.4, 0.8, 1.0)), ellipsoid((1.9, 61.2, 66.4), (1.0, 0.7, 0.7)), mouth
    )


def _wing() -> Field:
    """The wing at L > 0: its arm, a row of long feathers and one of short ones over their quills."""
    shoulder, wrist = np.array(SHOULDER), np.array(WRIST)
    hand = wrist + (np.array(TIP_FIRST) - wrist) * 0.35
    arm = smooth_curve(
        [
            (*shoulder, 3.4),
            (*(shoulder + (wrist - shoulder) * 0.55 + (0, 0, 3)), 2.6),
            (*wrist, 2.2),
            (*hand, 1.3),
        ],
        8,
    )
    along = np.linspace(0, 1, len(arm))
    first, last = np.array(TIP_FIRST), np.array(TIP_LAST)
    normal = np.cross(wrist - shoulder, last - shoulder)
    normal = normal / np.linalg.norm(normal)
    rows = []
    for share in np.linspace(0, 1, FEATHERS):  # 0: the outermost
        root = np.array([np.interp(1 - 0.92 * share, along, column) for column in arm.T])[:3]
        tip = first + (last - first) * share + np.array(BULGE) * np.sin(np.pi * share)
        rows.append([*root, 1.5, *tip, 1.0])
    long = np.array(rows)
    short = long.copy()
    short[:, 4:7] = short[:, :3] + 0.45 * (short[:, 4:7] - short[:, :3])
    short[:, [0, 1, 2]] += 0.9 * normal
    short[:, [4, 5, 6]] += 1.1 * normal
    short[:, 3], short[:, 7] = 1.9, 1.5
    flat = tuple(0.9 * normal)
    return union(melted(capsules(arm), 0.4), melted(long, 0.15, flat), melted(short, 0.15, flat))


def _plinth() -> Field:
    foot = slab((0, -0.9, 18), (18, 1.3, 33), 0.4)
    block = slab((0, 2, 18), (15, 4.1, 30), 0.4)
    return union(foot, block, slab((0, 5.1, 18), (16.4, 1.1, 31.4), 0.4))
