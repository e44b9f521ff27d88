"""Options of the computing of fields, and of the costs made of them.

An option that was not given is None, and means the library's own default.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Protocol

from cyclopts import Parameter

import locplan
from locplan._util.progress import progress_bar
from locplan.cli._groups import Threads, heading, option_group
from locplan.cli._values import given_of

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from locplan import Costmap, CovarianceField, FieldConfig, OccupancyGrid, Robot

    class Compute(Protocol):
        """A function that gives the field of a map, or its values at some lattice points."""

        def __call__(
            self, grid: OccupancyGrid, points: NDArray[np.bool_] | None = None
        ) -> CovarianceField: ...


Criterion = Annotated[
    str | None,
    Parameter(
        group=heading("Costs"),
        help="Scalar that the degeneracy u is made of: e (default of sad), position_std (default of"
        " the others), position_rms or heading_std; ambiguity or entropy of scan and fused.",
    ),
]
CacheDir = Annotated[
    Path | None,
    Parameter(help="Folder of the computed fields; LOCPLAN_CACHE names it, too."),
]


def _has_scheduler(_: object, scheduler: str | None) -> None:
    if scheduler is not None:
        locplan.field.check_scheduler(scheduler)


@option_group("Computing")
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
        scheduler = self.scheduler
        with locplan.field.executor_of(scheduler) if scheduler else nullcontext() as executor:

            def compute(
                grid: OccupancyGrid, points: NDArray[np.bool_] | None = None
            ) -> CovarianceField:
                started = time.perf_counter()
                with progress_bar(f"field of {grid.name}", "cells") as progress:
                    field = locplan.load_or_compute(
                        grid,
                        config,
                        points=None if whole else points,
                        cache_dir=self.cache_dir,
                        threads=self.threads,
                        executor=executor,
                        progress=progress,
                    )
                took = time.perf_counter() - started
                logging.getLogger("locplan.cli").info(
                    "field of %s: %.1f s, %s", grid.name, took, config
                )
                then()
                return field

            yield compute

    def field(self, grid: OccupancyGrid, config: FieldConfig) -> CovarianceField:
        """The field of one map."""
        with self.of(config) as compute:
            return compute(grid)


@option_group("Costs")
class CostOptions:
    """The costs of a path."""

    weight: float | None = None
    """Detour accepted per degenerate metre, in metres; by default the estimator's own, 4 for sad
    and 8 for the others."""
    criterion: Criterion = None

    def check(self, config: FieldConfig) -> None:
        """Raise a ConfigError if an option is out of range; to be called before long work."""
        if self.weight is not None:
            locplan.costs.check_weight(self.weight)
        if self.criterion is not None:
            locplan.costs.check_criterion(self.criterion, config)

    def costmap(self, grid: OccupancyGrid, field: CovarianceField, robot: Robot) -> Costmap:
        """The costmap of a field for a robot."""
        return locplan.Costmap.from_field(grid, field, robot=robot, **given_of(self))
