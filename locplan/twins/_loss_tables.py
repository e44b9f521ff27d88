"""The losses of beams' ends around a map, made in strips of rows that need little memory."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.progress import ProgressCallback
from locplan.field import wall_cells
from locplan.maps import OCCUPIED, OccupancyGrid
from locplan.twins._matching import Matching

BAND = 1 << 20
"""Number of cells of a strip, which bounds the memory."""
STEPS = (0.5, 0.25, 0.125)
"""Steps of the refinement, against the deviation; only with the least one there are several."""


def loss_tables(
    grid: OccupancyGrid,
    matching: Matching,
    fits: NDArray[np.bool_],
    progress: ProgressCallback | None = None,
) -> Any:
    """The losses around the map at each deviation, in the form that the kernels take.

    `progress` is called with (done, total) rows; what it raises ends the work.
    """
    import cv2

    from locplan._kernels.scan_losses import LossTables

    sigmas, resolution = matching.sigmas(grid.resolution), grid.resolution
    margin = math.ceil(4 * sigmas[0] / resolution) + 2
    clear = 1 - np.pad(wall_cells(grid.cells == OCCUPIED), margin)
    height, width = clear.shape
    levels = _losses_of_squares(sigmas, matching.z_rand, resolution, math.hypot(height, width))
    far = levels.shape[1] - 1
    reach = math.isqrt(far) + 1
    corners = np.empty((len(sigmas), height, width), np.uint32)
    rows = max(reach, BAND // width)
    for top in range(0, height, rows):
        above = max(0, top - reach)  # wall_cells farther away than this do not count
        part = clear[above : top + rows + 1 + reach]
        part = cv2.distanceTransform(part, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        part = np.minimum(part[top - above : top - above + rows + 1], reach)
        count = min(rows, height - top)
        squares = np.full((count + 1, width + 1), far)
        squares[: len(part), :-1] = np.minimum(np.rint(part * part), far)
        for level, words in zip(levels, corners[:, top : top + count], strict=True):
            steps = level[squares]
            words[:] = steps[:-1, :-1]
            for n, each in enumerate((steps[:-1, 1:], steps[1:, :-1], steps[1:, 1:]), 1):
                words |= each << np.uint32(8 * n)
        if progress:
            progress(top + count, height)
    steps = sigmas[:, None] / resolution * STEPS
    steps[:-1, 1:] = 0
    return LossTables(
        corners.reshape(len(sigmas), -1),
        fits.astype(np.uint8),
        margin=margin,
        width=width,
        height=height,
        steps=steps,
    )


def _losses_of_squares(
    sigmas: NDArray[np.float64], z_rand: float, resolution: float, farthest: float
) -> NDArray[np.uint32]:
    """Losses at a squared distance of 0, 1, ... cells^2 for each deviation; the last one is `TOP`.

    Distances of a map are at most the farthest [cells].
    """
    from locplan._kernels.scan_losses import TOP

    # At this distance a hit is half a step of loss above z_rand.
    excess = z_rand * math.expm1(-math.log(z_rand) / TOP / 2) / (1 - z_rand)
    reach = float(sigmas[0]) * math.sqrt(max(0.0, -2 * math.log(excess))) / resolution
    squares = np.arange(math.ceil(min(reach + 1, farthest)) ** 2 + 2)
    distance = np.sqrt(squares.astype(np.float32)) * np.float32(resolution)
    hit = (1 - z_rand) * np.exp(-0.5 * (distance / sigmas[:, None]) ** 2)
    losses = np.rint(TOP * np.log(hit + z_rand) / math.log(z_rand)).astype(np.uint32)
    losses[:, -1] = TOP
    return losses
