"""Figures of simulated drives, of recommendations and of tuned settings."""

from __future__ import annotations

import itertools
import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from locplan._support.drawing import (
    BLUE,
    MIN_ERROR,
    ORANGE,
    PATH_STYLES,
    RECOMMENDED,
    LineStyle,
    NotebookFigure,
    break_title,
    label_with_plain_numbers,
    make_logarithmic,
    make_white_outline,
)
from locplan._support.intervals import Interval, format_metres
from locplan._support.kernels.arrays import Bools, Floats
from locplan.maps.figures import (
    compute_figure_size,
    crop_map,
    downsample,
    draw_cells,
    draw_map,
    draw_zones,
    zoom_map,
)
from locplan.maps.grid import OccupancyGrid
from locplan.planning.figures import (
    draw_coloured_line,
    draw_degeneracy,
    draw_degeneracy_profiles,
    draw_inset,
    draw_path,
    draw_path_colour_bar,
    draw_start_and_goal,
    list_end_handles,
    make_path_norm,
)
from locplan.planning.path import Path
from locplan.robots.robot import Robot
from locplan.simulation.arrivals import ENDS, LEAVES, STOPS, Arrivals, describe_faults
from locplan.simulation.drives import (
    LOST_DISTANCE,
    LOST_SHORT_TEXT,
    LOST_TEXT,
    compute_rmse_ratios,
    format_rates,
)
from locplan.simulation.race import Candidate
from locplan.simulation.recommendation import Recommendation

if TYPE_CHECKING:
    from locplan.simulation.query_routes import Routes
    from locplan.simulation.simulations import Simulation


def simulation_figure(simulation: Simulation) -> Figure:
    """Draw paths over the map, coloured by their mean error, and the error along each path.

    Parameters
    ----------
    simulation : Simulation
        Drives along at most four paths; with more, colours repeat.
    """
    grid = simulation.grid
    paths = list(simulation.paths.values())
    part = zoom_map(grid, paths)
    width, height = compute_figure_size(part)
    figure = NotebookFigure(figsize=(width, height + 2.8), layout="constrained")
    upper, lower = figure.subplots(2, height_ratios=(height, 2.6))
    draw_map(upper, part)
    draw_inset(upper, grid, part, paths)
    profiles = {name: path_drives.profile() for name, path_drives in simulation.drives.items()}
    mean_errors = np.concatenate([profile[:, 4] for profile in profiles.values()])
    norm = make_path_norm(mean_errors, of_errors=True)
    ratios, handles = compute_rmse_ratios(simulation.drives), []
    for (name, profile), style in zip(profiles.items(), itertools.cycle(PATH_STYLES)):
        distance, xy, mean = profile[:, 0], profile[:, 1:3], profile[:, 4]
        colour, drives = style.color, simulation.drives[name]
        draw_path(upper, simulation.paths[name], color=colour, linewidth=7, path_effects=[])
        coloured = draw_coloured_line(upper, xy, mean[:-1], norm=norm)
        lower.fill_between(distance, profile[:, 6], profile[:, 7], color=colour, alpha=0.15, lw=0)
        lower.plot(distance, mean, linewidth=1.8, color=colour, linestyle=style.linestyle)
        text = (
            f"{name}: {distance[-1]:.1f} m, median error"
            f" {format_metres(drives.median_error.value)},"
            f" {format_rates(drives)}, RMSE {format_metres(drives.rmse.value)}"
        )
        if 0 < drives.lost_rate.value < 1:
            text += f" ({format_metres(drives.kept_rmse.value)} of those never lost)"
        if name in ratios:
            first = next(iter(profiles))
            text += f"; error of a typical drive {_format_interval(ratios[name])} times {first}'s"
        if simulation.arrivals:
            path_arrivals = simulation.arrivals[name]
            draw_places(upper, path_arrivals, colour)
            faults_text = describe_faults(path_arrivals)
            text += f"; steered by the filter, {path_arrivals.arrivals_text} arrive{faults_text}"
        label = "\n".join(break_title(text, width - 1))
        handle = Line2D([], [], color=colour, linestyle=style.linestyle, linewidth=2, label=label)
        handles.append(handle)
        draw_start_and_goal(upper, xy[0], xy[-1])
    draw_path_colour_bar(figure, coloured, upper)
    lower.axhline(LOST_DISTANCE, color="0.6", linewidth=0.8, zorder=0)
    lower.set(xlabel="distance along the path [m]", ylabel="position error [m]")
    make_logarithmic(lower.yaxis)
    lower.margins(x=0.01)
    marks = make_place_legend_handles((simulation.arrivals or {}).values())
    figure.key([*handles, *marks, *list_end_handles()])
    count = len(next(iter(simulation.drives.values())).errors)
    upper.set_title(
        f"{grid.name or 'map'}: {count} simulated drives of each path,"
        f" {simulation.robot.known_lidar.title}\n"
        "below: mean error of the position, and where 80 % of the drives are",
        fontsize="medium",
    )
    return figure


PLACE_MARKS = {ENDS: "x", STOPS: "s", LEAVES: "."}
"""Marks of where closed-loop drives go wrong."""
MARK_LABELS = {
    ENDS: "end of a closed-loop drive that misses the goal",
    STOPS: "standstill of 2 s or more in closed loop",
    LEAVES: f"a robot {LEAVES}",
}
"""Their texts in the legend."""
FAINT_MARK_STYLE: dict[str, Any] = {"markersize": 4, "markeredgewidth": 0.8, "alpha": 0.6}
"""Style of the mark of which there are many, near each other."""


def draw_places(
    axes: Axes,
    arrivals: Arrivals | None,
    colour: Any,
    *,
    kinds: Collection[str] = tuple(PLACE_MARKS),
) -> None:
    """Mark where robots stop, end without having arrived, and leave the path.

    Parameters
    ----------
    axes : Axes
        Where to draw.
    arrivals : Arrivals or None
        Closed-loop drives along one path, if there are any.
    colour : color
        The path's colour.
    kinds : collection of str, default all of them
        The kinds of places to mark.
    """
    rows = arrivals.places().rows if arrivals else ()
    for place_kind in kinds:
        mark = PLACE_MARKS[place_kind]
        if xy := [row[2:4] for row in rows if row[1] == place_kind]:
            # Below start and goal, which stay to be seen.
            style: dict[str, Any] = {"markersize": 6, "markeredgewidth": 1.5, "zorder": 3.5}
            if place_kind == LEAVES:
                style |= {"mfc": "none", **FAINT_MARK_STYLE}
            else:  # shows on a line of its colour
                style |= {"mfc": "white", "path_effects": make_white_outline(3.5)}
                style["zorder"] += 0.1 * (place_kind == ENDS)  # some drives end where they stand
            axes.plot(*np.array(xy).T, mark, color=colour, **style)


def make_place_legend_handles(
    arrivals: Iterable[Arrivals | None], *, kinds: Collection[str] = tuple(PLACE_MARKS)
) -> list[Line2D]:
    """Return legend entries for the marks in the figure.

    Parameters
    ----------
    arrivals : iterable of Arrivals, or of None
        Closed-loop drives along some paths.
    kinds : collection of str, default all of them
        The kinds of places that are marked.
    """
    present_kinds = {
        row[1] for path_arrivals in arrivals if path_arrivals for row in path_arrivals.places().rows
    }
    style: dict[str, Any] = {"linestyle": "", "color": "0.3", "mfc": "none"}
    return [
        Line2D([], [], marker=PLACE_MARKS[place_kind], label=MARK_LABELS[place_kind], **style)
        for place_kind in kinds
        if place_kind in present_kinds
    ]


def queries_figure(routes: Routes) -> Figure:
    """Draw RMSE and share of lost drives of both paths of each query, and the mean ratios.

    Parameters
    ----------
    routes : Routes
        Drives along both paths of some queries, as `simulate_queries` returns them.
    """
    rmse, lost = routes.get_value_pairs("rmse"), routes.get_value_pairs("lost")
    figure = NotebookFigure(figsize=(8.5 if lost.any() else 6.6, 4.9), layout="constrained")
    left, *right_axes = figure.subplots(1, 2 if lost.any() else 1, squeeze=False)[0]
    ends = _equalize_axes(left, rmse)
    left.plot(ends, ends, color="0.6", linewidth=0.8, zorder=0)
    left.plot(*rmse.T, "o", color=BLUE, alpha=0.7)
    left.set(xlabel="RMSE along the shortest path [m]", ylabel="RMSE along the aware path [m]")
    for right in right_axes:
        right.plot((0, 1), (0, 1), color="0.6", linewidth=0.8, zorder=0)
        right.plot(*lost.T, "o", color=BLUE, alpha=0.7)
        right.set(
            xlim=(-0.03, 1.03),
            ylim=(-0.03, 1.03),
            aspect="equal",
            xlabel=f"lost ({LOST_SHORT_TEXT}) on the shortest path, share of drives",
            ylabel="the same on the aware path",
        )
    for number, at in enumerate(_choose_label_offsets(np.log(rmse)), 1):
        style = {"ha": "center", "va": "center", "fontsize": "small"}
        left.annotate(str(number), rmse[number - 1], at, textcoords="offset points", **style)
    robot: Any = routes.description.get("robot")
    lidar = f", {Robot.from_summary(robot).known_lidar.title}" if robot else ""
    figure.title(
        f"{routes.grid.name or 'map'}{lidar}, {len(routes.routes)} queries: {routes.verdict}",
        f"aware over shortest: RMSE {_format_interval(routes.rmse_ratio)},"
        f" length {_format_interval(routes.length_ratio)}",
        *([] if lost.any() else [f"no drive was {LOST_TEXT} on either path"]),
    )
    return figure


def _equalize_axes(axes: Any, values: Floats) -> Floats:
    """Make both axes logarithmic with equal limits around the values; return the limits."""
    ends = np.array([values.min() * 0.8, values.max() * 1.25])
    for axis in (axes.xaxis, axes.yaxis):
        make_logarithmic(axis)
    axes.set(xlim=tuple(ends), ylim=tuple(ends), aspect="equal")
    return ends


def _choose_label_offsets(points: Floats) -> list[tuple[float, float]]:
    """Return the offset of each point's number, away from all points [typographic points]."""
    sides = 6.0 * np.array([(1, 1), (-1, 1), (1, -1), (-1, -1)])
    extent = float(np.ptp(points, axis=0).max()) or 1.0
    size = extent / 200.0  # the points of a panel take nearly as many typographic points
    obstacles, offsets = points, []
    for n, point in enumerate(points):
        other_points = np.delete(obstacles, n, axis=0)[:, None]
        distances = np.hypot(*(point + sides * size - other_points).transpose(2, 0, 1))
        best = int(distances.min(axis=0, initial=np.inf).argmax())
        obstacles = np.vstack([obstacles, point + sides[best] * size])
        offsets.append((float(sides[best, 0]), float(sides[best, 1])))
    return offsets


def _format_interval(interval: Interval) -> str:
    value, low, high = interval
    return f"{value:.3g}" + ("" if np.isnan(low) else f" [{low:.3g}, {high:.3g}]")


MIN_FIGURE_WIDTH = 8.6
"""Minimum width of the figure [inch]."""
LINE_COLOURS, LINE_WIDTHS = ("0.72", "black", RECOMMENDED), (1.0, 2.0, 3.6)
"""Styles of the other candidates, of the shortest path, and of the recommended one."""


def recommendation_figure(recommendation: Recommendation) -> Figure:
    """Draw the candidates over the map, the recommended path strongest, and the errors along it.

    If nothing was driven, draw the degeneracy u along the paths instead. A loaded recommendation
    has no map to draw.

    Parameters
    ----------
    recommendation : Recommendation
        The recommendation; without a path only its ends are shown.
    """
    ends = Path(np.array([recommendation.start[:2], recommendation.goal[:2]]))
    paths = [*(candidate.path for candidate in recommendation.candidates), ends]
    width, height, part, blind = MIN_FIGURE_WIDTH, 4.0, None, None
    if recommendation.costs is not None:
        blind = _find_blind_region(recommendation)
        range_circle = [blind.range_circle] if blind and blind.is_range_short else []
        part = crop_map(
            recommendation.costs.grid,
            [*paths, *_collect_marked_places(recommendation), *range_circle],
        )
        width, height = compute_figure_size(part)
        width = max(width, MIN_FIGURE_WIDTH)
    # Height of what is drawn along the paths [inch].
    below = 2.4 if recommendation.candidates else 0.0
    figure = NotebookFigure(figsize=(width, height + below + 0.8), layout="constrained")
    axes = figure.subplots(
        2 if below else 1, squeeze=False, height_ratios=[height, below][: 1 + bool(below)]
    )
    upper, zones, reasons = axes[0, 0], [], list[Artist]()
    if recommendation.costs is not None and part is not None:
        draw_map(upper, part)
        draw_inset(upper, recommendation.costs.grid, part, paths)
        zones = draw_zones(upper, recommendation.costs.zones, part)
        if recommendation.judgement is None:
            draw_degeneracy(figure, upper, recommendation.costs, part)
        elif blind:
            reasons = _draw_blind_region(upper, blind, recommendation.costs.grid, part)
    else:
        upper.set_aspect("equal")
    # The recommended path is drawn last.
    for candidate in sorted(
        recommendation.candidates, key=lambda candidate: _rank_candidate(recommendation, candidate)
    ):
        rank = _rank_candidate(recommendation, candidate)
        draw_places(upper, candidate.arrivals, LINE_COLOURS[rank], kinds=(ENDS, STOPS))
        style: dict[str, Any] = {"color": LINE_COLOURS[rank], "linewidth": LINE_WIDTHS[rank]}
        if rank == 0:  # white outlines of many thin paths would hide the shaded places
            style["path_effects"] = []
        draw_path(upper, candidate.path, **style)
    draw_start_and_goal(upper, recommendation.start, recommendation.goal)
    if recommendation.candidates:
        (_draw_errors if recommendation.judgement else _draw_degeneracy)(axes[1, 0], recommendation)
    marks = make_place_legend_handles(
        (candidate.arrivals for candidate in recommendation.candidates), kinds=(ENDS, STOPS)
    )
    name = recommendation.map["name"] or "map"
    title, *rest = _split_answer(f"{name}: {recommendation.answer[0]}", width)
    figure.title(title)
    figure.key(
        [*_make_legend_handles(recommendation), *reasons, *marks, *list_end_handles(), *zones],
        ncols=2,
        caption=[*rest, *recommendation.answer[1:], recommendation.drives_text],
    )
    return figure


def _split_answer(answer: str, width: float) -> list[str]:
    """Return an answer as the title, and its further sentences if it has more than two lines."""
    if len(break_title(answer, width)) <= 2:
        return [answer]
    return re.split(r"(?<=\.) (?=[A-Z])", answer, maxsplit=1)


WEAK_DEGENERACY = 0.5
"""Degeneracy u from which a place counts as weak."""
WEAK_COLOURS = ListedColormap([to_rgba(ORANGE, 0.45)])
"""Shade of weak places, as of the weak spots of `check`."""
RANGE_STYLE: dict[str, Any] = {"color": "0.3", "linestyle": (0, (4, 3)), "linewidth": 1.4}
"""Style of the lidar's range."""


@dataclass(frozen=True)
class BlindRegion:
    """Where the lidar has too little to match, on the shortest path and near it."""

    cells: Bools
    """Cells of the map in the region."""
    text: str
    """Reason, for the legend."""
    centre: tuple[float, float]
    """Position on the shortest path, in the middle of its part in the region [m]."""
    range: float
    """The lidar's range [m]."""
    is_range_short: bool
    """True if the range is no longer than the shortest path, so that its circle is drawn whole."""

    @property
    def range_circle(self) -> Path:
        """Circle of the lidar's range around the centre."""
        turn = np.linspace(0, 2 * np.pi, 181)
        circle = np.column_stack([np.cos(turn), np.sin(turn)])
        return Path(np.array(self.centre) + self.range * circle)


def _find_blind_region(recommendation: Recommendation) -> BlindRegion | None:
    """Return where no wall is in range, otherwise where u is large; None if not on the path."""
    costs, shortest, lidar = (
        recommendation.costs,
        recommendation.shortest,
        recommendation.robot.lidar,
    )
    if costs is None or shortest is None or lidar is None:
        return None
    grid = costs.grid
    points = shortest.path.resample(grid.resolution, even=True).xy
    rows, cols = np.floor(grid.world_to_grid(*points.T)).astype(np.int64)
    regions = {
        f"no wall within the lidar's {lidar.range:g} m": grid.clearance > lidar.range,
        f"too few features within the lidar's {lidar.range:g} m": costs.u >= WEAK_DEGENERACY,
    }
    for text, cells in regions.items():
        inside = np.flatnonzero(cells[rows, cols])
        if inside.size:
            x, y = points[inside[inside.size // 2]].tolist()
            is_short = lidar.range <= shortest.path.length
            return BlindRegion(cells & grid.free, text, (x, y), lidar.range, is_short)
    return None


def _draw_blind_region(
    axes: Axes, blind: BlindRegion, grid: OccupancyGrid, part: OccupancyGrid
) -> list[Artist]:
    """Shade the region, draw the lidar's range at its middle, and return their legend entries."""
    top, left = np.round(grid.world_to_grid(*part.origin[:2])).astype(int).tolist()
    cells = blind.cells[top : top + part.shape[0], left : left + part.shape[1]]
    shade = downsample(np.where(cells, 1.0, np.nan), maximum=True)
    draw_cells(axes, part, shade, cmap=WEAK_COLOURS, vmin=0, vmax=1)
    handles: list[Artist] = [Patch(color=WEAK_COLOURS(0), label=blind.text)]
    rows, cols = part.world_to_grid(*blind.range_circle.xy.T)
    height, width = part.shape
    if ((rows > 0) & (rows < height) & (cols > 0) & (cols < width)).any():
        limits = axes.axis()
        axes.plot(*blind.range_circle.xy.T, **RANGE_STYLE)
        axes.axis(limits)
        text = "the lidar's range at a place on the shortest path"
        handles.append(Line2D([], [], label=text, **RANGE_STYLE))
    return handles


def _collect_marked_places(recommendation: Recommendation) -> list[Path]:
    """Return the marked places as one path, if there are any."""
    place_rows = [
        candidate.arrivals.places().rows
        for candidate in recommendation.candidates
        if candidate.arrivals
    ]
    places = [row[2:4] for rows in place_rows for row in rows]
    return [Path(np.array(places))] if places else []


def _rank_candidate(recommendation: Recommendation, candidate: Candidate) -> int:
    """Return 2 for the recommended path, 1 for the shortest path, 0 for the rest."""
    return (
        2
        if candidate is recommendation.recommended_candidate
        else int(candidate is recommendation.shortest)
    )


def _make_legend_handles(recommendation: Recommendation) -> list[Line2D]:
    highlighted = dict.fromkeys(
        candidate
        for candidate in (recommendation.recommended_candidate, recommendation.shortest)
        if candidate is not None
    )
    handles = []
    for candidate in highlighted:
        rank = _rank_candidate(recommendation, candidate)
        name = f"{candidate.name} path" if candidate is recommendation.shortest else candidate.name
        is_recommended = candidate is recommendation.recommended_candidate
        role = f"{recommendation.role}: " if is_recommended else ""
        label = f"{role}{name}, {_format_key_figures(candidate)}"
        line = Line2D([], [], color=LINE_COLOURS[rank], linewidth=LINE_WIDTHS[rank], label=label)
        handles.append(line)
    n_remaining = len(recommendation.candidates) - len(handles)
    if n_remaining > 0:
        label = f"{n_remaining} other candidate{'s' if n_remaining > 1 else ''}"
        handles.append(Line2D([], [], color=LINE_COLOURS[0], linewidth=LINE_WIDTHS[0], label=label))
    return handles


def _format_key_figures(candidate: Candidate) -> str:
    """Return length, error and lost drives of a candidate as text."""
    if candidate.driven is None:
        return f"{candidate.path.length:.1f} m, {candidate.metrics.integrated_u:.1f} m degenerate"
    rates = {
        "lost": candidate.driven.lost_rate.value,
        "off at the end": candidate.driven.off_at_end_rate.value,
    }
    texts = [f"{100 * rate:.0f} % {name}" for name, rate in rates.items() if rate >= 0]
    return ", ".join([f"{candidate.path.length:.1f} m", *texts])


def _draw_errors(axes: Axes, recommendation: Recommendation) -> None:
    """Draw the median error along the shortest and the recommended path, and the middle 80 %."""
    for candidate in dict.fromkeys((recommendation.shortest, recommendation.recommended_candidate)):
        if candidate is None or candidate.driven is None:
            continue
        distance, median, low, high = candidate.driven.profile.T
        rank = _rank_candidate(recommendation, candidate)
        colour = LINE_COLOURS[rank]
        axes.fill_between(distance, low, high, color=colour, alpha=0.15, linewidth=0)
        axes.plot(distance, median, color=colour, linewidth=0.8 * LINE_WIDTHS[rank])
    axes.axhline(LOST_DISTANCE, color="0.6", linewidth=0.8, zorder=0)
    text_style: dict[str, Any] = {
        "ha": "right",
        "va": "bottom",
        "fontsize": "small",
        "color": "0.4",
    }
    axes.text(0.997, LOST_DISTANCE, "lost", transform=axes.get_yaxis_transform(), **text_style)
    axes.set_yscale("log")
    axes.set_ylim(bottom=max(MIN_ERROR / 2, axes.get_ylim()[0]))
    label_with_plain_numbers(axes.yaxis, 4)
    axes.set(xlabel="distance along the path [m]", ylabel="position error [m]")
    axes.margins(x=0.01)
    axes.set_title("open-loop drives: median, and where 80 % of them are", fontsize="small")


def _draw_degeneracy(axes: Axes, recommendation: Recommendation) -> None:
    """Draw the degeneracy along each path with a known degeneracy."""
    costs: Any = recommendation.costs
    paths = [
        (candidate.path, LineStyle(LINE_COLOURS[_rank_candidate(recommendation, candidate)]))
        for candidate in (recommendation.candidates if costs else ())
        if np.isfinite(candidate.metrics.integrated_u)
    ]
    draw_degeneracy_profiles(axes, costs, paths)
