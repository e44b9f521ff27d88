"""Figures of recorded drives: their evaluations, replays and trajectories."""

from __future__ import annotations

import textwrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from locplan import plotting
from locplan._kernels.arrays import Floats
from locplan._util.poses import way_along
from locplan.costs import Path
from locplan.field import position_axes
from locplan.maps import OccupancyGrid
from locplan.recordings._evaluation import PREFERRED, DriveEvaluation
from locplan.recordings._recording import Recording
from locplan.recordings._replay import Replay
from locplan.recordings._trajectory import Trajectory
from locplan.simulation import LOST

RECORDED, ESTIMATED, FILTER = "black", "#0072b2", "#d55e00"
MEASURED, PREDICTED, OUTDATED = "black", "#0072b2", "#009e73"


def drive_figure(found: DriveEvaluation) -> Figure:
    """The drive over the map, and its deviations along the way.

    Its wide line is coloured by the deviation that an estimator predicts, the narrow one by the
    measured one, and ellipses compare both at some poses. Crosses are scans that saw what is not on
    the map.

    Parameters
    ----------
    found : DriveEvaluation
        What `evaluate_drive` returned.
    """
    figure, upper, lower = _over_profile_of(found.matches.grid, found.matches.recording)
    name = next(each for each in (*PREFERRED, *found.predicted) if each in found.predicted)
    predicted = position_axes(found.predicted[name])[0]
    measured = np.where(found.compared, found.matches.position_std, np.nan)
    norm = plotting.along_norm(100 * np.concatenate([measured, predicted]))
    _draw_line(upper, found, 100 * predicted, 7.0, norm)
    _draw_line(upper, found, 100 * measured, 4.0, None)
    lines = _draw_line(upper, found, 100 * measured, 2.6, norm)
    plotting.draw_along_bar(figure, lines, upper, "std. dev. of the position [cm]", 0.8)
    magnify = _draw_ellipses(upper, found, name)
    xy = found.matches.recording.poses[found.outdated, :2]
    upper.plot(*xy.T, "x", color=OUTDATED, markersize=5, mew=1.6, zorder=6)
    handles = [
        Line2D([], [], color="0.6", linewidth=7, label=f"predicted by {name}"),
        Line2D([], [], color="0.3", linewidth=2.6, label="measured"),
        Line2D([], [], color=PREDICTED, label=f"predicted ellipse{magnify}"),
        Line2D([], [], color=MEASURED, label=f"measured ellipse{magnify}"),
    ]
    if found.outdated.any():
        count = int(found.outdated.sum())
        label = f"{count} scan{'s' * (count > 1)} unlike the map"
        handles.append(Line2D([], [], color=OUTDATED, marker="x", linestyle="", label=label))
    figure.key(handles, ncols=2, at="upper center")
    _draw_profile(lower, found, {"measured": measured, f"predicted by {name}": predicted})
    return _said(figure, *found.verdict)


def _over_profile_of(
    grid: OccupancyGrid, recording: Recording
) -> tuple[plotting.Picture, Axes, Axes]:
    return _map_over_profile(grid, recording.poses, recording.source.file, recording.lidar.title)


def _map_over_profile(
    grid: OccupancyGrid, poses: Floats, file: str, about: str
) -> tuple[plotting.Picture, Axes, Axes]:
    """A figure with the map around a drive's poses, and axes for what changes along it."""
    shown = [Path(poses[:, :2])]
    part = plotting.map_around(grid, shown)
    width, height = plotting.map_size(part)
    figure = plotting.Picture(figsize=(width, height + 3.0), layout="constrained")
    upper, lower = figure.subplots(2, height_ratios=(height, 2.6))
    plotting.draw_map(upper, part)
    plotting.draw_inset(upper, grid, part, shown)
    title = f"{grid.name or 'map'}{', ' if file else ''}{file}: {about}"
    upper.set_title(title, fontsize="medium")
    lower.set_xlabel("distance along the drive [m]")
    lower.grid(alpha=0.3)
    return figure, upper, lower


def _said(figure: Figure, *sentences: str) -> Figure:
    """The figure with sentences below it."""
    width = int(11 * figure.get_figwidth())
    text = textwrap.fill(" ".join(sentences), width, break_on_hyphens=False)
    figure.supxlabel(text, fontsize="small")
    return figure


def _draw_line(
    axes: Axes, found: DriveEvaluation, values: Floats, width: float, norm: LogNorm | None
) -> LineCollection:
    """Draw the drive from scan to scan, coloured by the mean of both ends' values, or white.

    A scan far from both of its neighbours becomes a dot.
    """
    xy = found.matches.recording.poses[:, :2]
    lines = np.stack([xy[:-1], xy[1:]], axis=1)
    means = (values[:-1] + values[1:]) / 2
    shown = np.isfinite(means) & (np.hypot(*(xy[1:] - xy[:-1]).T) < 3)
    joined = np.append(shown, False) | np.insert(shown, 0, False)
    alone = np.isfinite(values) & ~joined
    dots = np.stack([xy[alone], xy[alone] + 1e-3], axis=1)  # without length they are not drawn
    colours: dict[str, Any] = {"colors": "white"}
    if norm:
        every = np.concatenate([means[shown], values[alone]])
        colours = {"array": every, "cmap": plotting.FIELD_COLOURS, "norm": norm}
    drawn = LineCollection(
        list(np.concatenate([lines[shown], dots])),
        linewidths=width,
        capstyle="round",
        zorder=3,
        **colours,
    )
    axes.add_collection(drawn)
    return drawn


def _draw_ellipses(axes: Axes, found: DriveEvaluation, name: str) -> str:
    """Draw both ellipses at poses along the drive; return how much they are magnified."""
    some = np.flatnonzero(found.compared)
    chosen = some[np.unique(np.linspace(0, len(some) - 1, 14).round().astype(int))]
    xy = found.matches.recording.poses[chosen, :2]
    every = [
        position_axes(covariance[chosen])
        for covariance in (found.predicted[name], found.matches.covariance)
    ]
    largest = max(float(major.max()) for major, _, _ in every)
    low, high = axes.get_xlim()
    # The largest takes 4 % of the map's width.
    magnify = max(1.0, float(f"{0.04 * (high - low) / (2 * largest):.1g}"))
    for (major, minor, direction), colour, line in zip(
        every, (PREDICTED, MEASURED), (2.0, 1.2), strict=True
    ):
        axes.add_collection(
            EllipseCollection(
                *(2 * magnify * major, 2 * magnify * minor, np.degrees(direction)),
                units="xy",
                offsets=xy,
                offset_transform=axes.transData,
                facecolors="none",
                edgecolors=colour,
                linewidths=line,
                zorder=5,
            )
        )
    return "" if magnify == 1 else f", {magnify:g} times as large"


def _draw_profile(axes: Axes, found: DriveEvaluation, values: dict[str, Floats]) -> None:
    """Draw deviations along the way, and where scans are unlike the map."""
    way = way_along(found.matches.recording.poses)
    for (label, each), colour, line in zip(
        values.items(), (MEASURED, PREDICTED), (1.2, 2.0), strict=True
    ):
        axes.plot(way, 100 * each, color=colour, linewidth=line, label=label, zorder=4 - line)
    if found.outdated.any():
        at = way[found.outdated]
        low = 100 * min(float(np.nanmin(each)) for each in values.values())
        axes.plot(at, np.full(len(at), low), "x", color=OUTDATED, markersize=4)
    axes.set(yscale="log", xlim=(0, max(way[-1], 1e-3)), ylabel="std. dev. [cm]")
    plotting.label_plainly(axes.yaxis)


def replay_figure(replay: Replay) -> Figure:
    """The recorded way and the filter's over the map, and its error along the drive.

    Parameters
    ----------
    replay : Replay
        What `locplan.recordings.replay` returned.
    """
    figure, upper, lower = _over_profile_of(replay.grid, replay.recording)
    xy, ways = replay.recording.poses[:, :2], replay.poses[:20, :, :2]
    for way in ways:
        upper.plot(*way.T, color=ESTIMATED, linewidth=1.2, alpha=0.5, zorder=4)
    upper.plot(*xy.T, color=RECORDED, linewidth=1.0, linestyle=(0, (4, 2)), zorder=5)
    upper.plot(*xy[0], "o", color=RECORDED, markersize=6, zorder=6)
    profile, deviation = replay.drives.profile(), replay.filter_std
    way, known = profile[:, 0], np.isfinite(deviation)
    low, high = profile[:, 6], profile[:, 7]
    style: dict[str, Any] = {"color": ESTIMATED}
    runs = f"error, median of {len(replay.errors)} runs"
    lower.plot(way, profile[:, 5], linewidth=1.8, label=runs, **style)
    lower.fill_between(way, low, high, alpha=0.2, linewidth=0, label="error, 10 to 90 %", **style)
    style = {"color": FILTER, "linestyle": "--", "label": "rms deviation by the filter"}
    lower.plot(way[known], deviation[known], linewidth=1.4, **style)
    top = 1.1 * max(float(high.max()), float(deviation[known].max(initial=0.0)))
    if top > LOST / 2:
        lower.axhline(LOST, color="0.5", linewidth=0.8, zorder=0)
        box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1}
        style = {"ha": "left", "va": "bottom", "fontsize": "small", "bbox": box}
        lower.annotate("off by > 1 m", (0, LOST), (4, 2), textcoords="offset points", **style)
    lower.set(xlim=(0, max(way[-1], 1e-3)), ylim=(0, top), ylabel="position [m]")
    style = {"bbox_to_anchor": (0.5, 1.0), "frameon": False, "fontsize": "small"}
    lower.legend(loc="lower center", ncols=3, **style)
    recorded = Line2D([], [], color=RECORDED, linestyle=(0, (4, 2)), marker="o", label="recorded")
    estimated = Line2D([], [], color=ESTIMATED, label=f"AMCL replayed, {len(ways)} runs")
    figure.key([recorded, estimated], ncols=2, at="upper center")
    return _said(figure, replay.verdict, *(f"Note: {each}." for each in replay.notes))


def trajectory_figure(found: Trajectory) -> Figure:
    """The trajectory over the map, coloured by its deviation, and that along the way.

    Crosses are poses that are not to be trusted, and the thin line is the log's own poses.

    Parameters
    ----------
    found : Trajectory
        What `smooth` returned, with its map.
    """
    assert found.grid is not None  # else it is not drawable
    xy, deviation, doubtful = found.poses[:, :2], 100 * found.deviation, ~found.trusted
    about = f"{len(found):,} scans"
    figure, upper, lower = _map_over_profile(found.grid, found.poses, found.drive, about)
    look: dict[str, Any] = {"cmap": plotting.FIELD_COLOURS, "capstyle": "round"}
    means = (deviation[:-1] + deviation[1:]) / 2
    drawn = plotting.draw_along(upper, xy, means, norm=plotting.along_norm(deviation), **look)
    plotting.draw_along_bar(figure, drawn, upper, "std. dev. of the position [cm]", 0.8)
    limits = upper.get_xlim(), upper.get_ylim()
    upper.plot(*found.recorded[:, :2].T, color=RECORDED, linewidth=0.8, alpha=0.7, zorder=4)
    upper.plot(*xy[doubtful].T, "x", color=FILTER, markersize=5, mew=1.6, zorder=6)
    jumps = np.array([(each.x, each.y) for each in found.jumps]).reshape(-1, 2)
    upper.plot(*jumps.T, "o", mfc="none", color=FILTER, markersize=11, mew=1.8, zorder=6)
    upper.set(xlim=limits[0], ylim=limits[1])
    way = way_along(found.poses)
    lower.plot(way, 100 * found.off, color=RECORDED, linewidth=0.8)
    lower.plot(way, deviation, color=PREDICTED, linewidth=1.8)
    lower.plot(way[doubtful], deviation[doubtful], "x", color=FILTER, markersize=4)
    lower.set(yscale="log", xlim=(0, max(way[-1], 1e-3)), ylabel="position [cm]")
    lower.set_ylim(bottom=deviation.min() / 5)  # by chance some poses are the log's own
    plotting.label_plainly(lower.yaxis)
    crosses: dict[str, Any] = {"color": FILTER, "linestyle": ""}
    handles = [
        Line2D([], [], color="0.5", linewidth=4, label="trajectory"),
        Line2D([], [], color=RECORDED, linewidth=0.8, label="log's own poses; their distance"),
        Line2D([], [], color=PREDICTED, linewidth=1.8, label="std. dev. of the position"),
    ]
    if doubtful.any():
        handles.append(Line2D([], [], marker="x", label="not to be trusted", **crosses))
    if found.jumps:
        handles.append(Line2D([], [], marker="o", mfc="none", label="odometry jumps", **crosses))
    figure.key(handles, ncols=2, at="upper center")
    return _said(figure, *found.sentences)
