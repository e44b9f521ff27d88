"""Compiling the kernels of simulated drives before they are needed."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np

from locplan.maps import FREE, OccupancyGrid
from locplan.planners import prepared_beside
from locplan.robots import Lidar, Robot
from locplan.simulation._simulator import Simulator


@dataclass(frozen=True)
class DriveKernels:
    """The kernels of simulated drives, which another process can prepare."""

    name: str = "simulating"

    def prepare(self) -> None:
        """Compile them by a short drive through an empty room."""
        grid = OccupancyGrid(np.full((8, 8), FREE), 0.5)
        line = np.array([[1.0, 2.0, 0.0], [2.0, 2.0, 0.0]])
        Simulator(grid, Robot(Lidar(range=2.0, beams=8)), threads=1).drive([line])


def drives_prepared_beside(*, needed: bool = True) -> AbstractContextManager[Callable[[], None]]:
    """Let another process compile the kernels of drives meanwhile.

    Parameters
    ----------
    needed : bool, default True
        False compiles nothing, where there is nothing else to do meanwhile.

    Returns
    -------
    context manager
        It gives a function that waits until the kernels are compiled; see
        `locplan.planners.prepared_beside`.
    """
    return prepared_beside(DriveKernels(), needed=needed, compiled=_compiled)


def _compiled() -> bool:
    """Whether numba's cache holds the kernels of drives."""
    from locplan._kernels.compilation import are_cached
    from locplan._kernels.drives import drive

    return are_cached(drive)
