"""Options of the commands that simulate, and the objects made of them."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict

from cyclopts import Parameter

from locplan.cli._groups import INPUT, SIMULATION, Count, Pair, Seed, option_group, results
from locplan.cli._values import settings_of

if TYPE_CHECKING:
    from locplan.field import FieldConfig, Lidar
    from locplan.simulation._settings import Amcl, Disturbances

Folder = Annotated[Path | None, results("Pictures, JSON and CSV are written to this folder.")]


class Simulated(TypedDict):
    """The arguments that all simulations have."""

    lidar: Lidar
    amcl: Amcl
    disturbances: Disturbances
    seed: int


class Robot(TypedDict):
    """The filter and the disturbances of a simulation."""

    amcl: Amcl
    disturbances: Disturbances


@option_group(SIMULATION)
class FilterOptions:
    """The robot's filter, and the disturbances of it and of the lidar."""

    params: Annotated[Path | None, INPUT, Parameter(metavar="FILE")] = None
    """The settings of amcl in this parameter file of Nav2 are simulated."""
    set: Annotated[tuple[str, ...], Parameter(metavar="NAME=VALUE")] = ()
    """A setting of AMCL (alpha1, max_particles, laser_model_type, ...) or a disturbance
    (boundary_noise, outliers, heading_bias_deg, ...) is changed; repeatable; examples/README.md
    lists all."""

    def robot(self, lidar: Lidar, *, lints: bool = True) -> tuple[Robot, tuple[str, ...]]:
        """The filter and the disturbances, and the parameters that are not simulated.

        Warns of parameters that work badly with this lidar, unless `lints` is False.
        """
        from locplan.simulation._nav2 import ParameterWarning, other_parameters, read_filter
        from locplan.simulation._settings import Amcl, Disturbances, changed
        from locplan.simulation.tuning._lint import lint

        read, left_out = read_filter(self.params) if self.params else (Amcl(), ())
        settings = settings_of(self.set, "set", "alpha1=0.05", words=True)
        amcl, disturbances = changed(read, Disturbances(), settings)
        for fault in lint(amcl, lidar, other_parameters(self.params)) if lints else ():
            warnings.warn(ParameterWarning(fault), stacklevel=2)
        return {"amcl": amcl, "disturbances": disturbances}, left_out


@option_group(SIMULATION)
class SimulationOptions(FilterOptions):
    """The robot's filter, the disturbances of it and of the lidar, and the seed."""

    seed: Seed = 1
    """The seed of all random numbers is 1 by default."""

    def simulated(
        self, config: FieldConfig, named: Lidar | None, *, lints: bool = True
    ) -> Simulated:
        """The lidar, that of the field unless one is named, the filter, and the disturbances."""
        from locplan.simulation._nav2 import warn_of
        from locplan.simulation._settings import lidar_of

        lidar = named or lidar_of(config)
        robot, left_out = self.robot(lidar, lints=lints)
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
