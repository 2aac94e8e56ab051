"""The view in space that the report carries: where every FLS was, in so few bytes that a page can hold them.

Positions stand on a grid of 65,536 steps an axis, as differences from one frame to the next, so that who rests costs
nothing; low and high bytes apart; deflated. Frames are left out, evenly, until the whole fits `BYTES_MAX`, then points.
"""

from __future__ import annotations

import base64
import json
import zlib
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmer.observe.palette import CALM, DARK, PALE, swarm_colours
from swarmer.observe.report_drawing import clock_of
from swarmer.observe.report_page import Part, data_block, esc
from swarmer.observe.saved_run import SavedRun
from swarmer.observe.saved_timeline import SavedTimeline
from swarmer.shapes.views import usual_view

BYTES_MAX = 1_900_000  # deflated; base64 makes it 2.5 MB
FRAMES_MAX, FRAMES_MIN = 640, 12
VALUES_MAX = 24_000_000  # positions and colours before they are deflated: what a phone can unpack
STEP_CELLS = 0.01  # no finer than the eye could see
LARGEST = 65_535


class Packed(NamedTuple):
    """What the page's script unpacks."""

    data: str  # base64
    at: NDArray[np.int64]  # which samples are its frames
    rows: NDArray[np.int64]  # which FLSs are in it
    low: NDArray[np.float64]
    step: float


def scene_part(run: SavedRun) -> Part | None:
    """The points through time, to turn and to play; None for a run without a timeline."""
    timeline = run.timeline
    if timeline is None or not len(timeline.t_s):
        return None
    packed = pack(timeline)
    facts = json.dumps(_facts(run, timeline, packed), separators=(",", ":"), allow_nan=False)
    count, frames = len(packed.rows), len(packed.at)
    left_out = (
        "" if count == len(timeline.truth) else f" Of {len(timeline.truth):,} FLSs {count:,} are drawn."
    )
    if frames < len(timeline.t_s):
        left_out += (
            f" Of {len(timeline.t_s)} samples {frames} are kept; between them flights are drawn straight."
        )
    html = f"""<figure id=scene class=scene><div class=needs-script>
<canvas tabindex=0 role=application aria-roledescription="view in space" aria-describedby=scene-help
 aria-label="The display of {esc(run.shape)} in space: arrow keys turn it"></canvas></div>
<div class="controls needs-script"><button type=button data-do=play>Play</button>
<label class=grow>Time <input type=range min=0 max=1 value=0 aria-label="Moment shown"></label>
<label>Speed <select><option value=0.25>¼</option><option value=0.5>½</option><option value=1 selected>1</option>
<option value=2>2</option><option value=4>4</option><option value=10>10</option></select></label>
<label><input type=checkbox> Moved to its place</label>
<button type=button data-do=reset>Reset view</button><output></output></div>
<figcaption id=scene-help>Drag or use the arrow keys to turn, + and − to come nearer, space to play, comma and point
for the frame before and after, 0 to go back to the first view. One colour a swarm, pale who is alone, blue when all
are one; grey is dark, red has just gone dark; small grey dots are the places where the FLSs belong. A shape may be
right and stand beside its place: moved there, by the mean error of the lit FLSs, it is seen as HD is read.
{esc(left_out)}</figcaption>
{data_block("scene-facts", facts)}{data_block("scene-data", packed.data)}</figure>"""
    return Part("replay", "The display through time", html)


def _facts(run: SavedRun, timeline: SavedTimeline, packed: Packed) -> dict[str, Any]:
    truth, clock = timeline.truth[packed.rows], clock_of(run)
    shapes = timeline.standings()
    everywhere = np.concatenate([one.truth[packed.rows][one.member[packed.rows]] for one in shapes])
    low, high = everywhere.min(axis=0), everywhere.max(axis=0)
    view = usual_view(2 if low[2] == high[2] else 3)
    radius = float(np.linalg.norm(high - low)) / 2 or 1.0
    names = np.arange(min(len(timeline.truth), LARGEST) + 1)
    counts = [len(np.unique(timeline.swarm[i][timeline.lit[i]])) for i in packed.at]
    return {
        "points": len(truth), "all": len(timeline.truth), "clock": clock.words, "digits": clock.digits,
        "times": [round(float(t), 4) for t in timeline.t_s[packed.at]],
        "hd": [float(f"{hd:.4g}") if np.isfinite(hd) else None for hd in timeline.hd_cells[packed.at]],
        "swarms": counts, "lit": timeline.lit[packed.at].sum(axis=1).tolist(),
        "low": packed.low.tolist(), "step": packed.step, "centre": ((low + high) / 2).tolist(), "radius": radius,
        "spacing": _spacing(truth), "view": list(view),
        "calm": list(CALM), "dark": list(DARK),
        "shapes": [one.from_s for one in shapes],
        "vivid": _base64(swarm_colours(names)), "pale": _base64(swarm_colours(names, PALE)),
    }  # fmt: skip


def _base64(colours: NDArray[np.uint8]) -> str:
    return base64.b64encode(np.ascontiguousarray(colours, dtype=np.uint8).tobytes()).decode()


def pack(timeline: SavedTimeline, bytes_max: int = BYTES_MAX) -> Packed:
    """As many frames as fit, first and last among them."""
    count = len(timeline.truth)
    rows = np.arange(count)
    most = max(FRAMES_MIN, VALUES_MAX // (4 * count))
    frames = min(len(timeline.t_s), FRAMES_MAX, most)
    while True:
        at = np.unique(np.linspace(0, len(timeline.t_s) - 1, frames).round().astype(np.int64))
        packed = _packed(timeline, at, rows)
        size = len(packed.data) * 3 // 4
        if size <= bytes_max or (len(at) <= FRAMES_MIN and len(rows) <= 1000):
            return packed
        share = 0.95 * bytes_max / size
        if frames > FRAMES_MIN:
            frames = max(FRAMES_MIN, min(frames - 1, int(frames * share)))
        else:
            rows = rows[:: max(2, int(np.ceil(1 / share)))]


def _packed(timeline: SavedTimeline, at: NDArray[np.int64], rows: NDArray[np.int64]) -> Packed:
    shapes = timeline.standings()
    truth = np.stack([one.truth[rows] for one in shapes])  # (K, F, 3)
    position = timeline.position[at][:, rows].astype(np.float64)
    low = np.minimum(position.min(axis=(0, 1)), truth.min(axis=(0, 1)))
    high = np.maximum(position.max(axis=(0, 1)), truth.max(axis=(0, 1)))
    step = max(float((high - low).max()) / LARGEST, STEP_CELLS)
    first = len(shapes)  # of the frames behind the points of the shapes
    values = np.empty((len(at) + first, 4, len(rows)), dtype=np.uint16)
    values[:first, :3] = np.rint((truth - low) / step).transpose(0, 2, 1)
    values[:first, 3] = [one.member[rows] for one in shapes]
    values[first:, :3] = np.rint((position - low) / step).transpose(0, 2, 1)
    swarm = timeline.swarm[at][:, rows].astype(np.int64)
    values[first:, 3] = np.where(timeline.lit[at][:, rows] & (swarm > 0), (swarm - 1) % LARGEST + 1, 0)
    values[1:] = np.diff(values, axis=0)  # unsigned: it wraps, and so does the sum in the page
    octets = np.ascontiguousarray(values).astype("<u2").view(np.uint8).reshape(-1, 2).T
    data = base64.b64encode(zlib.compress(np.ascontiguousarray(octets).tobytes(), 6)).decode()
    return Packed(data, at, rows, low, step)


def _spacing(truth: NDArray[np.float64]) -> float:
    """The usual distance to the next point, cells: what dots must fit in."""
    from scipy.spatial import cKDTree

    few = truth[:: max(1, len(truth) // 2000)]
    if len(truth) < 2:
        return 1.0
    return float(np.median(np.asarray(cKDTree(truth).query(few, k=2)[0])[:, 1])) or 1.0
