"""What a picture shows of a map: its cells or blocks of them, all or a part of it, its size."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.image import AxesImage
from matplotlib.transforms import Affine2D, Bbox, IdentityTransform
from numpy.typing import NDArray

from locplan._kernels.arrays import Floats, Octets
from locplan.field import CovarianceField
from locplan.maps import FREE, UNKNOWN, OccupancyGrid
from locplan.plotting._picture import Picture

if TYPE_CHECKING:
    from locplan.costs import Path

DRAWN_CELLS = 2000
"""Most cells along a side that are drawn one by one; beyond, blocks of them are."""


class CellImage(AxesImage):
    """An image of matplotlib that is coloured cell by cell, and then scaled by OpenCV.

    Matplotlib scales four times as many bytes, several times over, in ten times the time.
    """

    def get_window_extent(self, renderer: Any = None) -> Bbox:
        """Bounds of the image in pixels, whichever way the map is turned."""
        x0, x1, y0, y1 = self.get_extent()
        corners = self.get_transform().transform([(x0, y0), (x1, y0), (x0, y1), (x1, y1)])
        return Bbox([corners.min(axis=0), corners.max(axis=0)])

    def make_image(
        self, renderer: Any, magnification: float = 1.0, unsampled: bool = False
    ) -> tuple[Any, float, float, Any]:
        """Scale the image to the pixels of the Axes; matplotlib calls it."""
        import cv2

        colours = self._colours()
        seen = Bbox.intersection(self.get_window_extent(), self.axes.bbox)
        if unsampled or colours is None or seen is None:
            return super().make_image(renderer, magnification, unsampled)
        (left, bottom), (right, top) = magnification * seen.get_points()
        left, bottom = math.floor(left + 0.5), math.ceil(bottom - 0.5)
        size = math.floor(right + 0.5) - left, math.ceil(top - 0.5) - bottom
        if min(size) < 1:
            return None, 0, 0, None
        # From the centre of a pixel to the centre of a cell, both counted from those of the first.
        x0, x1, y0, y1 = self.get_extent()
        height, width = colours.shape[:2]
        to_pixels = (
            Affine2D()
            .translate(0.5, 0.5)
            .scale((x1 - x0) / width, (y1 - y0) / height)
            .translate(x0, y0)
            + self.get_transform()
            + Affine2D().scale(magnification).translate(-left - 0.5, -bottom - 0.5)
        )
        to_cells = to_pixels.inverted().get_matrix()
        nearest = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
        drawn = cv2.warpAffine(colours, to_cells[:2], size, flags=nearest)
        cells_a_pixel = float(np.hypot(*to_cells[0, :2]))
        # Cells of three pixels and more have sharp edges.
        if self.get_interpolation() != "nearest" and cells_a_pixel > 1 / 3:
            cells = round(cells_a_pixel)
            mixed = cv2.blur(colours, (cells, cells)) if cells > 1 else colours
            to_cells[:2, 2] += 0.5 * (cells % 2 == 0)  # a mean of two cells stands at the second
            smooth = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
            around = cv2.BORDER_REPLICATE
            mixed = cv2.warpAffine(mixed, to_cells[:2], size, flags=smooth, borderMode=around)
            # The darker of both: no pixel of a wall is lighter beside a field that has sharp edges.
            drawn[..., :3] = np.minimum(mixed, drawn)[..., :3]
        return drawn, left / magnification, bottom / magnification, IdentityTransform()

    def _colours(self) -> Octets | None:
        """Colours of the cells, (h, w, 4); None where matplotlib is to find them itself."""
        values, (low, high) = self.get_array(), self.get_clim()
        if values is None or values.ndim != 2 or low is None or high is None:
            return None
        if values.dtype == np.uint8:
            every = self.to_rgba(np.arange(256), bytes=True)
            words = every.view(np.uint32)[:, 0][np.ma.getdata(values)]
            return np.asarray(words.view(np.uint8).reshape(*values.shape, 4))
        shares = np.ma.filled(values.astype(np.float32), np.nan)
        if type(self.norm) is LogNorm:
            with np.errstate(divide="ignore", invalid="ignore"):
                np.log(shares, out=shares)
            low, high = math.log(low), math.log(high)
        elif type(self.norm) is not Normalize:
            return None
        shares -= np.float32(low)
        shares *= np.float32(1 / (high - low)) if high > low else np.float32(0)
        return np.asarray(self.cmap(shares, bytes=True))


def draw_cells(axes: Axes, grid: OccupancyGrid, values: NDArray[Any], **options: Any) -> AxesImage:
    """Draw values of a map's cells, or of blocks of them, in world coordinates.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        The Axes to draw on, in world coordinates [m].
    grid : OccupancyGrid
        The map.
    values : (H, W) array
        The values of all cells, row 0 at the lowest y, or of the blocks that a map with more than
        `DRAWN_CELLS` cells along a side is drawn in.
    **options
        Options of ``matplotlib.image.AxesImage`` such as cmap and norm, and vmin and vmax.

    Returns
    -------
    matplotlib.image.AxesImage
        The image, for a colour bar.
    """
    cells = block(grid.shape) if values.shape[:2] != grid.shape else 1
    height, width = (size * cells * grid.resolution for size in values.shape[:2])
    x, y, yaw = grid.origin
    clim = options.pop("vmin", None), options.pop("vmax", None)
    image = CellImage(
        axes,
        origin="lower",
        extent=(0, width, 0, height),
        interpolation="antialiased" if values.dtype == np.uint8 else "nearest",
        **options,
    )
    image.set_data(values)
    image.set_clim(*clim) if clim != (None, None) else image.autoscale_None()
    image.set_clip_path(axes.patch)
    axes.add_image(image)
    image.set_transform(Affine2D().rotate(yaw).translate(x, y) + axes.transData)
    return image


def shrunk(values: NDArray[Any], *, maximum: bool = False, most: int | None = None) -> NDArray[Any]:
    """The minimum or the maximum of each block of cells; small maps stay as they are.

    The lowest level is the darkest one, so that walls stay. NaN counts only where a block has
    nothing else.

    Parameters
    ----------
    values : (H, W) array
        Levels, or other values of cells.
    maximum : bool, default False
        True takes the greatest value of each block.
    most : int, optional
        Maximum number of blocks along a side; `DRAWN_CELLS` by default.
    """
    cells = block(values.shape, most)
    if cells == 1:
        return values
    pick = np.fmax if maximum else np.fmin
    starts = [np.arange(0, size, cells) for size in values.shape]
    return np.asarray(pick.reduceat(pick.reduceat(values, starts[0], axis=0), starts[1], axis=1))


def field_cells(
    field: CovarianceField, values: Floats, *, logarithmic: bool, part: OccupancyGrid | None
) -> Floats:
    """Values (h, w) on the field's lattice as `draw_cells` takes them, NaN but in free space.

    They are those of all cells of the map, or of a part of it. The values of blocks are read in
    their middles: large maps are never filled cell by cell.
    """
    drawn = part or field.grid
    cells = block(drawn.shape)
    if cells == 1 and drawn.shape == field.grid.shape:
        return field.on_map(values, logarithmic=logarithmic)
    first = np.round(field.grid.world_to_grid(*drawn.origin[:2]))
    free = shrunk(drawn.cells) == FREE
    rows, cols = (
        (np.arange(size) + 0.5) * cells - 0.5 + float(start)
        for size, start in zip(free.shape, first, strict=True)
    )
    at_middles = rows[:, None], cols[None, :]
    read = field.on_map(values, logarithmic=logarithmic, cells=at_middles)
    return np.where(free, read, np.nan)


def coarse(grid: OccupancyGrid, most: int) -> OccupancyGrid:
    """The map of the blocks of `shrunk`, at most so many along a side; walls stay.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    most : int
        Maximum number of blocks along a side; a map with fewer cells stays as it is.
    """
    cells, resolution = shrunk(grid.cells, most=most), grid.resolution * block(grid.shape, most)
    return dataclasses.replace(grid, cells=cells, resolution=resolution)


def block(shape: tuple[int, ...], most: int | None = None) -> int:
    """Number of cells along a side of the blocks that large maps are drawn in."""
    return math.ceil(max(shape[:2]) / (most or DRAWN_CELLS))


def known_cells(grid: OccupancyGrid) -> tuple[int, int, int, int]:
    """First row, end of the rows, first column and end of the columns with known cells."""
    known = grid.cells != UNKNOWN
    if not known.any():
        return 0, grid.shape[0], 0, grid.shape[1]
    rows, cols = (np.flatnonzero(known.any(axis=axis)) for axis in (1, 0))
    return int(rows[0]), int(rows[-1]) + 1, int(cols[0]), int(cols[-1]) + 1


def limits_of(grid: OccupancyGrid, *, share: float = 0.02) -> dict[str, Any]:
    """`xlim` and `ylim` around the known cells, with a margin of a share of their extent [m]."""
    low, high, left, right = known_cells(grid)
    x, y = grid.grid_to_world(np.array([low, low, high, high]), np.array([left, right] * 2))
    margin = share * max(np.ptp(x), np.ptp(y)) + (grid.resolution if share else 0.0)
    ends = [(float(each.min() - margin), float(each.max() + margin)) for each in (x, y)]
    return dict(zip(("xlim", "ylim"), ends, strict=True))


def map_axes(grid: OccupancyGrid) -> tuple[Picture, Axes]:
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
    figure = Picture(figsize=map_size(grid), layout="constrained")
    return figure, figure.add_subplot()


def map_size(grid: OccupancyGrid) -> tuple[float, float]:
    """Figure size for the known part of a map with a colour bar at its side.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.

    Returns
    -------
    (width, height)
        The size of the figure [inch].
    """
    width, height = drawn_size(grid)
    return max(width, 5.0) + 1.6, max(height, 2.0) + 0.8


def drawn_size(grid: OccupancyGrid) -> tuple[float, float]:
    """Size at which the known part of a map is drawn.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.

    Returns
    -------
    (width, height)
        The size without margins [inch], at most 7.6 each.
    """
    low, high, left, right = known_cells(grid)
    height, width = high - low, right - left
    cos, sin = abs(np.cos(grid.origin[2])), abs(np.sin(grid.origin[2]))
    height, width = sin * width + cos * height, cos * width + sin * height
    drawn_width = min(7.6, 7.6 * width / height)
    return drawn_width, drawn_width * height / width


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
    margin = max(0.15 * np.ptp(rows), 0.15 * np.ptp(cols), 3.0 / grid.resolution)  # 3 m at least
    down, across = (
        slice(max(0, int(values.min() - margin)), min(size, int(values.max() + margin) + 1))
        for values, size in zip((rows, cols), grid.shape, strict=True)
    )
    beside = down.start >= down.stop or across.start >= across.stop
    return grid if beside else grid.part(down, across)


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
    ends = map(known_cells, (part, grid))
    own, whole = (max(high - low, right - left) for low, high, left, right in ends)
    return own < 0.6 * whole
