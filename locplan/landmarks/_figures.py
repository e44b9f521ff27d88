"""Figure of landmarks: before and after, the landmarks numbered, and the gain of each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter
from numpy.typing import NDArray

from locplan.landmarks._empty_figures import panels
from locplan.landmarks._landmarks import PAYING_SHARE, Landmarks
from locplan.landmarks._objects import outline_of
from locplan.landmarks._verification import Verification
from locplan.maps import OccupancyGrid
from locplan.plotting import draw_ends, draw_map, draw_path, map_around
from locplan.simulation import LOST, Drives

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ERROR_COLOURS = "viridis"
MIN_ERROR = 0.02
"""Smallest error with a colour of its own; smaller ones are drawn in the same colour [m]."""
BEFORE, AFTER, MARK, REGION = "#0072b2", "#d55e00", "#d55e00", "#56b4e9"


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
        map_around(grid, list(made.setting.routes.values())) for grid in (made.before, made.grid)
    ]
    title = f"{made.before.name or 'map'}: {len(made)} x {made.setting.kind.title}"
    said = [title, verification.verdict if verification else "not verified by drives"]
    said.append(f"with {made.setting.robot.title}")
    figure, part, maps, plots = panels(grids[0], said, 2, 3 if verification else 1)
    profiles = list(verification.profiles.values()) if verification else []
    _draw_maps(part, maps, grids, made, profiles)
    _draw_gains(plots[0], made)
    if verification:
        _draw_errors(plots[1], verification)
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
    every = [each.profile() for pair in profiles for each in pair]
    errors = np.concatenate([profile[:, 4] for profile in every]) if every else np.ones(1)
    low = max(MIN_ERROR, float(errors.min()))
    norm = LogNorm(low, max(float(errors.max()), 2 * low), clip=True)
    image = None
    for n, (own, grid) in enumerate(zip(axes, grids, strict=True)):
        draw_map(own, grid)
        if made.setting.region is not None:
            _draw_region(own, made)
        own.set_title(("before", "after")[n], fontsize="medium", loc="left")
        own.label_outer()
        for k, path in enumerate(made.setting.routes.values()):
            if profiles:
                profile = profiles[k][n].profile()
                xy = profile[:, 1:3]
                own.plot(*xy.T, color="black", linewidth=5.0, zorder=2)
                lines = LineCollection(
                    list(np.stack([xy[:-1], xy[1:]], axis=1)),
                    array=profile[:-1, 4],
                    cmap=ERROR_COLOURS,
                    norm=norm,
                    linewidths=3.5,
                    zorder=3,
                )
                image = own.add_collection(lines)
            else:
                draw_path(own, path, color="black", linewidth=1.5)
            draw_ends(own, path.xy[0], path.xy[-1])
    if image is not None:
        bar = figure.colorbar(image, ax=list(axes), label="mean position error [m]", shrink=0.9)
        _plainly(bar.ax.yaxis)
    shapes = [outline_of(made.setting.kind, pose) for pose in made.poses]
    axes[1].add_collection(PolyCollection(shapes, facecolor=MARK, edgecolor="black", zorder=4))
    for n, at in enumerate(_beside(made, grids[1])):
        box = {"boxstyle": "circle,pad=0.15", "facecolor": "white", "edgecolor": MARK}
        style: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 7, "zorder": 5}
        arrow = {"arrowstyle": "-", "color": MARK, "linewidth": 0.8, "shrinkA": 0, "shrinkB": 0}
        x, y = made.positions[n].tolist()
        axes[1].annotate(
            str(n + 1), (x, y), at, textcoords="offset points", bbox=box, arrowprops=arrow, **style
        )


def _draw_region(axes: Axes, made: Landmarks) -> None:
    """Outline the region in which the robot may be anywhere."""
    grid = made.setting.grid
    rows, cols = np.indices(grid.shape) + 0.5
    x, y = grid.grid_to_world(rows, cols)
    region = np.asarray(made.setting.region, np.float64)
    axes.contour(x, y, region, levels=[0.5], colors=REGION, linewidths=0.8, zorder=2)


def _beside(made: Landmarks, grid: OccupancyGrid) -> list[tuple[float, float]]:
    """Where the number of each landmark stands from it, away from the nearest route [points]."""
    from scipy.spatial import cKDTree

    points = np.concatenate([path.resampled(0.1).xy for path in made.setting.routes.values()])
    _, nearest = cKDTree(points).query(made.positions)
    places = []
    for away in made.positions - points[nearest]:
        length = float(np.hypot(*away)) or 1.0
        places.append((float(16 * away[0] / length), float(16 * away[1] / length)))
    return places


def _draw_gains(axes: Axes, made: Landmarks) -> None:
    """Draw the expected deviation over the number of landmarks."""
    numbers: NDArray[Any] = np.arange(len(made.curve))
    axes.plot(numbers, made.expected, "o-", color=AFTER, markersize=4)
    if made.expected[-1] > 0 and made.expected[0] > 10 * made.expected[-1]:
        axes.set_yscale("log")
        _plainly(axes.yaxis)
    else:
        axes.set_ylim(0, 1.05 * float(made.expected.max()) or 1.0)
    if 0 < made.paying < len(made):
        axes.axvline(made.paying, color="0.6", linewidth=0.8)
        note = f"further ones: less\nthan {PAYING_SHARE:.0%} each"
        at = "data", "axes fraction"
        axes.annotate(note, (made.paying, 0.97), (4, 0), at, "offset points", va="top", fontsize=8)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="number of landmarks", ylabel=made.measure.title)


def _draw_errors(axes: Axes, verification: Verification) -> None:
    """Draw the error along the first route, before and after."""
    pair = next(iter(verification.profiles.values()))
    for drives, colour, label, style in zip(
        pair, (BEFORE, AFTER), ("before", "after"), ("--", "-"), strict=True
    ):
        profile = drives.profile()
        axes.fill_between(
            profile[:, 0], profile[:, 6], profile[:, 7], color=colour, alpha=0.2, linewidth=0
        )
        axes.plot(profile[:, 0], profile[:, 4], style, color=colour, label=label)
    axes.axhline(LOST, color="0.6", linewidth=0.8, zorder=0)
    axes.set_yscale("log")
    axes.set_ylim(bottom=max(MIN_ERROR / 2, axes.get_ylim()[0]))
    _plainly(axes.yaxis)
    at = "axes fraction", "data"
    axes.annotate(
        "lost", (1, LOST), (-5, -2), at, "offset points", ha="right", va="top", fontsize=8
    )
    axes.set(xlabel=_along(verification), ylabel="position error [m]")
    axes.set_title("mean, and where 80 % of the drives are", fontsize="small", loc="left")
    axes.legend(fontsize="small", frameon=False)


def _draw_matches(axes: Axes, verification: Verification) -> None:
    """Draw the deviation of single matches along the first route, before and after."""
    pair = next(iter(verification.fields.values()))
    for profile, colour, style in zip(pair, (BEFORE, AFTER), ("--", "-"), strict=True):
        axes.plot(*profile.T, style, color=colour)
    axes.set_ylim(bottom=0)
    axes.set(xlabel=_along(verification), ylabel="deviation of a match [m]")
    axes.set_title("one scan alone, by the field", fontsize="small", loc="left")


def _along(verification: Verification) -> str:
    """Label of the distance along the first route."""
    name = next(iter(verification.profiles))
    many = f", {name}" if len(verification.profiles) > 1 else ""
    return f"distance along the route{many} [m]"


def _plainly(axis: Any) -> None:
    """Label a logarithmic axis with plain numbers."""
    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1.0,) if high > 200 * low else (1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
