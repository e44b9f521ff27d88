"""Figure of key features: the map with what is lost without each, and the deviation on the way."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.collections import PathCollection
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from locplan.landmarks._empty_figures import panels
from locplan.landmarks._feature_drives import FeatureDrives
from locplan.landmarks._features import MATTERS_M, Feature, KeyFeatures
from locplan.landmarks._figures import MIN_ERROR, _plainly
from locplan.maps import OccupancyGrid
from locplan.plotting import DRAWN_CELLS, draw_cells, draw_ends, draw_map, draw_path, map_around
from locplan.simulation import LOST

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LOSS_COLOURS = ListedColormap(colormaps["plasma_r"](np.linspace(0.08, 0.85, 256)))
"""Colours of the losses: the darker, the more; none as light as the floor."""
PALE = ListedColormap(["0.72", "0.92", "white", "0.72"])
"""Colours as in `locplan.plotting.MAP_COLOURS`, paler than those of the features."""
ALL, FIRST, FEW = "black", "#d55e00", "#0072b2"
NUMBERED = 8
"""Greatest number of features with their number beside them."""
MARK = 9.0
"""Least area of the mark of a cell that loses something [points^2]."""


def key_features_figure(found: KeyFeatures, drives: FeatureDrives | None = None) -> Figure:
    """Map with the loss by each feature, and the expected deviation along the first route.

    Parameters
    ----------
    found : KeyFeatures
        The features, as `key_features` returns them.
    drives : FeatureDrives, optional
        Drives of `KeyFeatures.verify`; with them their mean error along the first route is drawn.
    """
    grid = map_around(found.grid, list(found.routes.values()))
    said = [f"{found.grid.name or 'map'}: {found.verdict}"]
    said.append(drives.verdict if drives else "not verified by drives")
    said.append(f"with {found.robot.title}")
    figure, part, (axes,), plots = panels(grid, said, 1, 2)
    draw_map(axes, grid)
    axes.images[0].set_cmap(PALE)
    for path in found.routes.values():
        draw_path(axes, path, color="0.35", linewidth=1.5)
        draw_ends(axes, path.xy[0], path.xy[-1])
    if found.features:
        axes.set_autoscale_on(False)  # features may lie beyond what is drawn
        _draw_losses(part, axes, found, grid)
    _draw_profiles(plots[0], found)
    if drives:
        _draw_errors(plots[1], found, drives)
    else:
        _draw_curve(plots[1], found)
    return figure


def _draw_losses(figure: Any, axes: Axes, found: KeyFeatures, part: OccupancyGrid) -> None:
    """Draw the cells of each feature in the colour of its loss, and the numbers of the first."""
    losses = np.array([100 * each.loss for each in found.features])
    most = max(float(losses.max()), 100 * MATTERS_M)
    norm = Normalize(0, most, clip=True)
    if max(part.shape) <= DRAWN_CELLS:  # marks are smaller than the cells of small maps
        of_cells = np.full(found.grid.shape, np.nan)
        for each in found.features:
            of_cells[tuple(each.cells.T)] = 100 * each.loss
        x, y = part.grid_to_world(0.5, 0.5)
        row, col = found.grid.world_to_cell(float(x), float(y))
        of_part = of_cells[row : row + part.shape[0], col : col + part.shape[1]]
        draw_cells(axes, part, of_part, cmap=LOSS_COLOURS, norm=norm)
    marks: PathCollection | None = None
    for each in reversed(found.features):
        at = np.column_stack(found.grid.grid_to_world(*(each.cells.T + 0.5)))
        loss = 100 * each.loss
        size = MARK * (0.3 + 0.7 * min(max(loss / most, 0.0), 1.0))
        x, y = at.T
        marks = axes.scatter(
            x, y, size, np.full(len(at), loss), cmap=LOSS_COLOURS, norm=norm, marker="s",
            linewidths=0, zorder=3,
        )  # fmt: skip
    bar = figure.colorbar(marks, ax=axes, shrink=0.9)
    bar.set_label("rise of the expected deviation without it [cm]")
    low, high, bottom, top = *axes.get_xlim(), *axes.get_ylim()
    named = list(dict.fromkeys([*found.together, *range(1, NUMBERED + 1)]))
    for number in named[: max(NUMBERED, len(found.together))]:
        if number > len(found.features):
            continue
        feature = found.features[number - 1]
        if not (low <= feature.x <= high and bottom <= feature.y <= top):
            continue
        few = number in found.together
        box = {"boxstyle": "circle,pad=0.15", "facecolor": "white"}
        box["edgecolor"] = FEW if few else "0.4"
        style: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 7, "zorder": 5}
        style["fontweight"] = "bold" if few else "normal"
        arrow = {"arrowstyle": "-", "color": box["edgecolor"], "linewidth": 0.8}
        arrow |= {"shrinkA": 0, "shrinkB": 0}
        axes.annotate(
            str(number),
            (feature.x, feature.y),
            _beside(found, feature),
            textcoords="offset points",
            bbox=box,
            arrowprops=arrow,
            **style,
        )


def _beside(found: KeyFeatures, feature: Feature) -> tuple[float, float]:
    """Where the number of a feature stands from it, away from the nearest route [points]."""
    away = np.array([feature.x, feature.y]) - found.positions
    nearest = away[int(np.argmin(np.hypot(*away.T)))]
    length = float(np.hypot(*nearest)) or 1.0
    return float(18 * nearest[0] / length), float(18 * nearest[1] / length)


def _way(found: KeyFeatures) -> tuple[slice, NDArray[np.float64]]:
    """The first route's part of the poses, and the distance along it [m]."""
    part = slice(found.begins[0], found.begins[1])
    steps = np.hypot(*np.diff(found.positions[part], axis=0).T)
    return part, np.concatenate([[0.0], np.cumsum(steps)])


def _draw_profiles(axes: Axes, found: KeyFeatures) -> None:
    """Draw the expected deviation along the first route, with and without the features."""
    part, way = _way(found)
    few = len(found.together)
    labels = ["with all features", "without 1"]
    if few > 1:
        labels.append("without " + _listed(found.together))
    for values, label, colour, style in zip(
        np.sqrt(found.profiles), labels, (ALL, FIRST, FEW), ("-", "--", "-."), strict=False
    ):
        axes.plot(way, values[part], style, color=colour, label=label)
    names = list(found.routes)
    many = f" of {names[0]}" if len(names) > 1 else ""
    axes.set(xlabel=f"distance along the route{many} [m]", ylabel="expected deviation [m]")
    axes.set_ylim(bottom=0)
    axes.legend(fontsize="small", frameon=False)


def _draw_curve(axes: Axes, found: KeyFeatures) -> None:
    """Draw the expected deviation over the number of features that are away."""
    axes.plot(np.arange(len(found.curve)), found.deviations, "o-", color=FEW, markersize=4)
    for n, number in enumerate(found.together, 1):
        at = n, float(found.deviations[n])
        axes.annotate(f"without {number}", at, (0, -9), textcoords="offset points", ha="center",
                      va="top", fontsize=7)  # fmt: skip
    axes.set_ylim(0, 1.1 * float(found.deviations.max()))
    axes.set_xlim(-0.3, len(found.curve) - 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="number of features that are away", ylabel="expected deviation [m]")


def _draw_errors(axes: Axes, found: KeyFeatures, drives: FeatureDrives) -> None:
    """Draw the mean error of the drives along the first route, with and without the few."""
    name, pair = next(iter(drives.profiles.items()))
    for each, colour, label, style in zip(
        pair, (ALL, FEW), ("with all", "without " + _listed(found.together)), ("-", "-."),
        strict=True,
    ):  # fmt: skip
        profile = each.profile()
        axes.fill_between(
            profile[:, 0], profile[:, 6], profile[:, 7], color=colour, alpha=0.15, linewidth=0
        )
        axes.plot(profile[:, 0], profile[:, 4], style, color=colour, label=label)
    if axes.get_ylim()[1] > LOST / 2:
        axes.axhline(LOST, color="0.6", linewidth=0.8, zorder=0)
        note = "axes fraction", "data"
        axes.annotate("lost", (1, LOST), (-5, -2), note, "offset points", ha="right", va="top",
                      fontsize=8)  # fmt: skip
    axes.set_yscale("log")
    axes.set_ylim(bottom=max(MIN_ERROR / 2, axes.get_ylim()[0]))
    _plainly(axes.yaxis)
    many = f" of {name}" if len(drives.profiles) > 1 else ""
    axes.set(xlabel=f"distance along the route{many} [m]", ylabel="position error of drives [m]")
    axes.set_title("mean, and where 80 % of the drives are", fontsize="small", loc="left")
    axes.legend(fontsize="small", frameon=False)


def _listed(numbers: tuple[int, ...]) -> str:
    """Numbers of features, the first of many."""
    return ", ".join(map(str, numbers[:5])) + (", ..." if len(numbers) > 5 else "")
