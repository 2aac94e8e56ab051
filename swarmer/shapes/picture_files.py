"""A picture becomes a cloud: what is drawn in a PNG, and points spread over it."""

from __future__ import annotations

import io
import struct
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from swarmer.errors import BadInput
from swarmer.shapes.cloud import POINTS_MAX, Points
from swarmer.shapes.errors import BadShape
from swarmer.shapes.sampling import blue_noise

if TYPE_CHECKING:
    from PIL.Image import Image

Mask = NDArray[np.bool_]  # (rows, columns), the first row is the top one

FILE_BYTES_MAX = 64 * 2**20
PIXELS_MAX = 16_000_000
FINE_PIXELS = 2**20  # a picture of more is taken coarser, two by two pixels: no light needs it finer
OPAQUE = 128  # of 255
SIGNATURE = b"\x89PNG\r\n\x1a\n"

GAP = 0.8  # of the spacing along the outline: what comes nearer to an earlier light is left out
ROOM = 1.2  # of the spacing squared: the area that a light of a blue noise takes
CROWD = 4  # times as many lights as wanted: beyond it no thinning helps (a thin stroke has two sides)
STEPS = 24  # halvings in the search for the spacing
PROBES = 20_000  # places at which the room that the outline leaves is measured
PLACES, PLACES_EACH = 100_000, (10, 40)  # that the noise chooses from, and their bounds per light


class _Outline(NamedTuple):
    """The closed outlines of what is drawn, one after the other, as (column, row); pixels."""

    corners: Points  # (N, 2)
    run: NDArray[np.float64]  # (N,), how far along all of them together, with the ways between them
    start: NDArray[np.float64]  # (K,), of each outline in `run`, the longest first
    length: NDArray[np.float64]  # (K,)


def read_silhouette(data: bytes, invert: bool = False) -> Mask:
    """What is drawn in a PNG, (rows, columns) of bool, the top row first.

    Drawn is what is opaque, where the picture has transparency; else what is dark on a light ground, by
    Otsu's threshold. `invert`: the other way round, for light on dark. Sizes are judged by the header,
    before memory is taken. Raises BadShape: no PNG, damaged, too large, nothing drawn or everything.
    """
    _refuse_size(data)
    shown = _decoded(data)
    mask = _opaque(shown)
    if mask is None:
        mask = _dark(_grey(shown))
    mask = mask != invert
    if not mask.any():
        raise BadShape("nothing is drawn in the picture; for light on dark, or for a cut-out, invert it")
    if mask.all():
        raise BadShape("all of the picture is drawn, so it has no outline; leave some ground around it")
    return mask


def silhouette_cloud(mask: Mask, count: int, seed: int) -> Points:
    """Exactly `count` different points (count, 2) on what is drawn, in pixels: x to the right, y up.

    First come lights evenly along the outline, in one row where a stroke is thin, then a blue noise
    inside, a little wider. The origin is the lower left corner of the picture.
    mask: as of `read_silhouette`. seed: for the places that the noise chooses from.
    Raises BadInput (`points`) and BadShape (nothing drawn).
    """
    if not 2 <= count <= POINTS_MAX:
        raise BadInput("points", count, f"a whole number, 2 to {POINTS_MAX:,}")
    if not mask.any():
        raise BadShape("nothing is drawn in the picture")
    fine, pixel = _coarsened(mask)
    places = min(max(PLACES, PLACES_EACH[0] * count), PLACES_EACH[1] * count)
    drawn = _drawn_on(fine, max(places, PROBES), np.random.default_rng(seed))
    outline = _outline(fine)
    first = _along(outline, _spacing(outline, drawn[:PROBES], int(fine.sum()), count))
    pool = np.vstack([first, drawn])
    points = pool[blue_noise(pool, count, kept=len(first), seed=seed)] * pixel
    return np.column_stack([points[:, 0], len(mask) - points[:, 1]])


# -- what is drawn ---------------------------------------------------------------------------------------------------


def _refuse_size(data: bytes) -> None:
    if len(data) > FILE_BYTES_MAX:
        raise BadShape(f"{len(data):,} bytes; a picture has at most {FILE_BYTES_MAX:,}")
    if not data.startswith(SIGNATURE):
        raise BadShape("not a PNG")
    if len(data) < 24 or data[12:16] != b"IHDR":
        raise BadShape("the PNG is damaged: its header is not there")
    width, height = struct.unpack_from(">II", data, 16)
    if width * height == 0:
        raise BadShape(f"an empty picture, {width} x {height} pixels")
    if width * height > PIXELS_MAX:
        raise BadShape(f"{width:,} x {height:,} pixels; at most {PIXELS_MAX:,} are read")


def _decoded(data: bytes) -> Image:
    from PIL import Image

    try:
        image = Image.open(io.BytesIO(data), formats=["PNG"])
        image.load()
    except Exception as error:  # Pillow raises whatever a damaged file happens to break
        raise BadShape(f"the PNG is damaged: {error or type(error).__name__}") from None
    return image


def _opaque(image: Image) -> Mask | None:
    """Where the picture is opaque; None where it all is, so that its shades have to tell."""
    if not image.has_transparency_data:
        return None
    opaque = np.asarray(image.convert("RGBA").getchannel("A")) >= OPAQUE
    return None if opaque.all() else opaque


def _grey(image: Image) -> NDArray[np.uint8]:
    if image.mode.startswith("I"):  # 16 bits a pixel, which Pillow would cut off at 255
        return np.asarray(np.asarray(image, dtype=np.int64) >> 8, dtype=np.uint8)
    return np.asarray(image.convert("L"))


def _dark(grey: NDArray[np.uint8]) -> Mask:
    """What is darker than the threshold that divides the shades best.

    Source: Otsu, A threshold selection method from gray-level histograms, 1979.
    """
    share = np.bincount(grey.ravel(), minlength=256) / grey.size
    below = np.cumsum(share)
    mean = np.cumsum(share * np.arange(256))
    with np.errstate(divide="ignore", invalid="ignore"):
        between = (mean[-1] * below - mean) ** 2 / (below * (1 - below))
    between[~np.isfinite(between)] = -1.0
    return np.asarray(grey <= between.argmax())


# -- lights on it ----------------------------------------------------------------------------------------------------


def _coarsened(mask: Mask) -> tuple[Mask, int]:
    """The mask with at most FINE_PIXELS, and how many pixels one of its is wide. Thin strokes stay."""
    pixel = 1
    while mask.size > FINE_PIXELS:
        rows, columns = mask.shape
        mask = np.pad(mask, ((0, rows % 2), (0, columns % 2)))
        mask = mask[::2, ::2] | mask[1::2, ::2] | mask[::2, 1::2] | mask[1::2, 1::2]
        pixel *= 2
    return mask, pixel


def _drawn_on(mask: Mask, count: int, rng: np.random.Generator) -> Points:
    """`count` places (count, 2) drawn uniformly over the drawn pixels, as (column, row) from the top left."""
    row, column = np.nonzero(mask)
    chosen = rng.integers(len(row), size=count)
    return np.column_stack([column[chosen], row[chosen]]) + rng.random((count, 2))


def _outline(mask: Mask) -> _Outline:
    from contourpy import LineType, contour_generator

    field = np.pad(mask, 1).astype(np.float64)
    chunks: Any = contour_generator(z=field, line_type=LineType.ChunkCombinedOffset).lines(0.5)
    corners, first = (
        chunks[0][0],
        chunks[1][0].astype(np.int64),
    )  # one chunk; loop k is first[k] to first[k + 1]
    steps = np.linalg.norm(np.diff(corners, axis=0, prepend=corners[:1]), axis=1)
    run = np.cumsum(steps)  # with the steps from one loop to the next, where no light comes
    start, end = run[first[:-1]], run[first[1:] - 1]
    longest = np.argsort(start - end, kind="stable")
    return _Outline(corners - 0.5, run, start[longest], (end - start)[longest])


def _spacing(outline: _Outline, probes: Points, area: int, count: int) -> float:
    """How far apart lights have to stand for outline and inside to take `count` together; pixels."""
    low, high = 1e-3, 2 * float(np.hypot(*np.ptp(outline.corners, axis=0))) + 1
    for _ in range(STEPS):
        middle = float(np.sqrt(low * high))
        if _wanted(outline, probes, area, middle, count) > count:
            low = middle
        else:
            high = middle
    return high


def _wanted(outline: _Outline, probes: Points, area: int, spacing: float, count: int) -> float:
    if outline.length.sum() > CROWD * spacing * count:
        return np.inf
    lights = _along(outline, spacing)
    free = np.asarray(cKDTree(lights).query(probes)[0]) > GAP * spacing
    return len(lights) + float(free.mean()) * area / (ROOM * spacing**2)


def _along(outline: _Outline, spacing: float) -> Points:
    """Lights (N, 2) evenly along the outline, none nearer to an earlier one than GAP times the spacing."""
    number = np.rint(outline.length / spacing).astype(np.int64)
    number[0] = max(1, number[0])
    step = np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number) + 0.5
    at = np.repeat(outline.start, number) + step * np.repeat(outline.length / np.maximum(1, number), number)
    lights = np.column_stack([np.interp(at, outline.run, axis) for axis in outline.corners.T])
    pairs = cKDTree(lights).query_pairs(GAP * spacing, output_type="ndarray")
    kept = np.ones(len(lights), dtype=bool)
    for first, second in pairs[np.argsort(pairs[:, 0], kind="stable")]:
        kept[second] &= not kept[first]
    return lights[kept]
