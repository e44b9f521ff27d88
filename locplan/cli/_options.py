"""Options that commands share: fields, costs, recorded drives, and where results go.

An option that was not given is None, and means the library's own default.
"""

from __future__ import annotations

import json
import logging
import math
import sys
import time
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

import locplan
from locplan._util.checks import check_threads, printable
from locplan._util.progress import progress_bar, working
from locplan.cli import _types as typed
from locplan.errors import ConfigError, LocplanError, one_line

LOG = logging.getLogger("locplan.cli")
if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from locplan import Costmap, CovarianceField, FieldConfig, OccupancyGrid, Robot
    from locplan._util.output import Results
    from locplan.recordings import Recording


@typed.option_group("Computing")
class Threads(typed.Options):
    """The threads."""

    threads: Annotated[int | None, typed.checked(check_threads)] = None
    """Number of threads; all cores by default."""


@typed.option_group("Simulation")
class Seeded(Threads):
    """The random numbers of drives, and the threads."""

    seed: typed.Seed = 1
    """Seed of all random numbers; 1 by default."""


CacheDir = Annotated[
    Path | None, Parameter(help="Folder of the computed fields; LOCPLAN_CACHE names it, too.")
]


@typed.option_group("Computing")
class Cached(typed.Options):
    """The cache of fields."""

    cache_dir: CacheDir = None


@typed.option_group("Computing")
class Computing(Cached, Threads):
    """The resources for fields, and their cache."""

    def field_of(
        self,
        grid: OccupancyGrid,
        config: FieldConfig,
        points: NDArray[np.bool_] | None = None,
    ) -> CovarianceField:
        """The field of a map, or its values at some lattice points."""
        started = time.perf_counter()
        with progress_bar(f"field of {grid.name}", "cells") as progress:
            field = locplan.load_or_compute(
                grid,
                config,
                points=points,
                cache_dir=self.cache_dir,
                threads=self.threads,
                progress=progress,
            )
        LOG.info("field of %s: %.1f s, %s", grid.name, time.perf_counter() - started, config)
        return field


@typed.option_group("Costs")
class Criterion(typed.Options):
    """What degeneracy is."""

    criterion: str | None = None
    """Scalar that the degeneracy u is made of: e (default of sad), position_std (default of the
    others), position_rms or heading_std; ambiguity or entropy of scan and fused."""


@typed.option_group("Costs")
class CostOptions(Criterion):
    """The costs of a path."""

    weight: float | None = None
    """Detour accepted per degenerate metre, in metres; by default the estimator's own, 4 for sad
    and 8 for the others."""

    def check_costs(self, config: FieldConfig) -> None:
        """Raise a ConfigError if an option is out of range; before long work."""
        if self.weight is not None:
            locplan.costs.check_weight(self.weight)
        if self.criterion is not None:
            locplan.costs.check_criterion(self.criterion, config)

    def costmap(self, grid: OccupancyGrid, field: CovarianceField, robot: Robot) -> Costmap:
        """The costmap of a field for a robot."""
        return locplan.Costmap.from_field(grid, field, robot=robot, **self.given(CostOptions))


@typed.option_group("Options")
class Ends(typed.Options):
    """The ends of a path that is planned."""

    start: typed.XY = None
    """Start of a path that is planned, x,y in metres."""
    goal: typed.XY = None
    """Goal of this path, x,y in metres."""

    def ends(self) -> tuple[Any, ...]:
        """Both ends, or none; a ConfigError if only one was given."""
        if bool(self.start) != bool(self.goal):
            raise ConfigError("--start and --goal belong together")
        return (self.start, self.goal) if self.start and self.goal else ()


def move(name: str, text: str) -> tuple[float, ...]:
    """A shift in metres with a turn in degrees, which becomes radians."""
    x, y, turn = typed.numbers(name, text, 3)
    return x, y, math.radians(turn)


Topic = Annotated[str | None, Parameter(metavar="TOPIC")]
Frame = Annotated[str | None, Parameter(metavar="FRAME")]
Move = Annotated[Any, typed.parsed(move, "X,Y,DEG")]
DriveFiles = Annotated[
    tuple[Path, ...],
    typed.INPUT,
    Parameter(group=typed.heading("Recorded drive"), metavar="FILE"),
]


@typed.option_group("Recorded drive")
class DriveOptions(typed.Options):
    """A recorded drive, and how its file is read."""

    drive: Annotated[Path | None, typed.INPUT, Parameter(metavar="FILE")] = None
    """Recorded drive: a bag of ROS 1 or 2, a log of CARMEN, CSV or NPZ."""
    every: typed.Count | None = None
    """Step between the scans that are read; 1 by default, which is all."""
    scan_topic: Topic = None
    """Topic of the scans, where a bag has several."""
    pose_topic: Topic = None
    """Topic of the poses in a bag, in place of TF."""
    odom_topic: Topic = None
    """Topic of the odometry in a bag."""
    map_frame: Frame = None
    """Frame of the poses in a bag; map by default."""
    base_frame: Frame = None
    """Frame of the robot in a bag; that of its odometry, or base_footprint or base_link."""
    range_limits: Annotated[Any, typed.parsed(typed.two_numbers, "MIN,MAX")] = None
    """Distances between which a reading is a return, in metres, where the log's own are wrong."""
    mount: Move = None
    """Pose of the lidar on the robot, in metres and degrees, where the log does not have it."""
    align: Move = None
    """Turn of the recorded poses about the map frame's origin, in degrees, and shift after it, in
    metres, where the map was moved."""

    def check_drive(self) -> None:
        """Raise a ConfigError if an option is given without a drive; before long work."""
        if not self.drive:
            self.refuse("without --drive", DriveOptions, "reference")

    def read(self, file: Path | None = None, *, needs_poses: bool = True) -> Recording:
        """The drive, or one of several by its file; a ConfigError if none was named."""
        self.check_drive()
        file = file or self.drive
        if file is None:
            raise ConfigError("name a recorded drive with --drive")
        topics = locplan.recordings.Topics(**self.given(locplan.recordings.Topics))
        own = self.given("every", "range_limits", "mount") | {"needs_poses": needs_poses}
        with progress_bar(f"reading {file.name}", "messages") as progress:
            recording = locplan.recordings.read_drive(file, topics=topics, progress=progress, **own)
        return recording.moved(*self.align) if self.align else recording


@typed.option_group("Recorded drive")
class Reference(typed.Options):
    """What counts as true of a recorded drive."""

    reference: Literal["log", "smoothed"] | None = None
    """Poses that count as true: the log's own, or those that trajectory finds; by default these of
    a bag."""


@typed.option_group("Recorded drive")
class ReferencedOptions(Reference, DriveOptions):
    """A recorded drive, and what counts as true of it."""

    def referenced(self, grid: OccupancyGrid, file: Path | None = None) -> Recording:
        """The drive, with the poses that count as true on a map, whether it fits or not."""
        drive = self.read(file)
        with progress_bar("smoothing", "") as progress:
            return locplan.recordings.referenced(drive, grid, self.reference, progress=progress)

    def on_map(
        self, maps: Sequence[Path], file: Path | None = None
    ) -> tuple[OccupancyGrid, Recording]:
        """The map, and the drive on it; a LocplanError unless it is one map that fits.

        Where the user has aligned the drive, a warning says that it does not.
        """
        files = locplan.maps.find_maps(*maps)
        if len(files) != 1:
            raise ConfigError(f"--drive is of one map, not of {len(files)}; name the one it was on")
        grid = locplan.load_map(files[0])
        drive = self.referenced(grid, file)
        with working("looking whether the map fits"):
            fit = locplan.recordings.fit_to_map(drive, grid)
        if not fit.fits:
            x, y, turn = fit.move
            way = f" (--align {x:.3f},{y:.3f},{math.degrees(turn):.2f})" if fit.shifted else ""
            fault = f"{files[0]}: {fit.sentence.rstrip('.')}{way}"
            if self.align is None:
                raise LocplanError(f"{fault}; --align 0,0,0 goes on as it is")
            warnings.warn(locplan.maps.MapWarning(fault), stacklevel=2)
        return grid, drive


def read_paths(files: Sequence[Path]) -> dict[str, locplan.Path]:
    """Paths by the names of their files, with that of the folder where two have one."""
    stems = [file.stem for file in files]
    paths: dict[str, locplan.Path] = {}
    for file, stem in zip(files, stems, strict=True):
        several = stems.count(stem) > 1
        name = printable(f"{file.absolute().parent.name}/{stem}" if several else stem)
        if name in paths:
            raise LocplanError(f"two --path files are called {name}; rename one")
        paths[name] = locplan.Path.load(file)
    return paths


Json = Annotated[bool, typed.under("Output", help="Print the result as JSON.")]
Force = Annotated[bool, typed.under("Output", help="Overwrite existing files.")]


@typed.option_group("Output")
class Output(typed.Options):
    """Where the result goes."""

    output: Annotated[Path | None, typed.Target] = None
    """Folder for pictures, JSON and tables (CSV)."""
    force: Force = False
    json: Json = False

    def check_output(self, files: Results, *more: str) -> None:
        """Raise a LocplanError if the folder cannot take files of results; before long work."""
        if self.output:
            files.into(self.output, *more, force=self.force)

    def finish(self, result: Any, *about: Any, saved: tuple[Any, ...] | None = None) -> None:
        """Save a result, if a folder or a file was named, and print it.

        What belongs to it, such as the drives that verify it, is saved with it, or else `saved`.
        """
        written = None
        if self.output:
            with working("writing the results"):
                own = about if saved is None else saved
                written = result.save(self.output, *own, force=self.force)
        self.show(result.summary(*about), result.report(*about), *written or [self.output])

    def show(self, about: object, text: object, *written: Path | None) -> None:
        """Print a result that is saved."""
        show(self.json, about, text, *written)


def show(as_json: bool, about: object, text: object, *written: Path | None) -> None:
    """Print a result as JSON or as text for people, and say on stderr what was written."""
    print(json.dumps(about, indent=2) if as_json else text)
    say_written(*written)


def say_written(*paths: Path | None) -> None:
    """Say on stderr what was written."""
    for path in filter(None, paths):
        print(one_line(f"wrote {path}"), file=sys.stderr)
