"""The figure of landmarks: the maps before and after, and the errors along the first route."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from locplan import plotting
from locplan.landmarks._landmarks import EXPECTED, PAYING_SHARE, Landmarks
from locplan.landmarks._objects import outline_of
from locplan.landmarks._verification import Verification
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


def _panels(
    grid: OccupancyGrid, said: Sequence[str], plots: int
) -> tuple[Figure, Any, list[Axes], list[Axes]]:
    """An empty figure, its part for two maps, these maps, and plots.

    The lines of its title, `said`, are broken where they are too wide.
    """
    wide, high = plotting.drawn_size(grid)
    # Ratio of a map's height to its width up to which two maps stand above each other.
    columns = 1 if high <= 0.9 * wide else 2
    rows = 2 // columns
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
        for grid in (made.setting.grid, made.grid)
    ]
    title = f"{made.setting.grid.name or 'map'}: {len(made)} x {made.setting.kind.title}"
    said = [title, verification.verdict if verification else "not verified by drives"]
    said.append(f"with {made.setting.robot.title}")
    figure, part, maps, plots = _panels(grids[0], said, 2 if verification else 1)
    profiles = list(verification.profiles.values()) if verification else []
    _draw_maps(part, maps, grids, made, profiles)
    _draw_gains(plots[0], made)
    if verification:
        _draw_errors(plots[1], verification)
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
    _draw_numbers(axes[1], made)


def _draw_numbers(axes: Axes, made: Landmarks) -> None:
    """Draw the landmarks' numbers beside them, away from the nearest route."""
    from scipy.spatial import cKDTree

    routes = made.setting.routes.values()
    points = np.concatenate([path.resampled(0.1).xy for path in routes])
    near = cKDTree(points)
    for number, at in enumerate(made.positions, 1):
        away = at - points[near.query(at)[1]]
        aside = 17 * away / (float(np.hypot(*away)) or 1.0)
        plotting.draw_number(
            axes, number, tuple(at.tolist()), tuple(aside.tolist()), style.VERMILION
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
    axes.set(xlabel="number of landmarks", ylabel=EXPECTED.heading)


def _draw_errors(axes: Axes, verification: Verification) -> None:
    """Draw the error of drives along the first route, before and after."""
    routes = verification.profiles
    name, pair = next(iter(routes.items()))
    styles = ("before", style.BLUE, "--"), ("after", style.VERMILION, "-")
    for drives, (label, colour, line) in zip(pair, styles, strict=True):
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
    of_route = f" of {name}" if len(routes) > 1 else ""
    axes.set(
        xlabel=f"distance along the route{of_route} [m]", ylabel="position error of drives [m]"
    )
    axes.set_title("mean, and where 80 % of the drives are", fontsize="small", loc="left")
    axes.legend(fontsize="small", frameon=False)
