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

from locplan._util.files import keep_input
from locplan._util.runs import note_robot
from locplan.cli._groups import ROBOT, option_group
from locplan.cli._kinds import field_names
from locplan.cli._values import refuse, settings_of
from locplan.errors import ConfigError, LocplanError, one_line
from locplan.robots import PRESETS

if TYPE_CHECKING:
    from locplan.recordings import Recording
    from locplan.robots import Lidar, Robot

BEYOND = 10.0
"""Ratio to the data sheet's range above which a range was hardly meant in metres."""
START = ("start_sigma", "start_sigma_deg")
"""Disturbances of the filter alone, with which recorded drives are replayed."""


def _keep_files(_: object, files: Sequence[Path]) -> None:
    from locplan.robots import file_and_robot

    for file in files:
        keep_input(file_and_robot(file)[0])


@option_group(ROBOT)
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
        from locplan.robots import Lidar, Robot

        robot = Robot.load(*self.robot)
        named = Lidar.preset(self.lidar) if self.lidar else robot.lidar
        own = lidar if recorded else named or lidar
        settings = settings_of(self.set, "set", "alpha1=0.05", words=True)
        robot = dataclasses.replace(robot, lidar=own).changed(settings)
        if self.lidar and robot.known_lidar.range > BEYOND * PRESETS[self.lidar].range:
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
        from locplan.robots import Disturbances, Lidar, Odometry

        refuse("with --drive, whose lidar is taken", lidar=self.lidar)
        robot = recording.robot(self.load(recording.lidar, recorded=True))
        own = [Lidar, *([Odometry, Disturbances] if replayed else [])]
        names = {name for kind in own for name in field_names(kind)} - {*START}
        for name in (text.partition("=")[0] for text in self.set):
            if name in names:
                raise ConfigError(f"--set {name} is not read with --drive, which has its own")
        return robot

    def warn(self, robot: Robot) -> None:
        """Warn of settings of the filter that work badly with the robot's lidar."""
        from locplan.robots import ParameterWarning, read_parameters
        from locplan.simulation import filter_warnings

        others = read_parameters(self.nav2_file("amcl")).of("amcl")
        for fault in filter_warnings(robot.amcl, robot.known_lidar, others):
            warnings.warn(ParameterWarning(fault), stacklevel=2)

    def nav2_file(self, node: str = "") -> Path | None:
        """The last file that has Nav2's parameters, or those of a node; None without one.

        It is for files that `load` has read.
        """
        from locplan.robots import read_parameters

        for file in reversed(self.robot):
            with suppress(LocplanError):  # a file of another kind
                parameters = read_parameters(file)
                if not node or parameters.of(node):
                    return file
        return None
