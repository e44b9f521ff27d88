"""What a filter must offer to localize a robot: the protocols that `Amcl` follows first."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from locplan.maps import OccupancyGrid
    from locplan.robots._lidar import Lidar


class Filter(Protocol):
    """A filter's settings, which can `start` it any number of times.

    They are a frozen dataclass, as `Amcl` is: drives run in threads, each with a filter of its own
    that shares nothing with the others but the settings. `locplan.testing.check_filter` checks a
    filter of your own.
    """

    @property
    def title(self) -> str:
        """The filter in one short line for people."""

    def start(
        self,
        grid: OccupancyGrid,
        lidar: Lidar,
        pose: NDArray[np.float64],
        deviation: tuple[float, float],
        random: np.random.Generator,
    ) -> Tracker:
        """Begin to track a robot.

        Parameters
        ----------
        grid : OccupancyGrid
            The filter's map, which may differ from the one that is planned on and driven in.
        lidar : Lidar
            The lidar that takes the scans.
        pose : (3,) array
            First pose x, y, heading in the world [m, m, rad].
        deviation : (position, heading)
            Standard deviations of the first pose, along x and y each [m], and of the heading [rad].
        random : numpy.random.Generator
            The only source of random numbers, so that equal seeds give equal drives.
        """


class Tracker(Protocol):
    """A filter that runs: at every pose `motion`, `scan` and `estimate` are called in turn."""

    def motion(self, odometry: NDArray[np.float64]) -> None:
        """Take what odometry reports.

        Parameters
        ----------
        odometry : (3,) array
            The pose x, y, heading that odometry has added up, in a frame of its own
            [m, m, rad].
        """

    def scan(self, ranges: NDArray[np.float32]) -> None:
        """Take a scan from where the last `motion` led.

        Parameters
        ----------
        ranges : (beams,) array
            Distances along all of the lidar's beams [m]; what is not within its range is no
            return.
        """

    def estimate(self) -> NDArray[np.float64]:
        """The robot's pose x, y, heading in the world, (3,) [m, m, rad]."""

    def covariance(self) -> NDArray[np.float64]:
        """Covariance of the estimate in the world, (3, 3) [m, m, rad]; NaN while not known."""
