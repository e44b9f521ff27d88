"""Figures of recorded drives: evaluations, replays, trajectories, and located scans."""

from __future__ import annotations

import math
import textwrap
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse
from numpy.typing import ArrayLike

from locplan._support import drawing as style
from locplan._support.drawing import (
    FIELD_COLOURS,
    NotebookFigure,
    draw_number,
    label_with_plain_numbers,
)
from locplan._support.kernels.arrays import Bools, Floats
from locplan._support.poses import compute_travel_distances, move_ends_to_poses
from locplan.field.covariance import position_axes
from locplan.maps.figures import compute_figure_size, crop_map, draw_map, zoom_map
from locplan.maps.grid import OccupancyGrid
from locplan.planning.figures import (
    draw_coloured_line,
    draw_inset,
    draw_path_colour_bar,
    make_path_norm,
)
from locplan.planning.path import Path
from locplan.recordings.evaluation import PREFERRED, DriveEvaluation
from locplan.recordings.location import LocatedDrive, Location
from locplan.recordings.recording import Recording
from locplan.recordings.replays import Replay
from locplan.recordings.trajectory import Trajectory
from locplan.simulation.drives import LOST_DISTANCE, LOST_SHORT_TEXT

if TYPE_CHECKING:
    from matplotlib.axes import Axes


RECORDED, ESTIMATED, FILTER = "black", "#0072b2", "#d55e00"
MEASURED, PREDICTED, OUTDATED = "black", "#0072b2", "#009e73"


def drive_figure(drive_evaluation: DriveEvaluation) -> Figure:
    """Draw the drive on the map, and its standard deviations along the path.

    The wide line shows the predicted standard deviation, the narrow line the measured one. Ellipses
    compare both at some poses. Crosses mark scans that do not match the map.

    Parameters
    ----------
    drive_evaluation : DriveEvaluation
        The result of `evaluate_drive`.
    """
    figure, upper, lower = _make_recording_axes(
        drive_evaluation.matches.grid, drive_evaluation.matches.recording
    )
    name = next(
        estimator_name
        for estimator_name in (*PREFERRED, *drive_evaluation.predicted)
        if estimator_name in drive_evaluation.predicted
    )
    predicted = position_axes(drive_evaluation.predicted[name])[0]
    measured = np.where(drive_evaluation.is_compared, drive_evaluation.matches.position_std, np.nan)
    norm = make_path_norm(100 * np.concatenate([measured, predicted]))
    _draw_drive_line(upper, drive_evaluation, 100 * predicted, 7.0, norm)
    _draw_drive_line(upper, drive_evaluation, 100 * measured, 4.0, None)
    lines = _draw_drive_line(upper, drive_evaluation, 100 * measured, 2.6, norm)
    draw_path_colour_bar(figure, lines, upper, "std. dev. of the position [cm]", 0.8)
    magnify = _draw_ellipses(upper, drive_evaluation, name)
    xy = drive_evaluation.matches.recording.poses[drive_evaluation.is_outdated, :2]
    upper.plot(*xy.T, "x", color=OUTDATED, markersize=5, mew=1.6, zorder=6)
    handles = [
        Line2D([], [], color="0.6", linewidth=7, label=f"predicted by {name}"),
        Line2D([], [], color="0.3", linewidth=2.6, label="measured"),
        Line2D([], [], color=PREDICTED, label=f"predicted ellipse{magnify}"),
        Line2D([], [], color=MEASURED, label=f"measured ellipse{magnify}"),
    ]
    if drive_evaluation.is_outdated.any():
        count = int(drive_evaluation.is_outdated.sum())
        label = f"{count} scan{'s' * (count > 1)} not matching the map"
        handles.append(Line2D([], [], color=OUTDATED, marker="x", linestyle="", label=label))
    figure.key(handles, ncols=2, at="upper center")
    _draw_profile(
        lower, drive_evaluation, {"measured": measured, f"predicted by {name}": predicted}
    )
    return _add_sentences(figure, *drive_evaluation.verdict)


def _make_recording_axes(
    grid: OccupancyGrid, recording: Recording
) -> tuple[NotebookFigure, Axes, Axes]:
    """Make a figure with the map around a recording, and axes for profiles along it."""
    return _make_drive_axes(grid, recording.poses, recording.source.file, recording.lidar.title)


def _make_drive_axes(
    grid: OccupancyGrid, poses: Floats, file: str, subtitle: str
) -> tuple[NotebookFigure, Axes, Axes]:
    """Make a figure with the map around a drive's poses, and axes for profiles along it."""
    drive_paths = [Path(poses[:, :2])]
    part = crop_map(grid, drive_paths)
    width, height = compute_figure_size(part)
    figure = NotebookFigure(figsize=(width, height + 3.0), layout="constrained")
    upper, lower = figure.subplots(2, height_ratios=(height, 2.6))
    draw_map(upper, part)
    draw_inset(upper, grid, part, drive_paths)
    title = f"{grid.name or 'map'}{', ' if file else ''}{file}: {subtitle}"
    upper.set_title(title, fontsize="medium")
    lower.set_xlabel("distance along the drive [m]")
    lower.grid(alpha=0.3)
    return figure, upper, lower


def _add_sentences(figure: Figure, *sentences: str) -> Figure:
    """Add sentences below a figure."""
    width = int(11 * figure.get_figwidth())
    text = textwrap.fill(" ".join(sentences), width, break_on_hyphens=False)
    figure.supxlabel(text, fontsize="small")
    return figure


def _draw_drive_line(
    axes: Axes,
    drive_evaluation: DriveEvaluation,
    values: Floats,
    width: float,
    norm: LogNorm | None,
) -> LineCollection:
    """Draw the drive from scan to scan, coloured by the mean of both ends' values, or white.

    A scan far from both of its neighbours becomes a dot.
    """
    xy = drive_evaluation.matches.recording.poses[:, :2]
    lines = np.stack([xy[:-1], xy[1:]], axis=1)
    means = (values[:-1] + values[1:]) / 2
    is_segment = np.isfinite(means) & (np.hypot(*(xy[1:] - xy[:-1]).T) < 3)
    is_joined = np.append(is_segment, False) | np.insert(is_segment, 0, False)
    is_dot = np.isfinite(values) & ~is_joined
    dots = np.stack([xy[is_dot], xy[is_dot] + 1e-3], axis=1)  # without length they are not drawn
    line_collection = LineCollection(
        list(np.concatenate([lines[is_segment], dots])),
        linewidths=width,
        capstyle="round",
        zorder=3,
        colors=None if norm else "white",
        cmap=FIELD_COLOURS,
        norm=norm,
    )
    if norm:
        line_collection.set_array(np.concatenate([means[is_segment], values[is_dot]]))
    axes.add_collection(line_collection)
    return line_collection


def _draw_ellipses(axes: Axes, drive_evaluation: DriveEvaluation, name: str) -> str:
    """Draw both ellipses at poses along the drive; return a text with their magnification."""
    compared_scans = np.flatnonzero(drive_evaluation.is_compared)
    ellipse_scans = compared_scans[
        np.unique(np.linspace(0, len(compared_scans) - 1, 14).round().astype(int))
    ]
    xy = drive_evaluation.matches.recording.poses[ellipse_scans, :2]
    ellipse_axes = [
        position_axes(covariance[ellipse_scans])
        for covariance in (drive_evaluation.predicted[name], drive_evaluation.matches.covariance)
    ]
    largest = max(float(major.max()) for major, _, _ in ellipse_axes)
    low, high = axes.get_xlim()
    # The largest takes 4 % of the map's width.
    magnify = max(1.0, float(f"{0.04 * (high - low) / (2 * largest):.1g}"))
    for (major, minor, direction), colour, line in zip(
        ellipse_axes, (PREDICTED, MEASURED), (2.0, 1.2), strict=True
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


def _draw_profile(axes: Axes, drive_evaluation: DriveEvaluation, values: dict[str, Floats]) -> None:
    """Draw standard deviations along the drive, and mark scans that do not match the map."""
    way = compute_travel_distances(drive_evaluation.matches.recording.poses)
    for (label, deviations), colour, line in zip(
        values.items(), (MEASURED, PREDICTED), (1.2, 2.0), strict=True
    ):
        axes.plot(way, 100 * deviations, color=colour, linewidth=line, label=label, zorder=4 - line)
    if drive_evaluation.is_outdated.any():
        at = way[drive_evaluation.is_outdated]
        low = 100 * min(float(np.nanmin(deviations)) for deviations in values.values())
        axes.plot(at, np.full(len(at), low), "x", color=OUTDATED, markersize=4)
    axes.set(yscale="log", xlim=(0, max(way[-1], 1e-3)), ylabel="std. dev. [cm]")
    label_with_plain_numbers(axes.yaxis)


def replay_figure(replay: Replay) -> Figure:
    """Draw the recorded path and the filter's on the map, and the filter's error along the drive.

    Parameters
    ----------
    replay : Replay
        The result of `locplan.recordings.replay`.
    """
    figure, upper, lower = _make_recording_axes(replay.grid, replay.recording)
    xy, ways = replay.recording.poses[:, :2], replay.poses[:20, :, :2]
    for way in ways:
        upper.plot(*way.T, color=ESTIMATED, linewidth=1.2, alpha=0.5, zorder=4)
    upper.plot(*xy.T, color=RECORDED, linewidth=1.0, linestyle=(0, (4, 2)), zorder=5)
    upper.plot(*xy[0], "o", color=RECORDED, markersize=6, zorder=6)
    profile, deviation = replay.drives.profile(), replay.filter_std
    way, has_deviation = profile[:, 0], np.isfinite(deviation)
    low, high = profile[:, 6], profile[:, 7]
    runs = f"error, median of {len(replay.errors)} runs"
    lower.plot(way, profile[:, 5], linewidth=1.8, label=runs, color=ESTIMATED)
    lower.fill_between(
        way, low, high, alpha=0.2, linewidth=0, label="error, 10 to 90 %", color=ESTIMATED
    )
    lower.plot(
        way[has_deviation],
        deviation[has_deviation],
        linewidth=1.4,
        color=FILTER,
        linestyle="--",
        label="rms deviation reported by the filter",
    )
    top = 1.1 * max(float(high.max()), float(deviation[has_deviation].max(initial=0.0)))
    if top > LOST_DISTANCE / 2:
        lower.axhline(LOST_DISTANCE, color="0.5", linewidth=0.8, zorder=0)
        lower.annotate(
            LOST_SHORT_TEXT,
            (0, LOST_DISTANCE),
            (4, 2),
            textcoords="offset points",
            ha="left",
            va="bottom",
            fontsize="small",
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1},
        )
    lower.set(xlim=(0, max(way[-1], 1e-3)), ylim=(0, top), ylabel="position [m]")
    lower.legend(
        loc="lower center", ncols=3, bbox_to_anchor=(0.5, 1.0), frameon=False, fontsize="small"
    )
    recorded = Line2D([], [], color=RECORDED, linestyle=(0, (4, 2)), marker="o", label="recorded")
    estimated = Line2D([], [], color=ESTIMATED, label=f"AMCL replayed, {len(ways)} runs")
    figure.key([recorded, estimated], ncols=2, at="upper center")
    return _add_sentences(figure, replay.verdict, *(f"Note: {note}." for note in replay.notes))


def trajectory_figure(drive_trajectory: Trajectory) -> Figure:
    """Draw a trajectory on its map, coloured by standard deviation, and the deviation along it.

    Crosses mark doubtful poses; the thin line shows the poses of the log.

    Parameters
    ----------
    drive_trajectory : Trajectory
        The result of `smooth`, with its map.
    """
    assert drive_trajectory.grid is not None  # `drawable` is False without a map
    xy = drive_trajectory.poses[:, :2]
    deviation = 100 * drive_trajectory.deviation
    doubtful = ~drive_trajectory.is_trusted
    scan_count = f"{len(drive_trajectory):,} scans"
    figure, upper, lower = _make_drive_axes(
        drive_trajectory.grid, drive_trajectory.poses, drive_trajectory.drive, scan_count
    )
    means = (deviation[:-1] + deviation[1:]) / 2
    norm = make_path_norm(deviation)
    drive_line = draw_coloured_line(
        upper, xy, means, norm=norm, cmap=FIELD_COLOURS, capstyle="round"
    )
    draw_path_colour_bar(figure, drive_line, upper, "std. dev. of the position [cm]", 0.8)
    limits = upper.get_xlim(), upper.get_ylim()
    upper.plot(
        *drive_trajectory.recorded[:, :2].T, color=RECORDED, linewidth=0.8, alpha=0.7, zorder=4
    )
    upper.plot(*xy[doubtful].T, "x", color=FILTER, markersize=5, mew=1.6, zorder=6)
    jumps = np.array([(jump.x, jump.y) for jump in drive_trajectory.jumps]).reshape(-1, 2)
    upper.plot(*jumps.T, "o", mfc="none", color=FILTER, markersize=11, mew=1.8, zorder=6)
    upper.set(xlim=limits[0], ylim=limits[1])
    way = compute_travel_distances(drive_trajectory.poses)
    lower.plot(way, 100 * drive_trajectory.log_distance, color=RECORDED, linewidth=0.8)
    lower.plot(way, deviation, color=PREDICTED, linewidth=1.8)
    lower.plot(way[doubtful], deviation[doubtful], "x", color=FILTER, markersize=4)
    lower.set(yscale="log", xlim=(0, max(way[-1], 1e-3)), ylabel="position [cm]")
    lower.set_ylim(bottom=deviation.min() / 5)  # by chance some poses equal the log's poses
    label_with_plain_numbers(lower.yaxis)
    handles = [
        Line2D([], [], color="0.5", linewidth=4, label="trajectory"),
        Line2D([], [], color=RECORDED, linewidth=0.8, label="poses of the log; their distance"),
        Line2D([], [], color=PREDICTED, linewidth=1.8, label="std. dev. of the position"),
    ]
    if doubtful.any():
        handles.append(
            Line2D([], [], marker="x", label="doubtful pose", color=FILTER, linestyle="")
        )
    if drive_trajectory.jumps:
        handles.append(
            Line2D(
                [], [], marker="o", mfc="none", label="odometry jumps", color=FILTER, linestyle=""
            )
        )
    figure.key(handles, ncols=2, at="upper center")
    return _add_sentences(figure, *drive_trajectory.sentences)


CLOSE_UP_WIDTH = 4.5
"""Width of the map around the robot [inch]."""
DEVIATIONS = 2.0
"""Size of the ellipses in standard deviations."""


def locate_figure(location: Location, *, recorded: ArrayLike | None = None) -> Figure:
    """Draw the map with the scan at the best mode, and all modes with numbers and weights.

    Ellipses show the standard deviations of the positions. If the robot sees only a small part of
    the map, its surroundings are drawn separately.

    Parameters
    ----------
    location : Location
        The result of `locate`.
    recorded : (3,) array, optional
        Another pose x, y, heading to draw, such as the recorded one [m, m, rad].
    """
    grid, best = location.grid, location.best
    width, height = compute_figure_size(grid)
    on_robot = location.lidar.compute_ends_on_robot(location.ranges[None].astype(np.float32))
    ends = move_ends_to_poses(on_robot, np.array([best.pose]))[0]
    end_distances = np.hypot(*(ends - np.array(best.pose[:2])).T)
    # Minimum distance from the robot to the edges of the close-up [m].
    reach = max(4.0, 1.1 * float(np.nanquantile(end_distances, 0.95)))
    # A close-up is drawn only if it is clearly smaller than the map.
    columns = 2 if 2 * reach < 0.6 * max(grid.shape) * grid.resolution else 1
    figure = NotebookFigure(
        figsize=(width + (columns - 1) * CLOSE_UP_WIDTH, max(height, CLOSE_UP_WIDTH) + 1.2),
        layout="constrained",
    )
    axes = figure.subplots(
        1, columns, squeeze=False, width_ratios=(width, CLOSE_UP_WIDTH)[:columns]
    )[0]
    for map_axes in axes:
        draw_map(map_axes, grid)
        map_axes.plot(*ends.T, ".", color=style.VERMILION, markersize=3, zorder=4)
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
    # The ellipse of the best mode takes 8 % of the map's width.
    magnify = max(1.0, float(f"{0.08 * (high - low) / (DEVIATIONS * best.position_std):.1g}"))
    larger = "" if magnify == 1 else f", {magnify:g} times as large"
    for map_axes in axes:
        for mode in location.modes:
            major, minor, direction = (
                float(axis_value) for axis_value in position_axes(mode.covariance)
            )
            map_axes.add_patch(
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
        for map_axes in axes:
            map_axes.plot(*pose[:2], "x", color=style.GREEN, markersize=9, mew=2, zorder=7)
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
    """Draw the modes, the best one last, with their numbers on alternating sides."""
    for n, mode in reversed(list(enumerate(location.modes, 1))):
        colour = style.VERMILION if n == 1 else style.BLUE
        _draw_arrow(axes, mode.pose, colour)
        heading, side = mode.pose[2], (1, -1)[n % 2]
        offset = -15 * side * math.sin(heading), 15 * side * math.cos(heading)
        draw_number(axes, n, mode.pose[:2], offset, colour, zorder=8 if n == 1 else 7)


def _draw_arrow(axes: Axes, pose: tuple[float, float, float], colour: str) -> None:
    """Draw a pose as a dot with an arrow along its heading; the size does not depend on scale."""
    x, y, heading = pose
    axes.plot(x, y, "o", color=colour, markersize=6, markeredgecolor="white", zorder=6)
    ahead = 20 * math.cos(heading), 20 * math.sin(heading)
    arrow = {"arrowstyle": "<|-", "color": colour, "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (x, y), ahead, textcoords="offset points", arrowprops=arrow, zorder=6)


def located_drive_figure(located_drive: LocatedDrive) -> Figure:
    """Draw the recorded drive on the map, and whether each scan was located correctly.

    Lines connect wrongly located scans with the place where they were found. A single scan is
    drawn by `locate_figure`.

    Parameters
    ----------
    located_drive : LocatedDrive
        The result of `locate_drive`.
    """
    if located_drive.single_location:
        recorded = located_drive.recording.poses[0] if located_drive.recording.has_poses else None
        return locate_figure(located_drive.single_location, recorded=recorded)
    grid, poses, right, certain = (
        located_drive.grid,
        located_drive.poses[:, :2],
        located_drive.is_right,
        located_drive.is_certain,
    )
    is_located = np.isfinite(poses[:, 0])
    drive = located_drive.recording.poses[:, :2]
    if not located_drive.recording.has_poses:  # only the best places can be drawn
        drive, right = np.where(is_located[:, None], poses, 0.0), is_located
    drive_paths = [
        Path(
            np.concatenate(
                [drive[is_located | located_drive.recording.has_poses], poses[is_located]]
            )
        )
    ]
    part = zoom_map(grid, drive_paths)
    figure, axes = _make_map_axes(part, 1.4)
    draw_inset(axes, grid, part, drive_paths)
    wrong = is_located & ~right
    kinds: list[tuple[str, Bools, str, str]] = [
        ("right, certain", right & certain, "o", style.BLUE),
        ("right, other places alike", right & ~certain, "o", style.BLUE),
        ("elsewhere, other places alike", wrong & ~certain, "s", style.VERMILION),
        ("elsewhere, certain", wrong & certain, "s", style.VERMILION),
        ("too few returns", ~is_located & located_drive.recording.has_poses, "x", "0.4"),
    ]
    error_lines = list(np.stack([drive[wrong], poses[wrong]], axis=1))
    axes.add_collection(
        LineCollection(
            error_lines, colors=style.VERMILION, linewidths=0.8, linestyles="dotted", zorder=3
        )
    )
    axes.plot(*poses[wrong].T, "+", color=style.VERMILION, markersize=7, zorder=4)
    for label, is_kind, marker, colour in kinds:
        if is_kind.any():
            face = "white" if "alike" in label else colour
            text = label if located_drive.recording.has_poses else label.removeprefix("right, ")
            axes.plot(
                *drive[is_kind].T,
                marker,
                color=colour,
                mfc=face,
                markersize=5,
                label=f"{text}: {int(is_kind.sum())}",
                zorder=5,
            )
    if wrong.any():
        axes.plot([], [], "+", color=style.VERMILION, label="where they were found")
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    figure.title(
        f"{grid.name or 'map'}; {located_drive.recording.lidar.title}", located_drive.sentence
    )
    return figure


def _make_map_axes(grid: OccupancyGrid, extra_height: float) -> tuple[NotebookFigure, Axes]:
    """Make a figure with a map on its Axes, and extra height for the legend [inch]."""
    width, height = compute_figure_size(grid)
    figure = NotebookFigure(figsize=(width, height + extra_height), layout="constrained")
    axes = figure.add_subplot()
    draw_map(axes, grid)
    return figure, axes
