"""How a recording opens: the display on the left, curves on the right, what happened below."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmer.observe.palette import STATE_COLOURS, STATES, rgb
from swarmer.observe.tracks import EMULATED_TIME

BACKGROUND = (13, 16, 23)
HD_COLOUR, SWARMS_COLOUR = (76, 155, 232), (242, 177, 52)
SENT, DELIVERED = (242, 177, 52), (76, 155, 232)
TIMERS, MESSAGES = (141, 107, 209), (76, 176, 120)
SCENE = ("swarm/**", "ground_truth", "anchors", "localizations", "failures", "dispatchers")
HALF_VIEW = 0.52  # of the viewer's picture, up from its middle, one cell away: tan of half its 55 degrees
ASPECT = 1.25  # of the picture beside the curves, at least
ROOM = 1.12  # at its edge
WATCHED_S = 30.0  # a run that is longer is played so fast that it takes about as long as this


def log_curves(rec: Any, network: bool) -> None:
    """Names and colours of the curves. network: there are some of datagrams and lateness."""
    curves: dict[str, tuple[list[str], list[tuple[int, int, int]]]] = {
        "hd/log10": (["log10 HD"], [HD_COLOUR]),
        "hd_cells": (["HD, cells"], [HD_COLOUR]),
        "swarms": (["swarms"], [SWARMS_COLOUR]),
        "states": (list(STATES), [rgb(colour) for colour in STATE_COLOURS]),
    }
    if network:
        curves["datagrams"] = (["sent", "delivered"], [SENT, DELIVERED])
        curves["lateness"] = (["timers", "messages"], [TIMERS, MESSAGES])
    import rerun as rr

    straight = rr.components.InterpolationMode.Linear
    for entity, (names, colours) in curves.items():
        widths = [1.5] * len(names)
        look = rr.SeriesLines(names=names, colors=colours, widths=widths, interpolation_mode=straight)
        rec.log(entity, look, static=True)


def make_blueprint(truth: NDArray[np.float64], duration_s: float, network: bool, following: bool) -> Any:
    """What the viewer shows at first. truth: (F, 3), cells. network: there are curves of datagrams and lateness.

    It plays from the start, or, following, shows what came last.
    """
    import rerun.blueprint as rrb

    plots = [
        rrb.Tabs(
            _plot("/hd", "Hausdorff distance, log10 of cells"),
            _plot("/hd_cells", "Hausdorff distance, cells"),
        ),
        _plot("/swarms", "Swarms"),
        _plot("/states", "FLSs in each state", len(STATES)),
    ]
    if network:
        late = _plot("/lateness", "Lateness, p99, emulated ms", 2)
        plots.append(rrb.Tabs(_plot("/datagrams", "Datagrams per emulated second", 2), late))
    shown = rrb.Horizontal(
        _display(truth), rrb.Vertical(*plots, row_shares=[3, 2, 4, 2][: len(plots)]), column_shares=[3, 2]
    )
    return rrb.Blueprint(
        rrb.Vertical(shown, _log(), row_shares=[4, 1]),
        rrb.TimePanel(
            timeline=EMULATED_TIME,
            state="collapsed",
            play_state="following" if following else "playing",
            playback_speed=max(1.0, duration_s / WATCHED_S),
        ),
        collapse_panels=True,
    )


def _display(truth: NDArray[np.float64]) -> Any:
    """The display, whole in the picture: from the front if it is flat, else from above and a little aside."""
    import rerun.blueprint as rrb

    position, target = eye_for(truth)
    return rrb.Spatial3DView(
        origin="/",
        contents=[f"/{entity}" for entity in SCENE],
        name="Display",
        background=rrb.Background(color=BACKGROUND),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(position=position, look_target=target, eye_up=(0.0, 1.0, 0.0)),
    )


def eye_for(truth: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """From where to look at (F, 3) points, and where to, so that they fill the picture; height is up."""
    low, high = truth.min(axis=0), truth.max(axis=0)
    centre = (low + high) / 2
    flat = low[2] == high[2]  # seen aslant, what is nearer to the eye would be larger
    towards = _unit(np.array([0.0, 0.0, 1.0] if flat else [0.36, 0.27, 0.89]))
    right = _unit(np.cross([0.0, 1.0, 0.0], towards))
    across, up, near = ((truth - centre) @ np.stack([right, np.cross(towards, right), towards]).T).T
    room = np.maximum(np.abs(across) / ASPECT, np.abs(up)) / HALF_VIEW  # how far away each point must be
    away = max(float((near + ROOM * room).max()), float(near.max()) + 1.0)
    return centre + away * towards, centre


def _unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    return vector / float(np.linalg.norm(vector))


def _plot(origin: str, name: str, curves: int = 1) -> Any:
    """curves: how many; one alone needs no legend."""
    import rerun.blueprint as rrb

    legend = rrb.PlotLegend(rrb.Corner2D.RightTop, visible=curves > 1)
    return rrb.TimeSeriesView(origin=origin, name=name, plot_legend=legend)


def _log() -> Any:
    import rerun.blueprint as rrb

    columns = rrb.TextLogColumns(
        timeline_columns=[rrb.encodings.TimelineColumn(EMULATED_TIME)],
        text_log_columns=[
            rrb.encodings.TextLogColumn(rrb.encodings.TextLogColumnKind.LogLevel),
            rrb.encodings.TextLogColumn(rrb.encodings.TextLogColumnKind.Body),
        ],
    )
    return rrb.TextLogView(origin="/events", name="What happened", columns=columns)
