"""Options of the robot, and the robot made of them."""

from __future__ import annotations

import dataclasses
import sys
import warnings
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

import locplan
from locplan._util.files import keep_input
from locplan._util.runs import note_robot
from locplan.cli._groups import option_group
from locplan.cli._values import field_names, refuse, settings_of
from locplan.errors import ConfigError, LocplanError, one_line
from locplan.robots import PRESETS

if TYPE_CHECKING:
    from locplan import Lidar, Robot
    from locplan.recordings import Recording


def _keep_files(_: object, files: Sequence[Path]) -> None:
    for file in files:
        keep_input(locplan.robots.file_and_robot(file)[0])


@option_group("Robot")
class RobotOptions:
    """The robot."""

    robot: Annotated[
        tuple[Path, ...], Parameter(validator=_keep_files, metavar="FILE[:NAMESPACE]")
    ] = ()
    """Files of the robot: Nav2's parameters, a robot file, a URDF or SDF; later ones win."""
    lidar: Annotated[str | None, Parameter(choices=tuple(PRESETS))] = None
    """Lidar, or the robot that carries it."""
    set: Annotated[tuple[str, ...], Parameter(metavar="NAME=VALUE")] = ()
    """Any setting of the robot, such as range=8, footprint=0.3, margin=0, alpha1=0.05 or
    boundary_noise=0.1; repeatable; examples/guides/evidence.md lists all."""

    def load(self, lidar: Lidar | None = None, *, recorded: bool = False) -> Robot:
        """The robot; the title of one from files goes to stderr.

        It has this lidar where the options name none, or, where it was recorded, in any case.
        """
        robot = locplan.Robot.load(*self.robot)
        named = locplan.Lidar.preset(self.lidar) if self.lidar else robot.lidar
        own = lidar if recorded else named or lidar
        settings = settings_of(self.set, "set", "alpha1=0.05", words=True)
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

    def on_drive(self, recording: Recording, *, replayed: bool = True) -> Robot:
        """The robot of a recorded drive, whose lidar and speed it has.

        Raises
        ------
        ConfigError
            If a setting is given that the recording has of its own: one of the lidar, and, where it
            is replayed, one of the noise.
        """
        refuse("with --drive, whose lidar is taken", lidar=self.lidar)
        robot = recording.robot(self.load(recording.lidar, recorded=True))
        kinds = locplan.robots.Odometry, locplan.robots.Disturbances
        own = [locplan.Lidar, *(kinds if replayed else ())]
        # The filter's start is drawn where recorded drives are replayed, too.
        names = {n for kind in own for n in field_names(kind)} - {"start_sigma", "start_sigma_deg"}
        for name in (text.partition("=")[0] for text in self.set):
            if name in names:
                raise ConfigError(f"--set {name} is not read with --drive, which has its own")
        return robot

    def simulated(self) -> Robot:
        """The robot with a lidar, the fields' own where none is named; warns as `warn` does."""
        robot = locplan.field.equipped(self.load())
        self.warn(robot)
        return robot

    def warn(self, robot: Robot) -> None:
        """Warn of settings of the filter that work badly with the robot's lidar."""
        others = locplan.robots.read_parameters(self.nav2_file("amcl")).of("amcl")
        for fault in locplan.simulation.filter_warnings(robot.amcl, robot.known_lidar, others):
            warnings.warn(locplan.robots.ParameterWarning(fault), stacklevel=2)

    def nav2_file(self, node: str = "") -> Path | None:
        """The last file that has Nav2's parameters, or those of a node; None without one.

        It is for files that `load` has read.
        """
        for file in reversed(self.robot):
            with suppress(LocplanError):  # a file of another kind
                parameters = locplan.robots.read_parameters(file)
                if not node or parameters.of(node):
                    return file
        return None
