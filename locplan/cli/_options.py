"""Groups of options that commands share, each written once, and the objects made of them.

An option that was not given is None, and means the library's own default.
"""

from __future__ import annotations

import dataclasses
import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Protocol

from cyclopts import Parameter

from locplan.cli._groups import COMPUTING, COSTS, FIELD, INPUT, option_group
from locplan.cli._kinds import check_has, field_names, given_of
from locplan.cli._robot_options import RobotOptions
from locplan.cli._values import numbers
from locplan.errors import ConfigError
from locplan.field import ESTIMATORS

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from locplan.costs import Costmap
    from locplan.field import CovarianceField, Estimator, FieldConfig
    from locplan.maps import OccupancyGrid
    from locplan.robots import Lidar, Robot

    class Compute(Protocol):
        """A function that gives the field of a map, or its values at some lattice points."""

        def __call__(
            self, grid: OccupancyGrid, points: NDArray[np.bool_] | None = None
        ) -> CovarianceField: ...


LOG = logging.getLogger("locplan.cli")

Criterion = Annotated[
    str | None,
    Parameter(
        group=COSTS,
        help="Scalar that the degeneracy u is made of: e (default of sad), position_std (default of"
        " the others), position_rms or heading_std; ambiguity or entropy of scan and fused.",
    ),
]


def _bearable(_: object, threads: int | None) -> None:
    from locplan._util.checks import check_threads

    check_threads(threads)


Threads = Annotated[
    int | None,
    Parameter(
        group=COMPUTING,
        validator=_bearable,
        help="Number of threads; all cores by default.",
    ),
]
CacheDir = Annotated[
    Path | None,
    Parameter(help="Folder of the computed fields; LOCPLAN_CACHE names it, too."),
]


@option_group(FIELD)
class FieldOptions:
    """The settings of the covariance field."""

    config: Annotated[Path | None, INPUT, Parameter(metavar="FILE.json")] = None
    """All settings of the field, as calibrate wrote them, in place of the options below."""
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
    """Spacing of the evaluated cells, in metres; 0.2 by default. where it is not given and a
    lidar is simulated, plan takes twice as much away from its paths."""

    def with_robot(self, given: RobotOptions) -> tuple[Robot, FieldConfig]:
        """The robot, which has the lidar of the file of settings if no other, and the settings."""
        read = self._read()
        robot = given.load(getattr(read.estimator, "lidar", None) if read else None)
        return robot, _seen_by(read, robot.lidar) if read else self._made(robot.lidar)

    def simulated(self, given: RobotOptions) -> tuple[Robot, FieldConfig]:
        """The robot, which has the field's lidar if no other, and the field's settings.

        Warns of settings of the robot's filter that work badly with the lidar.
        """
        from locplan.field import equipped

        robot, config = self.with_robot(given)
        robot = equipped(robot, config)
        given.warn(robot)
        return robot, config

    def of_drive(self, lidar: Lidar) -> FieldConfig:
        """The settings of a field for a recorded drive; an estimator that casts rays has its lidar.

        Without an estimator it is fused.
        """
        read = self._read()
        config = _seen_by(read, lidar) if read else self._made(lidar)
        return config if config.estimator.casts_rays else read or self._made(None)

    def to_configs(
        self, given: RobotOptions, ranges: str | None
    ) -> tuple[Robot, list[FieldConfig]]:
        """The robot, and the settings with each of the ranges in a text [m], if there is one."""
        robot, config = self.with_robot(given)
        if ranges is None:
            return robot, [config]
        return robot, [_reaching(config, reach) for reach in numbers("ranges", ranges)]

    def _read(self) -> FieldConfig | None:
        """The settings in the file, if one was given."""
        from locplan.field import load_config

        if self.config is None:
            return None
        others = [_flag(name) for name in given_of(self) if name != "config"]
        if others:
            raise ConfigError(
                f"--config has all settings of the field; leave out {', '.join(others)}"
            )
        return load_config(self.config)

    def _made(self, lidar: Lidar | None) -> FieldConfig:
        """The settings that were asked for; `lidar` is the robot's, where it is known."""
        from locplan.field import FieldConfig, estimator_class

        given = given_of(self)
        kinds = [estimator_class(name) for name in ESTIMATORS]
        kind: Any = estimator_class(given.pop("estimator", "fused" if lidar else "sad"))
        for name in given:
            having = [each.name for each in kinds if _takes(each, name)]
            check_has(_flag(name), "--estimator", kind.name, having)
        others = {name: given.pop(name) for name in ("stride", "headings") if name in given}
        if kind.casts_rays:
            return FieldConfig(kind.of(lidar or _assumed()), **others)
        return FieldConfig(_with_template(kind, lidar, given), **others)


def _with_template(kind: Any, lidar: Lidar | None, given: dict[str, Any]) -> Estimator:
    """The estimator that compares a template with the map, of the options given."""
    made = kind.paper() if given.pop("preset", None) == "paper" else kind()
    if "disc" in given:
        given["range"] = given.pop("disc")
    made = made.with_lidar(lidar) if lidar else made
    changed: Estimator = dataclasses.replace(made, **given)
    return changed


def _flag(name: str) -> str:
    """The option of a field of `FieldOptions`, as it is typed."""
    return f"--{name.replace('_', '-')}"


def _takes(kind: type[Estimator], option: str) -> bool:
    """True if an option of `FieldOptions` is for this estimator."""
    if option == "headings":
        return kind.casts_rays
    if option in ("stride", "preset"):
        return option == "stride" or hasattr(kind, "paper")
    return {"disc": "range"}.get(option, option) in field_names(kind)


def _assumed() -> Lidar:
    """The lidar of estimators that need one where none is named."""
    from locplan.field import SHORT_LIDAR

    return dataclasses.replace(SHORT_LIDAR, model="no lidar named, one assumed")


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


def _has_scheduler(_: object, scheduler: str | None) -> None:
    from locplan.field import check_scheduler

    if scheduler is not None:
        check_scheduler(scheduler)


@option_group(COMPUTING)
class Computing:
    """The resources for fields, and their cache."""

    threads: Threads = None
    scheduler: Annotated[
        str | None, Parameter(metavar="tcp://HOST:PORT", validator=_has_scheduler)
    ] = None
    """Dask cluster that computes the field."""
    cache_dir: CacheDir = None

    @contextmanager
    def of(
        self, config: FieldConfig, *, whole: bool = False, then: Callable[[], None] = lambda: None
    ) -> Iterator[Compute]:
        """The function that gives the field of a map: read, or computed here or on a cluster.

        It has the whole field even where some points are asked for, if so, and calls `then` last.
        """
        from locplan._util.progress import progress_bar
        from locplan.field import executor_of, load_or_compute

        with executor_of(self.scheduler) if self.scheduler else nullcontext() as executor:

            def compute(
                grid: OccupancyGrid, points: NDArray[np.bool_] | None = None
            ) -> CovarianceField:
                started = time.perf_counter()
                with progress_bar(f"field of {grid.name}", "cells") as progress:
                    field = load_or_compute(
                        grid,
                        config,
                        points=None if whole else points,
                        cache_dir=self.cache_dir,
                        threads=self.threads,
                        executor=executor,
                        progress=progress,
                    )
                took = time.perf_counter() - started
                LOG.info("field of %s: %.1f s, %s", grid.name, took, config)
                then()
                return field

            yield compute

    def field(self, grid: OccupancyGrid, config: FieldConfig) -> CovarianceField:
        """The field of one map."""
        with self.of(config) as compute:
            return compute(grid)


@option_group(COSTS)
class CostOptions:
    """The costs of a path."""

    weight: float | None = None
    """Detour accepted per degenerate metre, in metres; by default the estimator's own, 4 for sad
    and 8 for the others."""
    criterion: Criterion = None

    def check(self, config: FieldConfig) -> None:
        """Raise a ConfigError if an option is out of range; to be called before long work."""
        from locplan.costs import check_criterion, check_weight

        if self.weight is not None:
            check_weight(self.weight)
        if self.criterion is not None:
            check_criterion(self.criterion, config)

    def costmap(self, grid: OccupancyGrid, field: CovarianceField, robot: Robot) -> Costmap:
        """The costmap of a field for a robot."""
        from locplan.costs import Costmap

        return Costmap.from_field(grid, field, robot_radius=robot.radius, **given_of(self))
