"""Evaluation of how well the fields predict where a robot is badly localized, on your own maps."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import whole
from locplan._util.intervals import Interval
from locplan._util.progress import ProgressCallback, parts
from locplan._util.tables import finite
from locplan.costs import ROBOT_RADIUS
from locplan.field import Lidar
from locplan.maps import OccupancyGrid
from locplan.simulation._places import DRIVES, PLACES, SCANS, ErrorKind, Places, places_of
from locplan.simulation._predictors import Predictor, configs, predictions
from locplan.simulation._ranking import Rank, Resamples, rank
from locplan.simulation._settings import SHORT_LIDAR, Amcl, Disturbances

KINDS: tuple[ErrorKind, ...] = get_args(ErrorKind)
KIND_LABELS: dict[ErrorKind, str] = {
    "tracking": "error of a particle filter, 10 m drives",
    "match": "error of single-scan matches",
}


@dataclass(frozen=True, eq=False, repr=False)
class Evaluation:
    """Errors at places of some maps, and the values of each predictor there."""

    places: Sequence[Places]
    """Places and errors of each map."""
    predictions: Sequence[dict[Predictor, NDArray[np.float64]]]
    """Values of each predictor at the places of each map, (n,)."""
    lidar: Lidar
    amcl: Amcl
    disturbances: Disturbances
    drives: int
    scans: int
    seed: int

    def __repr__(self) -> str:
        places = sum(len(each.points) for each in self.places)
        names = ", ".join(each.grid.name or "map" for each in self.places)
        return f"Evaluation({places} places of {names})"

    @cached_property
    def ranks(self) -> dict[tuple[Predictor, ErrorKind], Rank]:
        """Rank statistics of each predictor for each kind of error.

        Deviations of the heading are compared with the heading's error, all others with the
        position's.
        """
        drawn = Resamples.of([len(places.points) for places in self.places])
        return {
            (predictor, kind): rank(
                [found[predictor] for found in self.predictions],
                [self._errors(places, predictor, kind) for places in self.places],
                drawn,
            )
            for predictor in self.predictions[0]
            for kind in KINDS
        }

    @staticmethod
    def _errors(places: Places, predictor: Predictor, kind: ErrorKind) -> NDArray[np.float64]:
        if predictor.of_heading:
            return places.heading_rmse(kind)
        return places.position_rmse(kind)

    def of_map(self, number: int) -> Evaluation:
        """Evaluation of one map by itself."""
        return dataclasses.replace(
            self, places=[self.places[number]], predictions=[self.predictions[number]]
        )

    def quantiles(self, number: int, kind: ErrorKind) -> list[float]:
        """Percentiles 10, 50 and 90 of the position RMSE over a map's places [m]."""
        quantiles: list[float] = np.quantile(
            self.places[number].position_rmse(kind), (0.1, 0.5, 0.9)
        ).tolist()
        return quantiles

    def summary(self) -> dict[str, object]:
        """All ranks and settings, fit for JSON."""
        about: dict[str, object] = {
            "maps": [
                {"name": each.grid.name, "digest": each.grid.digest, "places": len(each.points)}
                | {f"{kind}_rmse_m_10_50_90": self.quantiles(n, kind) for kind in KINDS}
                for n, each in enumerate(self.places)
            ],
            "predictors": [
                {
                    "source": predictor.source,
                    "scalar": predictor.scalar or None,
                    "error": kind,
                    "of": "heading" if predictor.of_heading else "position",
                    **{name: list(getattr(found, name)) for name in ("spearman", "within", "auc")},
                }
                for (predictor, kind), found in self.ranks.items()
            ],
            "drives": self.drives,
            "scans": self.scans,
            "seed": self.seed,
            "lidar": dataclasses.asdict(self.lidar),
            "amcl": dataclasses.asdict(self.amcl),
            "disturbances": dataclasses.asdict(self.disturbances),
        }
        return finite(about)

    def rows(self) -> Iterator[tuple[str, NDArray[np.float64]]]:
        """Name of each map, and a row of `columns` per place: x, y, errors and predictions."""
        for places, found in zip(self.places, self.predictions, strict=True):
            errors = [
                each
                for kind in KINDS
                for each in (places.position_rmse(kind), places.heading_rmse(kind))
            ]
            values = [np.abs(each) for each in found.values()]  # counts of cells are negated
            yield places.grid.name, np.column_stack([places.xy, *errors, *values])

    @property
    def columns(self) -> list[str]:
        """Names of the values in `rows`."""
        errors = [name for kind in KINDS for name in (f"{kind}_rmse_m", f"{kind}_heading_rmse_rad")]
        found = [each.column for each in self.predictions[0]]
        return ["x_m", "y_m", *errors, *found]


def evaluate(
    grids: Sequence[OccupancyGrid] | OccupancyGrid,
    *,
    lidar: Lidar | None = None,
    amcl: Amcl | None = None,
    disturbances: Disturbances | None = None,
    places: int = PLACES,
    drives: int = DRIVES,
    scans: int = SCANS,
    disc: float | None = None,
    robot_radius: float = ROBOT_RADIUS,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Evaluation:
    """Measure errors at places of maps, and rank predictors by them.

    Parameters
    ----------
    grids : sequence of OccupancyGrid
        One map or several.
    lidar, amcl, disturbances : optional
        The robot's lidar, its filter, and the disturbances; see `Simulator`.
    places : int
        Greatest number of random places on each map, which are at least 1 m apart.
    drives, scans : int
        Number of drives to each place, and of single scans at each.
    disc : float, optional
        Radius of the templates of "sad" [m]; by default the paper's.
    robot_radius : float
        Radius of the robot, which limits where drives may go [m].
    seed : int
        Seed of all random numbers; equal seeds give equal results.
    threads : int, optional
        Number of threads; all cores by default.
    progress : callable, optional
        Called with (done, total) drives, places and fields of all maps.

    Returns
    -------
    Evaluation

    Raises
    ------
    ConfigError
        If there is no map, a number is out of its range, or a robot has no room on a map.
    """
    grids = [grids] if isinstance(grids, OccupancyGrid) else list(grids)
    lidar = lidar or SHORT_LIDAR
    amcl, disturbances = amcl or Amcl(), disturbances or Disturbances()
    for name, value in (("drives", drives), ("scans", scans)):
        whole(name, value, 1)
    fields = configs(lidar, disc)
    effort = len(grids) * places * (drives + 1)
    callbacks = parts(progress, [effort, *[max(1, effort // 50)] * len(grids)])
    measured = places_of(
        grids,
        lidar=lidar,
        amcl=amcl,
        disturbances=disturbances,
        places=places,
        drives=drives,
        scans=scans,
        robot_radius=robot_radius,
        seed=seed,
        threads=threads,
        progress=callbacks[0],
    )
    found = []
    for each, part in zip(measured, callbacks[1:], strict=True):
        found.append(predictions(each.grid, fields, each.points, threads=threads))
        part(max(1, effort // 50), 0)
    return Evaluation(measured, found, lidar, amcl, disturbances, drives, scans, seed)


def best(evaluation: Evaluation, kind: ErrorKind) -> tuple[Predictor, Interval]:
    """Predictor that ranks position errors best over all places, and its rank correlation."""
    return max(
        (
            (predictor, found.spearman)
            for (predictor, its), found in evaluation.ranks.items()
            if its == kind and not predictor.of_heading
        ),
        key=lambda pair: pair[1].value,
    )
