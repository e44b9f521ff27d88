"""Computing the covariance field of a map."""

from __future__ import annotations

from concurrent.futures import Executor

import numpy as np
from numpy.typing import NDArray

from locplan._util.progress import ProgressCallback
from locplan.field import _tiles as tiles
from locplan.field._config import FieldConfig, config_of
from locplan.field._estimator import Estimator
from locplan.field._field import CovarianceField
from locplan.maps import OccupancyGrid, check_grid


def covariance_field(
    grid: OccupancyGrid,
    config: FieldConfig | Estimator | None = None,
    *,
    points: NDArray[np.bool_] | None = None,
    threads: int | None = None,
    executor: Executor | None = None,
    progress: ProgressCallback | None = None,
) -> CovarianceField:
    """Compute the covariance of a pose match over the free cells of a map.

    It is evaluated on every lattice point (`config.stride` apart) in a free cell. A free cell
    without such a point around it adds its nearest lattice point.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    config : FieldConfig or Estimator, optional
        Estimator and lattice; `Sad()` by default.
    points : (h, w) array of bool, optional
        Lattice points to evaluate, by default all: point (i, j) is cell (i, j) times the stride.
        The others are read from those around them. A few points take a fraction of the time.
    threads : int, optional
        Number of threads, >= 1; all cores by default. The result does not depend on it.
    executor : concurrent.futures.Executor, optional
        Executor that runs the tiles instead of threads: a process pool, or a cluster by
        dask.distributed's ``client.get_executor()``. Its workers need locplan.
    progress : callable, optional
        Function that is called with (done, total) cells from time to time.

    Raises
    ------
    ConfigError
        If the config does not fit the map's resolution, `points` is no mask of the lattice, or
        `threads` is below 1.
    FieldError
        If the executor fails, or the estimator's values are no covariances or change with the map
        beyond its halo, see `locplan.field.Estimator.covariances`.

    Examples
    --------
    >>> import numpy as np
    >>> from locplan.field import Sad
    >>> from locplan.maps import FREE
    >>> grid = OccupancyGrid(np.full((30, 30), FREE), resolution=0.1)
    >>> field = covariance_field(grid, Sad(range=0.5))
    >>> field.covariance.shape
    (15, 15, 3, 3)
    """
    check_grid(grid)
    config = config_of(config)
    values = tiles.nothing_known(grid, config)
    wanted = tiles.wanted_points(grid, config, points)
    tiles.fill(values, grid, config, threads, executor, progress, wanted)
    return CovarianceField.of(values, grid, config)
