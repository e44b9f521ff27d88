"""Figure of a choice: the candidates over the map, and the error along each of them."""

from __future__ import annotations

import itertools
import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from locplan._util.formats import in_metres
from locplan.costs import Path
from locplan.plotting import (
    Picture,
    draw_ends,
    draw_inset,
    draw_map,
    draw_path,
    end_handles,
    label_plainly,
    map_around,
    map_size,
)
from locplan.simulation._drives import LOST
from locplan.simulation._figures import ERROR_COLOURS, MIN_ERROR
from locplan.simulation.choice._choice import Choice

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = ("black", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "0.55")
"""Colours of the candidates in turn; their numbers tell apart those of one colour."""
WIDTH = 8.6
"""Least width of the figure [inch]."""
NUMBER_SIZE = 0.035
"""Least distance between the numbers of two paths, as a share of the paths' extent."""
PANELS = 3
"""Greatest number of panels side by side."""


def choice_figure(choice: Choice) -> Figure:
    """Candidates over the map, coloured by the mean error there, and the error along each.

    Parameters
    ----------
    choice : Choice
        The choice; without a path only its ends are shown.
    """
    paths = [each.path for each in choice.candidates]
    ends = Path(np.array([choice.start[:2], choice.goal[:2]]))
    shown = [*paths, ends]
    grid = map_around(choice.costs.grid, shown)
    width, height = map_size(grid)
    width = max(width, WIDTH)
    columns = 2 if len(paths) in (2, 4) else min(PANELS, max(1, len(paths)))
    rows = -(-len(paths) // columns)
    below = 1.75 * rows + 0.4 if rows else 0
    figure = Picture(figsize=(width, height + below + 1.0), layout="constrained")
    title = _wrapped(_titles(choice), width)
    figure.suptitle(title, fontsize="medium")
    if not rows:
        upper = figure.subplots()
        draw_map(upper, grid)
        draw_inset(upper, choice.costs.grid, grid, shown)
        draw_ends(upper, choice.start, choice.goal)
        return figure
    parts: Any = figure.subfigures(2, height_ratios=(height + 0.3, below))
    upper = parts[0].subplots()
    draw_map(upper, grid)
    draw_inset(upper, choice.costs.grid, grid, shown)
    panels = parts[1].subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    _draw_candidates(parts[0], upper, choice)
    for n, axes in enumerate(panels.flat):
        if n < len(paths):
            _draw_errors(axes, choice, n, width / columns)
        else:
            axes.set_axis_off()
    first = panels.flat[0]
    first.set_yscale("log")
    first.set_ylim(bottom=max(MIN_ERROR / 2, first.get_ylim()[0]))
    label_plainly(first.yaxis, 4)
    at = "axes fraction", "data"
    style = {"ha": "right", "va": "top", "fontsize": "small"}
    first.annotate("lost", (1, LOST), (-5, -2), at, "offset points", **style)
    parts[1].supxlabel("distance along the path [m]", fontsize="medium")
    parts[1].supylabel("position error [m]", fontsize="medium")
    return figure


def _titles(choice: Choice) -> list[str]:
    name = choice.costs.grid.name or "map"
    if choice.chosen is None:
        return [f"{name}: {choice.why}"]
    settings = f"with {choice.robot.title}", choice.driven
    return [
        f"{name}: {choice.sentence}",
        "; ".join(filter(None, settings)),
        "below: mean error of the position, where 80 % of drives are, and (grey) the shortest's",
    ]


def _draw_candidates(figure: Any, axes: Axes, choice: Choice) -> None:
    """Draw the paths with the mean error there and their numbers, the chosen one last and bold."""
    profiles = [each.drives.profile() for each in choice.candidates]
    every = np.concatenate([profile[:, 4] for profile in profiles])
    low = max(MIN_ERROR, float(every.min()))
    norm = LogNorm(low, max(float(every.max()), 2 * low), clip=True)
    image = None
    for n in sorted(range(len(profiles)), key=lambda n: (n == choice.best, n == 0)):
        xy, mean, bold = profiles[n][:, 1:3], profiles[n][:, 4], n == choice.best
        colour = COLOURS[n % len(COLOURS)]
        width = 8.0 if bold else 4.5
        path = choice.candidates[n].path
        draw_path(axes, path, color=colour, linewidth=width, path_effects=[], zorder=3)
        lines = LineCollection(
            list(np.stack([xy[:-1], xy[1:]], axis=1)),
            array=mean[:-1],
            cmap=ERROR_COLOURS,
            norm=norm,
            linewidths=5.0 if bold else 2.2,
            zorder=3,
        )
        image = axes.add_collection(lines)
    assert image is not None
    bar = figure.colorbar(image, ax=axes, label="mean position error [m]", shrink=0.9)
    label_plainly(bar.ax.yaxis)
    draw_ends(axes, choice.start, choice.goal)
    paths = [each.path.resampled(0.25).xy for each in choice.candidates]
    for n, (x, y) in enumerate(places_of_numbers(paths)):
        bold = n == choice.best
        box: dict[str, Any] = {"boxstyle": "circle,pad=0.2", "facecolor": "white"}
        box |= {"edgecolor": COLOURS[n % len(COLOURS)], "linewidth": 2.5 if bold else 1.2}
        style: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 8, "zorder": 5}
        axes.text(x, y, str(n + 1), weight="bold" if bold else "normal", bbox=box, **style)
    figure.legend(handles=end_handles(), loc="outside lower center", frameon=False, ncols=2)


def places_of_numbers(paths: list[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
    """Point of each path that lies farthest from the other paths, and from the numbers before."""
    from scipy.spatial import cKDTree

    size = NUMBER_SIZE * float(np.ptp(np.concatenate(paths), axis=0).max())
    taken = [paths[0][0], paths[0][-1]]
    for n, path in enumerate(paths):
        others = [each for m, each in enumerate(paths) if m != n]
        apart = cKDTree(np.concatenate(others)).query(path)[0] if others else np.ones(len(path))
        room = cKDTree(np.array(taken)).query(path)[0]
        apart = np.where(room >= size, apart, -1.0) if (room >= size).any() else room
        # Where a stretch is equally far, its middle.
        best = np.flatnonzero(apart >= 0.9 * apart.max())
        taken.append(path[best[len(best) // 2]])
    return taken[2:]


def _draw_errors(axes: Axes, choice: Choice, n: int, width: float) -> None:
    """Draw the error along a candidate, above it its name, length, error and lost drives."""
    each, bold = choice.candidates[n], n == choice.best
    colour = COLOURS[n % len(COLOURS)]
    profile = each.drives.profile()
    distance, mean, low, high = profile[:, [0, 4, 6, 7]].T
    axes.axhline(LOST, color="0.6", linewidth=0.8, zorder=0)
    if n:
        first = choice.candidates[0].drives.profile()
        axes.plot(first[:, 0], first[:, 4], color="0.7", linewidth=1.0, zorder=1)
    axes.fill_between(distance, low, high, color=colour, alpha=0.2, linewidth=0)
    axes.plot(distance, mean, color=colour, linewidth=2.4 if bold else 1.6)
    axes.margins(x=0.01)
    extra = f" ({each.path.length - choice.candidates[0].path.length:+.1f})" if n else ""
    said = f"{n + 1}: {each.name}{', chosen' if bold else ''}"
    most = int(13.0 * width)
    said = said if len(said) <= most else f"{said[: most - 3]}..."
    lost = each.drives.lost_rate.value
    error = in_metres(each.typical_rmse)
    text = f"{each.path.length:.1f} m{extra}, error {error}, lost {lost:.0%}"
    weight = "bold" if bold else "normal"
    axes.set_title(f"{said}\n{text}", fontsize="small", loc="left", weight=weight)
    for spine in axes.spines.values():
        spine.set_linewidth(2.0 if bold else 0.8)


def _wrapped(lines: list[str], width: float) -> str:
    """Lines that fit into a width [inch] in letters of medium size."""
    most = int(12.5 * width)
    return "\n".join(itertools.chain(*(textwrap.wrap(line, most) or [""] for line in lines)))
