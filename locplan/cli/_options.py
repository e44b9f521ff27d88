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
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from locplan.cli._groups import COMPUTING, COSTS, FIELD, INPUT, option_group
from locplan.cli._kinds import check_has, field_names, given_of
from locplan.cli._values import numbers
from locplan.errors import ConfigError
from locplan.field import ESTIMATORS

if TYPE_CHECKING:
    from locplan.costs import Costmap
    from locplan.field import CovarianceField, Estimator, FieldConfig
    from locplan.maps import OccupancyGrid

    Compute = Callable[[OccupancyGrid], CovarianceField]

LOG = logging.getLogger("locplan.cli")
LIDAR = "--sensor"
"""The option that names the lidar of a field."""
LIDARS = ("rplidar-a1", "utm-30lx", "lms291", "urg-04lx")

RobotRadius = Annotated[
    float | None, Parameter(group=COSTS, help="The robot's radius is 0.25 by default [m].")
]
Criterion = Annotated[
    str | None,
    Parameter(
        group=COSTS,
        help="The degeneracy u is made of e (default), position_std, position_rms or heading_std,"
        " or of ambiguity or entropy of scan.",
    ),
]


def _bearable(_: object, threads: int | None) -> None:
    from locplan._util.machine import check_threads

    check_threads(threads)


Threads = Annotated[
    int | None,
    Parameter(
        group=COMPUTING,
        validator=_bearable,
        help="The number of threads is that of the cores by default.",
    ),
]
CacheDir = Annotated[
    Path | None,
    Parameter(help="Computed fields are kept in this folder; LOCPLAN_CACHE does the same."),
]


@option_group(FIELD)
class FieldOptions:
    """The settings of the covariance field."""

    config: Annotated[Path | None, INPUT, Parameter(metavar="FILE.json")] = None
    """This file has all settings, as calibrate wrote them; only --range may be given beside it."""
    estimator: Annotated[str | None, Parameter(choices=tuple(ESTIMATORS))] = None
    """The estimator is the paper's sad by default; fisher and scan know the lidar."""
    preset: Literal["default", "paper"] | None = None
    """The settings of sad are the default ones, or Eq. 8-10 of the paper as printed."""
    range: float | None = None
    """The lidar's range [m] is 6 by default, or that of the lidar that is named."""
    lidar: Annotated[str | None, Parameter(name=LIDAR, choices=LIDARS)] = None
    """The lidar is one of these, for fisher and scan."""
    field_of_view: float | None = None
    """The lidar's field of view [deg] is 360 by default, or that of the lidar that is named."""
    headings: int | None = None
    """The number of headings is 1 by default where the lidar sees all round, else 8."""
    template: Literal["disc", "visible"] | None = None
    """The template of sad is the paper's disc, or the part of it seen from its centre."""
    stride: float | None = None
    """The spacing of the evaluated cells is 0.2 by default [m]."""

    def to_config(self, reach: float | None = None) -> FieldConfig:
        """The settings of a field that were asked for; `reach` replaces the range."""
        from locplan.field import FieldConfig, Lidar, load_config
        from locplan.field._registry import estimator_class
        from locplan.field.estimators._sad import PAPER_RANGE

        given = given_of(self)
        own = given.pop("range", None)
        reach = own if reach is None else reach
        if self.config is not None:
            if len(given) > 1:
                names = [name for name in field_names(self) if name not in ("config", "range")]
                rest = ", ".join(map(_flag, names))
                raise ConfigError(
                    "--config has all settings of the field; besides it only --range may be given,"
                    f" none of {rest}"
                )
            config = load_config(self.config)
            return dataclasses.replace(config, estimator=_reaching(config.estimator, reach))
        kinds = [estimator_class(name) for name in ESTIMATORS]
        kind: Any = estimator_class(given.pop("estimator", "sad"))
        for name in given:
            check_has(
                _flag(name), "--estimator", kind.name, [k.name for k in kinds if _takes(k, name)]
            )
        others = {name: given.pop(name) for name in ("stride", "headings") if name in given}
        if _takes(kind, "lidar"):
            named, view = given.pop("lidar", None), given.pop("field_of_view", None)
            lidar = Lidar.preset(named) if named else Lidar(range=PAPER_RANGE)
            turned = lidar if view is None else dataclasses.replace(lidar, field_of_view_deg=view)
            estimator = kind(turned, **given)
        else:
            made = kind.paper if given.pop("preset", None) == "paper" else kind
            estimator = dataclasses.replace(made(), **given)
        return FieldConfig(_reaching(estimator, reach), **others)

    def to_configs(self, ranges: str | None) -> list[FieldConfig]:
        """The settings with each of the ranges in a text [m], or as they are without a text."""
        return [self.to_config(r) for r in (numbers("ranges", ranges) if ranges else (None,))]


def _flag(name: str) -> str:
    """The option of a field of `FieldOptions`, as it is typed."""
    return LIDAR if name == "lidar" else f"--{name.replace('_', '-')}"


def _takes(kind: type[Estimator], option: str) -> bool:
    """True if an option of `FieldOptions` is for this estimator."""
    if option in ("stride", "preset"):
        return option == "stride" or hasattr(kind, "paper")
    own = "lidar" if option in ("field_of_view", "headings") else option
    return own in field_names(kind)


def _reaching(estimator: Any, reach: float | None) -> Any:
    """An estimator with another range [m], unless that is None."""
    if reach is None:
        return estimator
    from locplan.field._registry import estimator_class

    if _takes(type(estimator), "lidar"):
        lidar = dataclasses.replace(estimator.lidar, range=reach)
        return dataclasses.replace(estimator, lidar=lidar)
    kinds = [estimator_class(name) for name in ESTIMATORS]
    having = [kind.name for kind in kinds if _takes(kind, "range") or _takes(kind, "lidar")]
    check_has("--range", "--estimator", estimator.name, having)
    return dataclasses.replace(estimator, range=reach)


def _has_scheduler(_: object, scheduler: str | None) -> None:
    from locplan.field._cluster import check_scheduler

    if scheduler is not None:
        check_scheduler(scheduler)


@option_group(COMPUTING)
class Computing:
    """The resources for fields, and their cache."""

    threads: Threads = None
    scheduler: Annotated[
        str | None, Parameter(metavar="tcp://HOST:PORT", validator=_has_scheduler)
    ] = None
    """A dask cluster computes the field."""
    cache_dir: CacheDir = None

    @contextmanager
    def of(self, config: FieldConfig) -> Iterator[Compute]:
        """The function that gives the field of a map: read, or computed here or on a cluster."""
        from locplan._util.progress import progress_bar
        from locplan.field import load_or_compute
        from locplan.field._cluster import executor_of

        with executor_of(self.scheduler) if self.scheduler else nullcontext() as executor:

            def compute(grid: OccupancyGrid) -> CovarianceField:
                started = time.perf_counter()
                with progress_bar(f"field of {grid.name}", "cells") as progress:
                    field = load_or_compute(
                        grid,
                        config,
                        cache_dir=self.cache_dir,
                        threads=self.threads,
                        executor=executor,
                        progress=progress,
                    )
                took = time.perf_counter() - started
                LOG.info("field of %s: %.1f s, %s", grid.name, took, config)
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
    """The weight is the detour accepted per degenerate metre [m]; by default the estimator's own,
    4 for sad."""
    criterion: Criterion = None
    robot_radius: RobotRadius = None

    def check(self, config: FieldConfig) -> None:
        """Raise a ConfigError if an option is out of range; to be called before long work."""
        from locplan.costs._costmap import check_weight
        from locplan.costs._degeneracy import check_criterion

        if self.weight is not None:
            check_weight(self.weight)
        if self.criterion is not None:
            check_criterion(self.criterion, config)

    def costmap(self, grid: OccupancyGrid, field: CovarianceField) -> Costmap:
        """The costmap of a field."""
        from locplan.costs import Costmap

        return Costmap.from_field(grid, field, **given_of(self))

    def blank(self, grid: OccupancyGrid) -> Costmap:
        """The costmap of the map alone, to check positions before long work."""
        from locplan.costs import Costmap

        return Costmap.blank(grid, robot_radius=radius_of(self.robot_radius))


def radius_of(robot_radius: float | None) -> float:
    """The robot's radius that was given, or the library's own [m]."""
    from locplan.costs import ROBOT_RADIUS

    return ROBOT_RADIUS if robot_radius is None else robot_radius
