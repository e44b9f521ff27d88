"""AMCL's settings tuned on one half of a recorded drive, and judged on the other and the whole."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import check_threads, instance, whole
from locplan._util.intervals import random_of
from locplan._util.poses import way_along
from locplan._util.progress import ProgressCallback
from locplan.errors import ConfigError, RecordingError
from locplan.maps import OccupancyGrid, check_grid
from locplan.matching import in_batches
from locplan.recordings._odometry_noise import odometry_noise
from locplan.recordings._recording import Recording
from locplan.recordings._tracks import REPLAY, Tracks, sparse_notes
from locplan.robots import MODELS, Amcl, Robot
from locplan.simulation import (
    BeamsLeft,
    DisturbanceLevel,
    Drives,
    Kidnapping,
    Tuning,
    TuningBench,
    check_drives,
    check_filter_map,
    check_of_one_map,
    joined,
    search_settings,
    several,
)

WHOLE = 1_000_000
"""Number, in place of a stretch's, from which replays of the whole drive have random numbers."""
RECORDED = DisturbanceLevel("recorded", 1.0, 1.0)
"""The only level of disturbance of a recorded drive."""
KIDNAPPED_WAY = 13.0
"""Length of the way that a part of the drive with a kidnapping needs beside it [m]."""


@dataclass(eq=False, repr=False)
class RecordedBench(TuningBench):
    """Replays of settings on some stretches of a recorded drive."""

    tracks: Tracks
    """What the filter gets of the drive."""
    stretches: Sequence[slice]
    """The scans of each stretch."""
    robot: Robot
    """Its disturbances are read for the deviation of the filter's first poses."""

    def arguments(self, amcl: Amcl) -> list[Any]:
        """The ends of beams that the filter compares, and the kernel's arguments."""
        ends, robot = self.tracks.ends(amcl), replace(self.robot, filter=amcl)
        return [(ends, self.tracks.arguments(robot, self.scores(amcl)))]

    def errors(self, level: int, path: int, drive: int, arguments: Any) -> NDArray[np.float64]:
        """Errors of one replay, in the world."""
        random = random_of(self.seed, REPLAY, path, drive)
        ends, own = arguments
        return self.tracks.track(random, ends, own, self.stretches[path])[0]

    def whole(self, amcl: Amcl) -> list[Drives]:
        """Replays of the whole drive from its beginning, as many as of a stretch."""
        (ends, own) = self.arguments(amcl)[0]

        def run(some: NDArray[np.int64]) -> list[NDArray[np.float64]]:
            randoms = (random_of(self.seed, REPLAY, WHOLE, int(n)) for n in some)
            return [self.tracks.track(random, ends, own)[0] for random in randoms]

        errors = in_batches(run, self.drives, self.threads, batch=1)
        return [Drives(self.tracks.recording.poses, np.array(errors))]

    def kidnapped(self, amcl: Amcl, metres: float) -> NDArray[np.float64]:
        """Errors after replays of parts of the whole drive, as many of each as of a stretch."""
        whole, own = self.tracks.recording, self.arguments(amcl)[0][1]
        ways = np.linspace(0.0, max(0.0, whole.length - KIDNAPPED_WAY - metres), len(self.lines))
        begins = np.searchsorted(way_along(whole.poses), ways)

        def run(some: NDArray[np.int64]) -> list[float]:
            found = []
            for n, begin in zip(some.tolist(), begins[some], strict=True):
                part = whole[begin:]
                if (kidnapping := Kidnapping.on(part.poses, metres)) is None:
                    continue
                reported = kidnapping.odometry(self.tracks.odometry[begin:])
                tracks = Tracks(replace(part[kidnapping.kept], odometry=reported), self.filter_map)
                ends = tracks.ends(amcl)
                for drive in range(self.drives):
                    random = random_of(self.seed, REPLAY, WHOLE, n, drive)
                    errors = tracks.track(random, ends, own)[0]
                    found.append(float(np.hypot(*errors[-1, :2])))
            return found

        return np.array(in_batches(run, len(begins), self.threads, batch=1))


def tune_on_drive(
    recording: Recording | Sequence[Recording],
    grid: OccupancyGrid | Sequence[OccupancyGrid],
    robot: Robot | None = None,
    *,
    drives: int = 8,
    filter_map: OccupancyGrid | None = None,
    others: Mapping[str, object] | None = None,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Tuning:
    """Find settings of AMCL that localize a robot better on its recorded drive than its own ones.

    Settings are searched on five stretches of the drive's first half and on all of it, as
    `locplan.simulation.tune` does on simulated paths, and judged on stretches of the second half.
    The whole drive from its beginning decides, since a filter that holds on stretches may be lost
    for good on a long way. The recorded poses are the reference, so that they should not be those
    of the filter to be tuned.

    Parameters
    ----------
    recording : Recording or sequence of Recording
        The drive, with odometry; or several, whose worst one counts.
    grid : OccupancyGrid or sequence of OccupancyGrid
        The map; the poses are in its world frame. Of several drives, that of all, or one for each.
    robot : Robot, optional
        The robot, from whose filter the search begins, with the deviation of the filter's first
        pose on a stretch; Nav2's defaults without it.
    drives : int, default 8
        Number of replays of each stretch, and of the whole drive, 2 to 100,000.
    filter_map : OccupancyGrid, optional
        The filter's map in the same frame, where it differs from `grid`.
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
    recordings, grids = several(recording), several(grid)
    for each in recordings:
        instance("recording", each, Recording, "read one with locplan.recordings.read_drive")
    for each in grids:
        check_grid(each)
    if len(grids) not in (1, len(recordings)):
        raise ConfigError(
            f"{len(recordings)} drives need one map, or one for each in their order, not"
            f" {len(grids)}"
        )
    check_of_one_map(filter_map, grids)
    check_drives(drives)
    whole("seed", seed, 0)
    workers = check_threads(threads)
    names = [each.source.file or "the drive" for each in recordings]
    pairs = zip(recordings, grids * (len(recordings) // len(grids)), strict=True)
    parts = [_Part.of(each, grid, filter_map, robot) for each, grid in pairs]

    def bench_of(own_seed: int, judging: bool) -> TuningBench:
        benches = [each.bench(judging, drives, own_seed, workers) for each in parts]
        return joined(benches, names)

    known = parts[0].robot
    like = [amcl for each in parts for amcl in _calibrated(each.tracks.recording, each.robot.amcl)]
    return search_settings(
        bench_of,
        known,
        left=min((each.left for each in parts), key=lambda left: left.returned),
        others=others,
        seed=seed,
        progress=progress,
        drive=", ".join(names),
        notes=[*dict.fromkeys(n for each in recordings for n in sparse_notes(each, known.amcl))],
        like=like,
    )


@dataclass(frozen=True)
class _Part:
    """A drive on its map, whose first half settings are searched on."""

    tracks: Tracks
    grid: OccupancyGrid
    robot: Robot
    stretches: Sequence[slice]

    @classmethod
    def of(
        cls,
        recording: Recording,
        grid: OccupancyGrid,
        filter_map: OccupancyGrid | None,
        robot: Robot | None,
    ) -> _Part:
        tracks = Tracks(recording, check_filter_map(filter_map, grid))
        return cls(tracks, grid, recording.robot(robot), _stretches(recording))

    @property
    def left(self) -> BeamsLeft:
        """Beams that return on the drive."""
        ends = self.tracks.ends(self.robot.amcl)
        return BeamsLeft(ends.shape[1], float(np.isfinite(ends[..., 0]).sum(axis=1).mean()))

    def bench(self, judging: bool, drives: int, seed: int, threads: int) -> RecordedBench:
        """The bench that settings are searched or judged on."""
        middle = len(self.stretches) // 2
        first_half = slice(0, self.stretches[middle].start)
        some = self.stretches[middle:] if judging else [*self.stretches[:middle], first_half]
        lines = [self.tracks.truth[each] for each in some]
        common = self.grid, self.tracks.grid, self.tracks.recording.lidar, [RECORDED], lines
        return RecordedBench(*common, drives, seed, threads, self.tracks, some, self.robot)


def _calibrated(recording: Recording, own: Amcl) -> list[Amcl]:
    """The user's settings with the odometry's own alphas, which small ones are raised to."""
    noise = odometry_noise(recording, own)
    if noise is None:
        return []
    names = "alpha1", "alpha2", "alpha3", "alpha4"
    fitted: dict[str, Any] = {
        name: round(min(max(getattr(noise, name).value, 0.01), 5.0), 3) for name in names
    }
    often: dict[str, Any] = {"update_min_d": 0.1, "update_min_a": 0.1}
    models: list[dict[str, Any]] = [{"laser_model_type": model} for model in MODELS]
    return [replace(own, **fitted, **model, **more) for model in models for more in ({}, often)]


def _stretches(recording: Recording) -> list[slice]:
    """The scans of equally long stretches of a drive, one after the other."""
    way = way_along(recording.poses)
    if way[-1] < 30:
        raise RecordingError(
            f"the drive is {way[-1]:.1f} m long, and tuning needs 30 m at least; record a longer"
            " one"
        )
    count = 2 * TuningBench.fewest_paths
    edges = np.searchsorted(way, np.linspace(0.0, way[-1], count + 1))
    edges[-1] = len(way)
    if np.diff(edges).min() < 3:
        raise RecordingError(
            f"the drive has {len(recording)} scans, too sparse to tune on: stretches of"
            f" {way[-1] / count:.1f} m have fewer than 3; record more scans"
        )
    return [slice(int(a), int(b)) for a, b in itertools.pairwise(edges)]
