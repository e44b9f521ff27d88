"""Areas where a match is degenerate, as polygons."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from locplan._kernels.arrays import Floats, Ints
from locplan._util.checks import instance, number
from locplan.costs import DEGENERATE, Costmap, check_costs
from locplan.diagnosis._outlines import QUARTERS, DegenerateArea, middle_of, polygons_of
from locplan.errors import FieldError
from locplan.field import CovarianceField, position_axes, scalar


def degenerate_areas(
    costs: Costmap, field: CovarianceField, *, threshold: float | None = None, min_area: float = 1.0
) -> tuple[DegenerateArea, ...]:
    """Find the areas where u is at least a threshold, the largest first.

    Cells belong together that share an edge. Polygons follow the edges of cells to within a cell;
    they do not meet themselves, their holes or each other. The smallest holes
    are filled: those below 0.1 m^2, up to 2 % of an area.

    Parameters
    ----------
    costs : Costmap
        A costmap that was made of the field; its law and criterion define u. One without a field
        has no areas.
    field : CovarianceField
        The field; several headings count by their mean information.
    threshold : float, optional
        Minimum u of a cell, 0..1; by default half of the u of a corridor without features: .5 for
        estimators that know the lidar, .18 for `Sad`. A lower one makes more and larger areas.
    min_area : float, default 1.0
        Minimum area [m^2], >= 0. Areas of a few lattice points may be chance.

    Returns
    -------
    tuple of DegenerateArea
        None where no area is large enough.

    Raises
    ------
    ConfigError
        If a number is out of its limits.
    FieldError
        If the field belongs to another map.

    Examples
    --------
    >>> import locplan
    >>> from locplan.maps import environments
    >>> grid = environments.make("two_corridors", resolution=0.1)
    >>> field = locplan.covariance_field(grid, locplan.Sad(range=3.0))
    >>> costs = locplan.Costmap.from_field(grid, field)
    >>> area, *_ = locplan.diagnosis.degenerate_areas(costs, field)
    >>> area.outline.shape[1], area.area >= 1
    (2, True)
    """
    import cv2

    if threshold is not None:
        number("threshold", threshold, 0, 1)
    number("min_area", min_area, 0)
    check_costs(costs)
    instance("field", field, CovarianceField, "compute one with locplan.load_or_compute")
    if field.grid.digest != costs.grid.digest:
        raise FieldError("the field belongs to another map than the costmap; compute it for this")
    threshold = _half_free(costs, field, threshold)
    grid = costs.grid
    cell_area = grid.resolution**2
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(
        (costs.u >= threshold).astype(np.uint8), connectivity=4, ltype=cv2.CV_32S
    )
    sizes = boxes[:, cv2.CC_STAT_AREA] * cell_area
    large = np.flatnonzero(sizes[1:] >= min_area - 1e-9) + 1
    large = large[np.argsort(-sizes[large], kind="stable")]
    is_large = np.isin(np.arange(len(sizes)), large)
    # Holes below 0.1 m^2 are filled, such as the legs of tables.
    polygons = polygons_of(is_large[labels], labels, min(0.1, min_area) / cell_area)
    points = _points_of(field, labels)
    areas = []
    for label in large.tolist():
        left, low, width, height = boxes[label, :4].tolist()
        window = slice(low, low + height), slice(left, left + width)
        inside = labels[window] == label
        row, col = middle_of(inside)
        covariance = points.get(label)
        if covariance is None:
            covariance = _read(field, np.argwhere(inside) + np.array([low, left]))
        outline, *holes = (
            np.stack(grid.grid_to_world(*corners.T[::-1] / QUARTERS), axis=1)
            for corners in polygons[label]
        )
        middle = grid.position(row + low, col + left)
        about = _deviations_of(covariance) | {"area": float(sizes[label])}
        areas.append(DegenerateArea(outline, tuple(holes), middle, **about))
    return tuple(areas)


def _half_free(costs: Costmap, field: CovarianceField, threshold: float | None) -> float:
    """A threshold, or half of the u of a place that is featureless along one line.

    Such a place, well marked across, is a corridor without features. Its u is 1 by the deviation of
    the position, and less by e, to which the position across and the heading count as well. On a
    logarithmic scale half of it is the geometric mean of the deviations of a perfect match and of
    none: .21 m for those that know the lidar, .26 m for `Sad`. Where u is made of something else,
    it is that of degenerate metres.
    """
    if threshold is not None:
        return threshold
    settings, estimator = costs.settings, field.config.estimator
    if settings is None or settings.criterion not in ("e", "position_std", "position_rms"):
        return DEGENERATE
    corridor = estimator.perfect(field.window).copy()
    corridor[0, 0] = estimator.featureless(field.window)[0, 0]
    least, greatest = field.anchors(settings.criterion)
    value = float(scalar(corridor, settings.criterion))
    if settings.law == "logarithmic":
        return math.log(value / least) / math.log(greatest / least) / 2
    share = value / greatest
    return (share ** (1 / 3) if settings.law == "cube-root" else share) / 2


def _points_of(field: CovarianceField, labels: NDArray[np.int32]) -> dict[int, Floats]:
    """The covariances on the lattice points of each label, (n, d, d)."""
    owner = np.where(field.evaluated, labels[:: field.stride, :: field.stride], 0)
    rows, cols = np.nonzero(owner)
    order = np.argsort(owner[rows, cols], kind="stable")
    rows, cols = rows[order], cols[order]
    found, starts = np.unique(owner[rows, cols], return_index=True)
    parts = np.split(field.mean_covariance[rows, cols], starts[1:])
    return dict(zip(found.tolist(), parts, strict=True)) if found.size else {}


def _read(field: CovarianceField, cells: Ints) -> Floats:
    """Covariances at some cells (n, 2) of an area that lies between the lattice's points."""
    some = cells[:: -(-len(cells) // 50)]
    xy = np.column_stack(field.grid.grid_to_world(*(some + 0.5).T))
    covariances = field.at(xy, "covariance")
    return covariances[np.isfinite(covariances).all(axis=(1, 2))]


def _deviations_of(covariance: Floats) -> dict[str, Any]:
    """What the covariances of places (n, d, d) say of their area: fields of `DegenerateArea`."""
    major, minor, direction = position_axes(covariance)
    heading = scalar(covariance, "heading_std")
    if covariance.shape[-1] == 2:
        heading = np.full_like(heading, np.nan)
    total = major**2 + minor**2
    longer = np.divide(major**2 - minor**2, total, where=total > 0, out=np.zeros_like(total))
    mean = np.mean(longer * np.exp(2j * direction))  # a line's directions are alike, doubled
    return {
        "position_std": float(np.median(major)),
        "heading_std": float(np.median(heading)),
        "direction": float(np.angle(mean) / 2),
        "agreement": float(np.abs(mean)),
    }
