"""Figures of maps, and helpers to draw maps on given Axes."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, Normalize, to_rgba_array
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path as Outline
from matplotlib.transforms import Affine2D
from numpy.typing import NDArray

from locplan._support import drawing as styles
from locplan._support.drawing import CellImage, NotebookFigure
from locplan._support.kernels.arrays import Floats, Octets
from locplan.maps.grid import OccupancyGrid
from locplan.maps.map_faults import MapFaults
from locplan.maps.occupancy import UNKNOWN
from locplan.maps.zones import KINDS, ZoneKind, Zones

MAX_DRAWN_CELLS = 2000
"""Maximum number of cells along a side to draw one by one; larger maps are drawn in blocks."""


def draw_cells(
    axes: Axes,
    grid: OccupancyGrid,
    values: NDArray[Any],
    *,
    cmap: Colormap | None = None,
    norm: Normalize | None = None,
    vmin: float | None = None,
    vmax: float | None = None,
) -> AxesImage:
    """Draw values of a map's cells, or of blocks of them, in world coordinates.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        The Axes to draw on, in world coordinates [m].
    grid : OccupancyGrid
        The map.
    values : (H, W) array
        The values of all cells, row 0 at the lowest y, or of the blocks that a map with more than
        `MAX_DRAWN_CELLS` cells along a side is drawn in.
    cmap : matplotlib.colors.Colormap, optional
        Colours of values that are not colours themselves.
    norm : matplotlib.colors.Normalize, optional
        Scale of the colours; linear by default.
    vmin, vmax : float, optional
        Values at the ends of a linear scale; by default the least and the greatest value.

    Returns
    -------
    matplotlib.image.AxesImage
        The image, for a colour bar.
    """
    cells = compute_block_size(grid.shape) if values.shape[:2] != grid.shape else 1
    height, width = (size * cells * grid.resolution for size in values.shape[:2])
    x, y, yaw = grid.origin
    image = CellImage(
        axes,
        origin="lower",
        extent=(0, width, 0, height),
        interpolation="antialiased" if values.dtype == np.uint8 else "nearest",
        cmap=cmap,
        norm=norm,
    )
    image.set_data(values)
    if vmin is None and vmax is None:
        image.autoscale_None()
    else:
        image.set_clim(vmin, vmax)
    image.set_clip_path(axes.patch)
    axes.add_image(image)
    image.set_transform(Affine2D().rotate(yaw).translate(x, y) + axes.transData)
    return image


def downsample(
    values: NDArray[Any], *, maximum: bool = False, max_blocks: int | None = None
) -> NDArray[Any]:
    """Return the minimum or the maximum of each block of cells; small maps stay as they are.

    The minimum keeps walls, because their level is the lowest. A block is NaN only if all its cells
    are.

    Parameters
    ----------
    values : (H, W) array
        Levels or values of cells.
    maximum : bool, default False
        True takes the greatest value of each block.
    max_blocks : int, optional
        Maximum number of blocks along a side; `MAX_DRAWN_CELLS` by default.
    """
    cells = compute_block_size(values.shape, max_blocks)
    if cells == 1:
        return values
    pick = np.fmax if maximum else np.fmin
    starts = [np.arange(0, size, cells) for size in values.shape]
    return np.asarray(pick.reduceat(pick.reduceat(values, starts[0], axis=0), starts[1], axis=1))


def downsample_map(grid: OccupancyGrid, max_blocks: int) -> OccupancyGrid:
    """Return the map of the blocks of `downsample`, at most `max_blocks` along a side.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    max_blocks : int
        Maximum number of blocks along a side; a map with fewer cells stays as it is.
    """
    cells, resolution = (
        downsample(grid.cells, max_blocks=max_blocks),
        grid.resolution * compute_block_size(grid.shape, max_blocks),
    )
    return dataclasses.replace(grid, cells=cells, resolution=resolution)


def compute_block_size(shape: tuple[int, ...], max_blocks: int | None = None) -> int:
    """Return the edge of the blocks of a large map's drawing [cells]."""
    return math.ceil(max(shape[:2]) / (max_blocks or MAX_DRAWN_CELLS))


def find_known_extent(grid: OccupancyGrid) -> tuple[int, int, int, int]:
    """Return first row, end of the rows, first column and end of the columns with known cells."""
    is_known = grid.cells != UNKNOWN
    if not is_known.any():
        return 0, grid.shape[0], 0, grid.shape[1]
    rows, cols = (np.flatnonzero(is_known.any(axis=axis)) for axis in (1, 0))
    return int(rows[0]), int(rows[-1]) + 1, int(cols[0]), int(cols[-1]) + 1


class AxesLimits(NamedTuple):
    """Limits of Axes in world coordinates, (low, high) each [m]."""

    xlim: tuple[float, float]
    ylim: tuple[float, float]


def compute_axes_limits(grid: OccupancyGrid, *, share: float = 0.02) -> AxesLimits:
    """Return the limits of Axes around the known cells, with a margin."""
    low, high, left, right = find_known_extent(grid)
    x, y = grid.grid_to_world(np.array([low, low, high, high]), np.array([left, right] * 2))
    margin = share * max(np.ptp(x), np.ptp(y)) + (grid.resolution if share else 0.0)
    return AxesLimits(
        xlim=(float(x.min() - margin), float(x.max() + margin)),
        ylim=(float(y.min() - margin), float(y.max() + margin)),
    )


def make_map_axes(grid: OccupancyGrid) -> tuple[NotebookFigure, Axes]:
    """Make an empty figure for one map.

    Parameters
    ----------
    grid : OccupancyGrid
        The map, whose known part gives the size.

    Returns
    -------
    figure : Picture
        The figure.
    axes : matplotlib.axes.Axes
        Its only Axes.
    """
    figure = NotebookFigure(figsize=compute_figure_size(grid), layout="constrained")
    return figure, figure.add_subplot()


def compute_figure_size(grid: OccupancyGrid) -> tuple[float, float]:
    """Return the size of a figure of the known part of a map with a colour bar next to it.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.

    Returns
    -------
    (width, height)
        The size of the figure [inch].
    """
    width, height = compute_drawing_size(grid)
    return max(width, 5.0) + 1.6, max(height, 2.0) + 0.8


def compute_drawing_size(grid: OccupancyGrid) -> tuple[float, float]:
    """Return the size of the drawing of a map's known part.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.

    Returns
    -------
    (width, height)
        The size without margins [inch], at most 7.6 each.
    """
    low, high, left, right = find_known_extent(grid)
    height, width = high - low, right - left
    cos, sin = abs(np.cos(grid.origin[2])), abs(np.sin(grid.origin[2]))
    height, width = sin * width + cos * height, cos * width + sin * height
    width_inches = min(7.6, 7.6 * width / height)
    return width_inches, width_inches * height / width


class Polyline(Protocol):
    """A path; only its positions are read here."""

    @property
    def xy(self) -> Floats:
        """World positions (n, 2) [m]."""


def crop_map(grid: OccupancyGrid, paths: Sequence[Polyline]) -> OccupancyGrid:
    """Return the part of a map around some paths.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    paths : sequence of locplan.Path
        The paths, one at least.

    Returns
    -------
    OccupancyGrid
        The part with a margin, cut off at the edge of the map; the whole map if all paths are
        outside it.
    """
    at = np.concatenate([path.xy for path in paths])
    rows, cols = grid.world_to_grid(*at.T)
    margin = max(0.15 * np.ptp(rows), 0.15 * np.ptp(cols), 3.0 / grid.resolution)  # 3 m at least
    down, across = (
        slice(max(0, int(values.min() - margin)), min(size, int(values.max() + margin) + 1))
        for values, size in zip((rows, cols), grid.shape, strict=True)
    )
    is_off_map = down.start >= down.stop or across.start >= across.stop
    return grid if is_off_map else grid.crop(down, across)


def zoom_map(grid: OccupancyGrid, paths: Sequence[Polyline]) -> OccupancyGrid:
    """Return the part of a map around some paths, if it is small.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    paths : sequence of locplan.Path
        The paths; without any the map stays whole.

    Returns
    -------
    OccupancyGrid
        The result of `crop_map` if it is below 0.6 of the map's extent, otherwise the map.
    """
    part = crop_map(grid, paths) if paths else grid
    return part if is_small_part(grid, part) else grid


def is_small_part(grid: OccupancyGrid, part: OccupancyGrid) -> bool:
    """True if a part is too small to be visible in a picture of the whole map."""
    ends = map(find_known_extent, (part, grid))
    part_size, grid_size = (max(high - low, right - left) for low, high, left, right in ends)
    return part_size < 0.6 * grid_size


def map_figure(grid: OccupancyGrid) -> Figure:
    """Draw the map alone: walls black, unknown space grey, free space white.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    """
    figure, axes = make_map_axes(grid)
    draw_map(axes, grid)
    axes.set_title(grid.name or "map", fontsize="medium")
    return figure


def draw_map(axes: Axes, grid: OccupancyGrid) -> None:
    """Draw the map in world coordinates: walls black, unknown space grey, free space white.

    The inside of thick walls is also grey; only their rim is black.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        The Axes to draw on; its limits are set to the extent of the map [m].
    grid : OccupancyGrid
        The map.
    """
    draw_cells(axes, grid, compute_shades(grid), cmap=styles.MAP_COLOURS, vmin=0, vmax=3)
    limits = compute_axes_limits(grid)
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", xlim=limits.xlim, ylim=limits.ylim)


def draw_zones(axes: Axes, zones: Zones, grid: OccupancyGrid) -> list[Patch]:
    """Draw the zones that overlap a map: no-go zones hatched, the rest as outlines.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        The Axes to draw on, in world coordinates [m].
    zones : Zones
        The zones; without any nothing is drawn.
    grid : OccupancyGrid
        The map, or the part of it that is drawn.

    Returns
    -------
    list of matplotlib.patches.Patch
        Entries of a legend, one for each kind.
    """
    visible_map, handles = downsample_map(grid, MAX_DRAWN_CELLS) if zones else grid, []
    for kind in KINDS:
        if not zones.cells(visible_map, kind).any():
            continue
        rings = [
            Outline([*ring, ring[0]], closed=True)
            for ring in _find_zone_outlines(zones, kind, visible_map)
        ]
        style, label = styles.ZONE_STYLES[kind], {"prefer": "preferred"}.get(kind, kind)
        around = styles.make_white_outline(style["linewidth"] + 1.6) if kind != "no-go" else []
        outlines = Outline.make_compound_path(*rings)
        axes.add_patch(PathPatch(outlines, path_effects=around, **style))
        handles.append(Patch(label=f"{label} zone", **style))
    return handles


def _find_zone_outlines(zones: Zones, kind: ZoneKind, grid: OccupancyGrid) -> list[Floats]:
    """Return the outlines of the zones of a kind; no-go zones, often many, are joined."""
    if kind != "no-go":
        return [zone.polygon for zone in zones if zone.kind == kind]
    import cv2

    # An outline passes through the middles of pixels: with two a cell, it is near the cell's edge.
    pixels = zones.cells(grid, kind).astype(np.uint8).repeat(2, axis=0).repeat(2, axis=1)
    contours, _ = cv2.findContours(pixels, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    corners = [(contour[:, 0, ::-1] + 0.5) / 2 for contour in contours]
    return [np.column_stack(grid.grid_to_world(*ring.T)) for ring in corners]


def compute_shades(grid: OccupancyGrid) -> Octets:
    """Return the index into `MAP_COLOURS` of each cell or block; 0 is a wall, or a thick wall's
    rim.
    """
    import cv2

    levels = np.asarray(downsample(grid.cells) // UNKNOWN)
    deep = max(3, round(0.006 * max(levels.shape)))
    around = np.ones((2 * deep + 1, 2 * deep + 1), np.uint8)
    levels[cv2.erode((levels == 0).astype(np.uint8), around) == 1] = 3
    return levels


def faults_figure(faults: MapFaults) -> Figure:
    """Draw the map with the cells of its faults in colour, and the faults' kinds.

    Parameters
    ----------
    faults : MapFaults
        The result of `locplan.maps.faults`.
    """
    figure, axes = make_map_axes(faults.grid)
    draw_map(axes, faults.grid)
    tints = to_rgba_array(["black", styles.VERMILION], [0.0, 0.8])
    colours = np.round(255 * tints).astype(np.uint8)
    draw_cells(axes, faults.grid, colours[downsample(faults.cells.astype(np.uint8))])
    kinds = ", ".join(dict.fromkeys(fault.kind for fault in faults)) or "no fault"
    axes.set_title(f"{faults.grid.name or 'map'}: {kinds}", fontsize="medium")
    return figure
