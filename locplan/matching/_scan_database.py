"""What a lidar sees at all places of a map, made once for many scans."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from locplan._kernels.arrays import Bools, Floats, Singles
from locplan._util.checks import instance, keep, number
from locplan.errors import ConfigError
from locplan.maps import OccupancyGrid, check_grid
from locplan.matching._database import Database, _of_lidar, in_blocks, make_database
from locplan.matching._matching import TURNS, Matcher, Matching
from locplan.robots import Lidar

CLEARANCE = 0.1
"""Default distance from walls at which a pose is possible [m]; less than the radius of robots,
since their recorded poses and maps err."""


@dataclass(frozen=True, eq=False, repr=False)
class ScanDatabase:
    """What a lidar sees at all places of a map; it is made when the first scan is compared.

    `locate` and `find_ambiguous_places` make one if none is given, and keep the last four.

    Raises
    ------
    ConfigError
        If a value is out of its range.

    Examples
    --------
    >>> import locplan
    >>> grid = locplan.maps.environments.make("places", resolution=0.1)
    >>> ScanDatabase(grid, locplan.Lidar(range=8.0))
    ScanDatabase(places, lidar, 8 m, 360°)
    """

    grid: OccupancyGrid
    """The map."""
    lidar: Lidar
    """The lidar, with its mount on the robot."""
    clearance: float = CLEARANCE
    """Distance of the robot's centre from walls at which a pose is possible [m], >= 0."""

    def __post_init__(self) -> None:
        check_grid(self.grid)
        instance("lidar", self.lidar, Lidar, 'such as locplan.Lidar.preset("rplidar-a1")')
        keep(self, clearance=number("clearance", self.clearance, 0.0))

    def __repr__(self) -> str:
        return f"ScanDatabase({self.grid.name or 'map'}, {self.lidar.title})"

    @cached_property
    def everywhere(self) -> Database:
        """Ranges at all places.

        Raises
        ------
        ConfigError
            If the map has no wall, or no place with this clearance.
        """
        return make_database(self.grid, Matching(lidar=self.lidar, robot_radius=self.clearance))

    @cached_property
    def matcher(self) -> Matcher:
        """What gives the covariance of a match about its pose."""
        return Matcher.of(self.grid, self.lidar)

    @cached_property
    def nats_a_loss(self) -> float:
        """Nats of the greatest loss of one of the beams that count."""
        matching = self.everywhere.matching
        beams = len(self.matcher.settings.beam_numbers)
        return matching.nats_a_loss * float(matching.seen.sum()) / beams

    def compared_ends(self, on_robot: Floats) -> Singles:
        """Ends of the beams that return, (2, k) [cells], of those that `locplan.Scan` compares.

        Parameters
        ----------
        on_robot : (beams, 2) array
            Ends of all beams ahead and to the left of the robot [m]; NaN without a return.
        """
        ends = on_robot[self.matcher.settings.beam_numbers] / self.grid.resolution
        return np.ascontiguousarray(ends[np.isfinite(ends[:, 0])].T, np.float32)

    def near(self, xy: Floats, within: float) -> Database:
        """Ranges at the places near some positions.

        Parameters
        ----------
        xy : (n, 2) array
            Positions in the world [m].
        within : float
            Maximum distance of a place from them [m].

        Raises
        ------
        ConfigError
            If the robot fits nowhere so near.
        """
        grid, every = self.grid, self.everywhere
        chosen = every.fits & (_distances(grid, xy) <= within)
        if not chosen.any():
            raise ConfigError(
                f"the robot has no place within {within:g} m of the {len(xy)} positions that it"
                f" may be near; are they in the frame of {grid.name or 'the map'}?"
            )
        return _restricted(every, chosen)


@lru_cache(maxsize=4)
def database_of(grid: OccupancyGrid, lidar: Lidar, clearance: float) -> ScanDatabase:
    """The database of a map and a lidar, one of the last or a new one."""
    return ScanDatabase(grid, lidar, clearance)


def checked_database(
    grid: OccupancyGrid, lidar: Lidar, clearance: float, database: ScanDatabase | None
) -> ScanDatabase:
    """The database that was given, or one of the last four, or a new one.

    Parameters
    ----------
    grid : OccupancyGrid
        The map, of which it must be.
    lidar : Lidar
        The lidar, of which it must be.
    clearance : float
        Clearance of a database that is not given [m].
    database : ScanDatabase, optional
        The one that was given.

    Raises
    ------
    ConfigError
        If it is of another map or lidar, or the clearance is out of its range.
    """
    if database is None:
        database = database_of(grid, lidar, number("clearance", clearance, 0.0))
    instance("database", database, ScanDatabase)
    if database.grid != grid or database.lidar != lidar:
        raise ConfigError(
            "the database is of another map or lidar; make ScanDatabase(grid, lidar) of these"
        )
    return database


def _distances(grid: OccupancyGrid, xy: Floats) -> Singles:
    """Distance of each cell from the nearest cell with a position, (H, W) [m]."""
    import cv2

    row, col = (np.floor(each).astype(np.int64) for each in grid.world_to_grid(*xy.T))
    inside = (row >= 0) & (row < grid.shape[0]) & (col >= 0) & (col < grid.shape[1])
    away = np.ones(grid.shape, np.uint8)
    away[row[inside], col[inside]] = 0
    if not inside.any():
        return np.full(grid.shape, np.inf, np.float32)
    cells = cv2.distanceTransform(away, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(cells * np.float32(grid.resolution))


def _restricted(database: Database, fits: Bools) -> Database:
    """The part of a database of the places from which the robot can get to cells (H, W)."""
    from locplan._kernels.simd import OCTETS

    near = _of_lidar(database.grid, database.matching, fits)
    col, row = np.floor(database.positions.T).astype(np.int64)
    chosen = np.flatnonzero(near[row, col])
    places = database.codes.reshape(-1, 2 * TURNS, OCTETS).transpose(0, 2, 1)
    return dataclasses.replace(
        database,
        fits=fits,
        positions=database.positions[chosen],
        codes=in_blocks(places.reshape(-1, 2 * TURNS)[chosen]),
        tables=database.tables._replace(fits=fits.astype(np.uint8)),
    )
