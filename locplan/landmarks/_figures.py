"""Figures of landmarks, before and after, and of key features, with what is lost without each."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.collections import PolyCollection
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from locplan import plotting
from locplan._kernels.arrays import Floats
from locplan._util.poses import way_along
from locplan.costs import Path
from locplan.landmarks._features import MATTERS_M, KeyFeatures
from locplan.landmarks._landmarks import PAYING_SHARE, Landmarks
from locplan.landmarks._objects import outline_of
from locplan.landmarks._outcomes import BeforeAndAfter, FeatureDrives, Verification
from locplan.maps import OccupancyGrid
from locplan.plotting import style
from locplan.simulation import LOST, Drives

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH, MIN_WIDTH = 11.0, 9.5
"""Width of a figure that its maps fill if they can, and minimum of all [inch]."""
BAR, LABELS = 1.6, 0.7
"""Width of a colour bar, and the space of a map's labels on each axis [inch]."""
PLOT_HEIGHT, PLOT_WIDTH = 2.9, 4.6
"""Size of the plots, where they stand below the maps or beside them [inch]."""

NUMBERED = 8
"""Maximum number of features with their number beside them."""


def panels(
    grid: OccupancyGrid, said: Sequence[str], maps: int, plots: int
) -> tuple[Figure, Any, list[Axes], list[Axes]]:
    """An empty figure, its part for one map or two, these maps, and plots.

    The lines of its title, `said`, are broken where they are too wide.
    """
    wide, high = plotting.drawn_size(grid)
    # Ratio of a map's height to its width up to which two maps stand above each other.
    columns = 1 if high <= 0.9 * wide else maps
    rows = maps // columns
    # Ratio of the maps' height to their width from which on the plots stand beside them.
    tall = high > 1.5 * columns * wide
    if not tall:
        scale = ((WIDTH - BAR) / columns - LABELS) / wide
        # Maximum height of a map [inch].
        scale = min(scale, max(8.0 / high, 1.0))
        wide, high = scale * wide, scale * high
    width, height = columns * (wide + LABELS) + BAR, rows * (high + LABELS)
    width = width + PLOT_WIDTH if tall else max(width, MIN_WIDTH)
    lines = [part for line in said for part in plotting.lines_within(line, width)]
    # Height of a line of the title [inch].
    top = 0.24 * (len(lines) + 1)
    height = max(height, plots * PLOT_HEIGHT) if tall else height + PLOT_HEIGHT
    figure: Any = plotting.Picture(figsize=(width, height + top), layout="constrained")
    if tall:
        parts = figure.subfigures(1, 2, width_ratios=(width - PLOT_WIDTH, PLOT_WIDTH))
    else:
        parts = figure.subfigures(2, height_ratios=(height - PLOT_HEIGHT, PLOT_HEIGHT))
    lower = parts[1].subplots(*((plots, 1) if tall else (1, plots)), squeeze=False)
    figure.suptitle("\n".join(lines), fontsize="medium")
    upper = parts[0].subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    return figure, parts[0], list(upper.ravel()), list(lower.ravel())


def landmarks_figure(made: Landmarks, verification: Verification | None = None) -> Figure:
    """Maps before and after with the routes, the expected deviation, and the error on the way.

    Parameters
    ----------
    made : Landmarks
        The placement, as `place_landmarks` returns it.
    verification : Verification, optional
        Drives of `Landmarks.verify`; with them the routes are coloured by the mean position error.
    """
    grids = [
        plotting.map_around(grid, list(made.setting.routes.values()))
        for grid in (made.before, made.grid)
    ]
    title = f"{made.before.name or 'map'}: {len(made)} x {made.setting.kind.title}"
    said = [title, verification.verdict if verification else "not verified by drives"]
    said.append(f"with {made.setting.robot.title}")
    figure, part, maps, plots = panels(grids[0], said, 2, 3 if verification else 1)
    profiles = list(verification.profiles.values()) if verification else []
    _draw_maps(part, maps, grids, made, profiles)
    _draw_gains(plots[0], made)
    if verification:
        draw_errors(plots[1], verification, ("before", "after"), (style.BLUE, style.VERMILION))
        _draw_matches(plots[2], verification)
    return figure


def _draw_maps(
    figure: Any,
    axes: Sequence[Axes],
    grids: Sequence[OccupancyGrid],
    made: Landmarks,
    profiles: Sequence[tuple[Drives, Drives]],
) -> None:
    """Draw the map without and with landmarks, and the routes over both."""
    driven = [[each.profile() for each in pair] for pair in profiles]
    errors = [profile[:, 4] for pair in driven for profile in pair] or [np.ones(1)]
    norm = plotting.along_norm(np.concatenate(errors), of_errors=True)
    image = None
    for n, (own, grid) in enumerate(zip(axes, grids, strict=True)):
        plotting.draw_map(own, grid)
        if made.setting.region is not None:
            _draw_region(own, made)
        own.set_title(("before", "after")[n], fontsize="medium", loc="left")
        own.label_outer()
        for k, path in enumerate(made.setting.routes.values()):
            if profiles:
                xy, error = driven[k][n][:, 1:3], driven[k][n][:-1, 4]
                own.plot(*xy.T, color="black", linewidth=5.0, zorder=2)
                image = plotting.draw_along(own, xy, error, norm=norm, linewidths=3.5)
            else:
                plotting.draw_path(own, path, color="black", linewidth=1.5)
            plotting.draw_ends(own, path.xy[0], path.xy[-1])
    if image is not None:
        plotting.draw_along_bar(figure, image, list(axes))
    shapes = [outline_of(made.setting.kind.shape, pose) for pose in made.poses]
    faces = PolyCollection(shapes, facecolor=style.VERMILION, edgecolor="black", zorder=4)
    axes[1].add_collection(faces)
    draw_numbers(axes[1], dict(enumerate(made.positions, 1)), made.setting.routes, style.VERMILION)


def _draw_region(axes: Axes, made: Landmarks) -> None:
    """Outline the region in which the robot may be anywhere."""
    grid = made.setting.grid
    rows, cols = np.indices(grid.shape) + 0.5
    x, y = grid.grid_to_world(rows, cols)
    region = np.asarray(made.setting.region, np.float64)
    axes.contour(x, y, region, levels=[0.5], colors=style.SKY, linewidths=0.8, zorder=2)


def draw_numbers(
    axes: Axes,
    places: Mapping[int, Floats],
    routes: Mapping[str, Path],
    colour: str,
    weight: str = "normal",
) -> None:
    """Draw numbers beside places x, y [m], away from the nearest route."""
    from scipy.spatial import cKDTree

    points = np.concatenate([path.resampled(0.1).xy for path in routes.values()])
    near = cKDTree(points)
    for number, at in places.items():
        away = at - points[near.query(at)[1]]
        aside = 17 * away / (float(np.hypot(*away)) or 1.0)
        plotting.draw_number(
            axes, number, tuple(at.tolist()), tuple(aside.tolist()), colour, fontweight=weight
        )


def _draw_gains(axes: Axes, made: Landmarks) -> None:
    """Draw the expected deviation over the number of landmarks."""
    numbers: NDArray[Any] = np.arange(len(made.curve))
    axes.plot(numbers, made.expected, "o-", color=style.VERMILION, markersize=4)
    if made.expected[-1] > 0 and made.expected[0] > 10 * made.expected[-1]:
        plotting.make_logarithmic(axes.yaxis)
    else:
        axes.set_ylim(0, 1.05 * float(made.expected.max()) or 1.0)
    if 0 < made.paying < len(made):
        axes.axvline(made.paying, color="0.6", linewidth=0.8)
        note = f"further ones: less\nthan {PAYING_SHARE:.0%} each"
        at = "data", "axes fraction"
        axes.annotate(note, (made.paying, 0.97), (4, 0), at, "offset points", va="top", fontsize=8)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="number of landmarks", ylabel=made.measure.heading)


def draw_errors(
    axes: Axes, driven: BeforeAndAfter, labels: Sequence[str], colours: Sequence[str]
) -> None:
    """Draw the error of drives along the first route, before and after."""
    pair = next(iter(driven.profiles.values()))
    for drives, colour, label, line in zip(pair, colours, labels, ("--", "-"), strict=True):
        profile = drives.profile()
        axes.fill_between(
            profile[:, 0], profile[:, 6], profile[:, 7], color=colour, alpha=0.2, linewidth=0
        )
        axes.plot(profile[:, 0], profile[:, 4], line, color=colour, label=label)
    if axes.get_ylim()[1] > LOST / 2:
        axes.axhline(LOST, color="0.6", linewidth=0.8, zorder=0)
        right: dict[str, Any] = {"ha": "right", "va": "top", "fontsize": 8}
        at = (1, LOST), (-5, -2), ("axes fraction", "data"), "offset points"
        axes.annotate("off by > 1 m", *at, **right)
    plotting.make_logarithmic(axes.yaxis)
    axes.set_ylim(bottom=max(style.MIN_ERROR / 2, axes.get_ylim()[0]))
    axes.set(xlabel=along_first(driven.profiles), ylabel="position error of drives [m]")
    axes.set_title("mean, and where 80 % of the drives are", fontsize="small", loc="left")
    axes.legend(fontsize="small", frameon=False)


def along_first(routes: Collection[str]) -> str:
    """Label of the distance along the first of some routes."""
    name = f" of {next(iter(routes))}" if len(routes) > 1 else ""
    return f"distance along the route{name} [m]"


def _draw_matches(axes: Axes, verification: Verification) -> None:
    """Draw the deviation of single matches along the first route, before and after."""
    pair = next(iter(verification.fields.values()))
    colours = style.BLUE, style.VERMILION
    for profile, colour, line in zip(pair, colours, ("--", "-"), strict=True):
        axes.plot(*profile.T, line, color=colour)
    axes.set_ylim(bottom=0)
    axes.set(xlabel=along_first(verification.fields), ylabel="deviation of a match [m]")
    axes.set_title("one scan alone, by the field", fontsize="small", loc="left")


def key_features_figure(found: KeyFeatures, drives: FeatureDrives | None = None) -> Figure:
    """Map with the loss by each feature, and the expected deviation along the first route.

    Parameters
    ----------
    found : KeyFeatures
        The features, as `key_features` returns them.
    drives : FeatureDrives, optional
        Drives of `KeyFeatures.verify`; with them their mean error along the first route is drawn.
    """
    grid = plotting.map_around(found.grid, list(found.routes.values()))
    said = [f"{found.grid.name or 'map'}: {found.verdict}"]
    said.append(drives.verdict if drives else "not verified by drives")
    said.append(f"with {found.robot.title}")
    figure, part, (axes,), plots = panels(grid, said, 1, 2)
    plotting.draw_map(axes, grid)
    axes.images[0].set_cmap(style.PALE_MAP_COLOURS)
    for path in found.routes.values():
        plotting.draw_path(axes, path, color="0.35", linewidth=1.5)
        plotting.draw_ends(axes, path.xy[0], path.xy[-1])
    if found.features:
        axes.set_autoscale_on(False)  # features may lie beyond what is drawn
        _draw_losses(part, axes, found, grid)
    _draw_profiles(plots[0], found)
    if drives:
        labels = "with all", "without " + _listed(found.together)
        draw_errors(plots[1], drives, labels, ("black", style.BLUE))
    else:
        _draw_curve(plots[1], found)
    return figure


def _draw_losses(figure: Any, axes: Axes, found: KeyFeatures, part: OccupancyGrid) -> None:
    """Draw the cells of each feature in the colour of its loss, and the numbers of the first."""
    most = 100 * max(found.features[0].loss, MATTERS_M)
    # Colours of the losses: the darker, the more; none as light as the floor.
    colours = ListedColormap(colormaps["plasma_r"](np.linspace(0.08, 0.85, 256)))
    shades: Any = {"cmap": colours, "norm": Normalize(0, most, clip=True)}
    features = found.features[::-1]  # the greatest losses on top
    cells = np.concatenate([each.cells for each in features])
    lost = [100 * each.loss for each in features]
    losses = np.repeat(lost, [len(each.cells) for each in features])
    if max(part.shape) <= plotting.DRAWN_CELLS:  # marks are smaller than the cells of small maps
        of_cells = np.full(found.grid.shape, np.nan)
        of_cells[tuple(cells.T)] = losses
        x, y = part.grid_to_world(0.5, 0.5)
        row, col = found.grid.world_to_cell(float(x), float(y))
        of_part = of_cells[row : row + part.shape[0], col : col + part.shape[1]]
        plotting.draw_cells(axes, part, of_part, **shades)
    # The less is lost, the smaller the mark of a cell [points^2].
    sizes = 9.0 * (0.3 + 0.7 * np.clip(losses / most, 0.0, 1.0))
    at = found.grid.grid_to_world(*(cells.T + 0.5))
    marks = axes.scatter(*at, sizes, losses, marker="s", linewidths=0, zorder=3, **shades)
    bar = figure.colorbar(marks, ax=axes, shrink=0.9)
    bar.set_label("rise of the expected deviation without it [cm]")
    low, high, bottom, top = *axes.get_xlim(), *axes.get_ylim()
    numbers = list(dict.fromkeys([*found.together, *range(1, NUMBERED + 1)]))
    numbers = numbers[: max(NUMBERED, len(found.together))]
    places = {
        each.number: np.array([each.x, each.y])
        for each in found.features
        if each.number in numbers and low <= each.x <= high and bottom <= each.y <= top
    }
    few = {number: at for number, at in places.items() if number in found.together}
    others = {number: at for number, at in places.items() if number not in few}
    draw_numbers(axes, others, found.routes, "0.4")
    draw_numbers(axes, few, found.routes, style.BLUE, "bold")


def _draw_profiles(axes: Axes, found: KeyFeatures) -> None:
    """Draw the expected deviation along the first route, with and without the features."""
    part = slice(found.begins[0], found.begins[1])
    way = way_along(found.positions[part])
    labels = ["with all features", "without 1", "without " + _listed(found.together)]
    labels = labels[: 3 if len(found.together) > 1 else 2]
    colours, lines = ("black", style.VERMILION, style.BLUE), ("-", "--", "-.")
    for values, label, colour, line in zip(
        np.sqrt(found.profiles), labels, colours, lines, strict=False
    ):
        axes.plot(way, values[part], line, color=colour, label=label)
    axes.set(xlabel=along_first(found.routes), ylabel="expected deviation [m]")
    axes.set_ylim(bottom=0)
    axes.legend(fontsize="small", frameon=False)


def _draw_curve(axes: Axes, found: KeyFeatures) -> None:
    """Draw the expected deviation over the number of features that are away."""
    axes.plot(np.arange(len(found.curve)), found.deviations, "o-", color=style.BLUE, markersize=4)
    for n, number in enumerate(found.together, 1):
        at = n, float(found.deviations[n])
        axes.annotate(f"without {number}", at, (0, -9), textcoords="offset points", ha="center",
                      va="top", fontsize=7)  # fmt: skip
    axes.set_ylim(0, 1.1 * float(found.deviations.max()))
    axes.set_xlim(-0.3, len(found.curve) - 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="number of features that are away", ylabel="expected deviation [m]")


def _listed(numbers: tuple[int, ...]) -> str:
    """Numbers of features, the first of many."""
    return ", ".join(map(str, numbers[:5])) + (", ..." if len(numbers) > 5 else "")
