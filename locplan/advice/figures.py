"""Figures of checks, of landmarks and of repaired maps."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from locplan._support import drawing as style
from locplan._support.drawing import (
    MAP_COLOURS,
    NotebookFigure,
    break_title,
    draw_number,
    make_logarithmic,
)
from locplan._support.intervals import Interval
from locplan._support.kernels.arrays import Floats
from locplan.advice.landmark_objects import compute_outline_points
from locplan.advice.landmarks import EXPECTED_DEVIATION, PAYING_SHARE, Landmarks, Verification
from locplan.advice.preset_choice import USER_SETTINGS
from locplan.advice.weak_spots import sample_path
from locplan.maps.figures import (
    AxesLimits,
    compute_axes_limits,
    compute_drawing_size,
    compute_figure_size,
    crop_map,
    downsample,
    draw_cells,
    draw_map,
)
from locplan.maps.grid import OccupancyGrid
from locplan.planning.figures import (
    draw_coloured_line,
    draw_path,
    draw_path_colour_bar,
    draw_start_and_goal,
    make_path_norm,
)
from locplan.simulation.drives import LOST_DISTANCE, LOST_SHORT_TEXT, Drives

if TYPE_CHECKING:
    from locplan.advice.tuning import Tuning

if TYPE_CHECKING:
    from locplan.advice.check_result import Check
    from locplan.advice.rates import RouteResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes

if TYPE_CHECKING:
    from locplan.advice.map_repair import RepairedMap


SETTINGS_MARKS = {
    USER_SETTINGS: ("0.35", "o"),
    "precise": (style.VERMILION, "^"),
    "safe": (style.BLUE, "s"),
}
"""Colour and marker of the user's settings and of each preset."""


def tuning_figure(tuning: Tuning) -> Figure:
    """Draw errors and rates of the user's settings and of the presets, case by case.

    Parameters
    ----------
    tuning : Tuning
        The result of `tune` or `locplan.advice.tuning.tune_on_drive`.
    """
    figure = NotebookFigure(figsize=(9.6, 4.2), layout="constrained")
    errors, off_at_end = figure.subplots(1, 2)
    results = tuning.choice.results
    cases = [*dict.fromkeys(result.case for result in results)]
    for place, name in enumerate(dict.fromkeys(result.settings for result in results)):
        mark, label = SETTINGS_MARKS[name], name
        if name == tuning.choice.name:
            label = f"{name}: {'keep these' if name == USER_SETTINGS else 'use this preset'}"
        of_settings = [result for result in results if result.settings == name]
        at = np.array([cases.index(result.case) for result in of_settings]) + 0.15 * (place - 1)
        error = np.array([result.error for result in of_settings])
        share = np.array([result.off_at_end for result in of_settings])
        _draw_intervals(errors, at, error, mark, label)
        _draw_intervals(off_at_end, at, 100 * share, mark, label)
    for axes in (errors, off_at_end):
        axes.set_xticks(range(len(cases)), [textwrap.fill(name, 10) for name in cases])
        axes.tick_params(axis="x", labelsize="small")
        axes.grid(axis="y", color="0.92")
        axes.margins(x=0.1)
    errors.set_title("error with 95 % intervals: lower is better", fontsize="medium")
    off_at_end.set_title(f"still {LOST_SHORT_TEXT} at the end: lower is safer", fontsize="medium")
    make_logarithmic(errors.yaxis)
    errors.set_ylabel("RMSE of the position [m]")
    off_at_end.set_ylabel("off at the end [% of the drives]")
    off_at_end.set_ylim(bottom=-0.04 * off_at_end.get_ylim()[1])
    figure.key(errors.get_legend_handles_labels()[0], ncols=3)
    figure.title(f"{tuning.conclusion}. {tuning.map_names}, {tuning.robot.known_lidar.title}")
    return figure


def _draw_intervals(
    axes: Axes,
    positions: NDArray[Any],
    intervals: Floats,
    colour_and_marker: tuple[str, str],
    label: str,
) -> None:
    """Draw values with their intervals, rows of (value, low, high), as marks of one colour."""
    value, low, high = intervals.T
    colour, marker = colour_and_marker
    bars = np.maximum([np.nan_to_num(value - low), np.nan_to_num(high - value)], 0)
    axes.errorbar(positions, value, bars, fmt="none", ecolor=colour, elinewidth=1.5)
    axes.plot(positions, value, marker, color=colour, label=label)


FAILS, WORKS, WEAK, LETTER, MARK = "#d55e00", "#8a929c", "#e69f00", "#7a3b00", "#b00020"
"""Colours of failing routes, of other routes, of weak spots, of their letters, and of the places
where drives get lost or stop before the goal."""
N_NAMED = 3
"""Maximum number of routes with a failure that have a label with its rate."""
SIZE = 0.055
"""Size of a label, as a share of the longer side of what is drawn."""


LABEL_STYLES = {
    "spot": (LETTER, "white", "white"),
    "route": (FAILS, "white", "white"),
    "end": ("white", "#1b1f24", "#5b6470"),
}
"""Colours of the face, the text and the edge of a label by its kind."""


class MapLabel(NamedTuple):
    """A label on the map: a spot's letter, a route's failure rate, or an end's name."""

    kind: str
    """"spot", "route" or "end"."""
    text: str
    """The text."""
    xy: tuple[float, float]
    """The labelled position [m]."""
    at: tuple[float, float]
    """Position of the label itself [m]."""


def place_labels(check: Check, size: float) -> list[MapLabel]:
    """Return labels that do not overlap.

    Parameters
    ----------
    check : Check
        The check.
    size : float
        Height of a label [m].
    """
    around = [
        (size * far * np.cos(turn), size * far * np.sin(turn))
        for far in (0.0, 1.05, 1.6, 2.2, 3.0, 4.0)
        for turn in np.radians(range(90, 450, 30))
    ]
    limits = compute_axes_limits(crop_to_free(check.scenario.world))
    # The marks of failures stay visible.
    failures = [xy for route in check.routes for xy in (route.lost_at, route.stopped_at)]
    marks = [MapLabel("mark", "", (x, y), (x, y)) for x, y in np.concatenate(failures).tolist()]
    labels: list[MapLabel] = []
    for kind, text, place in _list_labels(check):
        is_failure = kind == "failure"
        positions = [(place[0] + dx, place[1] + dy) for dx, dy in around[12 * is_failure :]]
        inner_positions = [at for at in positions if _is_label_inside(text, at, limits, size)]
        free = (
            at
            for obstacles in ((*labels, *marks), labels)
            for at in inner_positions
            if not any(_do_labels_overlap(text, at, other, size) for other in obstacles)
        )
        labels.append(MapLabel("spot" if is_failure else kind, text, place, next(free, place)))
    return labels


def _is_label_inside(text: str, at: tuple[float, float], limits: AxesLimits, size: float) -> bool:
    """True if a label would lie within the Axes, and so cover no title."""
    half_sizes = size * max(0.5, 0.2 * len(text)), 0.5 * size
    return all(
        low + half <= value <= high - half
        for value, half, (low, high) in zip(at, half_sizes, limits, strict=True)
    )


def _do_labels_overlap(text: str, at: tuple[float, float], other: MapLabel, size: float) -> bool:
    (x, y), (left, low) = at, other.at
    wide = max(1.0, 0.2 * (len(text) + len(other.text)))
    return abs(x - left) < size * wide and abs(y - low) < size


def _list_labels(check: Check) -> Iterator[tuple[str, str, tuple[float, float]]]:
    """Yield kind, text and position of each label."""
    for spot in check.spots:
        if spot.letter:
            kind = "failure" if spot.lost + spot.stopped else "spot"
            yield kind, spot.letter, (spot.x, spot.y)
    if check.passage and check.passage.is_narrow:
        place = check.passage.x, check.passage.y
        yield "failure", f"passage of {check.passage.width:.2f} m", place
    ends: dict[str, tuple[float, ...]] = {}
    for route in check.routes:
        start, _, goal = route.name.partition(" to ")
        ends.update(zip((start, goal), map(tuple, route.path.xy[[0, -1]].tolist()), strict=True))
    yield from (("end", name, (x, y)) for name, (x, y) in ends.items() if name)
    failing = [route for route in check.routes if route.rates.has_failure]
    for route in failing[:N_NAMED]:
        points = sample_path(route.path)
        failures = route.lost_at if route.rates.is_mostly_lost else route.stopped_at
        middle = np.median(failures, axis=0) if len(failures) else points[len(points) // 2]
        x, y = points[np.linalg.norm(points - middle, axis=1).argmin()].tolist()
        yield "route", failure_text(route), (x, y)


def failure_text(route: RouteResult) -> str:
    """Return the rate of the worse failure of a route."""
    rates = route.rates
    if rates.is_mostly_lost:
        return f"{100 * rates.lost.value:.0f} % lost"
    return f"{100 * rates.reached.value:.0f} % reach the goal"


def crop_to_free(grid: OccupancyGrid) -> OccupancyGrid:
    """Crop a map to its free cells and their walls.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    """
    rows, cols = (np.flatnonzero(grid.free.any(axis=axis)) for axis in (1, 0))
    edge = max(2, round(0.03 * max(np.ptp(rows), np.ptp(cols))))
    return grid.crop(
        *(slice(max(0, indices[0] - edge), int(indices[-1]) + edge) for indices in (rows, cols))
    )


def check_figure(check: Check) -> Figure:
    """Draw the map with its routes, weak spots, and where drives fail.

    Parameters
    ----------
    check : Check
        The result of `locplan.check`.
    """
    part = crop_to_free(check.scenario.world)
    figure = NotebookFigure(figsize=compute_figure_size(part), layout="constrained")
    axes = figure.subplots()
    draw_map(axes, part)
    for spot in check.spots:
        rings = [Outline(np.vstack([ring, ring[:1]])) for ring in spot.rings]
        if rings:
            shape = Outline.make_compound_path(*rings)
            axes.add_patch(PathPatch(shape, facecolor=WEAK, alpha=0.45, edgecolor="none"))
    for route in check.routes[::-1]:  # the worst on top
        fails = route.rates.has_failure
        width, colour = (3.2, FAILS) if fails else (1.4, WORKS)
        draw_path(axes, route.path, color=colour, linewidth=width, zorder=3 if fails else 2)
        axes.plot(*route.lost_at.T, "x", color=MARK, markersize=7, markeredgewidth=2, zorder=4)
        axes.plot(
            *route.stopped_at.T,
            linestyle="none",
            marker="s",
            color=MARK,
            markeredgecolor="white",
            markersize=8,
            zorder=4,
        )
    for label in place_labels(check, SIZE * max(part.shape) * part.resolution):
        back, ink, edge = LABEL_STYLES[label.kind]
        axes.plot(
            *zip(label.xy, label.at, strict=True), color=back if edge == "white" else edge, zorder=5
        )
        axes.text(
            *label.at,
            label.text,
            fontsize="small",
            weight="normal" if label.kind == "end" else "bold",
            ha="center",
            va="center",
            color=ink,
            zorder=6,
            bbox={"boxstyle": "round,pad=.25", "fc": back, "ec": edge},
        )
    rates = check.baseline
    rate = f"reaches the goal in {100 * rates.reached.value:.0f} %"
    if rates.is_mostly_lost:
        rate = f"gets lost in {100 * rates.lost.value:.0f} %"
    title = f"{check.grid.name or 'Map'}: the robot {rate} of simulated drives"
    figure.suptitle(title, fontsize="large", weight="bold")
    text = caption_text(check)
    axes.set_title(f"{text[:1].upper()}{text[1:]}", fontsize="small")
    return figure


def caption_text(check: Check) -> str:
    """Return the caption of the check's figure.

    Parameters
    ----------
    check : Check
        The check.
    """
    lost, stopped = (
        any(len(getattr(route, name)) for route in check.routes)
        for name in ("lost_at", "stopped_at")
    )
    fails = any(route.rates.has_failure for route in check.routes)
    explained = [
        (True, "orange: routes on which drives fail" if fails else "no route fails"),
        (lost, "x: a drive gets lost"),
        (stopped, "square: a drive misses the goal"),
        (any(spot.letter for spot in check.spots), "letters: weak spots"),
        (any(spot.rings for spot in check.spots), "shaded: few features"),
        (True, "framed: ends of routes"),
    ]
    parts = [text for is_drawn, text in explained if is_drawn]
    half = (len(parts) + 1) // 2
    return ",\n".join(filter(None, [", ".join(parts[:half]), ", ".join(parts[half:])]))


MAX_WIDTH, MIN_WIDTH = 11.0, 9.5
"""Width of a figure that its maps fill if they can, and minimum of all [inch]."""
BAR, LABELS = 1.6, 0.7
"""Width of a colour bar, and the space of a map's labels on each axis [inch]."""
PLOT_HEIGHT, PLOT_WIDTH = 2.9, 4.6
"""Size of the plots, where they stand below the maps or beside them [inch]."""


def _make_panels(
    grid: OccupancyGrid, title_lines: Sequence[str], n_plots: int
) -> tuple[Figure, Any, list[Axes], list[Axes]]:
    """Return an empty figure, its part for two maps, and the Axes of maps and plots.

    Too long lines of the title, `title_lines`, are wrapped.
    """
    wide, high = compute_drawing_size(grid)
    # Ratio of a map's height to its width up to which two maps stand above each other.
    columns = 1 if high <= 0.9 * wide else 2
    rows = 2 // columns
    # Ratio of the maps' height to their width from which on the plots stand beside them.
    tall = high > 1.5 * columns * wide
    if not tall:
        scale = ((MAX_WIDTH - BAR) / columns - LABELS) / wide
        # Maximum height of a map [inch].
        scale = min(scale, max(8.0 / high, 1.0))
        wide, high = scale * wide, scale * high
    width, height = columns * (wide + LABELS) + BAR, rows * (high + LABELS)
    width = width + PLOT_WIDTH if tall else max(width, MIN_WIDTH)
    lines = [part for line in title_lines for part in break_title(line, width)]
    # Height of a line of the title [inch].
    top = 0.24 * (len(lines) + 1)
    height = max(height, n_plots * PLOT_HEIGHT) if tall else height + PLOT_HEIGHT
    figure: Any = NotebookFigure(figsize=(width, height + top), layout="constrained")
    if tall:
        parts = figure.subfigures(1, 2, width_ratios=(width - PLOT_WIDTH, PLOT_WIDTH))
    else:
        parts = figure.subfigures(2, height_ratios=(height - PLOT_HEIGHT, PLOT_HEIGHT))
    lower = parts[1].subplots(*((n_plots, 1) if tall else (1, n_plots)), squeeze=False)
    figure.suptitle("\n".join(lines), fontsize="medium")
    upper = parts[0].subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    return figure, parts[0], list(upper.ravel()), list(lower.ravel())


def landmarks_figure(landmarks: Landmarks, verification: Verification | None = None) -> Figure:
    """Draw maps before and after, the expected deviation, and errors along the route.

    Parameters
    ----------
    landmarks : Landmarks
        The placement, as `place_landmarks` returns it.
    verification : Verification, optional
        Drives of `Landmarks.verify`; with them the routes are coloured by the mean position error.
    """
    grids = [
        crop_map(grid, list(landmarks.setting.routes.values()))
        for grid in (landmarks.setting.grid, landmarks.grid)
    ]
    name = landmarks.setting.grid.name or "map"
    title_lines = [
        f"{name}: {verification.verdict if verification else 'not verified by drives'}",
        f"{len(landmarks)} x {landmarks.setting.kind.title}; {landmarks.setting.robot.title}",
    ]
    figure, part, maps, plots = _make_panels(grids[0], title_lines, 2 if verification else 1)
    profiles = list(verification.profiles.values()) if verification else []
    _draw_maps(part, maps, grids, landmarks, profiles)
    _draw_expected_deviation(plots[0], landmarks)
    if verification:
        _draw_route_errors(plots[1], verification)
    return figure


def _draw_maps(
    figure: Any,
    axes: Sequence[Axes],
    grids: Sequence[OccupancyGrid],
    landmarks: Landmarks,
    profiles: Sequence[tuple[Drives, Drives]],
) -> None:
    """Draw the map without and with landmarks, and the routes over both."""
    drive_profiles = [[drives.profile() for drives in pair] for pair in profiles]
    errors = [profile[:, 4] for pair in drive_profiles for profile in pair] or [np.ones(1)]
    norm = make_path_norm(np.concatenate(errors), of_errors=True)
    image = None
    for n, (map_axes, grid) in enumerate(zip(axes, grids, strict=True)):
        draw_map(map_axes, grid)
        map_axes.set_title(("before", "after")[n], fontsize="medium", loc="left")
        map_axes.label_outer()
        for k, path in enumerate(landmarks.setting.routes.values()):
            if profiles:
                xy, error = drive_profiles[k][n][:, 1:3], drive_profiles[k][n][:-1, 4]
                map_axes.plot(*xy.T, color="black", linewidth=5.0, zorder=2)
                image = draw_coloured_line(map_axes, xy, error, norm=norm, linewidths=3.5)
            else:
                draw_path(map_axes, path, color="black", linewidth=1.5)
            draw_start_and_goal(map_axes, path.xy[0], path.xy[-1])
    if image is not None:
        draw_path_colour_bar(figure, image, list(axes))
    shapes = [
        compute_outline_points(landmarks.setting.kind.shape, pose) for pose in landmarks.poses
    ]
    faces = PolyCollection(shapes, facecolor=style.VERMILION, edgecolor="black", zorder=4)
    axes[1].add_collection(faces)
    _draw_landmark_numbers(axes[1], landmarks)


def _draw_landmark_numbers(axes: Axes, landmarks: Landmarks) -> None:
    """Draw the landmarks' numbers next to them, away from the nearest route."""
    from scipy.spatial import cKDTree

    routes = landmarks.setting.routes.values()
    points = np.concatenate([path.resample(0.1).xy for path in routes])
    near = cKDTree(points)
    for number, at in enumerate(landmarks.positions, 1):
        route_offset = at - points[near.query(at)[1]]
        label_offset = 17 * route_offset / (float(np.hypot(*route_offset)) or 1.0)
        draw_number(axes, number, tuple(at.tolist()), tuple(label_offset.tolist()), style.VERMILION)


def _draw_expected_deviation(axes: Axes, landmarks: Landmarks) -> None:
    """Draw the expected deviation over the number of landmarks."""
    numbers: NDArray[Any] = np.arange(len(landmarks.curve))
    axes.plot(numbers, landmarks.expected_deviations, "o-", color=style.VERMILION, markersize=4)
    if (
        landmarks.expected_deviations[-1] > 0
        and landmarks.expected_deviations[0] > 10 * landmarks.expected_deviations[-1]
    ):
        make_logarithmic(axes.yaxis)
    else:
        axes.set_ylim(0, 1.05 * float(landmarks.expected_deviations.max()) or 1.0)
    if 0 < landmarks.n_useful < len(landmarks):
        axes.axvline(landmarks.n_useful, color="0.6", linewidth=0.8)
        note = f"further ones: less\nthan {PAYING_SHARE:.0%} each"
        at = "data", "axes fraction"
        axes.annotate(
            note, (landmarks.n_useful, 0.97), (4, 0), at, "offset points", va="top", fontsize=8
        )
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="number of landmarks", ylabel=EXPECTED_DEVIATION.heading)


def _draw_route_errors(axes: Axes, verification: Verification) -> None:
    """Draw the error of drives along the first route, before and after."""
    routes = verification.profiles
    name, pair = next(iter(routes.items()))
    styles = ("before", "black", "--"), ("after", style.VERMILION, "-")
    for drives, (label, colour, line) in zip(pair, styles, strict=True):
        profile = drives.profile()
        axes.fill_between(
            profile[:, 0], profile[:, 6], profile[:, 7], color=colour, alpha=0.2, linewidth=0
        )
        axes.plot(profile[:, 0], profile[:, 4], line, color=colour, label=label)
    if axes.get_ylim()[1] > LOST_DISTANCE / 2:
        axes.axhline(LOST_DISTANCE, color="0.6", linewidth=0.8, zorder=0)
        at = (1, LOST_DISTANCE), (-5, -2), ("axes fraction", "data"), "offset points"
        axes.annotate(LOST_SHORT_TEXT, *at, ha="right", va="top", fontsize=8)
    make_logarithmic(axes.yaxis)
    axes.set_ylim(bottom=max(style.MIN_ERROR / 2, axes.get_ylim()[0]))
    of_route = f" of {name}" if len(routes) > 1 else ""
    axes.set(
        xlabel=f"distance along the route{of_route} [m]", ylabel="position error of drives [m]"
    )
    axes.set_title("mean, and where 80 % of the drives are", fontsize="small", loc="left")
    axes.legend(fontsize="small", frameon=False)


def repair_figure(repaired_map: RepairedMap) -> Figure:
    """Draw the original and the repaired map, side by side, below the verdict.

    Parameters
    ----------
    repaired_map : RepairedMap
        The result of `locplan.repair`.
    """
    width, height = compute_figure_size(repaired_map.grid)
    scale = min(1.0, MAX_WIDTH / (2 * width))
    size = 2 * scale * width, scale * height + 0.6
    figure = NotebookFigure(figsize=size, layout="constrained")
    pair = figure.subplots(1, 2, sharex=True, sharey=True)
    verdicts = repaired_map.verdicts
    maps: list[tuple[str, OccupancyGrid, dict[str, Interval]]] = [
        ("original", repaired_map.grid, {v.filter: v.lost_as_is for v in verdicts}),
        ("repaired", repaired_map.filter_map, {v.filter: v.lost_repaired for v in verdicts}),
    ]
    for axes, (title, grid, lost) in zip(pair, maps, strict=True):
        draw_map(axes, grid)
        # Draw occupied cells in black; other figures draw only the rims of walls.
        levels = downsample(grid.cells) // 127
        draw_cells(axes, grid, levels, cmap=MAP_COLOURS, vmin=0, vmax=3)
        rates = [f"{share.value:.0%} of the drives lost, {name}" for name, share in lost.items()]
        axes.set_title("\n".join([f"{title} map", *rates]), fontsize="medium")
    outcome = ", ".join(f"{v.verdict} for {v.filter}" for v in verdicts)
    nothing = f"{repaired_map.n_changed:,} cells differ, not simulated"
    answer = outcome or (nothing if repaired_map.n_changed else "nothing to repair")
    figure.title(f"{repaired_map.grid.name or 'map'}, repaired map: {answer}")
    return figure
