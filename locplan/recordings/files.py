"""Reading recordings of all formats, and writing locplan's .npz format."""

from __future__ import annotations

import dataclasses
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._support.arrays import read_arrays, write_arrays
from locplan._support.checks import check_file_path, short_repr
from locplan._support.files import protect_input
from locplan._support.output import replace_file
from locplan._support.progress import ProgressCallback
from locplan._support.reading import NO_FILE, check_file_stamp, make_file_stamp, parse_json
from locplan._support.saved import TREE_NAME, decode_tree
from locplan.errors import ConfigError, LocplanError, RecordingError
from locplan.recordings.bags import SUFFIXES as BAGS, read_bag
from locplan.recordings.carmen import SUFFIXES as CARMEN, read_carmen
from locplan.recordings.logs import LogTopics, ReadOptions, RecordingSource
from locplan.recordings.recording import Recording

MAX_ARRAY_BYTES = 2**28
"""Maximum total size of a file's unpacked arrays; reading takes about six times this memory."""
KIND, VERSION = "recording", 1
BUILT_IN = ("two_corridors",)
"""Names of the built-in recordings, each of a drive in the built-in map of this name."""
BUILT_IN_FOLDER = Path(__file__).parent / "drives"
NO_RETURN_MM = 65535
"""Code for no return among ranges in millimetres, uint16."""


def read_recording(
    file: str | os.PathLike[str],
    *,
    every: int = 1,
    window: tuple[float, float] | None = None,
    topics: LogTopics | None = None,
    range_limits: tuple[float, float] | None = None,
    mount: tuple[float, float, float] | None = None,
    needs_poses: bool = True,
    progress: ProgressCallback | None = None,
) -> Recording:
    """Read a recorded drive: a bag of ROS 1 or 2, a CARMEN log, an .npz file, or a built-in one.

    Bags (.bag, .mcap, .db3, or a folder of rosbag2) are read by PyPI's rosbags, without ROS. Topics
    are found by type. Poses come from TF between map and robot. If TF does not connect them, poses
    come from the only topic of type PoseWithCovarianceStamped (such as AMCL's), PoseStamped (such
    as motion capture), or Odometry in the map's frame. Otherwise, poses come from odometry in the
    odometry frame, which is sufficient for `study_recording`. Poses are interpolated at the stamps
    of the scans, but not over more than a second of motion; odometry carries poses of AMCL to the
    scans. Scans without a pose are dropped. The motion of the robot during a scan is not corrected.
    AMCL dates its transform ahead by transform_tolerance:
    ``topics=LogTopics(pose_topic="/amcl_pose")`` reads the poses of the scans that AMCL matched.
    The lidar's mount comes from TF; the beams of an upside-down lidar are reversed. Bags are read
    in several passes, so that large bags fit into memory.

    Logs of CARMEN (.log, .clf, also .gz) are read line by line: ODOM and FLASER or ROBOTLASER1.
    FLASER lines lack angles: beams are assumed to begin at -90 deg and to cover 180 deg by an even
    number of steps. They lack the lidar's range as well: many equal readings at the maximum count
    as no return.

    The .npz format is written by `Recording.save`, and other programs can write it. It has the
    arrays ``ranges`` (scans, beams) [m], or uint16 in millimetres with 65535 for no return,
    ``poses`` (scans, 3) [m, m, rad], ``lidar``, a text of JSON with the fields of `locplan.Lidar`,
    and optionally ``times`` (scans,) [s], ``odometry`` (scans, 3) and ``speeds`` (scans,) [m/s].

    "two_corridors" is a simulated drive in the built-in map of this name.

    Parameters
    ----------
    file : path
        The file, the folder of a bag, or the name of a built-in recording.
    every : int, default 1
        Keep every n-th scan, n >= 1. Raise it for long drives with dense scans.
    window : (start, end), optional
        Keep the scans of a part of the drive, from `start` up to `end` after its beginning [s],
        0 <= start < end; all by default.
    topics : LogTopics, optional
        Topics and frames, if a log has several, or has unusual names. Not for .npz.
    range_limits : (min, max), optional
        Distances between which a beam's reading is a return [m], 0 <= min < max; by default the
        limits in the log.
    mount : (x, y, yaw), optional
        Pose of the lidar on the robot [m, m, rad], if the log lacks it.
    needs_poses : bool, default True
        If False, also read a bag without poses on the map, for `locate_drive`: all poses of the
        recording are NaN then.
    progress : callable, optional
        Called with (done, total) messages of a bag, in each pass.

    Returns
    -------
    Recording
        The drive. Its `source` lists the topics, assumptions and dropped data.

    Raises
    ------
    ConfigError
        If an option is out of range, or does not apply to this file format.
    RecordingError
        If the file cannot be read, has no scans or poses, has unconnected frames or several
        candidate topics, or its clock runs backwards.
    LocplanError
        If the package rosbags is missing.

    Examples
    --------
    >>> read_recording("two_corridors", every=5)
    Recording(two_corridors, 199 scans of 121 beams, 94.01 m, with odometry)
    """
    topics = topics or LogTopics()
    options = ReadOptions(
        every=every,
        window=window,
        range_limits=range_limits,
        mount=mount,
        needs_poses=needs_poses,
        scan_topic=topics.scan_topic,
        pose_topic=topics.pose_topic,
        odom_topic=topics.odom_topic,
        map_frame=topics.map_frame,
        base_frame=topics.base_frame,
    )
    path = check_file_path("a recorded drive", file)
    try:
        return _read_file(path, options, progress)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None
    except LocplanError as error:
        raise RecordingError(f"{path}: {error}") from None


def _read_file(path: Path, options: ReadOptions, progress: ProgressCallback | None) -> Recording:
    """Read a recording with the reader for the file's suffix."""
    name = path.name.lower()
    if _is_built_in(path):
        return _read_npz(BUILT_IN_FOLDER / f"{path}.npz", options)
    if not path.exists():
        fault, remedy = NO_FILE
        names = ", ".join(BUILT_IN)
        raise RecordingError(f"{fault}; {remedy}, or give a built-in recording: {names}")
    protect_input(path)
    if path.is_dir() or name.endswith(BAGS):
        return read_bag(path, options, progress)
    if name.endswith(CARMEN):
        return read_carmen(path, options)
    if name.endswith(".npz"):
        return _read_npz(path, options)
    suffix_list = ", ".join((*BAGS, *CARMEN, ".npz"))
    raise RecordingError(f"has an unknown format; use {suffix_list}, or a folder of rosbag2")


def _is_built_in(path: Path) -> bool:
    """True if a path is the name of a built-in recording, and no file or folder has this name."""
    return str(path) in BUILT_IN and not os.path.lexists(path)


def save_recording(recording: Recording, target: str | os.PathLike[str]) -> None:
    """Write a recording as .npz; a failed write leaves no partial file."""
    path = check_file_path("a file to write", target)
    if path.suffix != ".npz":
        raise RecordingError(f"{path}: must end in .npz")
    with replace_file(path) as temporary:
        _write_npz(recording, temporary)


def _read_npz(path: Path, options: ReadOptions) -> Recording:
    """Read an .npz file; raise a RecordingError if it is damaged or holds no recording."""
    options.refuse_unused("an .npz file", of_robot=False)
    names = (TREE_NAME, "ranges", "poses", "times", "odometry", "speeds", "lidar", "source")
    try:
        arrays = read_arrays(path, MAX_ARRAY_BYTES, names)
    except OSError as error:
        raise RecordingError(f"cannot be read ({error.strerror or error})") from None
    except ValueError as error:
        raise RecordingError(f"is not a valid .npz file ({error}); copy it again") from None
    missing = [name for name in ("ranges", "poses", "lidar") if name not in arrays]
    if missing:
        raise RecordingError(
            f"has no array {' and '.join(missing)}; a recording has {', '.join(names[1:])}, of"
            " which times, odometry, speeds and source may be missing"
        )
    ranges = arrays["ranges"]
    if ranges.dtype == np.uint16:
        metres = (ranges / np.float64(1000)).astype(np.float32)
        ranges = np.where(ranges == NO_RETURN_MM, np.float32(np.inf), metres)
    if TREE_NAME in arrays:  # older files have no version
        _check_stamp(path, _parse_entries(TREE_NAME, arrays[TREE_NAME]))
    lidar = options.make_lidar(_parse_entries("lidar", arrays["lidar"]))
    source = RecordingSource(file=path.name)
    if "source" in arrays:
        source_fields = _parse_entries("source", arrays["source"])
        try:
            source = decode_tree(RecordingSource, source_fields)
        except (LookupError, TypeError, ValueError) as error:
            raise RecordingError(
                f"its source is not as Recording.save writes it: {error}"
            ) from None
    times, odometry = arrays.get("times"), arrays.get("odometry")
    speeds = arrays.get("speeds")
    recording = Recording(ranges, lidar, arrays["poses"], times, odometry, source, speeds)
    if options.window is not None:
        recording = recording.window(*options.window)
    return recording.subsample(options.every)


def _check_stamp(path: Path, stamp: dict[str, Any]) -> None:
    """Raise a RecordingError unless the stamp is that of a recording that is read here."""
    try:
        check_file_stamp(path, stamp, KIND, VERSION)
    except LocplanError as error:  # the caller names the file
        raise RecordingError(str(error).removeprefix(f"{path}: ")) from None


def _parse_entries(name: str, text: NDArray[Any]) -> dict[str, Any]:
    """Parse the JSON object in a text array."""
    try:
        values = parse_json(str(text))
    except ValueError:
        values = None
    if not isinstance(values, dict):
        raise RecordingError(
            f"its {name} must be JSON with entries by name, not {short_repr(str(text))}"
        )
    return values


def _write_npz(drive: Recording, target: Path) -> None:
    """Write a recording as .npz, with ranges in millimetres if that is exact."""
    ranges: NDArray[Any] = drive.ranges
    millimetres = np.where(np.isfinite(ranges), np.rint(ranges * np.float64(1000)), NO_RETURN_MM)
    returns = np.isfinite(ranges)
    exact = (millimetres[returns] / 1000).astype(np.float32) == ranges[returns]
    if exact.all() and (millimetres[returns] < NO_RETURN_MM).all():  # nothing is lost
        ranges = millimetres.astype(np.uint16)
    values = {
        TREE_NAME: np.array(json.dumps(make_file_stamp(KIND, VERSION))),
        "ranges": ranges,
        "poses": drive.poses,
        "lidar": np.array(json.dumps(dataclasses.asdict(drive.lidar))),
        "source": np.array(json.dumps(dataclasses.asdict(drive.source))),
        "times": drive.times,
        "odometry": drive.odometry,
        "speeds": drive.speeds,
    }
    arrays: Any = {name: value for name, value in values.items() if value is not None}
    write_arrays(target, arrays)
