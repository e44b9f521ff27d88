"""Figure of key features: the map with what is lost without each, and the deviation on the way."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.collections import PathCollection
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from locplan._util.poses import way_along
from locplan.landmarks._features import MATTERS_M, KeyFeatures
from locplan.landmarks._figures import along_first, draw_errors, draw_numbers, panels
from locplan.landmarks._outcomes import FeatureDrives
from locplan.maps import OccupancyGrid
from locplan.plotting import (
    DRAWN_CELLS,
    draw_cells,
    draw_ends,
    draw_map,
    draw_path,
    map_around,
    style,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LOSS_COLOURS = ListedColormap(colormaps["plasma_r"](np.linspace(0.08, 0.85, 256)))
"""Colours of the losses: the darker, the more; none as light as the floor."""
NUMBERED = 8
"""Maximum number of features with their number beside them."""


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
    axes.images[0].set_cmap(style.PALE_MAP_COLOURS)
    for path in found.routes.values():
        draw_path(axes, path, color="0.35", linewidth=1.5)
        draw_ends(axes, path.xy[0], path.xy[-1])
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
        # Least area of the mark of a cell that loses something [points^2].
        size = 9.0 * (0.3 + 0.7 * min(max(loss / most, 0.0), 1.0))
        x, y = at.T
        marks = axes.scatter(
            x, y, size, np.full(len(at), loss), cmap=LOSS_COLOURS, norm=norm, marker="s",
            linewidths=0, zorder=3,
        )  # fmt: skip
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
    few = len(found.together)
    labels = ["with all features", "without 1"]
    if few > 1:
        labels.append("without " + _listed(found.together))
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
