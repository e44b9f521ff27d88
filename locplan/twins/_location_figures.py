"""Figures of located scans: where the robot may be, and how a whole drive is located."""

from __future__ import annotations

import math
import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse
from numpy.typing import ArrayLike, NDArray

from locplan._util.poses import ends_in_map
from locplan.costs import Path
from locplan.field import position_axes
from locplan.plotting import Picture, draw_inset, draw_map, draw_number, map_size, style, zoomed_to
from locplan.twins._located_drive import LocatedDrive
from locplan.twins._location import Location, Mode

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
    width, height = map_size(grid)
    on_robot = location.lidar.ends_on_robot(location.ranges[None].astype(np.float32))
    ends = ends_in_map(on_robot, np.array([best.pose]))[0]
    away = np.hypot(*(ends - np.array(best.pose[:2])).T)
    # Minimum distance from the robot to the edges of that map [m].
    reach = max(4.0, 1.1 * float(np.nanquantile(away, 0.95)))
    # Share of the map's width from which on the surroundings of the robot get no map of their own.
    columns = 2 if 2 * reach < 0.6 * _width_of(grid) else 1
    figure = Picture(
        figsize=(width + (columns - 1) * CLOSE, max(height, CLOSE) + 1.2), layout="constrained"
    )
    axes = figure.subplots(1, columns, squeeze=False, width_ratios=(width, CLOSE)[:columns])[0]
    for own in axes:
        draw_map(own, grid)
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
    magnify = _magnified(close, best)
    larger = "" if magnify == 1 else f", {magnify:g} times as large"
    for own in axes:
        for mode in location.modes:
            _draw_ellipse(own, mode, magnify, style.VERMILION if mode is best else style.BLUE)
    handles = [
        Line2D([], [], color=style.VERMILION, marker=".", linestyle="", label="scan at place 1"),
        Line2D([], [], color=style.VERMILION, label=f"{DEVIATIONS:g} std. deviations{larger}"),
    ]
    if recorded is not None:
        pose = np.asarray(recorded, np.float64)
        for own in axes:
            own.plot(*pose[:2], "x", color=style.GREEN, markersize=9, mew=2, zorder=7)
        handles.append(
            Line2D(
                [], [], color=style.GREEN, marker="x", mew=2, linestyle="", label="recorded pose"
            )
        )
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    letters = int(11 * figure.get_figwidth())
    lines = [f"{grid.name or 'map'}; {location.lidar.title}"]
    lines += textwrap.wrap(location.sentence, letters, break_on_hyphens=False)
    if len(location.modes) > 1:
        weights = [f"{n}: {_percent(mode.weight)}" for n, mode in enumerate(location.modes, 1)]
        lines += textwrap.wrap(f"share of each place:  {',  '.join(weights)}", letters)
    figure.suptitle("\n".join(lines), fontsize="medium")
    return figure


def _width_of(grid: Any) -> float:
    """Maximum extent of the map [m]."""
    return float(max(grid.shape) * grid.resolution)


def _draw_modes(axes: Axes, location: Location) -> None:
    """Draw the modes, the best one last, each with its number at one side or the other."""
    for n, mode in reversed(list(enumerate(location.modes, 1))):
        colour = style.VERMILION if n == 1 else style.BLUE
        _draw_arrow(axes, mode.pose, colour)
        heading, side = mode.pose[2], (1, -1)[n % 2]
        aside = -15 * side * math.sin(heading), 15 * side * math.cos(heading)
        draw_number(axes, n, mode.pose[:2], aside, colour, zorder=8 if n == 1 else 7)


def _percent(share: float) -> str:
    return f"{share:.0%}" if share >= 0.005 else "< 1%"


def _draw_arrow(axes: Axes, pose: tuple[float, float, float], colour: str) -> None:
    """Draw a pose as a dot with an arrow of its heading, of one size at any scale."""
    x, y, heading = pose
    axes.plot(x, y, "o", color=colour, markersize=6, markeredgecolor="white", zorder=6)
    ahead = 20 * math.cos(heading), 20 * math.sin(heading)
    arrow = {"arrowstyle": "<|-", "color": colour, "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (x, y), ahead, textcoords="offset points", arrowprops=arrow, zorder=6)


def _magnified(axes: Axes, mode: Mode) -> float:
    """How much the ellipse of a mode is magnified so that it is seen."""
    low, high = axes.get_xlim()
    # Size to which ellipses are magnified, as a share of the map's width.
    return max(1.0, float(f"{0.08 * (high - low) / (DEVIATIONS * mode.position_std):.1g}"))


def _draw_ellipse(axes: Axes, mode: Mode, magnify: float, colour: str) -> None:
    """Draw the ellipse of a mode's position."""
    major, minor, direction = (float(each) for each in position_axes(mode.covariance))
    size = 2 * DEVIATIONS * magnify * np.array([major, minor])
    axes.add_patch(
        Ellipse(
            mode.pose[:2],
            *size,
            angle=math.degrees(direction),
            facecolor="none",
            edgecolor=colour,
            linewidth=1.2,
            zorder=5,
        )
    )


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
        return locate_figure(found.alone, recorded=found.recording.poses[0])
    grid, drive = found.grid, found.recording.poses[:, :2]
    poses, right, certain = found.poses[:, :2], found.right, found.certain
    known = np.isfinite(poses[:, 0])
    shown = [Path(np.concatenate([drive, poses[known]]))]
    part = zoomed_to(grid, shown)
    width, height = map_size(part)
    figure = Picture(figsize=(width, height + 1.4), layout="constrained")
    axes = figure.add_subplot()
    draw_map(axes, part)
    draw_inset(axes, grid, part, shown)
    wrong = known & ~right
    kinds: list[tuple[str, NDArray[np.bool_], dict[str, Any]]] = [
        ("right, certain", right & certain, {"marker": "o", "color": style.BLUE}),
        (
            "right, other places alike",
            right & ~certain,
            {"marker": "o", "mfc": "white", "color": style.BLUE},
        ),
        (
            "elsewhere, other places alike",
            wrong & ~certain,
            {"marker": "s", "mfc": "white", "color": style.VERMILION},
        ),
        ("elsewhere, certain", wrong & certain, {"marker": "s", "color": style.VERMILION}),
        ("too few returns", ~known, {"marker": "x", "color": "0.4"}),
    ]
    axes.add_collection(
        LineCollection(
            list(np.stack([drive[wrong], poses[wrong]], axis=1)),
            colors=style.VERMILION,
            linewidths=0.8,
            linestyles="dotted",
            zorder=3,
        )
    )
    axes.plot(*poses[wrong].T, "+", color=style.VERMILION, markersize=7, zorder=4)
    for label, chosen, mark in kinds:
        if chosen.any():
            text = f"{label}: {int(chosen.sum())}"
            axes.plot(*drive[chosen].T, linestyle="", markersize=5, label=text, zorder=5, **mark)
    if wrong.any():
        axes.plot([], [], "+", color=style.VERMILION, label="where they were found")
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    lines = textwrap.wrap(found.sentence, int(11 * width), break_on_hyphens=False)
    title = f"{grid.name or 'map'}; {found.recording.lidar.title}"
    figure.suptitle("\n".join([title, *lines]), fontsize="medium")
    return figure
