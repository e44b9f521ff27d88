"""Settings of AMCL replayed over a whole recorded drive, by which `check` and `tune` decide."""

from __future__ import annotations

from dataclasses import dataclass, replace

from locplan._util.poses import way_length
from locplan.maps import OccupancyGrid
from locplan.recordings._recording import Recording
from locplan.recordings._replay import replay
from locplan.robots import Amcl, Robot
from locplan.simulation import Drives

RUNS = 12
"""Number of runs of a filter over a drive: of settings that end one run in ten lost, some run of 12
does so in 72 %."""
SHORTEST = 30.0
"""Length from which on a drive decides [m]."""


@dataclass(frozen=True, eq=False)
class ReplayedDrive:
    """A recorded drive on its map, over which any settings can be replayed."""

    name: str
    """Name in tables."""
    recording: Recording
    """The drive, with odometry; its poses are the ground truth."""
    grid: OccupancyGrid
    """The map."""
    robot: Robot
    """The robot, whose filter is replaced by the settings."""
    filter_map: OccupancyGrid | None = None
    """The filter's map, if it is not `grid`."""
    runs: int = RUNS
    """Number of runs."""
    seed: int = 1
    """Seed of all random numbers; equal settings have equal runs."""
    threads: int | None = None
    """Number of threads, all cores by default."""

    def replay(self, amcl: Amcl) -> Drives:
        """Replay settings over the whole drive.

        Parameters
        ----------
        amcl : Amcl
            The settings.
        """
        return replay(
            self.recording,
            self.grid,
            replace(self.robot, filter=amcl),
            runs=self.runs,
            filter_map=self.filter_map,
            seed=self.seed,
            threads=self.threads,
        ).drives


def find_replay_limit(recording: Recording) -> str:
    """Return why settings cannot be judged by replays of a recording; empty if they can.

    Parameters
    ----------
    recording : Recording
        The recording.

    Examples
    --------
    >>> import numpy as np, locplan
    >>> poses = [[n / 4, 0.0, 0.0] for n in range(9)]
    >>> lidar = locplan.Lidar(range=5.0, beams=5)
    >>> drive = Recording(np.full((9, 5), 1.0), lidar, poses, odometry=poses)
    >>> find_replay_limit(drive)
    'it is 2 m long, too short to judge settings by; 30 m are needed'
    """
    if recording.odometry is None:
        return "it has no odometry, so that the filter cannot be run on it"
    length = way_length(recording.poses)
    if length < SHORTEST:
        return (
            f"it is {length:.2g} m long, too short to judge settings by; {SHORTEST:g} m are needed"
        )
    return ""
