"""Options that commands share, each written once, and what becomes of them.

An option that was not given is None, and means the library's own default.
"""

from __future__ import annotations

import dataclasses
import logging
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from locplan.cli._groups import COMPUTING, COSTS, FIELD, OUTPUT, option_group
from locplan.cli._kinds import check_has, given_of
from locplan.errors import ConfigError
from locplan.field import ESTIMATORS

if TYPE_CHECKING:
    from locplan.costs import Costmap
    from locplan.field import CovarianceField, Estimator, FieldConfig
    from locplan.maps import OccupancyGrid

    Compute = Callable[[OccupancyGrid], CovarianceField]

LOG = logging.getLogger("locplan.cli")
LIDAR = "--sensor"
"""Option that names the lidar of a field."""
LIDARS = ("rplidar-a1", "utm-30lx", "lms291", "urg-04lx")

MapFile = Annotated[
    Path, Parameter(name="MAP", help="The map is a map_server YAML file, or a folder with one.")
]
MapFiles = Annotated[
    list[Path],
    Parameter(name="MAP", help="The maps are map_server YAML files, or folders of them."),
]
Text = Annotated[str, Parameter(allow_leading_hyphen=True)]
"""Text that may begin with a minus sign, such as -2,3."""
Count = Annotated[int, Parameter(validator=Number(gte=1))]
Json = Annotated[
    bool, Parameter(name="--json", group=OUTPUT, help="The result is printed as JSON.")
]
RobotRadius = Annotated[
    float | None,
    Parameter(group=COSTS, help="The robot's radius is 0.25 by default [m]."),
]
Criterion = Annotated[
    str | None,
    Parameter(
        group=COSTS,
        help="The degeneracy u is made of e (default), position_std, position_rms or heading_std,"
        " or of ambiguity or entropy of scan.",
    ),
]
Threads = Annotated[
    Count | None,
    Parameter(group=COMPUTING, help="The number of threads is that of the cores by default."),
]


def results(what: str) -> Parameter:
    """The option that says where results go."""
    return Parameter(name=("--output", "-o"), group=OUTPUT, help=what)


@option_group(FIELD)
class FieldOptions:
    """How the covariance field is made."""

    config: Annotated[Path | None, Parameter(metavar="FILE.json")] = None
    """A file holds all settings, as calibrate wrote them; only --range may stand beside it."""
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
    """The template of sad is the paper's disc, or what a ray from its centre sees of it."""
    stride: float | None = None
    """The spacing of the evaluated cells is 0.2 by default [m]."""


def config_of(options: FieldOptions, reach: float | None = None) -> FieldConfig:
    """The settings of a field that were asked for; `reach` replaces the range."""
    from locplan.field import FieldConfig, Lidar, load_config
    from locplan.field._registry import estimator_class

    given = given_of(options)
    own = given.pop("range", None)
    reach = own if reach is None else reach
    if options.config is not None:
        if len(given) > 1:
            names = [each.name for each in dataclasses.fields(options)]
            rest = ", ".join(_flag(name) for name in names if name not in ("config", "range"))
            raise ConfigError(
                "--config has all settings of the field; besides it only --range may be given,"
                f" none of {rest}"
            )
        config = load_config(options.config)
        return dataclasses.replace(config, estimator=_reaching(config.estimator, reach))
    kinds = {name: estimator_class(name) for name in ESTIMATORS}
    kind: Any = kinds[given.pop("estimator", "sad")]
    for name in given:
        having = [each.name for each in kinds.values() if _takes(each, name)]
        check_has(_flag(name), "--estimator", kind.name, having)
    others = {name: given.pop(name) for name in ("stride", "headings") if name in given}
    if _takes(kind, "lidar"):
        named, view = given.pop("lidar", None), given.pop("field_of_view", None)
        lidar = Lidar.preset(named) if named else Lidar(range=6.0)
        turned = lidar if view is None else dataclasses.replace(lidar, field_of_view_deg=view)
        estimator = kind(turned, **given)
    else:
        made = kind.paper if given.pop("preset", None) == "paper" else kind
        estimator = dataclasses.replace(made(), **given)
    return FieldConfig(_reaching(estimator, reach), **others)


def _takes(kind: type[Estimator], option: str) -> bool:
    """Whether an option of `FieldOptions` is for this estimator."""
    if option in ("stride", "preset"):
        return option == "stride" or hasattr(kind, "paper")
    own = "lidar" if option in ("field_of_view", "headings") else option
    return any(own == each.name for each in dataclasses.fields(kind))


def _reaching(estimator: Any, reach: float | None) -> Any:
    """An estimator with another range [m]."""
    if reach is None:
        return estimator
    if not _takes(type(estimator), "lidar"):
        return dataclasses.replace(estimator, range=reach)
    lidar = dataclasses.replace(estimator.lidar, range=reach)
    return dataclasses.replace(estimator, lidar=lidar)


def ranges_of(options: FieldOptions, ranges: Sequence[float]) -> list[FieldConfig]:
    """The same settings for each of these ranges [m], or as they are where there are none."""
    return [config_of(options, reach) for reach in ranges or (None,)]


@option_group(COMPUTING)
class Computing:
    """Where fields are computed and kept."""

    threads: Threads = None
    scheduler: Annotated[str | None, Parameter(metavar="tcp://HOST:PORT")] = None
    """A dask cluster computes the field."""
    cache_dir: Path | None = None
    """The folder keeps computed fields; LOCPLAN_CACHE does the same."""

    @contextmanager
    def of(self, config: FieldConfig) -> Iterator[Compute]:
        """What gives the field of a map: read, or computed here or on a cluster."""
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
    """What a path is charged for."""

    weight: float | None = None
    """The weight is the detour accepted per degenerate metre [m]; 4 by default."""
    criterion: Criterion = None
    robot_radius: RobotRadius = None

    def check(self, config: FieldConfig) -> None:
        """Complain before long work."""
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


def _flag(name: str) -> str:
    """The option of a field of `FieldOptions`, as it is typed."""
    return LIDAR if name == "lidar" else f"--{name.replace('_', '-')}"
