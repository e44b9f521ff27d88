"""Options of the commands that simulate, and the objects made of them."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict

from cyclopts import Parameter

from locplan.cli._groups import SIMULATION, Count, Pair, Params, Seed, option_group, results
from locplan.cli._values import settings_of
from locplan.errors import ConfigError

if TYPE_CHECKING:
    from locplan.field import FieldConfig
    from locplan.robots import Amcl, Disturbances, Lidar

Folder = Annotated[Path | None, results("Pictures, JSON and CSV are written to this folder.")]


class Simulated(TypedDict):
    """The arguments that all simulations have."""

    lidar: Lidar
    amcl: Amcl
    disturbances: Disturbances
    seed: int


class Replayed(TypedDict):
    """The filter of a replay, and the spread of its first pose."""

    amcl: Amcl
    start_sigma: float
    start_sigma_deg: float


class Robot(TypedDict):
    """The filter and the disturbances of a simulation."""

    amcl: Amcl
    disturbances: Disturbances


@option_group(SIMULATION)
class FilterOptions:
    """The robot's filter, and the disturbances of it and of the lidar."""

    params: Params = None
    """The settings of amcl in this parameter file of Nav2 are simulated, and the robot has the
    robot_radius or the footprint of its costmaps; of several robots that of a namespace."""
    set: Annotated[tuple[str, ...], Parameter(metavar="NAME=VALUE")] = ()
    """A setting of AMCL (alpha1, max_particles, laser_model_type, ...) or a disturbance
    (boundary_noise, outliers, heading_bias_deg, ...) is changed; repeatable;
    examples/guides/evidence.md lists all."""

    def robot(
        self, lidar: Lidar, *, config: Path | None = None, lints: bool = True
    ) -> tuple[Robot, tuple[str, ...]]:
        """The filter and the disturbances, and the parameters that are not simulated.

        They are those of a file of settings, `config`, but the filter is that of the robot's own
        parameters where they are given. Warns of parameters that work badly with this lidar, unless
        `lints` is False.
        """
        from locplan.robots import (
            Amcl,
            Disturbances,
            ParameterWarning,
            changed,
            other_parameters,
            read_filter,
            read_robot,
        )
        from locplan.simulation.tuning._lint import lint

        calibrated, known = read_robot(config) if config else (Amcl(), Disturbances())
        read, left_out = read_filter(self.params) if self.params else (calibrated, ())
        settings = settings_of(self.set, "set", "alpha1=0.05", words=True)
        amcl, disturbances = changed(read, known, settings)
        for fault in lint(amcl, lidar, other_parameters(self.params)) if lints else ():
            warnings.warn(ParameterWarning(fault), stacklevel=2)
        return {"amcl": amcl, "disturbances": disturbances}, left_out

    def replayed(self, lidar: Lidar, *, config: Path | None, lints: bool = True) -> Replayed:
        """The filter that recorded drives are replayed with, and the spread of its first pose.

        Raises
        ------
        ConfigError
            If a disturbance is set that the recording has of its own.
        """
        from locplan.robots import warn_of

        names = [text.partition("=")[0] for text in self.set]
        refuse_those_of_drives(names)
        robot, left_out = self.robot(lidar, config=config, lints=lints)
        if self.params:
            warn_of(self.params, left_out)
        start = robot["disturbances"]
        return {
            "amcl": robot["amcl"],
            "start_sigma": start.start_sigma,
            "start_sigma_deg": start.start_sigma_deg,
        }


def refuse_those_of_drives(names: Sequence[str]) -> None:
    """Raise a ConfigError if a disturbance is named that a recorded drive has of its own."""
    from locplan.cli._kinds import field_names
    from locplan.robots import Disturbances

    for name in names:
        if name in field_names(Disturbances) and not name.startswith("start_sigma"):
            raise ConfigError(f"--set {name} is not read with --drive, which has its own noise")


@option_group(SIMULATION)
class SimulationOptions(FilterOptions):
    """The robot's filter, the disturbances of it and of the lidar, and the seed."""

    seed: Seed = 1
    """The seed of all random numbers is 1 by default."""

    def simulated(
        self,
        config: FieldConfig,
        named: Lidar | None,
        *,
        file: Path | None = None,
        lints: bool = True,
    ) -> Simulated:
        """The lidar, that of the field unless one is named, the filter, and the disturbances.

        `file` is the file of settings that was given, if any.
        """
        from locplan.field import lidar_of
        from locplan.robots import warn_of

        lidar = named or lidar_of(config)
        robot, left_out = self.robot(lidar, config=file, lints=lints)
        if self.params:
            warn_of(self.params, left_out)
        return {"lidar": lidar, **robot, "seed": self.seed}


@option_group(SIMULATION)
class AtPlaces:
    """The number of places drawn at random, and of the simulations at each."""

    places: Pair = 100
    """The number of places on each map is 100 by default."""
    drives: Count | None = None
    """The number of drives of 10 m to each place is 16 by default."""
    scans: Count | None = None
    """The number of single scans matched at each place is 16 by default."""
