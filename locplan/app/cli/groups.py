"""Groups of options that commands share: the robot, the computation, and the output."""

from __future__ import annotations

import dataclasses
import json as json_files
import math
import sys
import warnings
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter
from cyclopts.validators import Number

import locplan
from locplan._support.checks import check_choice, check_threads, format_suggestion, short_repr
from locplan._support.files import protect_input
from locplan._support.progress import show_progress_bar, show_spinner
from locplan._support.runs import pop_written_lines, record_robot
from locplan.app.cli import arguments
from locplan.app.cli.application import COMPUTATION, OUTPUT, ROBOT
from locplan.app.cli.arguments import INPUT, INTEGER, Switch, make_validator
from locplan.app.cli.log import LOG
from locplan.app.cli.wording import translate_options
from locplan.errors import ConfigError, LocplanError, RecordingError, format_one_line

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from locplan._support.output import ResultFiles
    from locplan.field.config import FieldConfig
    from locplan.field.field import CovarianceField
    from locplan.maps.grid import OccupancyGrid
    from locplan.recordings.recording import Recording
    from locplan.robots.lidar import Lidar
    from locplan.robots.robot import Robot

PAPER = "sad-paper"
"""Name of the field settings for Eq. 8-10 as printed."""


def _protect_robot_file(file: Path) -> None:
    """Protect a robot's file from being overwritten by results."""
    from locplan.robots.parameters import split_robot_name

    protect_input(split_robot_name(file)[0])


def _check_lidar(name: str) -> None:
    """Raise a ConfigError unless a built-in lidar has the name."""
    from locplan.robots.lidar import LIDARS

    check_choice("--lidar", name, LIDARS)


@Parameter(name="*", group=ROBOT)
@dataclass(frozen=True, kw_only=True)
class RobotOptions:
    """Options for the robot of a command."""

    robot: Annotated[
        tuple[Path, ...], Parameter(metavar="FILE[:NAMESPACE]"), make_validator(_protect_robot_file)
    ] = ()
    """Nav2 parameters, robot file, URDF or SDF. Later files win."""
    lidar: Annotated[str | None, Parameter(metavar="NAME"), make_validator(_check_lidar)] = None
    """Lidar or robot, such as turtlebot4. See `locplan info`."""
    set: Annotated[tuple[str, ...], Parameter(metavar="NAME=VALUE")] = ()
    """Setting, such as range=8. See `locplan info --settings`."""

    def load(self, lidar: Lidar | None = None, *, is_recorded: bool = False) -> Robot:
        """Return the robot, and log the title of a robot from files.

        Parameters
        ----------
        lidar : Lidar, optional
            Lidar if the options name none. A recorded lidar overrides them.
        is_recorded : bool, default False
            True for the robot of a recording.
        """
        from locplan.robots.nav2 import ParameterWarning

        settings = arguments.parse_settings(self.set, "--set", "alpha1=0.05", allows_words=True)
        planner = settings.pop("planner", None)
        with warnings.catch_warnings():
            if is_recorded or any(name.startswith("mount_") for name in settings):
                warnings.filterwarnings("ignore", ".*set mount_x", ParameterWarning)
            name = None if is_recorded else self.lidar
            robot = locplan.Robot.load(*self.robot, lidar=name or lidar, planner=planner)
        if is_recorded or robot.lidar is None:
            robot = dataclasses.replace(robot, lidar=lidar)
        robot = robot.with_settings(settings)
        from locplan.robots.lidar import LIDARS

        # More than ten times the range in the data sheet is probably in another unit.
        if self.lidar and robot.known_lidar.range > 10 * LIDARS[self.lidar].range:
            raise ConfigError(
                f"--set range must be in metres; the data sheet of {self.lidar} says"
                f" {LIDARS[self.lidar].range:g} m, not {robot.known_lidar.range:g}"
            )
        record_robot(robot.title, robot.digest)
        if self.robot:
            LOG.info("robot: %s", robot.title)
        return robot

    def load_recorded(self, recording: Recording, *, is_replayed: bool = True) -> Robot:
        """Return the robot with the lidar and the speed of a recording.

        Parameters
        ----------
        recording : Recording
            The recording.
        is_replayed : bool, default True
            True if the filter is replayed, so that settings of noise are not read.

        Raises
        ------
        ConfigError
            If an option sets a value that the recording provides.
        """
        self.check_recorded(is_replayed=is_replayed)
        return recording.robot(self.load(recording.lidar, is_recorded=True))

    def check_recorded(self, *, is_replayed: bool = True) -> None:
        """Raise a ConfigError if an option sets a value that recordings provide.

        Parameters
        ----------
        is_replayed : bool, default True
            True if the filter is replayed, so that settings of noise are not read.
        """
        from locplan.robots.parts import Disturbances, Odometry

        arguments.reject_options("with --recording, which sets the lidar", lidar=self.lidar)
        kinds: list[type[Any]] = [locplan.Lidar]
        if is_replayed:
            kinds += [Odometry, Disturbances]
        names = {field.name for kind in kinds for field in dataclasses.fields(kind)}
        # The filter's start is random with recordings, too.
        names -= {"start_sigma", "start_sigma_deg"}
        for name in (text.partition("=")[0] for text in self.set):
            if name in names:
                raise ConfigError(
                    f"--set {name} has no effect with --recording, which sets it; remove it"
                )

    def load_with_field_lidar(self, config: FieldConfig | None = None) -> Robot:
        """Return the robot, with the lidar of the field if it has none; warn of bad settings."""
        from locplan.field.config import equip_robot

        robot = equip_robot(self.load(), config)
        self.warn_of_filter_settings(robot)
        return robot

    def warn_of_filter_settings(self, robot: Robot) -> None:
        """Warn of filter settings that do not suit the robot's lidar."""
        from locplan.robots.nav2 import ParameterWarning
        from locplan.robots.parameters import read_parameters
        from locplan.simulation.amcl_parameters import find_filter_warnings

        further_parameters = read_parameters(*self.list_nav2_files()).read_node_parameters("amcl")
        for fault in find_filter_warnings(robot.amcl, robot.known_lidar, further_parameters):
            warnings.warn(ParameterWarning(fault), stacklevel=2)

    def find_nav2_file(self, node: str) -> Path | None:
        """Return the file with most of a node's parameters; the last one if none has any."""
        from locplan.robots.parameters import read_parameters

        files = self.list_nav2_files()
        if not files:
            return None
        parameters = read_parameters(*files)
        place = parameters.find_file_index(node)
        if place is not None:
            return files[place]
        return files[-1] if parameters.read_node_parameters(node) else None

    def list_nav2_files(self) -> list[Path]:
        """Return the Nav2 parameter files among the robot's files."""
        from locplan.robots.parameters import read_parameters

        files = []
        for file in self.robot:
            with suppress(LocplanError):  # a file of another kind
                read_parameters(file)
                files.append(file)
        return files


FilterMapFile = Annotated[
    Path | None,
    make_validator(arguments.protect_map_files),
    Parameter(
        metavar="MAP", group=ROBOT, help="Map of the robot's filter, if it differs from MAP."
    ),
]


def load_zones(file: Path | None, grid: OccupancyGrid | None = None) -> locplan.Zones:
    """Return the zones of a file, empty without a file.

    Parameters
    ----------
    file : path or None
        The file, see `Zones.load`.
    grid : OccupancyGrid, optional
        The map.

    Raises
    ------
    ConfigError
        If no zone lies on the map.
    """
    from locplan.maps.zones import check_zones_on_map

    zones = locplan.Zones() if file is None else locplan.Zones.load(file)
    if grid is not None:
        try:
            check_zones_on_map(zones, grid)
        except ConfigError as error:
            raise ConfigError(f"{file}: {error}") from None
    return zones


def print_zones(file: Path | None, zones: locplan.Zones) -> None:
    """Print the zones and their file; nothing without a file.

    Parameters
    ----------
    file : path or None
        The file.
    zones : Zones
        Its zones.
    """
    if file is not None:
        print(format_one_line(f"zones of {file}: {str(zones) or 'none'}"))


def load_filter_map(file: Path | None, maps: Sequence[Path]) -> OccupancyGrid | None:
    """Return the filter's map if a file was given; warn of masks and of maps to repair.

    Parameters
    ----------
    file : path or None
        The filter's map.
    maps : sequence of path
        The maps of the simulation.
    """
    from locplan.advice import map_repair
    from locplan.maps.files import MapWarning, find_maps, read_map
    from locplan.maps.map_faults import find_mask_faults
    from locplan.simulation.worlds import check_filter_map, check_single_map

    map_files = find_maps(*maps)
    for map_file in map_files:
        grid, source = read_map(map_file)
        for fault in find_mask_faults(grid, source) if source else ():
            warning = MapWarning(format_one_line(f"{map_file}: {fault.sentence}"))
            warnings.warn(warning, stacklevel=2)
    grids = [locplan.load_map(map_file) for map_file in map_files]
    filter_maps = [locplan.load_map(file)] if file else grids
    for grid in filter_maps:
        if offer := map_repair.format_solid_wall_warning(grid):
            warnings.warn(MapWarning(offer), stacklevel=2)
    if file is None:
        return None
    check_single_map(filter_maps[0], grids)
    return check_filter_map(filter_maps[0], grids[0])


RecordingFile = Annotated[
    Path | None,
    INPUT,
    Parameter(metavar="FILE", help="Recording: drive.npz of `locplan recording`, a bag or a log."),
]
RecordingFiles = Annotated[
    tuple[Path, ...],
    INPUT,
    Parameter(
        metavar="FILE",
        help="Recording: drive.npz of `locplan recording`, a bag or a log. Repeatable.",
    ),
]


def read_recording(file: Path, *, needs_poses: bool = True) -> Recording:
    """Return a recording, read with the defaults of `locplan recording`."""
    from locplan.recordings import files

    try:
        with show_progress_bar(f"reading {file.name}", "messages") as progress:
            read = files.read_recording
            return read(file, needs_poses=needs_poses, progress=progress)
    except LocplanError as error:
        text = translate_options(str(error), "recording")
        if text == str(error):
            raise
        remedy = f"run `locplan recording {file}` with its options first"
        raise RecordingError(f"{text}; {remedy}") from None


def load_recording(file: Path, grid: OccupancyGrid, map_file: Path) -> Recording:
    """Return a recording with its ground truth; raise a LocplanError unless the map fits."""
    from locplan.recordings.map_fit import check_recording_on_map, fit_to_map
    from locplan.recordings.smoothing import with_ground_truth

    recording = read_recording(file)
    with show_spinner("comparing the scans with the map"):
        check_recording_on_map(recording, grid)
    with show_progress_bar("smoothing the trajectory", "") as progress:
        recording = with_ground_truth(recording, grid, progress=progress)
    with show_spinner("comparing the scans with the map"):
        fit = fit_to_map(recording, grid)
    if not fit.fits:
        x, y, turn = fit.move
        align = f" --align {x:.3f},{y:.3f},{math.degrees(turn):.2f}" if fit.is_shifted else ""
        raise LocplanError(
            f"{map_file}: {fit.sentence.rstrip('.')}; run `locplan recording{align}` to find the"
            " ground truth"
        )
    return recording


SEED = 1
"""Default seed."""
Seed = Annotated[
    int,
    Parameter(
        group=COMPUTATION,
        help="Seed of all random numbers.",
        validator=Number(gte=0, lte=2**63 - 1),
    ),
    INTEGER,
]
Threads = Annotated[
    int | None,
    Parameter(group=COMPUTATION, help="Number of threads.", show_default="all cores"),
    make_validator(check_threads),
]


def _default_stride(_: object) -> str:
    """Return the default stride, read only when the help is shown."""
    return f"{locplan.FieldConfig.stride:g}"


@Parameter(name="*", group=COMPUTATION)
@dataclass(frozen=True, kw_only=True)
class FieldOptions:
    """Options for the covariance field of a command."""

    field: Annotated[str | None, Parameter(metavar="NAME|FILE", show_default="fused or sad")] = None
    """fused, scan, fisher, sad, sad-paper, .json or .npz."""
    stride: Annotated[float | None, Parameter(metavar="METRES", show_default=_default_stride)] = (
        None
    )
    """Spacing of the evaluated cells, in metres."""

    def resolve(self, robot: Robot) -> tuple[Robot, FieldConfig]:
        """Return the robot and the settings of the field.

        If the robot has no lidar, it gets the lidar of a settings file.

        Parameters
        ----------
        robot : Robot
            The robot.
        """
        config = self._make_config(robot)
        lidar = getattr(config.estimator, "lidar", None)
        if robot.lidar is None and self._is_file and lidar:
            robot = dataclasses.replace(robot, lidar=lidar)
        if (
            robot.lidar
            and lidar
            and dataclasses.replace(lidar, model=robot.lidar.model) != robot.lidar
        ):
            raise ConfigError(
                f"--field {self.field} was computed for another lidar ({lidar.title}); run"
                " `locplan field` with this robot's options"
            )
        if self.stride is not None:
            config = dataclasses.replace(config, stride=self.stride)
        return robot, config

    @property
    def _is_file(self) -> bool:
        return self.field is not None and Path(self.field).suffix.lower() in (".json", ".npz")

    def _make_config(self, robot: Robot) -> FieldConfig:
        name = self.field or ("fused" if robot.lidar else "sad")
        if not self._is_file:
            return config_by_name(name, robot.lidar)
        file = Path(name)
        protect_input(file)
        if file.suffix.lower() == ".json":
            return with_lidar(locplan.load_config(file), robot.lidar)
        arguments.reject_options("with a computed field", stride=self.stride)
        return locplan.CovarianceField.load(file).config

    def compute(
        self,
        grid: OccupancyGrid,
        config: FieldConfig,
        threads: int | None,
        points: NDArray[np.bool_] | None = None,
    ) -> CovarianceField:
        """Compute the field of a map, or read it from the cache or the file.

        Parameters
        ----------
        grid : OccupancyGrid
            The map.
        config : FieldConfig
            The settings that `resolve` returned.
        threads : int or None
            Number of threads.
        points : (h, w) array of bool, optional
            Lattice points to compute. With --stride, all are computed.
        """
        LOG.debug("field: %s", config)
        if self.field is not None and Path(self.field).suffix.lower() == ".npz":
            field = locplan.CovarianceField.load(self.field)
            if field.grid.digest != grid.digest:
                raise ConfigError(
                    f"--field {self.field} was computed for another map"
                    f" ({field.grid.name or 'no name'}); run `locplan field` on"
                    f" {grid.name or 'this map'}"
                )
            return field
        with show_progress_bar(f"computing the field of {grid.name}", "cells") as progress:
            return locplan.load_or_compute(
                grid,
                config,
                points=points if self.stride is None else None,
                threads=threads,
                progress=progress,
            )


def config_by_name(name: str, lidar: Lidar | None) -> FieldConfig:
    """Return the field settings for the name of an estimator.

    Parameters
    ----------
    name : str
        Name of an estimator, or `PAPER`.
    lidar : Lidar or None
        The robot's lidar.
    """
    from locplan.field.config import SHORT_LIDAR
    from locplan.field.estimators import ESTIMATORS, estimator_class

    if name == PAPER:
        return with_lidar(locplan.FieldConfig(locplan.Sad.paper()), lidar)
    if name not in ESTIMATORS:
        names = ", ".join([*ESTIMATORS, PAPER])
        raise ConfigError(
            f"--field must be one of {names}, or a file (.json or .npz), not {short_repr(name)}"
            f"{format_suggestion(name, [*ESTIMATORS, PAPER])}"
        )
    kind: Any = estimator_class(name)
    if kind.casts_rays:
        assumed = dataclasses.replace(SHORT_LIDAR, model="assumed lidar")
        return locplan.FieldConfig(kind(lidar or assumed))
    return with_lidar(locplan.FieldConfig(kind()), lidar)


def with_lidar(config: FieldConfig, lidar: Lidar | None) -> FieldConfig:
    """Return settings with another lidar, and its number of headings unless one was set."""
    if lidar is None or lidar == getattr(config.estimator, "lidar", None):
        return config
    is_default = config.headings == config.estimator.headings
    return dataclasses.replace(
        config,
        estimator=config.estimator.with_lidar(lidar),
        headings=0 if is_default else config.headings,
    )


def with_range(config: FieldConfig, lidar_range: float) -> FieldConfig:
    """Return settings with another range of the lidar, or of the template [m]."""
    lidar = getattr(config.estimator, "lidar", None)
    if lidar:
        return with_lidar(config, dataclasses.replace(lidar, range=lidar_range))
    estimator: Any = config.estimator
    return dataclasses.replace(config, estimator=dataclasses.replace(estimator, range=lidar_range))


Weight = Annotated[
    float | None,
    Parameter(metavar="METRES"),
    make_validator(lambda weight: locplan.planning.layers.check_weight(weight)),
]


@Parameter(name="*", group=OUTPUT)
@dataclass(frozen=True, kw_only=True)
class OutputOptions:
    """Options for the output of a command."""

    output: Annotated[Path | None, Parameter(name=("--output", "-o"), metavar="PATH")] = None
    """Folder or file for the results."""
    force: Switch = False
    """Overwrite existing files."""
    json: Switch = False
    """Print the result as JSON."""

    def check(self, files: ResultFiles, *further_names: str) -> None:
        """Raise a LocplanError if the files cannot be written; called before long computations."""
        if self.output:
            files.make_output(self.output, *further_names, force=self.force)

    def finish(
        self, result: Any, *details: Any, saved_details: tuple[Any, ...] | None = None
    ) -> None:
        """Save a result if --output was given, and print it.

        Parameters
        ----------
        result : Result
            The result.
        *details
            Further arguments of `summary` and `report`, such as verifying drives.
        saved_details : tuple, optional
            Further arguments of `save`. By default the details.
        """
        files = None
        if self.output:
            with show_spinner("writing the results"):
                extra = details if saved_details is None else saved_details
                files = result.save(self.output, *extra, force=self.force)
        self.show(result.summary(*details), result.report(*details), *files or [self.output])

    def show(self, values: object, text: object, *files: Path | None) -> None:
        """Print a result as JSON or as text, and list the written files."""
        print(json_files.dumps(values, indent=2) if self.json else text)
        lines = pop_written_lines() or [f"wrote {file}" for file in filter(None, files)]
        for line in lines:
            print(format_one_line(line), file=sys.stderr if self.json else sys.stdout)
