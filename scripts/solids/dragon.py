"""The dragon: 760 lights, made from nothing but the numbers below.

A chain of tapered capsules melted together gives tail, torso, neck, head and legs; the wings are
extruded plates, bent; both are joined to one solid. With so few lights a body alone is a cloud of
dust, so the lines that the eye looks for come first (arms, fingers and edge of the wings, crest,
horns, jaws, claws, tip of the tail) and the surface gets what is left as blue noise.
"""

from __future__ import annotations

import manifold3d
import numpy as np

from solids.fields import Array, body, capsules, drawn_on, evenly, fill_up, smooth_curve, thinned

COUNT = 760
BOX = (95.0, 59.0, 57.0)  # cells: length, height, depth
GAP = 1.25  # cells, between any two lights before the fit to the box

# (L, H, D, radius)
TAIL = [
    (9, 29, -2, 0.7),
    (3, 23.5, -6, 0.9),
    (0.5, 16, -9, 1.1),
    (3.5, 9, -10, 1.5),
    (11, 6.5, -8, 2.0),
    (19, 9.5, -3, 2.9),
    (27, 15, 0, 4.2),
]
TORSO = [(27, 15, 0, 4.2), (35, 17.5, 0, 5.2), (45, 18.5, 0, 4.8), (54, 21.5, 0, 5.6), (60, 25.5, 0, 4.6)]
NECK = [
    (60, 25.5, 0, 4.6),
    (67.5, 27.5, 0, 3.4),
    (73.5, 32, 0, 2.8),
    (74, 38.5, 0, 2.4),
    (74.5, 44.5, 0.5, 2.3),
    (79, 49, 1, 2.6),
]
SKULL = [
    (78, 49, 1, 2.6),
    (83, 50, 1.2, 3.2),
    (88, 48.5, 1.6, 2.0),
    (92.5, 47.6, 1.9, 1.8),
    (96, 46.6, 2, 1.3),
]
JAW = [(81.5, 47, 1.1, 1.9), (85.5, 41.2, 1.5, 1.3), (90.5, 37.2, 1.8, 0.8)]
HORN = [(80.5, 52.5, 1.7, 0.9), (76, 54.8, 3.6, 0.7), (71.5, 58.5, 5.5, 0.4)]  # D beside the head's middle
HIND = [
    (34, 16, 4.0, 4.4),
    (41, 11.5, 7.5, 2.8),
    (34, 5.5, 8, 1.6),
    (35.5, 1.8, 8.3, 1.3),
    (40, 0.9, 8.7, 1.0),
]
FORE = [
    (56, 20, -4, 3.4),
    (52, 13, -7, 2.2),
    (56.5, 7, -7.5, 1.5),
    (57.5, 1.9, -7.7, 1.2),
    (62, 0.9, -8.1, 0.9),
]
RAISED = [
    (56, 20, 4, 3.4),
    (60.5, 12, 7.5, 2.2),
    (68, 14.5, 8, 1.5),
    (71, 12.5, 8.2, 1.1),
    (73.5, 10, 8.3, 0.8),
]

# The wing in its plane: (outwards from the shoulder, backwards).
SHOULDER, ELBOW, WRIST = (0.0, 0.0), (12.0, 6.0), (28.0, -7.0)
FINGER_TIPS = [(49.0, 6.0), (43.5, 26.0), (31.0, 37.0), (14.0, 36.0)]
ROOT = (0.0, 19.0)
SCALLOP = 0.19  # how deep the edge hangs in between two tips, as a share of their distance
WING_AT = (54.5, 25.5, 3.0)  # L, H, |D| of the shoulder
RISE = np.radians(69.0)  # of the wing's plane over the horizontal, at the shoulder
BEND = 0.009  # radians per cell, by which the rise falls off outwards
HANG = 0.008  # cells of height per cell out and cell back, by which the trailing edge hangs


def make() -> Array:
    """The dragon's points (760, 3), display cells, lower corner at 0."""
    lines = thinned(np.vstack(_lines()), GAP)
    candidates = drawn_on(_solid(), 40_000, seed=760)
    points = fill_up(lines, candidates, _weight(candidates), COUNT)
    points -= points.min(axis=0)
    return points * (np.array(BOX) / points.max(axis=0))


def _solid() -> manifold3d.Manifold:
    chains = [smooth_curve(knots, 6) for knots in (TAIL, TORSO, NECK, SKULL, JAW)]
    chains += [smooth_curve(knots, 4) for knots in (HIND, _mirrored(HIND), FORE, RAISED, *_horns())]
    trunk = body(capsules(*chains), blend=0.45, edge=1.1)
    wing = _plate()
    return trunk + wing + wing.mirror((0, 0, 1))


def _plate() -> manifold3d.Manifold:
    """The wing on the side of +D, some 1 cell thick."""
    outline = manifold3d.CrossSection([_wing_outline()], manifold3d.FillRule.NonZero)
    flat = manifold3d.Manifold.extrude(outline, 1.0).refine_to_length(2.0)
    thick = np.array([0.0, -0.7, 0.7])  # away from the plane, about square to it
    return flat.warp_batch(lambda at: _in_space(at[:, :2], 1) + thick * (at[:, 2:] - 0.5))


def _wing_outline() -> Array:
    leading = smooth_curve([SHOULDER, ELBOW, WRIST], 6)
    return np.vstack([leading, *_edges()])


def _edges() -> list[Array]:
    """The scalloped edge, from tip to tip and to the root."""
    ends = [*FINGER_TIPS, ROOT]
    middle = np.array(WRIST)
    edges = []
    for one, other in zip(np.array(ends[:-1]), np.array(ends[1:]), strict=True):
        centre = (one + other) / 2
        inwards = (middle - centre) / np.linalg.norm(middle - centre)
        hung = centre + inwards * SCALLOP * np.linalg.norm(other - one)
        edges.append(smooth_curve([one, hung, other], 8))
    return edges


def _in_space(flat: Array, side: int) -> Array:
    """(N, 2) of the wing's plane to (N, 3): bent about the length axis, trailing edge a little lower."""
    out, back = flat[:, 0], flat[:, 1]
    rise = RISE - BEND * out
    across = (np.sin(RISE) - np.sin(rise)) / BEND
    up = (np.cos(rise) - np.cos(RISE)) / BEND
    length, height, depth = WING_AT
    return np.column_stack([length - back, height + up - HANG * out * back, side * (depth + across)])


def _lines() -> list[Array]:
    """The lines the eye looks for, most important first: where two meet, the first keeps its points."""
    lines = [*_head()]
    for side in (1, -1):
        arm = smooth_curve([SHOULDER, ELBOW, WRIST], 8)
        lines.append(_in_space(evenly(arm, 1.7), side))
        for tip in FINGER_TIPS:
            bow = (np.array(WRIST) + tip) / 2 + 0.06 * np.array([tip[1] - WRIST[1], WRIST[0] - tip[0]])
            lines.append(_in_space(evenly(smooth_curve([WRIST, bow, tip], 8), 2.1), side))
        lines += [_in_space(evenly(edge, 1.9), side) for edge in _edges()]
    lines += [_spade(), *_claws(), *_crest(), *_limbs()]
    return lines


def _horns() -> list[list[tuple[float, ...]]]:
    return [[(x, y, 1 + side * z, r) for x, y, z, r in HORN] for side in (1, -1)]


def _head() -> list[Array]:
    horns = [evenly(smooth_curve(horn), 1.5)[:, :3] for horn in _horns()]
    eyes = np.array([[84.5, 51.6, 1.2 + side * 2.0] for side in (1, -1)])
    top, under = smooth_curve(SKULL), smooth_curve(JAW)
    brow = evenly(top + np.array([0, 1, 0, 0]) * top[:, 3:], 1.6)[:, :3]
    palate = evenly((top - np.array([0, 1, 0, 0]) * top[:, 3:])[14:], 1.6)[:, :3]
    chin = evenly(under - np.array([0, 1, 0, 0]) * under[:, 3:], 1.6)[:, :3]
    tongue = evenly(under + np.array([0, 1, 0, 0]) * under[:, 3:], 1.6)[:, :3]
    return [*horns, eyes, brow, palate, chin, tongue]


def _spade() -> Array:
    """The outline of the tail's tip, in the plane of length and height."""
    at = np.array(TAIL[0][:3])
    outline = np.array([(0, 0), (-4.5, 1.0), (-1.5, 5), (1.5, 9.5), (3.2, 4.5), (4.5, -0.5), (0, 0)])
    flat = evenly(outline, 1.6)
    return at + np.column_stack([flat, np.zeros(len(flat))])


def _spine() -> tuple[Array, Array]:
    """The middle line (N, 4) from tail to head, and what "up" is along it (N, 3)."""
    spine = evenly(smooth_curve([*TAIL, *TORSO[1:], *NECK[1:]]), 1.15)
    return spine, _left_of(spine)


def _left_of(curve: Array) -> Array:
    """Unit normals (N, 3) of a curve in the plane of length and height: up, when it runs along +L."""
    along = np.gradient(curve[:, :3], axis=0)
    normal = np.column_stack([-along[:, 1], along[:, 0], np.zeros(len(along))])
    return np.asarray(normal / np.linalg.norm(normal, axis=1)[:, None])


def _crest() -> list[Array]:
    """The outline of back and belly; along the back every second light stands out as a spike."""
    spine, up = _spine()
    skin = spine[:, :3] + up * (spine[:, 3:] + 0.2)
    tips = (skin + 2.6 * up - 0.8 * np.gradient(skin, axis=0))[5:-4:4]
    back, belly = skin[3:-3:2], (spine[:, :3] - up * spine[:, 3:])[4:-4:2]
    return [tips, back, belly]


def _limbs() -> list[Array]:
    """Front and back outline of each leg."""
    outlines = []
    for knots in (HIND, _mirrored(HIND), FORE, RAISED):
        leg = evenly(smooth_curve(knots[1:] if knots[0][3] > 4 else knots, 8), 2.0)
        side = _left_of(leg) * leg[:, 3:]
        outlines += [leg[:, :3] + side, leg[:, :3] - side]
    return outlines


def _claws() -> list[Array]:
    feet = [HIND[-1], _mirrored(HIND)[-1], FORE[-1], RAISED[-1]]
    claws = []
    for x, y, z, _ in feet:
        down = 0.0 if y > 5 else 0.5
        claws.append(np.array([[x + 2.2, y - 1 + down, z + d] for d in (-1.8, 0.0, 1.8)]))
    return claws


def _weight(points: Array) -> Array:
    """How dense the lights shall be on the surface: the head most, the wings' skin least."""
    length, height, depth = points.T
    weight = np.full(len(points), 0.8)
    weight[np.abs(depth) > 6] = 1.1  # legs
    weight[(height > 30) & (length < 64)] = 0.35  # wings: their lines say enough
    weight[(length > 66) & (height > 27)] = 1.2  # neck
    weight[(length > 78) & (height > 37)] = 1.5  # head
    weight[length < 22] = 1.2  # tail
    return weight


def _mirrored(knots: list[tuple[float, ...]]) -> list[tuple[float, ...]]:
    return [(x, y, -z, r) for x, y, z, r in knots]
