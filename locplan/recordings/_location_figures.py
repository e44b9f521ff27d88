"""Figures of located scans, and of located drives."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse
from numpy.typing import ArrayLike

from locplan import plotting
from locplan._kernels.arrays import Bools
from locplan._util.poses import ends_in_map
from locplan.costs import Path
from locplan.field import position_axes
from locplan.maps import OccupancyGrid
from locplan.plotting import style
from locplan.recordings._location import LocatedDrive, Location

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CLOSE = 4.5
"""Width of that map [inch]."""
DEVIATIONS = 2.0
"""Deviations at which ellipses are drawn."""


def locate_figure(location: Location, *, recorded: ArrayLike | None = None) -> Figure:
    """The map with the scan at the best mode, and the other modes, numbered, with their weights.

    Ellipses show the deviations of the positions. Where the robot sees but a part of the map, its
    surroundings are shown beside it.

    Parameters
    ----------
    location : Location
        A located scan, as `locate` returns it.
    recorded : (3,) array, optional
        Another pose x, y, heading to show, such as the recorded one [m, m, rad]; none by default.
    """
    grid, best = location.grid, location.best
    width, height = plotting.map_size(grid)
    on_robot = location.lidar.ends_on_robot(location.ranges[None].astype(np.float32))
    ends = ends_in_map(on_robot, np.array([best.pose]))[0]
    away = np.hypot(*(ends - np.array(best.pose[:2])).T)
    # Minimum distance from the robot to the edges of that map [m].
    reach = max(4.0, 1.1 * float(np.nanquantile(away, 0.95)))
    # Share of the map's width from which on the surroundings of the robot get no map of their own.
    columns = 2 if 2 * reach < 0.6 * max(grid.shape) * grid.resolution else 1
    figure = plotting.Picture(
        figsize=(width + (columns - 1) * CLOSE, max(height, CLOSE) + 1.2), layout="constrained"
    )
    axes = figure.subplots(1, columns, squeeze=False, width_ratios=(width, CLOSE)[:columns])[0]
    for own in axes:
        plotting.draw_map(own, grid)
        own.plot(*ends.T, ".", color=style.VERMILION, markersize=3, zorder=4)
    _draw_modes(axes[0], location)
    close = axes[-1]
    if columns == 2:
        x, y, _ = best.pose
        (left, right), (low, high) = close.get_xlim(), close.get_ylim()
        close.set(xlim=(max(left, x - reach), min(right, x + reach)), ylabel="")
        close.set(ylim=(max(low, y - reach), min(high, y + reach)))
        close.set_title("around place 1", fontsize="medium", loc="left")
        _draw_arrow(close, best.pose, style.VERMILION)
    low, high = close.get_xlim()
    # Ellipses are so much larger that that of the best mode has this share of the map's width.
    magnify = max(1.0, float(f"{0.08 * (high - low) / (DEVIATIONS * best.position_std):.1g}"))
    larger = "" if magnify == 1 else f", {magnify:g} times as large"
    for own in axes:
        for mode in location.modes:
            major, minor, direction = (float(each) for each in position_axes(mode.covariance))
            own.add_patch(
                Ellipse(
                    mode.pose[:2],
                    2 * DEVIATIONS * magnify * major,
                    2 * DEVIATIONS * magnify * minor,
                    angle=math.degrees(direction),
                    facecolor="none",
                    edgecolor=style.VERMILION if mode is best else style.BLUE,
                    linewidth=1.2,
                    zorder=5,
                )
            )
    handles = [
        Line2D([], [], color=style.VERMILION, marker=".", linestyle="", label="scan at place 1"),
        Line2D([], [], color=style.VERMILION, label=f"{DEVIATIONS:g} std. deviations{larger}"),
    ]
    if recorded is not None:
        pose = np.asarray(recorded, np.float64)
        for own in axes:
            own.plot(*pose[:2], "x", color=style.GREEN, markersize=9, mew=2, zorder=7)
        cross = Line2D([], [], color=style.GREEN, marker="x", mew=2, ls="", label="recorded pose")
        handles.append(cross)
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    lines = [location.sentence]
    if len(location.modes) > 1:
        weights = [
            f"{n}: {mode.weight:.0%}" if mode.weight >= 0.005 else f"{n}: < 1%"
            for n, mode in enumerate(location.modes, 1)
        ]
        lines.append(f"share of each place:  {',  '.join(weights)}")
    figure.title(f"{grid.name or 'map'}; {location.lidar.title}", *lines)
    return figure


def _draw_modes(axes: Axes, location: Location) -> None:
    """Draw the modes, the best one last, each with its number at one side or the other."""
    for n, mode in reversed(list(enumerate(location.modes, 1))):
        colour = style.VERMILION if n == 1 else style.BLUE
        _draw_arrow(axes, mode.pose, colour)
        heading, side = mode.pose[2], (1, -1)[n % 2]
        aside = -15 * side * math.sin(heading), 15 * side * math.cos(heading)
        plotting.draw_number(axes, n, mode.pose[:2], aside, colour, zorder=8 if n == 1 else 7)


def _draw_arrow(axes: Axes, pose: tuple[float, float, float], colour: str) -> None:
    """Draw a pose as a dot with an arrow of its heading, of one size at any scale."""
    x, y, heading = pose
    axes.plot(x, y, "o", color=colour, markersize=6, markeredgecolor="white", zorder=6)
    ahead = 20 * math.cos(heading), 20 * math.sin(heading)
    arrow = {"arrowstyle": "<|-", "color": colour, "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (x, y), ahead, textcoords="offset points", arrowprops=arrow, zorder=6)


def located_drive_figure(found: LocatedDrive) -> Figure:
    """The recorded drive over the map, with what each scan by itself was located as.

    Scans that are located elsewhere are joined to the place where they were found. The only scan is
    drawn by `locate_figure`.

    Parameters
    ----------
    found : LocatedDrive
        What `locate_drive` returned.
    """
    if found.alone:
        recorded = found.recording.poses[0] if found.recording.has_poses else None
        return locate_figure(found.alone, recorded=recorded)
    grid, poses, right, certain = found.grid, found.poses[:, :2], found.right, found.certain
    known = np.isfinite(poses[:, 0])
    drive = found.recording.poses[:, :2]
    if not found.recording.has_poses:  # then the best places are drawn by themselves
        drive, right = np.where(known[:, None], poses, 0.0), known
    shown = [Path(np.concatenate([drive[known | found.recording.has_poses], poses[known]]))]
    part = plotting.zoomed_to(grid, shown)
    figure, axes = _on_map(part, 1.4)
    plotting.draw_inset(axes, grid, part, shown)
    wrong = known & ~right
    kinds: list[tuple[str, Bools, str, str]] = [
        ("right, certain", right & certain, "o", style.BLUE),
        ("right, other places alike", right & ~certain, "o", style.BLUE),
        ("elsewhere, other places alike", wrong & ~certain, "s", style.VERMILION),
        ("elsewhere, certain", wrong & certain, "s", style.VERMILION),
        ("too few returns", ~known & found.recording.has_poses, "x", "0.4"),
    ]
    joined = list(np.stack([drive[wrong], poses[wrong]], axis=1))
    dotted: dict[str, Any] = {"linewidths": 0.8, "linestyles": "dotted", "zorder": 3}
    axes.add_collection(LineCollection(joined, colors=style.VERMILION, **dotted))
    axes.plot(*poses[wrong].T, "+", color=style.VERMILION, markersize=7, zorder=4)
    for label, chosen, marker, colour in kinds:
        if chosen.any():
            face = "white" if "alike" in label else colour
            text = label if found.recording.has_poses else label.removeprefix("right, ")
            named: dict[str, Any] = {"label": f"{text}: {int(chosen.sum())}", "zorder": 5}
            axes.plot(*drive[chosen].T, marker, color=colour, mfc=face, markersize=5, **named)
    if wrong.any():
        axes.plot([], [], "+", color=style.VERMILION, label="where they were found")
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    figure.title(f"{grid.name or 'map'}; {found.recording.lidar.title}", found.sentence)
    return figure


def _on_map(grid: OccupancyGrid, more: float) -> tuple[plotting.Picture, Axes]:
    """A figure with Axes on which the map is drawn, so much higher than it [inch]."""
    width, height = plotting.map_size(grid)
    figure = plotting.Picture(figsize=(width, height + more), layout="constrained")
    axes = figure.add_subplot()
    plotting.draw_map(axes, grid)
    return figure, axes
