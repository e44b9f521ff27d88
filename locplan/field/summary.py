"""A field as a few numbers, and at a few representative positions."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from locplan._support.kernels.arrays import Floats, Ints
from locplan._support.tables import format_table
from locplan.field.config import FieldConfig
from locplan.field.covariance import SCALARS, average_information
from locplan.field.field import CovarianceField

SATURATED = 1 / 3
"""A larger saturated share makes the table suggest what would resolve it."""


@dataclass(frozen=True)
class Percentiles:
    """Values that 10 %, half and 90 % of a field's cells stay below; NaN without cells."""

    low: float
    """The value that 10 % stay below."""
    median: float
    """The value that half of them stay below."""
    high: float
    """The value that 90 % stay below."""

    def text(self, factor: float, unit: str) -> str:
        """Return the three values for people; a dash for NaN.

        Parameters
        ----------
        factor : float
            Number of units in the unit of the values.
        unit : str
            The unit that is shown.
        """
        values = self.low, self.median, self.high
        return f"{' / '.join(_format_e(factor * value) for value in values)} {unit}"

    def median_text(self, factor: float = 1.0) -> str:
        """Return the median for people; a dash for NaN.

        Parameters
        ----------
        factor : float, default 1.0
            Number of the units shown in the unit of the values.
        """
        return _format_e(factor * self.median)


@dataclass(frozen=True)
class FieldSummary:
    """Number of evaluated cells, and distributions of their values over all headings."""

    map: str
    """Name of the map."""
    config: FieldConfig
    """Settings of the field."""
    cells_evaluated: int
    """Number of cells with a covariance."""
    position_std: Percentiles
    """Largest standard deviation of the position [m]."""
    heading_std: Percentiles
    """Standard deviation of the heading [rad]."""
    e: Percentiles
    """e, in `e_unit`."""
    saturated_share: float
    """Share of the cells whose matches count as perfect, 0..1."""
    all_perfect: bool
    """True if u is 0 throughout the map."""
    e_unit: str
    """Unit of e: without rotation in the search window it is m^2."""

    @classmethod
    def from_field(cls, field: CovarianceField) -> FieldSummary:
        """Summarize a field.

        Parameters
        ----------
        field : CovarianceField
            The field.
        """
        criterion = field.config.estimator.criterion
        decisive = field.scalar(criterion, with_q=True)[field.is_evaluated]
        perfect = bool(decisive.size and decisive.max() <= field.anchors(criterion)[0])
        return cls(
            field.grid.name,
            field.config,
            int(field.is_evaluated.sum()),
            position_std=_compute_percentiles(field.scalar("position_std")[field.is_evaluated]),
            heading_std=_compute_percentiles(field.scalar("heading_std")[field.is_evaluated]),
            e=_compute_percentiles(field.scalar("e")[field.is_evaluated]),
            saturated_share=field.saturated_share,
            all_perfect=perfect,
            e_unit=field.e_unit,
        )

    def table(self) -> str:
        """Return the summary for people, with advice about a saturated field."""
        estimator, headings = self.config.estimator, self.config.headings
        several = "" if headings == 1 else f", {headings} headings"
        position, heading = SCALARS["position_std"], SCALARS["heading_std"]
        text = format_table(
            ["", "10 % / median / 90 % of cells and headings"],
            [
                ["map", self.map],
                ["estimator", f"{estimator.title}{several}"],
                ["cells evaluated", f"{self.cells_evaluated:,}"],
                ["position std", self.position_std.text(position.factor, position.unit)],
                ["heading std", self.heading_std.text(heading.factor, heading.unit)],
                ["e", self.e.text(1.0, self.e_unit)],
                ["saturated", f"{self.saturated_share:.0%} of the cells: u is about 0"],
            ],
        )
        if self.all_perfect:
            return f"{text}\nthis lidar has no weak spot on the map: u is 0 throughout"
        resolved = self.saturated_share <= SATURATED
        return text if resolved else f"{text}\n{estimator.remedy}"


def _compute_percentiles(values: Floats) -> Percentiles:
    """Return the percentiles of finite values."""
    percentiles = np.percentile(values, (10, 50, 90)).tolist() if values.size else [math.nan] * 3
    return Percentiles(*percentiles)


def _format_e(e: float) -> str:
    """Return a value of e for people; a dash for NaN."""
    return "–" if math.isnan(e) else f"{e:.3g}"


def describe_field(field: CovarianceField) -> str:
    """Describe in a line a field's settings, its saturated share, and advice for it.

    Parameters
    ----------
    field : CovarianceField
        The field.
    """
    several = "" if field.config.headings == 1 else f", {field.config.headings} headings"
    estimator_text = f"{field.config.estimator.title}{several}"
    share = field.saturated_share
    remedy = f"\n{field.config.estimator.remedy}" if share > SATURATED else ""
    spacing = field.stride * field.grid.resolution
    spacing_text = f"; every {spacing:g} m near the paths, else {2 * spacing:g} m"
    near_paths = spacing_text if field.is_interpolated.any() else ""
    map_text = f"u is about 0 (localizable) on {share:.0%} of the map"
    return f"{estimator_text}{near_paths}; {map_text}{remedy}"


def sample_covariances(field: CovarianceField, spacing: float) -> tuple[Floats, Floats]:
    """Choose positions of a field with their covariances, positions far from walls first.

    Parameters
    ----------
    field : CovarianceField
        The field.
    spacing : float
        Minimum distance of two positions [m].

    Returns
    -------
    xy : (n, 2) array
        The positions [m].
    covariances : (n, d, d) array
        Their covariances; for several headings from the mean information.
    """
    stride = field.stride
    clearance = field.grid.clearance[::stride, ::stride]
    # Closer to walls than 0.15 m they would lie in slits and stray cells.
    i, j = np.nonzero(field.is_evaluated & (clearance >= 0.15))
    xy = np.stack(field.grid.grid_to_world(i * stride + 0.5, j * stride + 0.5), axis=1)
    indices = select_spaced_positions(xy, clearance[i, j], spacing)
    covariance = field.covariance[i[indices], j[indices]]
    return xy[indices], average_information(covariance) if covariance.ndim == 4 else covariance


def select_spaced_positions(xy: Floats, priority: Floats, spacing: float) -> Ints:
    """Choose positions at least `spacing` apart that leave no gap, high priority first.

    Parameters
    ----------
    xy : (n, 2) array
        The positions.
    priority : (n,) array
        Priority of each position; of two positions that are too close the one with the higher
        priority stays.
    spacing : float
        Minimum distance of two positions, in their unit.

    Returns
    -------
    (k,) array of int
        Indices of the chosen positions.

    Examples
    --------
    >>> xy = np.array([[0.1, 0.5], [0.9, 0.5], [1.1, 0.5], [2.5, 0.5]])
    >>> select_spaced_positions(xy, np.array([1.0, 2.0, 3.0, 1.0]), 0.9).tolist()
    [2, 0, 3]
    """
    from scipy.spatial import cKDTree

    tree, covered, indices = cKDTree(xy), np.zeros(len(xy), bool), []
    for k in np.argsort(-priority, kind="stable").tolist():
        if not covered[k]:
            indices.append(k)
            covered[tree.query_ball_point(xy[k], spacing * (1 - 1e-9))] = True
    return np.array(indices, np.int64)
