"""Options of the robot and of the covariance field, and what is made of them."""

from __future__ import annotations

import dataclasses
import inspect
import sys
import warnings
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

import locplan
from locplan._util.files import keep_input
from locplan._util.runs import note_robot
from locplan.cli import _types as typed
from locplan.errors import ConfigError, LocplanError, one_line
from locplan.field import ESTIMATORS, estimator_class
from locplan.robots import PRESETS

if TYPE_CHECKING:
    from locplan import FieldConfig, Lidar, OccupancyGrid, Robot
    from locplan.field import Estimator
    from locplan.recordings import Recording


def _keep_file(file: Path) -> None:
    keep_input(locplan.robots.file_and_robot(file)[0])


@typed.option_group("Robot")
class RobotOptions(typed.Options):
    """The robot."""

    robot: Annotated[
        tuple[Path, ...],
        Parameter(metavar="FILE[:NAMESPACE]"),
        typed.checked(_keep_file),
    ] = ()
    """Files of the robot: Nav2's parameters, a robot file, a URDF or SDF; later ones win."""
    lidar: Annotated[str | None, Parameter(choices=tuple(PRESETS))] = None
    """Lidar, or the robot that carries it."""
    set: Annotated[tuple[str, ...], Parameter(metavar="NAME=VALUE")] = ()
    """Any setting of the robot, such as range=8, footprint=0.3, margin=0, alpha1=0.05 or
    boundary_noise=0.1; repeatable; examples/guides/evidence.md lists all."""

    def load_robot(self, lidar: Lidar | None = None, *, recorded: bool = False) -> Robot:
        """The robot; the title of one from files goes to stderr.

        It has this lidar where the options name none, or, where it was recorded, in any case.
        """
        settings = typed.settings_of(self.set, "set", "alpha1=0.05", words=True)
        planner = settings.pop("planner", None)
        with warnings.catch_warnings():
            if recorded or any(name.startswith("mount_") for name in settings):
                warnings.filterwarnings("ignore", ".*set mount_x", locplan.robots.ParameterWarning)
            known = lidar if recorded else self.lidar
            robot = locplan.Robot.load(*self.robot, lidar=known, planner=planner)
        own = lidar if recorded else robot.lidar or lidar
        robot = dataclasses.replace(robot, lidar=own).changed(settings)
        # Ten times the range of the data sheet was hardly meant in metres.
        if self.lidar and robot.known_lidar.range > 10 * PRESETS[self.lidar].range:
            raise ConfigError(
                f"--set range must be in metres; the data sheet of {self.lidar} names"
                f" {PRESETS[self.lidar].range:g}, not {robot.known_lidar.range:g}"
            )
        note_robot(robot.title, robot.digest)
        if self.robot:
            print(one_line(f"robot: {robot.title}"), file=sys.stderr)
        return robot

    def robot_on(self, recording: Recording, *, replayed: bool = True) -> Robot:
        """The robot of a recorded drive, whose lidar and speed it has.

        A setting that it has of its own is a ConfigError: one of the lidar, and, where the drive is
        replayed, one of the noise.
        """
        self.refuse("with --drive, whose lidar is taken", "lidar")
        robot = recording.robot(self.load_robot(recording.lidar, recorded=True))
        kinds = locplan.robots.Odometry, locplan.robots.Disturbances
        names = {n for kind in (locplan.Lidar, *kinds * replayed) for n in typed.field_names(kind)}
        # The filter's start is drawn where recorded drives are replayed, too.
        drawn = "start_sigma", "start_sigma_deg"
        for name in (text.partition("=")[0] for text in self.set):
            if name in names and name not in drawn:
                raise ConfigError(f"--set {name} is not read with --drive, which has its own")
        return robot

    def simulated(self, robot: Robot | None = None, config: FieldConfig | None = None) -> Robot:
        """The robot with a lidar, that of a field if it names none; warns as `warn` does."""
        robot = locplan.field.equipped(robot or self.load_robot(), config)
        self.warn(robot)
        return robot

    def warn(self, robot: Robot) -> None:
        """Warn of settings of the filter that work badly with the robot's lidar."""
        others = locplan.robots.read_parameters(*self.nav2_files()).of("amcl")
        for fault in locplan.simulation.filter_warnings(robot.amcl, robot.known_lidar, others):
            warnings.warn(locplan.robots.ParameterWarning(fault), stacklevel=2)

    def nav2_file(self, node: str = "") -> Path | None:
        """The file that has most of a node's parameters, or the last of Nav2; None without."""
        files = self.nav2_files()
        if not (node and files):
            return files[-1] if files else None
        parameters = locplan.robots.read_parameters(*files)
        at = parameters.file_of(node)
        if at is not None:
            return files[at]
        return files[-1] if parameters.of(node) else None

    def nav2_files(self) -> list[Path]:
        """The files of Nav2's parameters, of those that the options name."""
        files = []
        for file in self.robot:
            with suppress(LocplanError):  # a file of another kind
                locplan.robots.read_parameters(file)
                files.append(file)
        return files


@typed.option_group("Robot")
class FilterMap(RobotOptions):
    """The robot, and the map of its filter."""

    filter_map: Annotated[Path | None, typed.checked(typed.keep_map), Parameter(metavar="MAP")] = (
        None
    )
    """Map of the robot's filter, in the same frame, where it is not the one driven in."""

    def load_filter_map(self, *grids: OccupancyGrid) -> OccupancyGrid | None:
        """The map of the filter, where it was named; it is of one map that is driven in.

        Warnings offer to mend a map on which the filter gets lost, and tell of masks.
        """
        self._warn_of_masks()
        own = [locplan.load_map(self.filter_map)] if self.filter_map else [*grids]
        for each in own:
            if offered := locplan.mending.offer(each):
                warnings.warn(locplan.maps.MapWarning(offered), stacklevel=2)
        if self.filter_map is None:
            return None
        (grid,) = own
        locplan.simulation.check_of_one_map(grid, grids)
        return locplan.simulation.check_filter_map(grid, grids[0])

    def _warn_of_masks(self) -> None:
        """Warn of maps that are masks for a costmap filter, as `info` does."""
        maps = getattr(self, "maps", None) or [getattr(self, "map_file", None)]
        for file in locplan.maps.find_maps(*filter(None, maps)):
            grid, source = locplan.maps.read_map(file)
            for fault in locplan.maps.of_mask(grid, source) if source else ():
                said = one_line(f"{file}: {fault.sentence}")
                warnings.warn(locplan.maps.MapWarning(said), stacklevel=2)


@typed.option_group("Field")
class FieldOptions(RobotOptions):
    """The robot, and the settings of the covariance field."""

    config: typed.ConfigFile = None
    """Settings of the field, as locplan.save_config wrote them, in place of the options below."""
    estimator: Annotated[str | None, Parameter(choices=tuple(ESTIMATORS))] = None
    """Estimator of the covariance; fused by default where the lidar is known, else the paper's
    sad."""
    preset: Literal["default", "paper"] | None = None
    """Settings of sad: the default ones, or Eq. 8-10 of the paper as printed."""
    disc: Annotated[float | None, Parameter(metavar="METRES")] = None
    """Radius of sad's template, in metres; 6 by default, or the lidar's range."""
    headings: int | None = None
    """Number of headings; 1 by default where the lidar sees all round, else 8."""
    template: Literal["disc", "visible"] | None = None
    """Template of sad: the paper's disc, or the part of it seen from its centre."""
    stride: float | None = None
    """Spacing of the evaluated cells, in metres; 0.2 by default. Where it is not given and a
    lidar is simulated, plan takes twice as much away from its paths."""

    def robot_and_field(self) -> tuple[Robot, FieldConfig]:
        """The robot, which has the lidar of the file of settings if no other, and the settings."""
        read = self._read()
        robot = self.load_robot(getattr(read.estimator, "lidar", None) if read else None)
        return robot, _seen_by(read, robot.lidar) if read else self._made(robot.lidar)

    def robot_and_fields(self, ranges: tuple[float, ...] | None) -> tuple[Robot, list[FieldConfig]]:
        """The robot, and the settings with each of the ranges [m], if there are any."""
        robot, config = self.robot_and_field()
        if ranges is None:
            return robot, [config]
        return robot, [_reaching(config, reach) for reach in ranges]

    def _read(self) -> FieldConfig | None:
        """The settings in the file, if one was given."""
        if self.config is None:
            return None
        if others := ", ".join(map(typed.flag, self.given(*FIELD[1:]))):
            raise ConfigError(f"--config has all settings of the field; leave out {others}")
        return locplan.load_config(self.config)

    def _made(self, lidar: Lidar | None) -> FieldConfig:
        """The settings that were asked for; `lidar` is the robot's, where it is known."""
        given = self.given(*FIELD)
        kind: Any = estimator_class(given.pop("estimator", "fused" if lidar else "sad"))
        if given:
            options = {name: _options_of(estimator_class(name)) for name in ESTIMATORS}
            typed.check_read(given, "--estimator", kind.name, options)
        others = {name: given.pop(name) for name in ("stride", "headings") if name in given}
        if kind.casts_rays:
            short, what = locplan.field.SHORT_LIDAR, "no lidar named, one assumed"
            assumed = dataclasses.replace(short, model=what)
            return locplan.FieldConfig(kind(lidar or assumed), **others)
        return locplan.FieldConfig(_with_template(kind, lidar, given), **others)


FIELD = tuple(inspect.get_annotations(FieldOptions))
"""Names of the options of the field, the file of all settings first."""


def _with_template(kind: Any, lidar: Lidar | None, given: dict[str, Any]) -> Estimator:
    """The estimator that compares a template with the map, of the options given."""
    made = kind.paper() if given.pop("preset", None) == "paper" else kind()
    if "disc" in given:
        given["range"] = given.pop("disc")
    made = made.with_lidar(lidar) if lidar else made
    changed: Estimator = dataclasses.replace(made, **given)
    return changed


def _options_of(kind: type[Estimator]) -> list[str]:
    """The options of `FieldOptions` that are for an estimator."""
    own = [{"range": "disc"}.get(name, name) for name in typed.field_names(kind)]
    return [*own, "stride", *["headings"] * kind.casts_rays, *["preset"] * hasattr(kind, "paper")]


def _seen_by(config: FieldConfig, lidar: Lidar | None) -> FieldConfig:
    """Settings with another lidar; the number of headings by default is that of the new one."""
    if lidar is None or lidar == getattr(config.estimator, "lidar", None):
        return config
    by_default = config.headings == config.estimator.headings
    return dataclasses.replace(
        config,
        estimator=config.estimator.with_lidar(lidar),
        headings=0 if by_default else config.headings,
    )


def _reaching(config: FieldConfig, reach: float) -> FieldConfig:
    """Settings with another range of the lidar, or of the template [m]."""
    lidar = getattr(config.estimator, "lidar", None)
    if lidar:
        return _seen_by(config, dataclasses.replace(lidar, range=reach))
    estimator: Any = config.estimator
    return dataclasses.replace(config, estimator=dataclasses.replace(estimator, range=reach))
