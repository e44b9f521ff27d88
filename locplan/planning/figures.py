"""Figures of paths, of Pareto fronts, and of the progress of searches."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm, Normalize, to_rgba_array
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon
from matplotlib.ticker import MaxNLocator, MultipleLocator

from locplan._support import drawing as styles
from locplan._support.drawing import (
    ERROR_COLOURS,
    FIELD_COLOURS,
    PATH_STYLES,
    RECOMMENDED,
    LineStyle,
    NotebookFigure,
    draw_field_bar,
    label_with_plain_numbers,
    make_logarithmic,
    make_white_outline,
)
from locplan._support.kernels.arrays import Floats
from locplan._support.tables import format_area
from locplan.field.covariance import DEGENERATE
from locplan.field.field import CovarianceField
from locplan.field.figures import (
    HARMLESS,
    draw_field,
    format_weak_share,
)
from locplan.maps.figures import (
    compute_axes_limits,
    compute_block_size,
    compute_figure_size,
    downsample,
    downsample_map,
    draw_cells,
    draw_map,
    draw_zones,
    is_small_part,
    make_map_axes,
    zoom_map,
)
from locplan.maps.grid import OccupancyGrid
from locplan.planning.costmap import Costmap
from locplan.planning.metrics import compute_profile, format_costs_caption
from locplan.planning.path import Path
from locplan.planning.results import Plan
from locplan.robots.parts import Footprint
from locplan.robots.robot import format_radius

if TYPE_CHECKING:
    from locplan.planning.map_info import MapInfo
    from locplan.planning.path_check import PathCheck
    from locplan.planning.results import ParetoFront

MARKER_COLOUR, MARKER_EDGE = "white", "black"
"""Colours of the markers of starts, goals and other places, and of their edges."""


def format_request(costs: Costmap, plans: Mapping[str, Plan]) -> str:
    """Return the weight, limits, footprint and robot radius of some plans as a text."""
    parts = [f"weight {costs.weight:g}"]
    for plan in plans.values():
        if plan.budget is not None:
            parts = [f"budget {plan.budget:g} m"]
        if plan.max_e is not None:
            parts.append(f"e at most {plan.max_e:g}")
        if plan.footprint is not None and "footprint" not in parts:
            parts.append("footprint")
    radius = format_radius(costs.robot, costs.robot_radius)
    return ", ".join([*parts, f"robot radius {radius}"])


def map_info_figure(description: MapInfo) -> Figure:
    """Draw the map with numbered grid lines [m], its rooms tinted, and its places named.

    Parameters
    ----------
    description : MapInfo
        The description of the map, from `locplan.planning.describe_map`.
    """
    figure, axes = make_map_axes(description.grid)
    draw_map(axes, description.grid)
    colours = (
        styles.SKY,
        styles.ORANGE,
        styles.GREEN,
        styles.PURPLE,
        styles.YELLOW,
        styles.BLUE,
        "#b08d57",
    )  # the last one of all others
    shades = [to_rgba_array("black", 0.0), to_rgba_array(colours, 0.45)]
    tints = np.round(255 * np.concatenate(shades)).astype(np.uint8)
    tint_of_cell = np.minimum(description.room_of_cell, len(tints) - 1).astype(np.uint8)
    draw_cells(axes, description.grid, tints[downsample(tint_of_cell)])
    extent = max(*np.diff(axes.get_xlim()), *np.diff(axes.get_ylim()))
    # At most 24 lines, at 1, 2 or 5 times a power of ten; the same on both axes.
    ticks = MaxNLocator(24, steps=[1, 2, 5, 10]).tick_values(0, extent)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MultipleLocator(ticks[1] - ticks[0]))
    axes.grid(color="0.25", linewidth=0.5, alpha=0.5)
    axes.tick_params(labeltop=True, labelright=True, top=True, right=True, labelsize="small")
    for place in description.places:
        _draw_marker(axes, (place.x, place.y), "o", size=13, zorder=2)
        text = axes.text(place.x, place.y, place.name, fontsize=9, fontweight="bold", zorder=5)
        text.set(horizontalalignment="center", verticalalignment="center_baseline")
    (width, height), yaw_deg = description.size, math.degrees(description.grid.origin[2])
    yaw = f", yaw {yaw_deg:.4g} deg" if yaw_deg else ""
    size = f"{width:.4g} x {height:.4g} m, {description.grid.resolution:g} m a cell{yaw}"
    rooms = f"{len(description.rooms)} room{'' if len(description.rooms) == 1 else 's'}"
    robot = f"{rooms} for a robot of radius {description.robot_size}"
    axes.set_title(f"{description.grid.name or 'map'}: {size}\n{robot}", fontsize="medium")
    _add_legend(figure, description, colours)
    return figure


def _add_legend(figure: Figure, description: MapInfo, colours: Sequence[str]) -> None:
    """Name the rooms' colours and the places' positions below the map."""
    count = len(colours) - 1
    labels = [f"room {room.number}, {format_area(room.area)}" for room in description.rooms[:count]]
    if further_rooms := description.rooms[count:]:
        labels.append(
            f"{len(further_rooms)} more, {format_area(sum(room.area for room in further_rooms))}"
        )
    handles: list[Patch | Line2D] = [
        Patch(facecolor=colour, alpha=0.45, label=label)
        for label, colour in zip(labels, colours, strict=False)
    ]
    for place in description.places:
        handle = Line2D([], [], color="black", linestyle="", markeredgewidth=0)
        handle.set(marker=f"$\\mathbf{{{place.name}}}$", label=f"{place.position_argument} m")
        handles.append(handle)
    if handles:
        figure.legend(
            handles=handles,
            loc="outside lower center",
            ncols=max(1, min(len(handles), int(figure.get_figwidth() / 1.6))),
            frameon=False,
            fontsize="small",
        )


def draw_path(
    axes: Axes,
    path: Path,
    *,
    color: Any,
    linestyle: Any = "-",
    linewidth: float = 2.2,
    path_effects: Sequence[Any] | None = None,
    label: str | None = None,
    zorder: float = 2,
) -> None:
    """Draw a path as a line with a white outline.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        The Axes to draw on, in world coordinates [m].
    path : Path
        The path.
    color, linestyle
        The line's colour and dashes, as matplotlib takes them.
    linewidth : float, default 2.2
        Width of the line without its outline [points].
    path_effects : sequence, optional
        Effects of matplotlib that replace the outline; none if empty.
    label : str, optional
        The path's entry in the legend.
    zorder : float, default 2
        Artists with a higher number are drawn on top of the line.
    """
    axes.plot(
        *path.xy.T,
        color=color,
        linestyle=linestyle,
        linewidth=linewidth,
        path_effects=make_white_outline() if path_effects is None else path_effects,
        label=label,
        zorder=zorder,
    )


def _draw_marker(
    axes: Axes,
    xy: Sequence[Any] | Floats,
    marker: str,
    *,
    size: float,
    zorder: float = 4,
    label: str | None = None,
) -> None:
    """Draw a white marker with a black edge at one position, or at several (x, y)."""
    axes.plot(
        *xy,
        marker,
        markersize=size,
        color=MARKER_COLOUR,
        markeredgecolor=MARKER_EDGE,
        zorder=zorder,
        label=label,
    )


def make_path_norm(values: Floats, *, of_errors: bool = False) -> LogNorm:
    """Return the logarithmic colour scale for values that are drawn along paths.

    Parameters
    ----------
    values : array (n,)
        The values; NaN if unknown.
    of_errors : bool, default False
        True if the values are mean errors [m]: the scale then begins at `MIN_ERROR` and ends at
        the greatest one. Otherwise it spans the quantiles of 2 to 98 %.
    """
    finite_values = values[np.isfinite(values)]
    if of_errors:
        low = max(styles.MIN_ERROR, float(finite_values.min()))
        return LogNorm(low, max(float(finite_values.max()), 2 * low), clip=True)
    low, high = np.quantile(finite_values, (0.02, 0.98)).tolist()
    return LogNorm(low, max(high, 1.5 * low), clip=True)


def draw_coloured_line(
    axes: Axes,
    xy: Floats,
    values: Floats,
    *,
    norm: Normalize | None = None,
    cmap: Any = ERROR_COLOURS,
    linewidths: float = 4.0,
    capstyle: Any = None,
) -> LineCollection:
    """Draw a line in pieces from position to position, each in the colour of its value.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        The Axes to draw on, in world coordinates [m].
    xy : array (n, 2)
        The positions [m].
    values : array (n - 1,)
        The value of each piece.
    norm : matplotlib.colors.Normalize, optional
        The scale of the colours; by default it spans the values.
    cmap : str or Colormap, default ERROR_COLOURS
        The colours.
    linewidths : float, default 4.0
        Width of the line [points].
    capstyle : str, optional
        Shape of the ends of each piece, such as "round".
    """
    lines = LineCollection(
        list(np.stack([xy[:-1], xy[1:]], axis=1)),
        array=values,
        norm=norm,
        cmap=cmap,
        linewidths=linewidths,
        capstyle=capstyle,
        zorder=3,
    )
    axes.add_collection(lines)
    return lines


def draw_path_colour_bar(
    figure: Any, lines: Any, axes: Any, label: str = "mean position error [m]", shrink: float = 0.9
) -> None:
    """Draw the colour bar of coloured lines, with plain numbers.

    Parameters
    ----------
    figure : matplotlib.figure.Figure or SubFigure
        The figure.
    lines : LineCollection
        The lines, from `draw_coloured_line`.
    axes : matplotlib.axes.Axes, or a list of them
        The Axes next to the bar.
    label : str, default "mean position error [m]"
        The quantity that the colours show, with its unit.
    shrink : float, default 0.9
        Height of the bar, as a share of the Axes'.
    """
    bar = figure.colorbar(lines, ax=axes, label=label, shrink=shrink)
    label_with_plain_numbers(bar.ax.yaxis)


def draw_start_and_goal(axes: Axes, start: Sequence[float], goal: Sequence[float]) -> None:
    """Draw start (circle) and goal (star), each with an arrow if it has a heading.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        The Axes to draw on, in world coordinates [m].
    start, goal : (x, y) or (x, y, heading)
        The poses in the world [m, m, rad].
    """
    _draw_marker(axes, start[:2], "o", size=7)
    _draw_marker(axes, goal[:2], "*", size=13)
    for x, y, *heading in (start, goal):
        if heading:
            ahead = 22 * np.cos(heading[0]), 22 * np.sin(heading[0])  # in points, at any scale
            arrow = {"arrowstyle": "<|-", "color": "black", "linewidth": 1.5, "shrinkA": 0}
            axes.annotate("", (x, y), ahead, textcoords="offset points", arrowprops=arrow)


def list_end_handles() -> list[Line2D]:
    """Return the legend's entries of start and goal, as `draw_start_and_goal` draws them.

    Returns
    -------
    list of matplotlib.lines.Line2D
        The two handles, labelled "start" and "goal".
    """
    return [_make_marker_handle("o", "start"), _make_marker_handle("*", "goal", size=10)]


def _make_marker_handle(marker: str, label: str, size: float | None = None) -> Line2D:
    """Return a legend's entry of a marker that `_draw_marker` draws."""
    return Line2D(
        [],
        [],
        linestyle="none",
        marker=marker,
        markersize=size,
        color=MARKER_COLOUR,
        markeredgecolor=MARKER_EDGE,
        label=label,
    )


def draw_inset(axes: Axes, grid: OccupancyGrid, part: OccupancyGrid, paths: Sequence[Path]) -> None:
    """Draw the whole map in a corner without paths, with the outline of the small part shown.

    A part that is not small gets no inset. The part is drawn without a margin, since the map
    continues there.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        The Axes that show the part.
    grid, part : OccupancyGrid
        The map, and the part of it that was drawn.
    paths : sequence of Path
        The paths that the inset must not cover, one at least.
    """
    if part.shape != grid.shape:
        _set_limits(axes, part, share=0.0)
    if not is_small_part(grid, part):
        return
    points = [path.resample(0.5, even=True).xy for path in paths]
    size = _compute_inset_size(axes, grid)
    inset = axes.inset_axes((*_find_free_corner(axes, np.concatenate(points), size), *size))
    draw_map(inset, downsample_map(grid, 300))
    inset.images[0].set_cmap(styles.LIGHT_MAP_COLOURS)
    inset.set(xlabel="", ylabel="", xticks=(), yticks=(), zorder=6)
    _set_limits(inset, grid)
    height, width = part.shape
    x, y = part.grid_to_world(np.array([0, 0, height, height]), np.array([0, width, width, 0]))
    corners = np.stack([x, y], axis=1)
    colour = styles.VERMILION
    inset.add_patch(Polygon(corners, fill=False, linewidth=2.2, color=colour, zorder=5))
    if max(part.shape) < 0.06 * max(grid.shape):  # its outline is hard to see
        inset.plot(*corners.mean(axis=0), "o", markersize=5, color=colour, zorder=5)


def _set_limits(axes: Axes, grid: OccupancyGrid, share: float = 0.02) -> None:
    """Limit Axes to the known cells of a map, with a margin of a share of their extent."""
    limits = compute_axes_limits(grid, share=share)
    axes.set(xlim=limits.xlim, ylim=limits.ylim)


def _compute_inset_size(axes: Axes, grid: OccupancyGrid) -> tuple[float, float]:
    """Return the width and height of the inset with a map, as shares of the Axes."""
    shares = np.ptp(compute_axes_limits(grid), axis=1)
    shares /= np.ptp([axes.get_xlim(), axes.get_ylim()], axis=1)
    across, along = (shares * (0.3 / shares.max())).tolist()
    return across, along


def _find_free_corner(axes: Axes, xy: Floats, size: tuple[float, float]) -> tuple[float, float]:
    """Return the inset's lower left end, as shares of the Axes, in the emptiest corner."""
    low, high = np.transpose([axes.get_xlim(), axes.get_ylim()])
    points = (xy - low) / (high - low)
    gap = 0.015
    far = 1 - np.array(size) - gap
    corners = np.array([(gap, far[1]), (far[0], far[1]), (far[0], gap), (gap, gap)])
    near = gap + 0.03

    inside = [
        ((points > corner - near) & (points < corner + size + near)).all(1) for corner in corners
    ]
    x, y = corners[np.argmin(np.sum(inside, axis=1))].tolist()
    return x, y


def plan_figure(costs: Costmap, field: CovarianceField, plans: Mapping[str, Plan]) -> Figure:
    """Draw paths over the e field of the map and, below, u along each path.

    Parameters
    ----------
    costs : Costmap
        The costmap that the paths were planned on.
    field : CovarianceField
        The field to draw below the paths, of the costmap's map.
    plans : mapping of str to Plan
        At most four plans, by the name to show; plans without a path are only named.
    """
    solved = [(label, plan, plan.path) for label, plan in plans.items() if plan.path is not None]
    styled_paths = [
        StyledPath(label, plan, path, style)
        for (label, plan, path), style in zip(solved, PATH_STYLES, strict=False)
    ]
    paths = [path for plan in plans.values() for path in _collect_shown_paths(plan)]
    figure, upper, lower, part = _make_map_and_plot(costs.grid, paths, 2.2)
    config = field.config
    of_field = costs.settings is not None and costs.settings.config == config
    plain = config.headings == 1 and config.estimator.criterion == "e"
    is_whole_map = (
        part is costs.grid and compute_block_size(part.shape) == 1 and costs.grid == field.grid
    )
    read = costs.e if of_field and plain and is_whole_map else None  # they are the same
    image = draw_field(upper, field, part=part, read=read)
    draw_inset(upper, costs.grid, part, paths)
    draw_field_bar(figure, image, upper, field.quantity().axis, shrink=0.9)
    # The first plan comes out on top, with its dashes visible where paths coincide.
    for styled in reversed(styled_paths):
        style = styled.style
        draw_path(upper, styled.path, color=style.color, linestyle=style.linestyle)
    _draw_stops(upper, plans)
    _draw_profiles(lower, costs, styled_paths)
    figure.legend(
        handles=[
            *_list_plan_handles(plans, styled_paths, field.e_unit),
            *draw_zones(upper, costs.zones, part),
        ],
        loc="outside lower center",
        ncols=2,
        frameon=False,
        fontsize="medium",
    )
    weak = format_weak_share(field, image.get_array())
    field_text = f"{config.title}; u is about 0 on {field.saturated_share:.0%}; {weak}"
    answer = f"{costs.grid.name or 'map'}: {_format_plans_answer(plans)}"
    title_lines = answer, format_request(costs, plans), field_text
    upper.set_title("\n".join(title_lines), fontsize="medium")
    return figure


def _format_plans_answer(plans: Mapping[str, Plan]) -> str:
    """Return the difference between the first and the least degenerate plan as text."""
    metrics = {label: plan.metrics for label, plan in plans.items() if plan.metrics is not None}
    if not metrics:
        return "no path"
    first, best = next(iter(metrics)), min(metrics, key=lambda label: metrics[label].integrated_u)
    longer = metrics[best].length - metrics[first].length
    avoided = metrics[first].integrated_u - metrics[best].integrated_u
    if avoided < 0.05:
        return f"'{first}' has {metrics[first].integrated_u:.1f} degenerate metres"
    return f"'{best}' avoids {avoided:.1f} degenerate metres and is {longer:.1f} m longer"


class StyledPath(NamedTuple):
    """A plan with a path, and the style of the path's line."""

    label: str
    plan: Plan
    path: Path
    style: LineStyle


def _make_map_and_plot(
    grid: OccupancyGrid, paths: Sequence[Path], height: float
) -> tuple[NotebookFigure, Axes, Axes, OccupancyGrid]:
    """Make a figure with Axes for a map and, below, for a plot of some height [inch].

    The last value is the part of the map to draw: the surroundings of the paths if they are small.
    """
    part = zoom_map(grid, paths)
    wide, high = compute_figure_size(part)
    figure = NotebookFigure(figsize=(wide, high + height + 0.2), layout="constrained")
    upper, lower = figure.subplots(2, height_ratios=(high, height))
    return figure, upper, lower, part


def _draw_stops(axes: Axes, plans: Mapping[str, Plan]) -> None:
    """Draw the ends and the waypoints of all plans."""
    for plan in plans.values():
        draw_start_and_goal(axes, plan.start, plan.goal)
        if plan.via:
            stops = np.array([pose[:2] for pose in plan.via])
            _draw_marker(axes, stops.T, "s", size=6)


def draw_degeneracy_profiles(
    axes: Axes, costs: Costmap, paths: Iterable[tuple[Path, LineStyle]]
) -> None:
    """Draw the degeneracy u along some paths.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        The Axes to draw on.
    costs : Costmap
        The costmap.
    paths : iterable of (Path, LineStyle)
        The paths, with the styles of their lines.
    """
    for path, style in paths:
        u_of_heading = None if path.heading is None else costs.u_of_heading
        layer = costs.u if u_of_heading is None else u_of_heading
        distance, u = compute_profile(costs, path, layer)
        _plot_steps(axes, distance, [*u, u[-1]], style)
    axes.set(xlabel="distance along the path [m]", ylabel="degeneracy u", ylim=(-0.03, 1.03))
    axes.margins(x=0.01)


def _plot_steps(axes: Axes, x: Any, y: Any, style: LineStyle, label: str | None = None) -> None:
    """Plot a step function whose values hold from one x to the next."""
    axes.step(
        x,
        y,
        where="post",
        linewidth=1.8,
        color=style.color,
        linestyle=style.linestyle,
        label=label,
    )


def _draw_profiles(axes: Axes, costs: Costmap, styled_paths: Sequence[StyledPath]) -> None:
    """Draw u along each path, and note if all paths are the same."""
    profiles = [(styled.path, styled.style) for styled in styled_paths]
    draw_degeneracy_profiles(axes, costs, profiles)
    axes.axhline(DEGENERATE, color="0.6", linewidth=0.8, zorder=0)
    lines = [styled.path.xy for styled in styled_paths]
    are_equal = all(line.shape == lines[0].shape and np.allclose(line, lines[0]) for line in lines)
    if are_equal and len(lines) > 1:
        subject = "both" if len(styled_paths) == 2 else "all"
        axes.set_title(f"{subject} take the same path", fontsize="medium")
    if not styled_paths:
        axes.text(0.5, 0.25, "no path", transform=axes.transAxes, ha="center", va="center")
        axes.set_xticks([])


def _list_plan_handles(
    plans: Mapping[str, Plan], styled_paths: Sequence[StyledPath], e_unit: str
) -> list[Artist]:
    """Return the legend's entries: each plan with its metrics or its status, and its stops."""
    handles: list[Artist] = []
    for styled in styled_paths:
        metrics = styled.plan.metrics
        assert metrics is not None
        text = (
            f"{styled.label}: {metrics.length:.1f} m, {metrics.integrated_u:.1f} m degenerate,"
            f" ∫e ds = {metrics.integrated_e:.3g} {e_unit} m"
        )
        handle = Line2D([], [], path_effects=make_white_outline(), linewidth=2, label=text)
        handle.set(color=styled.style.color, linestyle=styled.style.linestyle)
        handles.append(handle)
    handles += [
        Line2D([], [], linestyle="none", label=f"{label}: {plan.status}")
        for label, plan in plans.items()
        if plan.path is None
    ]
    handles += list_end_handles()
    if any(plan.via for plan in plans.values()):
        handles.append(_make_marker_handle("s", "waypoint"))
    return handles


def _collect_shown_paths(plan: Plan) -> list[Path]:
    """Return the paths that a picture of a plan must show: its path, and the line of its stops."""
    stops = [plan.start, *plan.via, plan.goal]
    places = Path(np.array([pose[:2] for pose in stops], dtype=float))
    return [places] if plan.path is None else [plan.path, places]


def costmap_figure(costs: Costmap) -> Figure:
    """Draw the degeneracy u of a costmap over its map; blocked cells show the map.

    Parameters
    ----------
    costs : Costmap
        The costmap.
    """
    radius = format_radius(costs.robot, costs.robot_radius)
    return _make_degeneracy_figure(costs, f"robot radius {radius}", costs.grid)[0]


def path_figure(plan: Plan) -> Figure:
    """Draw a plan's path over the degeneracy u of its costmap.

    Parameters
    ----------
    plan : Plan
        The plan; without a path only its ends are shown.
    """
    assert plan.costs is not None
    outcome = f"{plan.metrics.length:.1f} m" if plan.metrics else plan.status
    paths = _collect_shown_paths(plan)
    part = zoom_map(plan.costs.grid, paths)
    figure, axes = _make_degeneracy_figure(plan.costs, f"{plan.planner}, {outcome}", part)
    draw_inset(axes, plan.costs.grid, part, paths)
    if plan.path is not None:
        draw_path(axes, plan.path, color=RECOMMENDED)
    draw_start_and_goal(axes, plan.start, plan.goal)
    return figure


def path_check_figure(check: PathCheck) -> Figure:
    """Draw the robot's outline along a path over the map, in red at places it cannot drive.

    Parameters
    ----------
    check : PathCheck
        The check of the path.
    """
    part = zoom_map(check.grid, [check.path])
    figure, axes = make_map_axes(part)
    draw_map(axes, part)
    draw_inset(axes, check.grid, part, [check.path])
    size = check.outline.circumscribed_radius
    for pose in check.path.resample(max(size, check.length / 500)).poses:
        _draw_outline(axes, check.outline, pose, color="0.4", linewidth=0.6)
    draw_path(axes, check.path, color=RECOMMENDED)
    for fault in check.faults:
        pose = np.array([fault.x, fault.y, fault.heading])
        _draw_outline(axes, check.outline, pose, color="tab:red", linewidth=1.4)
    name, count = check.grid.name or "map", len(check.faults)
    drivability = (
        f"cannot be driven at {count} place{'s' if count > 1 else ''}" if count else "drivable"
    )
    clear = f"clearance {check.clearance:.2f} m, least radius {check.least_radius:.2f} m"
    axes.set_title(f"{name}: {drivability}\n{clear}", fontsize="medium")
    return figure


def _draw_outline(
    axes: Axes, outline: Footprint, pose: Floats, *, color: str, linewidth: float
) -> None:
    """Draw a robot's outline at a pose (x, y, heading) [m, m, rad]."""
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    corners = outline.vertices @ np.array([[cos, sin], [-sin, cos]]) + pose[:2]
    axes.plot(*np.vstack([corners, corners[:1]]).T, color=color, linewidth=linewidth)


def _make_degeneracy_figure(costs: Costmap, title: str, part: OccupancyGrid) -> tuple[Figure, Axes]:
    """Make a figure of the degeneracy u of a part of a costmap's map, with its zones."""
    figure, axes = make_map_axes(part)
    draw_map(axes, part)
    if handles := draw_zones(axes, costs.zones, part):
        figure.key(handles, ncols=3)
    greatest = draw_degeneracy(figure, axes, costs, part)
    weak = "" if greatest >= HARMLESS else f"\nno weak spot: u is {greatest:.2f} at most"
    axes.set_title(f"{costs.grid.name or 'map'}: {title}{weak}", fontsize="medium")
    return figure, axes


def draw_degeneracy(figure: Figure, axes: Axes, costs: Costmap, part: OccupancyGrid) -> float:
    """Draw the degeneracy u of the cells that the robot can enter, with its colour bar.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        The figure, for the bar.
    axes : matplotlib.axes.Axes
        The Axes to draw on.
    costs : Costmap
        The costmap of the whole map.
    part : OccupancyGrid
        The part of the map that is drawn.

    Returns
    -------
    float
        The greatest u there, 0..1.
    """
    top, left = np.round(costs.grid.world_to_grid(*part.origin[:2])).astype(int).tolist()
    window = slice(top, top + part.shape[0]), slice(left, left + part.shape[1])
    u, density = (downsample(layer[window], maximum=True) for layer in (costs.u, costs.density))
    u = np.where(np.isfinite(density), u, np.nan)
    if np.isfinite(u).any():
        image = draw_cells(axes, part, u, cmap=FIELD_COLOURS, vmin=0, vmax=1)
        figure.colorbar(image, ax=axes, label="degeneracy u", shrink=0.9)
    return float(np.nanmax(u, initial=0.0))


def front_figure(front: ParetoFront) -> Figure:
    """Draw a Pareto front and, over the map, its paths in the same colours, the knee's bold.

    Dark paths are degenerate.

    Parameters
    ----------
    front : ParetoFront
        The front, with at least one path.
    """
    grid = front.costs.grid
    ends = front.plan(0), front.plan(len(front) - 1)
    paths = [path for plan in ends for path in _collect_shown_paths(plan)]
    figure, upper, lower, part = _make_map_and_plot(grid, paths, 3.0)
    draw_map(upper, part)
    draw_inset(upper, grid, part, paths)
    norm = Normalize(float(front.integral.min()), float(front.integral.max()) or 1.0)
    low, high = front.length[[0, -1]]
    targets = np.linspace(low, high, 12)  # more lines hide each other
    indices = np.unique(np.abs(front.length[:, None] - targets).argmin(axis=0)).tolist()
    lines: list[tuple[int, float, list[Any]]] = [(index, 1.6, []) for index in indices]
    if front.knee is not None:
        lines.append((front.knee, 3.0, make_white_outline()))
    for index, width, effects in lines:
        path = front.plan(index).path
        assert path is not None
        color = ERROR_COLOURS(norm(front.integral[index]))
        draw_path(upper, path, color=color, linewidth=width, path_effects=effects)
    draw_start_and_goal(upper, front.start, front.goal)
    if handles := draw_zones(upper, front.costs.zones, part):
        figure.key(handles, ncols=3)
    epsilon = "exact" if front.epsilon == 0 else f"within {front.epsilon:.2%}"
    unit = "m" if front.objective == "u" else f"{front.costs.e_unit} m"
    label = "degenerate metres (∫u ds)" if front.objective == "u" else "∫e ds"
    answer = f"{grid.name or 'map'}: {_format_front_answer(front)}"
    drawn = f"{len(indices)} of {len(front)} paths, front {epsilon}"
    upper.set_title(f"{answer}\n{drawn}{format_costs_caption(front.costs)}", fontsize="medium")
    lower.plot(front.length, front.integral, color="0.7", linewidth=0.8, zorder=1)
    image = lower.scatter(
        front.length, front.integral, s=14, c=front.integral, cmap=ERROR_COLOURS, norm=norm
    )
    if front.knee is not None:
        length, integral = front.length[front.knee], front.integral[front.knee]
        knee_text = f"knee, bold above: {length:.1f} m long, {integral:.3g} {unit}"
        _draw_marker(lower, (length, integral), "D", size=9, zorder=2, label=knee_text)
        lower.legend(loc="upper right", frameon=False)
    lower.set(xlabel="length [m]", ylabel=f"{label} [{unit}]")
    figure.colorbar(image, ax=[upper, lower], label=f"{label} [{unit}]", shrink=0.6)
    return figure


def _format_front_answer(front: ParetoFront) -> str:
    """Return the gain of the knee, or else of the longest path, over the shortest one as text."""
    if len(front) == 1:
        return "no path is less degenerate than the shortest one"
    name, index = "the knee", front.knee
    if index is None:
        name, index = "no knee, the longest path", -1
    longer = front.length[index] - front.length[0]
    avoided = 1.0 - front.integral[index] / front.integral[0]
    return f"{name} is {longer:.1f} m longer and {avoided:.0%} less degenerate"


def history_figure(plans: Mapping[str, Plan]) -> Figure:
    """Draw the best J of sampling planners over the time since they began.

    Parameters
    ----------
    plans : mapping of str to Plan
        At most four plans with a history, by the name to show.
    """
    figure = NotebookFigure(figsize=(7, 4), layout="constrained")
    axes = figure.subplots()
    for (label, plan), style in zip(plans.items(), PATH_STYLES, strict=False):
        if not plan.history:
            continue
        seconds, cost = np.transpose(plan.history)
        name = f"{label}: {plan.planner}, {cost[-1]:.2f} m after {seconds[-1]:.1f} s"
        _plot_steps(axes, seconds, cost, style, label=name)
    axes.set(xlabel="time since the search began [s]", ylabel="best cost J so far [m]")
    make_logarithmic(axes.xaxis)
    maps = {plan.costs.grid.name or "map": None for plan in plans.values() if plan.costs}
    axes.set_title(f"{', '.join([*maps])}: best cost of each search over time", fontsize="medium")
    axes.legend(frameon=False)
    return figure
