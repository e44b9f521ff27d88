"""Presets of AMCL replayed on one half of a recording, and the best one on the rest."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import check_threads, instance, whole
from locplan._util.intervals import random_of
from locplan._util.poses import way_along
from locplan._util.progress import ProgressCallback
from locplan.errors import ConfigError, RecordingError
from locplan.maps import OccupancyGrid, check_grid
from locplan.matching import in_batches
from locplan.recordings._recording import Recording
from locplan.recordings._tracks import REPLAY, Tracks, sparse_notes
from locplan.robots import Amcl, Robot
from locplan.simulation import (
    BeamsLeft,
    Case,
    Drives,
    Tuning,
    TuningBench,
    as_list,
    check_drives,
    check_filter_map,
    check_of_one_map,
    choose_settings,
    number_names,
)
from locplan.simulation.verdict import DriveSet

Parts = Mapping[tuple[int, ...], slice]
"""The scans of parts of a drive, by the stream of their random numbers."""
STRETCHES = 5
"""Number of stretches of each half of a drive."""


def tune_on_drive(
    recording: Recording | Sequence[Recording],
    grid: OccupancyGrid | Sequence[OccupancyGrid],
    robot: Robot | None = None,
    *,
    drives: int = 12,
    filter_map: OccupancyGrid | None = None,
    others: Mapping[str, object] | None = None,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Tuning:
    """Find the preset of AMCL's settings that localizes a robot best on its recorded drive.

    The presets of `locplan.robots.presets` are replayed on the drive's first half, whole and in
    five stretches. The best preset and the user's settings are then replayed on stretches of the
    second half, whose verdict decides, and on the whole drive from its beginning. There the preset
    must err less, and must not be lost in a single replay more. The recorded poses are the
    reference, so they should not be those of the filter to be tuned.

    Parameters
    ----------
    recording : Recording or sequence of Recording
        The drive, with odometry; or several for one parameter file: all count together, and none
        may contradict.
    grid : OccupancyGrid or sequence of OccupancyGrid
        The map; the poses are in its world frame. Of several drives, that of all, or one for each.
    robot : Robot, optional
        The robot with the user's settings of the filter, and with the deviation of the filter's
        first pose on a stretch; Nav2's defaults without it.
    drives : int, default 12
        Number of replays of each stretch, and of the whole drive, 2 to 100,000.
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
        If the drive has no odometry, is shorter than 30 m, or has too few scans.
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
        instance("recording", drive, Recording, "read one with locplan.recordings.read_drive")
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
    workers = check_threads(threads)
    names = [drive.source.file or "the drive" for drive in recordings]
    labels = number_names(names) if names[1:] else [""]
    pairs = zip(recordings, grids * (len(recordings) // len(grids)), labels, strict=True)
    replays = [
        _Replays(
            Tracks(drive, check_filter_map(filter_map, one)),
            drive.robot(robot),
            label,
            seed,
            workers,
        )
        for drive, one, label in pairs
    ]
    known = replays[0].robot
    notes = dict.fromkeys(note for drive in recordings for note in sparse_notes(drive, known.amcl))
    return choose_settings(
        TuningBench(
            [each.choosing for each in replays],
            [case for each in replays for case in each.judging],
            drives,
        ),
        known,
        tuple(dict.fromkeys(grids)),
        filter_map=filter_map,
        beams_left=min((each.beams_left for each in replays), key=lambda left: left.returned),
        others=others,
        recording=", ".join(names),
        notes=[*notes],
        seed=seed,
        progress=progress,
    )


@dataclass(frozen=True)
class _Replays:
    """Replays of a recording on its map."""

    tracks: Tracks
    robot: Robot
    label: str
    """Name of the recording before that of a case; empty for a single one."""
    seed: int
    threads: int

    @property
    def choosing(self) -> Case:
        """The stretches of the first half, and all of it."""
        stretches = split_drive(self.tracks.recording)
        half = slice(0, stretches[STRETCHES].start)
        parts: Parts = {(n,): part for n, part in enumerate([*stretches[:STRETCHES], half], 1)}
        return self._case("first half", parts)

    @property
    def judging(self) -> list[Case]:
        """The stretches of the second half, which decide, and the whole drive."""
        second = split_drive(self.tracks.recording)[STRETCHES:]
        parts: Parts = {(n,): part for n, part in enumerate(second, STRETCHES + 2)}
        stretches = self._case("second half", parts)
        whole_drive = self._case("whole drive", {(): slice(0, len(self.tracks.truth))})
        return [stretches, replace(whole_drive, decides=False, is_strict=True)]

    @property
    def beams_left(self) -> BeamsLeft:
        """Beams that return on the drive."""
        ends = self.tracks.ends(self.robot.amcl)
        return BeamsLeft(ends.shape[1], float(np.isfinite(ends[..., 0]).sum(axis=1).mean()))

    def _case(self, name: str, parts: Parts) -> Case:
        """Return a case of some parts of the drive by their streams of random numbers.

        Without a stream, replays have the random numbers of `replay`.
        """
        lines = [self.tracks.truth[part] for part in parts.values()]

        def drive(amcl: Amcl, numbers: range) -> DriveSet:
            arguments = self.tracks.arguments(replace(self.robot, filter=amcl))
            ends = self.tracks.ends(amcl)
            tasks = [(stream, n) for stream in parts for n in numbers]

            def run(some: NDArray[np.int64]) -> list[NDArray[np.float64]]:
                errors = []
                for stream, n in (tasks[place] for place in some):
                    random = random_of(self.seed, REPLAY, *stream, n)
                    errors.append(self.tracks.track(random, ends, arguments, parts[stream])[0])
                return errors

            errors = in_batches(run, len(tasks), self.threads, batch=1)
            poses, count = self.tracks.recording.poses, len(numbers)
            return DriveSet.from_drives(
                Drives(poses[part], np.array(errors[place * count : (place + 1) * count]))
                for place, part in enumerate(parts.values())
            )

        return Case(f"{self.label} {name}".strip(), lines, drive)


def split_drive(recording: Recording) -> list[slice]:
    """Return the scans of equally long stretches of a drive, one after the other.

    Parameters
    ----------
    recording : Recording
        The drive.
    """
    way = way_along(recording.poses)
    if way[-1] < 30:
        raise RecordingError(
            f"the drive is {way[-1]:.1f} m long, and tuning needs 30 m at least; record a longer"
            " one"
        )
    count = 2 * STRETCHES
    edges = np.searchsorted(way, np.linspace(0.0, way[-1], count + 1))
    edges[-1] = len(way)
    if np.diff(edges).min() < 3:
        raise RecordingError(
            f"the drive has {len(recording)} scans, too sparse to tune on: stretches of"
            f" {way[-1] / count:.1f} m have fewer than 3; record more scans"
        )
    return [slice(int(a), int(b)) for a, b in itertools.pairwise(edges)]
