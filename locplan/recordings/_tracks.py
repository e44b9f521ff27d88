"""What AMCL gets of a recorded drive: odometry and ends of beams, in a map's own axes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from locplan._util.poses import Numbers, way_length, wrapped
from locplan.errors import RecordingError
from locplan.maps import OccupancyGrid
from locplan.recordings._recording import Recording
from locplan.robots import Amcl, Robot
from locplan.simulation import DriveArguments, drive_arguments

REPLAY = 14
"""Stream of random numbers of replays."""
SPARSE = 1.5
"""Factor on the filter's own distance between updates above which scans are too sparse for it."""
STILL = 0.1
"""Way of the odometry over that of the poses below which it stood still."""
ALL = slice(None)


def updates_of(odometry: Numbers, amcl: Amcl) -> NDArray[np.int64]:
    """Indices of the poses by odometry (n, 3) at which the filter updates."""
    chosen = [0]
    for n, (x, y, heading) in enumerate(odometry):
        at = odometry[chosen[-1]]
        far = max(abs(x - at[0]), abs(y - at[1])) > amcl.update_min_d
        if far or abs(wrapped(heading - at[2])) > amcl.update_min_a:
            chosen.append(n)
    return np.array(chosen)


def sparse_notes(recording: Recording, amcl: Amcl) -> tuple[str, ...]:
    """A note if the filter updates less often than it would with more scans."""
    assert recording.odometry is not None
    xy = recording.odometry[updates_of(recording.odometry, amcl), :2]
    way = np.hypot(*np.diff(xy, axis=0).T)
    spacing = float(np.median(way)) if len(way) else 0.0
    if spacing <= SPARSE * amcl.update_min_d:
        return ()
    return (
        f"the filter updated every {spacing:.2g} m for lack of scans, in place of every"
        f" {amcl.update_min_d:g} m: with all scans of the robot it errs less",
    )


class Tracks:
    """What the filter gets of a recorded drive, in a map's own axes.

    Raises
    ------
    RecordingError
        If the drive has no odometry, or its first pose is not on the map.
    """

    def __init__(self, recording: Recording, grid: OccupancyGrid) -> None:
        self.recording, self.grid = recording, grid
        if recording.odometry is None:
            raise RecordingError(
                f"{recording.source.file or 'the recording'} has no odometry, which a replay needs;"
                " record it, too, or name its topic (--odom-topic, odom_topic=)"
            )
        moved, told = recording.length, way_length(recording.odometry)
        if told < STILL * moved:
            raise RecordingError(
                f"the odometry moves by {told:.1f} m, but the poses by {moved:.1f} m; is it the"
                " right topic, and was it recorded?"
            )
        row, col = (np.floor(each) for each in grid.world_to_grid(*recording.poses[0, :2]))
        if not (0 <= row < grid.shape[0] and 0 <= col < grid.shape[1]):
            x, y, _ = recording.poses[0]
            raise RecordingError(
                f"the drive begins at {x:.2f},{y:.2f}, off {grid.name or 'the map'}; is it the"
                " right one? See locplan.recordings.fit_to_map"
            )
        self.odometry: Numbers = recording.odometry
        rows, cols = grid.world_to_grid(*recording.poses[:, :2].T)
        yaw = grid.origin[2]
        self.truth = np.column_stack(
            [cols * grid.resolution, rows * grid.resolution, recording.poses[:, 2] - yaw]
        )
        cos, sin = math.cos(yaw), math.sin(yaw)
        self._turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])

    def arguments(self, robot: Robot, scores: NDArray[np.float32] | None = None) -> DriveArguments:
        """The arguments of the kernels; of the disturbances those of the start are read."""
        robot = replace(robot, lidar=self.recording.lidar)
        return drive_arguments(self.grid, robot, scores=scores)

    def ends(self, amcl: Amcl) -> Numbers:
        """Ends of the beams that AMCL compares, (n, beams, 2) [cells]; NaN without a return."""
        recording = self.recording
        beams = slice(None, None, amcl.beam_step(recording.lidar.beams))
        ranges, lidar = recording.ranges[:, beams], recording.lidar
        least, most = max(lidar.least_range, amcl.laser_min_range), amcl.laser_max_range
        used = (ranges >= least) & (ranges < (most if most > 0 else math.inf))
        bearings = lidar.mount_yaw + lidar.angles[beams]
        known = np.where(used, ranges, np.nan).astype(np.float64)
        ends = known[..., None] * np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)
        mount = np.array([lidar.mount_x, lidar.mount_y])
        return np.asarray((ends + mount) / self.grid.resolution)

    def track(
        self,
        random: np.random.Generator,
        ends: Numbers,
        arguments: DriveArguments,
        part: slice = ALL,
    ) -> tuple[Numbers, Numbers]:
        """Errors (n, 3) and covariances (n, 3, 3) of one run on a part of the drive, in the world.

        `ends` are those of the whole drive.
        """
        from locplan._kernels.drives import replay as kernel

        truth, odometry = self.truth[part], self.odometry[part]
        poses, covariances = np.empty_like(truth), np.empty((len(truth), 3, 3))
        kernel(
            random,
            truth[0].copy(),
            np.ascontiguousarray(odometry),
            ends[part],
            arguments.scores,
            arguments.start,
            arguments.filter,
            poses,
            covariances,
        )
        errors = poses - truth
        errors[:, 2] = wrapped(errors[:, 2])
        return errors @ self._turn.T, self._turn @ covariances @ self._turn.T
