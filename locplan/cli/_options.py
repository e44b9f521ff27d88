"""Groups of options that commands share, each written once, and the objects made of them.

An option that was not given is None, and means the library's own default.
"""

from __future__ import annotations

import dataclasses
import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Protocol

from cyclopts import Parameter

from locplan.cli._groups import COMPUTING, COSTS, FIELD, INPUT, option_group
from locplan.cli._kinds import check_has, field_names, given_of
from locplan.cli._values import numbers, refuse, size_in
from locplan.errors import ConfigError, FieldError
from locplan.field import ESTIMATORS
from locplan.robots import PRESETS

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from locplan.costs import Costmap
    from locplan.field import CovarianceField, Estimator, FieldConfig
    from locplan.maps import OccupancyGrid
    from locplan.robots import Lidar

    class Compute(Protocol):
        """A function that gives the field of a map, or its values at some lattice points."""

        def __call__(
            self, grid: OccupancyGrid, points: NDArray[np.bool_] | None = None
        ) -> CovarianceField: ...


LOG = logging.getLogger("locplan.cli")

RobotRadius = Annotated[
    float | None, Parameter(group=COSTS, help="The robot's radius is 0.25 by default [m].")
]
Criterion = Annotated[
    str | None,
    Parameter(
        group=COSTS,
        help="The degeneracy u is made of e (default of sad), position_std (default of the others),"
        " position_rms or heading_std, or of ambiguity or entropy of scan and fused.",
    ),
]


BEYOND = 10.0
"""Ratio to the data sheet's range above which a range was hardly meant in metres."""


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
    """The lidar, and the settings of the covariance field."""

    lidar: Annotated[str | None, Parameter(choices=tuple(PRESETS))] = None
    """The lidar, or the robot that carries it, is one of these; it decides the estimator, too."""
    range: float | None = None
    """The lidar's range [m] is that of its data sheet, or 6 by default where none is named."""
    field_of_view: float | None = None
    """The lidar's field of view [deg] is that of its data sheet, or 360 where none is named."""
    config: Annotated[Path | None, INPUT, Parameter(metavar="FILE.json")] = None
    """This file has all settings, as calibrate wrote them, and those of simulated robots if they
    are of a recorded drive; only a lidar may be given beside it."""
    estimator: Annotated[str | None, Parameter(choices=tuple(ESTIMATORS))] = None
    """The estimator is fused by default where a lidar is named, and else the paper's sad."""
    preset: Literal["default", "paper"] | None = None
    """The settings of sad are the default ones, or Eq. 8-10 of the paper as printed."""
    headings: int | None = None
    """The number of headings is 1 by default where the lidar sees all round, else 8."""
    template: Literal["disc", "visible"] | None = None
    """The template of sad is the paper's disc, or the part of it seen from its centre."""
    stride: float | None = None
    """The spacing of the evaluated cells is 0.2 by default [m]; plan and choose take twice as much
    away from their paths, where a lidar is simulated."""

    def named_lidar(self, reach: float | None = None) -> Lidar | None:
        """The lidar that was named, or None; `reach` replaces its range [m]."""
        from locplan.robots import Lidar

        if self.lidar is None:
            return None
        reach = self.range if reach is None else reach
        sheet = Lidar.preset(self.lidar)
        if reach is not None and reach > BEYOND * sheet.range:
            raise ConfigError(
                f"--range must be in metres; the data sheet of {self.lidar} names {sheet.range:g},"
                f" not {reach:g}"
            )
        return _changed(sheet, reach, self.field_of_view)

    def own_lidar(self, config: FieldConfig) -> Lidar | None:
        """The lidar that was named, or that of the settings in the file; None without either."""
        of_file = getattr(config.estimator, "lidar", None) if self.config else None
        return self.named_lidar() or of_file

    def to_config(self, reach: float | None = None) -> FieldConfig:
        """The settings of a field that were asked for; `reach` replaces the range [m]."""
        from locplan.field import FieldConfig, load_config
        from locplan.field._registry import estimator_class

        lidar = self.named_lidar(reach)
        given = given_of(self)
        own, view = given.pop("range", None), given.pop("field_of_view", None)
        reach = own if reach is None else reach
        given.pop("lidar", None)
        if self.config is not None:
            if len(given) > 1:
                allowed = ("config", "lidar", "range", "field_of_view")
                names = [name for name in field_names(self) if name not in allowed]
                raise ConfigError(
                    "--config has all settings of the field; besides it only a lidar and its range"
                    f" and field of view may be given, none of {', '.join(map(_flag, names))}"
                )
            config = load_config(self.config)
            estimator = _seen_by(config.estimator, lidar, reach, view)
            own = config.headings == config.estimator.headings  # by default, as is the new one's
            headings = 0 if own else config.headings
            return dataclasses.replace(config, estimator=estimator, headings=headings)
        kinds = [estimator_class(name) for name in ESTIMATORS]
        kind: Any = estimator_class(given.pop("estimator", "fused" if lidar else "sad"))
        for name in given:
            check_has(
                _flag(name), "--estimator", kind.name, [k.name for k in kinds if _takes(k, name)]
            )
        others = {name: given.pop(name) for name in ("stride", "headings") if name in given}
        if kind.casts_rays:
            made = kind.of(lidar or _assumed())
        else:
            paper = given.pop("preset", None) == "paper"
            made = dataclasses.replace(kind.paper() if paper else kind(), **given)
        return FieldConfig(_seen_by(made, lidar, reach, view), **others)

    def of_drive(self, lidar: Lidar) -> FieldConfig:
        """The settings of a field for a recorded drive: its lidar takes the place of a named one.

        Without an estimator it is fused.
        """
        from locplan.field import FieldConfig, Fused

        refuse("with --drive, whose lidar is taken", lidar=self.lidar, range=self.range)
        refuse("with --drive, whose lidar is taken", field_of_view=self.field_of_view)
        if set(given_of(self)) <= {"stride", "headings"}:
            return FieldConfig(Fused.of(lidar), **given_of(self))
        config = self.to_config()
        if not config.estimator.casts_rays:
            return config
        headings = {} if self.headings else {"headings": 0}
        return dataclasses.replace(config, estimator=config.estimator.with_lidar(lidar), **headings)

    def is_fine_near_paths(self, config: FieldConfig) -> bool:
        """Whether a field on which paths are planned need only be fine near these.

        It need where a lidar is simulated, which takes long, and no spacing was given.
        """
        return config.estimator.casts_rays and self.stride is None and self.config is None

    def to_configs(self, ranges: str | None) -> list[FieldConfig]:
        """The settings with each of the ranges in a text [m], or as they are without a text."""
        return [self.to_config(r) for r in (numbers("ranges", ranges) if ranges else (None,))]


def _flag(name: str) -> str:
    """The option of a field of `FieldOptions`, as it is typed."""
    return f"--{name.replace('_', '-')}"


def _takes(kind: type[Estimator], option: str) -> bool:
    """True if an option of `FieldOptions` is for this estimator."""
    if option == "headings":
        return kind.casts_rays
    if option in ("stride", "preset"):
        return option == "stride" or hasattr(kind, "paper")
    return option in field_names(kind)


def _assumed() -> Lidar:
    """The lidar of estimators that need one where none is named."""
    from locplan.field import SHORT_LIDAR

    return dataclasses.replace(SHORT_LIDAR, model="no lidar named, one assumed")


def _changed(lidar: Lidar, reach: float | None, view: float | None) -> Lidar:
    """A lidar with another range [m] and field of view [deg], where they are given."""
    if reach is not None:
        lidar = dataclasses.replace(lidar, range=reach)
    return lidar if view is None else dataclasses.replace(lidar, field_of_view_deg=view)


def _seen_by(
    estimator: Any, lidar: Lidar | None, reach: float | None, view: float | None
) -> Estimator:
    """An estimator with another lidar, or with another range [m] and field of view [deg]."""
    if lidar is None and (own := getattr(estimator, "lidar", None)):
        lidar = _changed(own, reach, view)
    if lidar is not None:
        made: Estimator = estimator.with_lidar(lidar)
        return made
    from locplan.field._registry import estimator_class

    kinds = [estimator_class(name) for name in ESTIMATORS]
    seeing = [kind.name for kind in kinds if kind.casts_rays]
    if view is not None:
        check_has("--field-of-view", "--estimator", estimator.name, seeing)
    if reach is None:
        return estimator  # type: ignore[no-any-return]
    having = [kind.name for kind in kinds if kind.casts_rays or "range" in field_names(kind)]
    check_has("--range", "--estimator", estimator.name, having)
    return dataclasses.replace(estimator, range=reach)  # type: ignore[no-any-return]


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

            def compute(
                grid: OccupancyGrid, points: NDArray[np.bool_] | None = None
            ) -> CovarianceField:
                started = time.perf_counter()
                with progress_bar(f"field of {grid.name}", "cells") as progress:
                    field = load_or_compute(
                        grid,
                        config,
                        points=points,
                        cache_dir=self.cache_dir,
                        threads=self.threads,
                        executor=executor,
                        progress=progress,
                    )
                took = time.perf_counter() - started
                LOG.info("field of %s: %.1f s, %s", grid.name, took, config)
                return field

            yield compute

    def begun(self, grid: OccupancyGrid, config: FieldConfig, *, in_part: bool) -> bool:
        """Whether the cache has a part of a field, with `in_part` of one of some points."""
        from locplan.field._store import field_path

        try:
            return field_path(grid, config, self.cache_dir, in_part=in_part).exists()
        except FieldError:  # it is not cached, as will be said
            return False

    def field(self, grid: OccupancyGrid, config: FieldConfig) -> CovarianceField:
        """The field of one map."""
        with self.of(config) as compute:
            return compute(grid)


@option_group(COSTS)
class CostOptions:
    """The costs of a path."""

    weight: float | None = None
    """The weight is the detour accepted per degenerate metre [m]; by default the estimator's own,
    4 for sad and 8 for the others."""
    criterion: Criterion = None
    robot_radius: RobotRadius = None

    def sized(self, params: Path | None) -> CostOptions:
        """The costs of a robot whose radius is that of its parameters, unless one was given."""
        return dataclasses.replace(self, robot_radius=radius_of(self.robot_radius, params))

    def check(self, config: FieldConfig) -> None:
        """Raise a ConfigError if an option is out of range; to be called before long work."""
        from locplan.costs._degeneracy import check_criterion
        from locplan.costs._density import check_weight

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


def radius_of(robot_radius: float | None, params: Path | None = None) -> float:
    """The robot's radius that was given, or that of its parameters, or the library's own [m]."""
    from locplan.costs import ROBOT_RADIUS

    size = size_in(params) if robot_radius is None else None
    given = size.radius if size else robot_radius
    return ROBOT_RADIUS if given is None else given
