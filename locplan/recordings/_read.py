"""How recordings come about: read from files of any kind, or taken of a simulated drive."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np

from locplan._util.checks import file_path, positive
from locplan._util.files import keep_input
from locplan._util.poses import way_along
from locplan._util.progress import ProgressCallback
from locplan._util.reading import NO_FILE
from locplan.errors import ConfigError, LocplanError, RecordingError
from locplan.maps import OccupancyGrid, own_axes
from locplan.recordings._bag_files import SUFFIXES as BAGS
from locplan.recordings._bags import read_bag
from locplan.recordings._carmen import SUFFIXES as CARMEN, read_carmen
from locplan.recordings._logs import Options, Source, Topics
from locplan.recordings._recording import Recording
from locplan.recordings._tables import read_csv, read_npz
from locplan.robots import Robot

if TYPE_CHECKING:
    from locplan.costs import AnyPath

READERS: dict[str, Callable[[FilePath, Options], Recording]] = {
    **dict.fromkeys(BAGS, read_bag),
    **dict.fromkeys(CARMEN, read_carmen),
    ".csv": read_csv,
    ".npz": read_npz,
}
"""What reads a file, by the end of its name."""


def read_drive(
    path: str | os.PathLike[str],
    *,
    every: int = 1,
    window: tuple[float, float] | None = None,
    topics: Topics | None = None,
    range_limits: tuple[float, float] | None = None,
    mount: tuple[float, float, float] | None = None,
    needs_poses: bool = True,
    progress: ProgressCallback | None = None,
) -> Recording:
    """Read a recorded drive: a bag of ROS 1 or 2, a log of CARMEN, CSV or NPZ.

    Bags (.bag, .mcap, .db3, or a folder of rosbag2) are read by PyPI's rosbags, without ROS. Topics
    are found by their type. Poses are those of TF from the map to the robot; where TF does not
    lead there, those of the only topic of PoseWithCovarianceStamped (as AMCL's), PoseStamped (as of
    motion capture), or Odometry in the map's frame. Without any of them they are those of odometry
    in its own frame, as `trajectory_of` needs them. They are interpolated at the stamps of the
    scans, but not over more than a second of motion; those of AMCL are carried there by odometry if
    there is some. Scans without a pose are left out. The motion of the robot during a scan is not
    undone. AMCL dates its transform ahead by transform_tolerance:
    ``topics=Topics(pose_topic="/amcl_pose")`` gives the poses of the scans that it matched. The
    lidar's mount comes from TF; one that is mounted upside down has its beams reversed. Scans are
    read in a first pass, poses in others: memory is taken by what is kept, not by the bag.

    Logs of CARMEN (.log, .clf, also .gz) are read in the order of their lines, ODOM and FLASER or
    ROBOTLASER1. FLASER does not tell its angles: the beams are taken to begin at -90 deg, 180 deg
    by an even number of steps. Nor does it tell its range: readings that pile up at the largest are
    taken for no return.

    CSV has a line ``# lidar: range=12.0, field_of_view_deg=180.0, mount_x=0.1`` with fields of
    `locplan.Lidar`, and columns ``time, x, y, heading, odom_x, odom_y, odom_heading,
    range_0, range_1, ...`` [s, m, rad], one row a scan; those of time and odometry may be
    missing, and an empty range means no return. NPZ has arrays ``ranges`` (scans, beams) [m], or
    uint16 in millimetres with 65535 for no return, ``poses`` (scans, 3), ``lidar``, a text of JSON
    with the fields of `locplan.Lidar`, and if known ``times``, ``odometry`` and ``speeds``.
    `Recording.save` writes both.

    Parameters
    ----------
    path : path
        The file, or the folder of a bag.
    every : int, default 1
        Keep every n-th scan, n >= 1. Raise it for a long drive, whose neighbouring scans tell the
        same.
    window : (start, end), optional
        Keep the scans of a part of the drive, from `start` up to `end` after its beginning [s],
        0 <= start < end; all by default.
    topics : Topics, optional
        Topics and frames, where a log has several, or others than usual. Not for CSV and NPZ.
    range_limits : (min, max), optional
        Distances between which a beam's reading is a return [m], 0 <= min < max, where the
        log's own are wrong.
    mount : (x, y, yaw), optional
        Pose of the lidar on the robot [m, m, rad], where the log does not tell it.
    needs_poses : bool, default True
        False reads a bag without poses on the map, too, for `locate_drive`: then all poses of the
        recording are NaN.
    progress : callable, optional
        Called with (done, total) messages of a bag, in each pass.

    Returns
    -------
    Recording
        The drive. Its `source` says what was used, assumed and left out.

    Raises
    ------
    ConfigError
        If an option is out of its range, or does not belong to this kind of file.
    RecordingError
        If the file cannot be read, has no scans or poses, frames are not connected, there are
        several topics to choose from, or a bag's clock runs backwards.
    LocplanError
        If the package rosbags is missing.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "drive.csv"
    ...     lines = ["# lidar: range=8.0, field_of_view_deg=90.0", "x,y,heading,range_0"]
    ...     _ = path.write_text("\\n".join([*lines, "1.0,2.0,0.5,3.25", "1.5,2.0,0.5,"]))
    ...     read_drive(path)
    Recording(drive.csv, 2 scans of 1 beams, 0.5 m)
    """
    limits: Any = {"window": window, "range_limits": range_limits, "mount": mount}
    limits["needs_poses"] = needs_poses
    options = Options(every=every, **vars(topics or Topics()), **limits)
    path = file_path("a recorded drive", path)
    if not path.exists():
        raise RecordingError(f"{path}: " + "; ".join(NO_FILE))
    keep_input(path)
    name = path.name.lower()
    read = next((own for suffix, own in READERS.items() if name.endswith(suffix)), None)
    try:
        if path.is_dir() or read is read_bag:
            return read_bag(path, options, progress)
        if read is None:
            known = ", ".join(READERS)
            raise RecordingError(f"is of no kind that is known ({known}, or a folder of rosbag2)")
        drive = read(path, options)
        drive = drive if window is None else drive.window(*window)
        return drive.every(every) if read is read_npz and every > 1 else drive
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None
    except LocplanError as error:
        raise RecordingError(f"{path}: {error}") from None


def record_drive(
    grid: OccupancyGrid,
    path: AnyPath,
    robot: Robot | None = None,
    *,
    spacing: float = 0.2,
    speed: float = 0.5,
    seed: int = 1,
) -> Recording:
    """Record a simulated drive along a path, in a world that differs from the map a little.

    The recorded poses are the true ones, and ranges are whole millimetres.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    path : Path, Plan, or (n, 2) or (n, 3) array
        The way of the robot, in the world [m, m, rad].
    robot : Robot, optional
        The robot with the lidar that is recorded; by default one of 6 m that sees all round.
    spacing : float, default 0.2
        Distance from scan to scan [m], above 0; it is rounded to multiples of 0.05 m.
    speed : float, default 0.5
        Speed of the robot [m/s], above 0.
    seed : int, default 1
        Seed of all random numbers, >= 0.

    Returns
    -------
    Recording
        The scans with times, true poses and odometry.

    Raises
    ------
    LocplanError
        If the path has no length, or leaves the free cells of the map.

    Examples
    --------
    >>> import locplan
    >>> grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
    >>> path = locplan.plan(locplan.Costmap.blank(grid), (2.0, 3.0), (20.0, 3.0)).path
    >>> record_drive(grid, path, locplan.Robot(locplan.Lidar(range=6.0, beams=90)), spacing=0.5)
    Recording(simulated, 37 scans of 90 beams, 18 m, with odometry)
    """
    from locplan._kernels.drives import odometry_along
    from locplan._kernels.lidar import measured_ends
    from locplan.costs import path_from
    from locplan.simulation import POSE_SPACING, Simulator, poses_along

    path = path_from(path)
    every = max(1, round(positive("spacing", spacing, "m") / POSE_SPACING))
    positive("speed", speed, "m/s")
    simulator = Simulator(grid, robot, seed=seed, threads=1)
    lidar = simulator.robot.known_lidar
    try:
        line = poses_along(path, grid)
    except LocplanError as error:
        raise ConfigError(f"the path {error}") from None
    random = np.random.default_rng(seed)
    arguments = simulator.arguments
    reported = odometry_along(random, own_axes(grid, line), arguments.odometry)[::every]
    poses = line[::every]
    sensor = arguments.lidar._replace(angles=lidar.angles)
    rows, cols = grid.world_to_grid(*poses[:, :2].T)
    headings = poses[:, 2] - grid.origin[2]
    ranges, ends = np.empty((len(poses), lidar.beams)), np.empty((lidar.beams, 2))
    for n, pose in enumerate(np.column_stack([rows, cols, headings])):
        world, size = simulator.worlds[0], grid.resolution
        measured_ends(random, world, size, pose, sensor, arguments.disturbances, ends)
        away = ends * grid.resolution - (lidar.mount_x, lidar.mount_y)
        ranges[n] = np.hypot(*away.T)
    # A hundredth of a second a scan beside the way's time, so that turns on the spot take some.
    times = way_along(line)[::every] / speed + 0.01 * np.arange(len(poses), dtype=float)
    return Recording(
        (np.rint(ranges * 1000) / 1000).astype(np.float32),
        lidar,
        np.round(poses, 5),
        np.round(times, 3),
        np.round(reported, 5).astype(np.float64),
        Source(file="simulated", scans="simulated", poses="true", odometry="simulated"),
    )
