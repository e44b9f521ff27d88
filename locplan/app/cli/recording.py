"""The command `recording`: read a recorded drive for the other commands."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

import locplan
from locplan._support.progress import show_progress_bar
from locplan.app.cli.application import command
from locplan.app.cli.arguments import (
    INPUT,
    Count,
    Limits,
    Pose,
    Shift,
    make_validator,
    protect_map_files,
    reject_options,
)
from locplan.app.cli.groups import SEED, OutputOptions, RobotOptions, Seed, Threads
from locplan.errors import ConfigError

Topic = Annotated[str | None, Parameter(metavar="TOPIC")]
Frame = Annotated[str | None, Parameter(metavar="FRAME")]
DriveFile = Annotated[Path, Parameter("FILE"), INPUT]
OptionalMap = Annotated[Path | None, Parameter("MAP"), make_validator(protect_map_files)]


@command(
    "recording monday.mcap lab.yaml -o drive.npz",
    "recording monday.mcap lab.yaml --robot nav2_params.yaml -o monday",
    "recording two_corridors two_corridors -o drive.npz",
)
def recording(
    file: DriveFile,
    map_file: OptionalMap = None,
    /,
    *,
    every: Count = 1,
    start: Pose = None,
    scan_topic: Topic = None,
    odom_topic: Topic = None,
    pose_topic: Topic = None,
    map_frame: Frame = None,
    base_frame: Frame = None,
    range_limits: Limits = None,
    mount: Shift = None,
    align: Shift = None,
    robot: RobotOptions = RobotOptions(),
    seed: Seed = SEED,
    threads: Threads = None,
    output: OutputOptions = OutputOptions(),
) -> None:
    """Read a recorded drive: topics, faults, noise, and the ground truth on a map.

    Other commands read the written drive.npz with --recording.
    If --output is a folder, also writes poses for evo, a picture and the robot with its noise.

    Parameters
    ----------
    file
        Bag of ROS 1 or 2, CARMEN log, .npz, or built-in recording.
    map_file
        Map YAML, folder with one, or built-in map.
    every
        Read every n-th scan.
    start
        Pose at the first scan. [default: search the whole map]
    scan_topic
        Topic of the scans, if a bag has several.
    odom_topic
        Topic of the odometry.
    pose_topic
        Topic of the poses, instead of TF.
    map_frame
        Frame of the poses. [default: map]
    base_frame
        Frame of the robot. [default: from the odometry]
    range_limits
        Minimum and maximum range of valid returns, in metres.
    mount
        Pose of the lidar on the robot, in metres and degrees.
    align
        Shift of the poses after a turn about the map's origin.
    """
    from locplan.recordings.files import read_recording
    from locplan.recordings.logs import LogTopics
    from locplan.recordings.study import make_recording_output, study_recording

    if start is not None and len(start) != 3:
        raise ConfigError("--start needs a heading; write X,Y,DEG")
    if map_file is None:
        reject_options("without a map", start=start)
    robot.check_recorded(is_replayed=False)
    if output.output:
        make_recording_output(output.output, force=output.force)
    topics = LogTopics(
        scan_topic=scan_topic,
        odom_topic=odom_topic,
        pose_topic=pose_topic,
        map_frame=map_frame or "map",
        base_frame=base_frame,
    )
    with show_progress_bar(f"reading {file.name}", "messages") as progress:
        drive = read_recording(
            file,
            every=every,
            topics=topics,
            range_limits=range_limits,
            mount=mount,
            progress=progress,
        )
    if align:
        drive = drive.move(*align)
    grid = locplan.load_map(map_file) if map_file else None
    with show_progress_bar(
        "finding the ground truth" if grid else "comparing scans", ""
    ) as progress:
        report = study_recording(
            drive,
            grid,
            robot.load_recorded(drive, is_replayed=False),
            start=start,
            seed=seed,
            threads=threads,
            progress=progress,
        )
    output.finish(report)
    if map_file and output.output and not output.json:
        name = output.output if output.output.suffix else output.output / "drive.npz"
        files = [f"--robot={file}" for file in robot.robot]
        words = ["locplan", "check", str(map_file), f"--recording={name}", *files, "-o", "report"]
        print(f"\nNext: find the fix that helps the robot most:\n  {shlex.join(words)}")
