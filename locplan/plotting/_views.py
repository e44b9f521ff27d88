"""The part of a map that a picture shows: all of it, or what lies around some paths."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from locplan.costs import Path
from locplan.maps import OccupancyGrid
from locplan.plotting._cells import block, shrunk
from locplan.plotting._maps import draw_map, known_cells, limits_of
from locplan.plotting.style import LIGHT_MAP_COLOURS, VERMILION

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def map_around(grid: OccupancyGrid, paths: Sequence[Path]) -> OccupancyGrid:
    """Cut the part of a map around some paths out of it.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    paths : sequence of Path
        The paths, one at least.

    Returns
    -------
    OccupancyGrid
        The part, with a margin as far as the map reaches; the map itself where all paths are
        beside it.
    """
    at = np.concatenate([path.xy for path in paths])
    rows, cols = grid.world_to_grid(*at.T)
    extent = max(float(np.ptp(rows)), float(np.ptp(cols)))
    margin = max(0.15 * extent, 3.0 / grid.resolution)  # 3 m at least
    ends = [
        (max(0, int(values.min() - margin)), min(size, int(values.max() + margin) + 1))
        for values, size in zip((rows, cols), grid.shape, strict=True)
    ]
    (top, bottom), (left, right) = ends
    if top >= bottom or left >= right:  # the paths are beside the map
        return grid
    return grid.part(slice(top, bottom), slice(left, right))


def zoomed_to(grid: OccupancyGrid, paths: Sequence[Path]) -> OccupancyGrid:
    """Cut the part of a map around some paths out of it, where that is small.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    paths : sequence of Path
        The paths; without any the map stays whole.

    Returns
    -------
    OccupancyGrid
        The part as `map_around` has it if it is below 0.6 of the map's extent, else the map.
    """
    part = map_around(grid, paths) if paths else grid
    return part if is_small(grid, part) else grid


def is_small(grid: OccupancyGrid, part: OccupancyGrid) -> bool:
    """Whether a part is so small that a picture of the map would hardly show what is in it."""
    sizes = []
    for each in (part, grid):
        low, high, left, right = known_cells(each)
        sizes.append(max(high - low, right - left))
    return sizes[0] < 0.6 * sizes[1]


def cut(values: NDArray[np.float64], grid: OccupancyGrid, part: OccupancyGrid) -> Any:
    """Values of the cells of a part, from those of all the map's cells."""
    top, left = np.round(grid.world_to_grid(*part.origin[:2])).astype(int).tolist()
    height, width = part.shape
    return values[top : top + height, left : left + width]


def draw_inset(axes: Axes, grid: OccupancyGrid, part: OccupancyGrid, paths: Sequence[Path]) -> None:
    """Show in a corner without paths where a small part lies on its map, if it is small.

    The part is drawn without a margin, since the map goes on there.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        The Axes on which the part was drawn.
    grid, part : OccupancyGrid
        The map, and the part of it that was drawn.
    paths : sequence of Path
        The paths that the inset must not cover, one at least.
    """
    if part.shape != grid.shape:
        axes.set(**limits_of(part, share=0.0))
    if not is_small(grid, part):
        return
    points = [path.resampled(0.5, even=True).xy for path in paths]
    size = _size(axes, grid)
    inset = axes.inset_axes((*_free_corner(axes, np.concatenate(points), size), *size))
    cells = shrunk(grid.cells, most=300)
    size_of_cell = grid.resolution * block(grid.shape, 300)
    draw_map(inset, dataclasses.replace(grid, cells=cells, resolution=size_of_cell))
    inset.images[0].set_cmap(LIGHT_MAP_COLOURS)
    inset.set(xlabel="", ylabel="", xticks=(), yticks=(), zorder=6, **limits_of(grid))
    height, width = part.shape
    x, y = part.grid_to_world(np.array([0, 0, height, height]), np.array([0, width, width, 0]))
    corners = np.stack([x, y], axis=1)
    inset.add_patch(Polygon(corners, fill=False, edgecolor=VERMILION, linewidth=2.2, zorder=5))
    if max(part.shape) < 0.06 * max(grid.shape):  # its outline is hard to see
        inset.plot(*corners.mean(axis=0), "o", color=VERMILION, markersize=5, zorder=5)


def _size(axes: Axes, grid: OccupancyGrid) -> tuple[float, float]:
    """Width and height of an inset that shows a map, as shares of those of the Axes."""
    across, along = (
        float(np.ptp(own) / np.ptp(all_of_it))
        for own, all_of_it in zip(
            limits_of(grid).values(), (axes.get_xlim(), axes.get_ylim()), strict=True
        )
    )
    scale = 0.3 / max(across, along)
    return across * scale, along * scale


def _free_corner(
    axes: Axes, xy: NDArray[np.float64], size: tuple[float, float]
) -> tuple[float, float]:
    """Lower left end, in shares of the Axes, of the inset in the corner with fewest points."""
    low, high = np.transpose([axes.get_xlim(), axes.get_ylim()])
    at = (xy - low) / (high - low)
    gap = 0.015
    far = 1 - np.array(size) - gap
    corners = [(gap, far[1]), (far[0], far[1]), (far[0], gap), (gap, gap)]
    near = gap + 0.03

    def count(corner: tuple[float, float]) -> int:
        inside = (at > np.array(corner) - near) & (at < np.array(corner) + size + near)
        return int(inside.all(axis=1).sum())

    x, y = min(corners, key=count)
    return float(x), float(y)
