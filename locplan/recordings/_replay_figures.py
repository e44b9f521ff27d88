"""Figure of replays of recorded drives."""

from __future__ import annotations

import textwrap

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from locplan.costs import Path
from locplan.plotting import Picture, draw_inset, draw_map, map_around, map_size
from locplan.recordings._figures import title_of
from locplan.recordings._replay import Replay
from locplan.simulation import LOST

RECORDED, ESTIMATED, FILTER = "black", "#0072b2", "#d55e00"
MOST_RUNS = 20
"""Number of runs whose ways are drawn."""


def replay_figure(replay: Replay) -> Figure:
    """The recorded way and the filter's over the map, and its error along the drive.

    Parameters
    ----------
    replay : Replay
        What `locplan.recordings.replay` returned.
    """
    grid, xy = replay.grid, replay.recording.poses[:, :2]
    shown = [Path(xy)]
    part = map_around(grid, shown)
    width, height = map_size(part)
    figure = Picture(figsize=(width, height + 3.0), layout="constrained")
    upper, lower = figure.subplots(2, height_ratios=(height, 2.6))
    draw_map(upper, part)
    draw_inset(upper, grid, part, shown)
    for way in replay.poses[:MOST_RUNS, :, :2]:
        upper.plot(*way.T, color=ESTIMATED, linewidth=1.2, alpha=0.5, zorder=4)
    upper.plot(*xy.T, color=RECORDED, linewidth=1.0, linestyle=(0, (4, 2)), zorder=5)
    upper.plot(*xy[0], "o", color=RECORDED, markersize=6, zorder=6)
    upper.set_title(title_of(replay.recording, grid), fontsize="medium")
    profile, spread = replay.drives.profile(), replay.filter_std
    way, known = profile[:, 0], np.isfinite(spread)
    low, high = profile[:, 6], profile[:, 7]
    lower.fill_between(way, low, high, color=ESTIMATED, alpha=0.2, linewidth=0)
    lower.plot(way, profile[:, 5], color=ESTIMATED, linewidth=1.8)
    lower.plot(way[known], spread[known], color=FILTER, linewidth=1.4, linestyle="--")
    top = 1.1 * max(float(high.max()), float(spread[known].max(initial=0.0)))
    if top > LOST / 2:
        lower.axhline(LOST, color="0.5", linewidth=0.8, zorder=0)
        box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1}
        style = {"ha": "left", "va": "bottom", "fontsize": "small", "bbox": box}
        lower.annotate("lost", (0, LOST), (4, 2), textcoords="offset points", **style)
    lower.set(xlim=(0, max(way[-1], 1e-3)), ylim=(0, top))
    lower.set(xlabel="distance along the drive [m]", ylabel="position [m]")
    lower.grid(alpha=0.3)
    runs = f"{len(replay.errors)} runs"
    lower.legend(
        handles=[
            Line2D([], [], color=ESTIMATED, linewidth=1.8, label=f"error, median of {runs}"),
            Patch(color=ESTIMATED, alpha=0.2, label="error, 10 to 90 %"),
            Line2D([], [], color=FILTER, linestyle="--", label="rms deviation by the filter"),
        ],
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        ncols=3,
        frameon=False,
        fontsize="small",
    )
    drawn = min(MOST_RUNS, len(replay.errors))
    figure.legend(
        handles=[
            Line2D([], [], color=RECORDED, linestyle=(0, (4, 2)), marker="o", label="recorded"),
            Line2D([], [], color=ESTIMATED, label=f"AMCL replayed, {drawn} runs"),
        ],
        loc="outside upper center",
        ncols=2,
        frameon=False,
    )
    text = " ".join([replay.verdict, *(f"Note: {each}." for each in replay.notes)])
    figure.supxlabel(textwrap.fill(text, int(11 * width), break_on_hyphens=False), fontsize="small")
    return figure
