"""Presets of AMCL tried on a recording: replayed over the whole drive, and simulated on its map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from locplan._util.checks import check_threads, instance, whole
from locplan._util.progress import ProgressCallback
from locplan.costs import Costmap
from locplan.errors import ConfigError, RecordingError
from locplan.maps import OccupancyGrid, check_grid
from locplan.recordings._recording import Recording
from locplan.recordings._recording_faults import find_recording_faults
from locplan.recordings._replayed_drive import (
    RUNS,
    ReplayedDrive,
    find_replay_limit,
)
from locplan.recordings._tracks import Tracks, sparse_notes
from locplan.robots import Robot
from locplan.simulation import (
    BeamsLeft,
    Tuning,
    as_list,
    check_drives,
    check_filter_map,
    check_of_one_map,
    choose_preset,
    number_names,
    plan_random_paths,
    simulated_cases,
    warn_of_settings,
)
from locplan.simulation.levels import USUAL

PATHS, DRIVES = 12, 4
"""Number of random paths on each map that settings are simulated on, and of drives along each."""


def tune_on_drive(
    recording: Recording | Sequence[Recording],
    grid: OccupancyGrid | Sequence[OccupancyGrid],
    robot: Robot | None = None,
    *,
    drives: int = RUNS,
    filter_map: OccupancyGrid | None = None,
    others: Mapping[str, object] | None = None,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Tuning:
    """Find the preset of AMCL's settings that localizes a robot best on its recorded drive.

    The user's settings and the presets of `locplan.robots.presets` are replayed over the whole
    drive. The precise preset is used if the recording has no fault, no run is off at the end, the
    error is no larger than with the user's settings, and the preset is not worse in simulation.
    Otherwise the safe preset is tried in the same way, and otherwise the user's settings stay. The
    recorded poses are the ground truth, so they should not be those of the filter to be tuned.

    Parameters
    ----------
    recording : Recording or sequence of Recording
        The drive, with odometry; or several for one parameter file: settings must hold on each.
    grid : OccupancyGrid or sequence of OccupancyGrid
        The map; the poses are in its world frame. Of several drives, that of all, or one for each.
    robot : Robot, optional
        The robot with the user's settings of the filter, and with the deviation of the filter's
        first pose; Nav2's defaults without it.
    drives : int, default 12
        Number of replays of the whole drive, 2 to 100,000.
    filter_map : OccupancyGrid, optional
        The filter's map in the same frame, if it differs from `grid`.
    others, seed, threads, progress
        See `locplan.simulation.tune`.

    Returns
    -------
    Tuning
        The settings to use, and the evidence for them.

    Raises
    ------
    RecordingError
        If the drive has no odometry, or is shorter than 30 m.
    ConfigError
        If a number is out of its range.

    Examples
    --------
    >>> import locplan
    >>> from locplan.recordings import record_drive
    >>> grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
    >>> path = locplan.plan(locplan.Costmap.blank(grid), (2.0, 3.0), (36.0, 3.0)).path
    >>> robot = locplan.Robot(locplan.Lidar(range=6.0, beams=60))
    >>> drive = record_drive(grid, path, robot)
    >>> own = robot.changed({"min_particles": 20, "max_particles": 20})
    >>> tune_on_drive(drive, grid, own, drives=2).winner.max_particles
    20
    """
    recordings, grids = as_list(recording), as_list(grid)
    for drive in recordings:
        instance("recording", drive, Recording, "read one with locplan.recordings.read_recording")
    for one in grids:
        check_grid(one)
    if len(grids) not in (1, len(recordings)):
        raise ConfigError(
            f"{len(recordings)} drives need one map, or one for each in their order, not"
            f" {len(grids)}"
        )
    check_of_one_map(filter_map, grids)
    check_drives(drives)
    whole("seed", seed, 0)
    check_threads(threads)
    names = [drive.source.file or "the drive" for drive in recordings]
    labels = number_names(names)
    known = recordings[0].robot(robot)
    drives_on_maps = [
        ReplayedDrive(label, drive, one, drive.robot(robot), filter_map, drives, seed, threads)
        for drive, one, label in zip(
            recordings, grids * (len(recordings) // len(grids)), labels, strict=True
        )
    ]
    for each in drives_on_maps:
        _check_drive(each)
    faults = [find_recording_faults(each.recording, each.grid) for each in drives_on_maps]
    maps = [*dict.fromkeys(grids)]
    map_labels = number_names([one.name or "map" for one in maps]) if maps[1:] else [""]
    cases = []
    for one, label in zip(maps, map_labels, strict=True):
        paths = plan_random_paths(Costmap.blank(one, robot=known), PATHS, seed)
        cases += simulated_cases(
            one,
            known,
            paths,
            [USUAL],
            drives=DRIVES,
            label=label,
            filter_map=filter_map,
            seed=seed,
            threads=threads,
        )
    choice = choose_preset(
        known.amcl,
        cases,
        [drive.poses for drive in recordings],
        drives_on_maps,
        are_recordings_sound=all(fault.is_sound for fault in faults),
        progress=progress,
    )
    beams_left = min(map(_beams_left, drives_on_maps), key=lambda left: left.returned)
    sparse = dict.fromkeys(note for drive in recordings for note in sparse_notes(drive, known.amcl))
    of_faults = [
        f"{each.name}: {text.rstrip('.')}"
        for each, fault in zip(drives_on_maps, faults, strict=True)
        for text in fault.sentences
    ]
    return Tuning(
        grids=tuple(maps),
        robot=known,
        choice=choice,
        beams_left=beams_left,
        warnings=warn_of_settings(known, choice.settings, beams_left, others),
        paths=PATHS,
        drives=DRIVES,
        seed=seed,
        recording=", ".join(labels),
        filter_map=filter_map,
        notes=(*sparse, *of_faults),
    )


def _check_drive(drive: ReplayedDrive) -> None:
    """Raise a RecordingError if a drive cannot be replayed, or is too short."""
    Tracks(drive.recording, check_filter_map(drive.filter_map, drive.grid))
    if limit := find_replay_limit(drive.recording):
        raise RecordingError(f"{drive.name}: {limit}")


def _beams_left(drive: ReplayedDrive) -> BeamsLeft:
    """Return the beams that return on a drive."""
    tracks = Tracks(drive.recording, check_filter_map(drive.filter_map, drive.grid))
    ends = tracks.ends(drive.robot.amcl)
    return BeamsLeft(ends.shape[1], float(np.isfinite(ends[..., 0]).sum(axis=1).mean()))
