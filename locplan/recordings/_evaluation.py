"""How well the fields say where a recorded drive was badly localized."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._util.intervals import Interval
from locplan._util.progress import ProgressCallback
from locplan._util.tables import finite
from locplan.errors import RecordingError
from locplan.field import (
    FieldConfig,
    Fisher,
    Fused,
    Sad,
    Scan,
    load_or_compute,
    position_axes,
    scalar,
)
from locplan.field._estimator import Estimator
from locplan.field._lattice import points_near, stride_cells
from locplan.maps import OccupancyGrid
from locplan.recordings._matches import Matches, match_scans
from locplan.recordings._recording import Recording
from locplan.simulation._ranking import Rank, Resamples, rank

Numbers = NDArray[np.float64]
BLOCK = 10.0
"""Length of way of a block [m]: scans within it see the same walls, so that blocks are drawn."""
LEAST_BLOCKS = 5
"""Number of blocks below which there are no intervals."""
OUTDATED = -0.5
"""Log-likelihood a return below which a scan saw what is not on the map: a sixth of its returns
ended away from all walls."""
ELONGATED = 3.0
"""Ratio of the measured deviations from which an ellipse has a direction."""
ALIGNED = math.radians(15.0)
"""Greatest angle between a measured and a predicted axis that agree [rad]."""
LEAST_SCANS = 10
"""Number of scans below which nothing is compared."""
NEAR = 0.3
"""Distance from the poses up to which the fields are computed [m]."""


@dataclass(frozen=True)
class Agreement:
    """How well an estimator's deviations agree with the measured ones.

    Intervals are percentiles of a bootstrap over blocks of 10 m of the drive; NaN where it has
    fewer than five.
    """

    rank: Rank
    """Rank correlation, and AUC for the worst fifth of the scans."""
    aligned: Interval
    """Share of the elongated ellipses whose direction is right to 15 deg; NaN without any."""
    factor: Interval
    """Predicted over measured deviation: geometric mean."""


@dataclass(frozen=True, eq=False, repr=False)
class DriveEvaluation:
    """Measured and predicted deviations along a recorded drive."""

    matches: Matches
    """The measured ones."""
    predicted: Mapping[str, Numbers]
    """Covariances at the poses and headings of the scans, (n, d, d), by the estimators' names."""
    criteria: Mapping[str, str]
    """The scalar that each estimator ranks places by."""

    def __repr__(self) -> str:
        return f"DriveEvaluation({len(self.matches)} scans, {', '.join(self.predicted)})"

    @cached_property
    def outdated(self) -> NDArray[np.bool_]:
        """Mask of the scans that saw what is not on the map: people, or changed places, (n,)."""
        return np.asarray(self.matches.judged & (self.matches.score < OUTDATED))

    @cached_property
    def compared(self) -> NDArray[np.bool_]:
        """Mask of the scans at which measured and all predicted deviations are compared, (n,)."""
        known = self.matches.judged & ~self.outdated
        for each in self.predicted.values():
            known &= np.isfinite(each[:, 0, 0])
        return np.asarray(known)

    @cached_property
    def blocks(self) -> NDArray[np.int64]:
        """The block of the drive that each scan belongs to, (n,)."""
        steps = np.hypot(*np.diff(self.matches.recording.poses[:, :2], axis=0).T)
        way = np.concatenate([[0.0], np.cumsum(steps)])
        return np.asarray((way / BLOCK).astype(np.int64))

    @cached_property
    def agreements(self) -> dict[str, Agreement]:
        """How well each estimator agrees with the measurement, at the scans compared."""
        some = self.compared
        drawn = _blocks_drawn(self.blocks[some])
        major, minor, direction = position_axes(self.matches.covariance[some])
        elongated = major > ELONGATED * minor
        found = {}
        for name, every in self.predicted.items():
            covariance = every[some]
            own, _, towards = position_axes(covariance)
            turned = np.abs((towards - direction + np.pi / 2) % np.pi - np.pi / 2)
            factor = _mean(np.log(own / major), drawn)
            found[name] = Agreement(
                _ranked(scalar(covariance, self.criteria[name]), major, drawn),
                _mean((turned < ALIGNED).astype(float), drawn * elongated, elongated),
                Interval(*np.exp(factor).tolist()),
            )
        return found

    def summary(self) -> dict[str, object]:
        """All that was found, fit for JSON."""
        matches = self.matches
        major = matches.position_std[self.compared]
        about: dict[str, object] = {
            "drive": matches.recording.summary().to_json(),
            "map": matches.grid.name,
            "scans": len(matches),
            "compared": int(self.compared.sum()),
            "outdated": int(self.outdated.sum()),
            "position_std_10_50_90_m": np.quantile(major, (0.1, 0.5, 0.9)).tolist(),
            "estimators": {
                name: {
                    "criterion": self.criteria[name],
                    "spearman": list(each.rank.spearman),
                    "auc": list(each.rank.auc),
                    "aligned": list(each.aligned),
                    "factor": list(each.factor),
                }
                for name, each in self.agreements.items()
            },
        }
        return finite(about)


def evaluate_drive(
    recording: Recording,
    grid: OccupancyGrid,
    *,
    estimators: Mapping[str, Estimator] | None = None,
    settings: Scan | None = None,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> DriveEvaluation:
    """Compare the deviations that fields predict with those of the scans of a drive.

    Scans of which more than a sixth of the returns lie away from all walls saw what is not on the
    map, and are set apart.

    Parameters
    ----------
    recording : Recording
        The drive; its poses are the reference.
    grid : OccupancyGrid
        The map; the poses are in its world frame.
    estimators : dict of Estimator, optional
        The estimators by name; by default all of them with the recording's lidar.
    settings : Scan, optional
        The search window and the likelihood of the measurement, see `match_scans`.
    threads : int, optional
        Number of threads; all cores by default.
    progress : callable, optional
        Called with (done, total) fields and matchings.

    Raises
    ------
    RecordingError
        If too few scans were taken where the map is known and fits.
    """
    lidar = recording.lidar
    if estimators is None:
        estimators = {
            "sad": Sad(),
            "fisher": Fisher(lidar),
            "scan": Scan(lidar),
            "fused": Fused.of(lidar),
        }
    tell = progress or (lambda done, total: None)
    matches = match_scans(recording, grid, settings=settings, threads=threads)
    tell(1, len(estimators) + 1)
    predicted = {}
    for n, (name, estimator) in enumerate(estimators.items(), start=2):
        config = FieldConfig(estimator)
        field = load_or_compute(
            grid, config, points=_points_along(recording, grid, config), threads=threads
        )
        predicted[name] = np.array([field.at(x, y, turn) for x, y, turn in recording.poses])
        tell(n, len(estimators) + 1)
    criteria = {name: each.criterion for name, each in estimators.items()}
    result = DriveEvaluation(matches, predicted, criteria)
    if result.compared.sum() < LEAST_SCANS:
        raise RecordingError(
            f"{int(result.compared.sum())} of {len(recording)} scans fit the map and lie in its"
            " free space, too few to compare; is it the right map, and are the poses in its frame?"
            " See locplan.recordings.fit_to_map"
        )
    return result


def _points_along(
    recording: Recording, grid: OccupancyGrid, config: FieldConfig
) -> NDArray[np.bool_]:
    """Lattice points near the poses, (h, w)."""
    stride = stride_cells(config.stride, grid.resolution)
    cells = np.column_stack(grid.world_to_grid(*recording.poses[:, :2].T)) - 0.5
    inside = ((cells > -0.5) & (cells < np.array(grid.shape) - 0.5)).all(axis=1)
    free = grid.free[::stride, ::stride]
    return points_near(free, stride, cells[inside], NEAR / grid.resolution)


def _blocks_drawn(blocks: NDArray[np.int64]) -> Numbers:
    """Number of times that the block of each scan is drawn, (resamples, n)."""
    _, number = np.unique(blocks, return_inverse=True)
    drawn = Resamples.of([int(number.max()) + 1]).places[0]
    return np.asarray(drawn[:, number])


def _ranked(values: Numbers, measured: Numbers, drawn: Numbers) -> Rank:
    """Rank statistics with intervals over blocks."""
    found = rank([values], [measured], Resamples([drawn], np.ones((len(drawn), 1))))
    if _too_few(drawn):
        bare = {each.name: _bare(getattr(found, each.name)) for each in dataclasses.fields(found)}
        return Rank(**bare)
    return found


def _mean(values: Numbers, drawn: Numbers, counted: NDArray[Any] | None = None) -> Interval:
    """Mean of the values that count, with an interval over blocks; NaN where none counts."""
    weights = np.ones(len(values)) if counted is None else counted.astype(float)
    if not weights.any():
        return Interval(math.nan, math.nan, math.nan)
    mean = float(np.average(values, weights=weights))
    totals = drawn.sum(axis=1)
    means = (drawn @ values)[totals > 0] / totals[totals > 0]
    low, high = np.quantile(means, (0.025, 0.975)).tolist()
    return _bare(Interval(mean, low, high)) if _too_few(drawn) else Interval(mean, low, high)


def _too_few(drawn: Numbers) -> bool:
    """Whether the scans are of too few blocks: scans of one block are drawn alike."""
    return len(np.unique(drawn, axis=1).T) < LEAST_BLOCKS


def _bare(interval: Interval) -> Interval:
    return Interval(interval.value, math.nan, math.nan)
