"""Options that commands share: fields, costs, recorded drives, and where results go.

An option that was not given is None, and means the library's own default.
"""

# Annotations are objects, not texts: the options are inherited by classes in other modules.

import json
import logging
import math
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Protocol

from cyclopts import Parameter

import locplan
from locplan._util.checks import printable
from locplan._util.progress import progress_bar, working
from locplan._util.runs import write_run_beside
from locplan.cli import _types as typed
from locplan.errors import ConfigError, LocplanError, one_line

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from locplan import Costmap, CovarianceField, FieldConfig, OccupancyGrid, Robot
    from locplan._util.results import Results
    from locplan.recordings import Recording

    class Compute(Protocol):
        """A function that gives the field of a map, or its values at some lattice points."""

        def __call__(
            self, grid: "OccupancyGrid", points: "NDArray[np.bool_] | None" = None
        ) -> "CovarianceField": ...


Criterion = Annotated[
    str | None,
    Parameter(
        group=typed.heading("Costs"),
        help="Scalar that the degeneracy u is made of: e (default of sad), position_std (default of"
        " the others), position_rms or heading_std; ambiguity or entropy of scan and fused.",
    ),
]
CacheDir = Annotated[
    Path | None,
    Parameter(help="Folder of the computed fields; LOCPLAN_CACHE names it, too."),
]


def _check_scheduler(scheduler: str) -> None:
    locplan.field.check_scheduler(scheduler)


@typed.option_group("Computing")
class Computing:
    """The resources for fields, and their cache."""

    threads: typed.Threads = None
    scheduler: Annotated[
        str | None,
        Parameter(metavar="tcp://HOST:PORT"),
        typed.checked(_check_scheduler),
    ] = None
    """Dask cluster that computes the field."""
    cache_dir: CacheDir = None

    @contextmanager
    def of(
        self, config: "FieldConfig", *, whole: bool = False, then: Callable[[], None] = lambda: None
    ) -> "Iterator[Compute]":
        """The function that gives the field of a map: read, or computed here or on a cluster.

        It has the whole field even where some points are asked for, if so, and calls `then` last.
        """
        scheduler = self.scheduler
        with locplan.field.executor_of(scheduler) if scheduler else nullcontext() as executor:

            def compute(
                grid: "OccupancyGrid", points: "NDArray[np.bool_] | None" = None
            ) -> "CovarianceField":
                started = time.perf_counter()
                with progress_bar(f"field of {grid.name}", "cells") as progress:
                    field = locplan.load_or_compute(
                        grid,
                        config,
                        points=None if whole else points,
                        cache_dir=self.cache_dir,
                        threads=self.threads,
                        executor=executor,
                        progress=progress,
                    )
                took = time.perf_counter() - started
                logging.getLogger("locplan.cli").info(
                    "field of %s: %.1f s, %s", grid.name, took, config
                )
                then()
                return field

            yield compute

    def field(self, grid: "OccupancyGrid", config: "FieldConfig") -> "CovarianceField":
        """The field of one map."""
        with self.of(config) as compute:
            return compute(grid)


@typed.option_group("Costs")
class CostOptions:
    """The costs of a path."""

    weight: float | None = None
    """Detour accepted per degenerate metre, in metres; by default the estimator's own, 4 for sad
    and 8 for the others."""
    criterion: Criterion = None

    def check(self, config: "FieldConfig") -> None:
        """Raise a ConfigError if an option is out of range; to be called before long work."""
        if self.weight is not None:
            locplan.costs.check_weight(self.weight)
        if self.criterion is not None:
            locplan.costs.check_criterion(self.criterion, config)

    def costmap(self, grid: "OccupancyGrid", field: "CovarianceField", robot: "Robot") -> "Costmap":
        """The costmap of a field for a robot."""
        return locplan.Costmap.from_field(grid, field, robot=robot, **typed.given_of(self))


def move(name: str, text: str) -> tuple[float, ...]:
    """A shift in metres with a turn in degrees, which becomes radians."""
    x, y, turn = typed.numbers(name, text, 3)
    return x, y, math.radians(turn)


Topic = Annotated[str | None, Parameter(metavar="TOPIC")]
Frame = Annotated[str | None, Parameter(metavar="FRAME")]
Move = Annotated[Any, typed.parsed(move, "X,Y,DEG")]


@typed.option_group("Recorded drive")
class DriveOptions:
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

    def check(self) -> None:
        """Raise a ConfigError if an option is given without a drive; before long work."""
        if self.drive is None:
            typed.refuse("without --drive", **typed.given_of(self))

    def read(self) -> "Recording":
        """The drive, with a progress bar while it is read.

        Raises
        ------
        ConfigError
            If no drive was named.
        RecordingError
            If the file cannot be read, or holds no drive.
        """
        self.check()
        if self.drive is None:
            raise ConfigError("name a recorded drive with --drive")
        names = vars(locplan.recordings.Topics())
        topics = {name: value for name, value in typed.given_of(self).items() if name in names}
        with progress_bar(f"reading {self.drive.name}", "messages") as progress:
            recording = locplan.recordings.read_drive(
                self.drive,
                every=self.every or 1,
                topics=locplan.recordings.Topics(**topics),
                range_limits=self.range_limits,
                mount=self.mount,
                progress=progress,
            )
        return recording.moved(*self.align) if self.align else recording


@typed.option_group("Recorded drive")
class ReferencedOptions(DriveOptions):
    """A recorded drive, and what counts as true of it."""

    reference: Literal["log", "smoothed"] | None = None
    """Poses that count as true: the log's own, or those that trajectory finds; by default these
    of a bag."""

    def on_map(self, maps: Sequence[Path]) -> "tuple[OccupancyGrid, Recording]":
        """The map, and the drive on it.

        Where the map does not fit, a warning says so if the user has aligned the drive.

        Raises
        ------
        LocplanError
            If there are several maps, the map does not fit, or a file cannot be read.
        """
        files = locplan.maps.find_maps(*maps)
        if len(files) != 1:
            raise ConfigError(f"--drive is of one map, not of {len(files)}; name the one it was on")
        grid, drive = locplan.load_map(files[0]), self.read()
        with progress_bar("smoothing", "") as progress:
            smoothed = locplan.recordings.referenced
            drive = smoothed(drive, grid, self.reference, progress=progress)
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


def load_filter_map(
    filter_map: Path | None, grids: "Sequence[OccupancyGrid]"
) -> "OccupancyGrid | None":
    """The map of a robot's filter, where it was named; it is of one map that is driven in."""
    if filter_map is None:
        return None
    grid = locplan.load_map(filter_map)
    locplan.simulation.check_of_one_map(grid, grids)
    return locplan.simulation.check_filter_map(grid, grids[0])


def read_paths(files: Sequence[Path]) -> "dict[str, locplan.Path]":
    """Paths by the names of their files."""
    paths = {printable(file.stem): locplan.Path.load(file) for file in files}
    if len(paths) < len(files):
        raise LocplanError("two --path files have one name; rename one")
    return paths


@typed.option_group("Output")
class Output:
    """Where the result goes."""

    output: Annotated[Path | None, typed.Target] = None
    """Folder for pictures, JSON and tables (CSV)."""
    force: typed.Force = False
    json: typed.Json = False

    def check(self, files: "Results", *more: str) -> None:
        """Raise a LocplanError if the folder cannot take files of results; before long work."""
        if self.output:
            files.into(self.output, *more, force=self.force)

    def finish(self, result: Any, *about: Any, saved: tuple[Any, ...] | None = None) -> None:
        """Save a result, if a folder or a file was named, and print it.

        Parameters
        ----------
        result : Result
            The result.
        *about
            What belongs to it, such as the drives that verify it.
        saved : tuple, optional
            What belongs to it in its folder, by default the same.
        """
        written = None
        if self.output:
            with working("writing the results"):
                own = about if saved is None else saved
                written = result.save(self.output, *own, force=self.force)
        self.show(result.summary(*about), result.report(*about), *written or [self.output])

    def show(self, about: object, text: object, *written: Path | None) -> None:
        """Print a result that is saved, and write its run beside it."""
        if self.output and self.output in written:
            write_run_beside(self.output)
        show(self.json, about, text, *written)


def show(as_json: bool, about: object, text: object, *written: Path | None) -> None:
    """Print a result as JSON or as text for people, and say on stderr what was written."""
    print(json.dumps(about, indent=2) if as_json else text)
    say_written(*written)


def say_written(*paths: Path | None) -> None:
    """Say on stderr what was written."""
    for path in filter(None, paths):
        print(one_line(f"wrote {path}"), file=sys.stderr)
