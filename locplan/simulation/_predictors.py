"""Predictors of where a robot is badly localized, and what their ranks and the errors come to."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from locplan._kernels.arrays import Floats, Ints
from locplan._util.intervals import Interval, Rank, in_metres, short
from locplan.field import FieldConfig, Fisher, Fused, Sad, Scan, covariances_at, scalar
from locplan.maps import OCCUPIED, OccupancyGrid
from locplan.robots import Lidar
from locplan.simulation._drives import LOST
from locplan.simulation._places import KINDS, Places


class Predictor(NamedTuple):
    """A source and the scalar that is read of it; greater values should mean greater errors."""

    source: str
    """Name of the field, or of a baseline."""
    scalar: str
    """e, position_std or heading_std; nothing for a baseline."""

    @property
    def of_heading(self) -> bool:
        """True if it predicts the heading's error instead of the position's."""
        return self.scalar == "heading_std"

    def __str__(self) -> str:
        short = self.scalar.removesuffix("_std")
        return f"{self.source}, {short}" if short else self.source

    @property
    def column(self) -> str:
        """Name of the predictor's column in a CSV file."""
        return "_".join(filter(None, (self.source, self.scalar))).replace(" ", "_")


def configs(lidar: Lidar, disc: float | None = None) -> dict[str, FieldConfig]:
    """Settings of the fields that are tried, by name; all but "sad" and "paper" use this lidar.

    "sad" is the default preset and "paper" the paper's, with discs of the radius `disc` [m], by
    default the paper's; "visible" ones have templates of what is visible within that radius.
    """
    radius = Sad().range if disc is None else disc
    default, paper = Sad(range=radius), Sad.paper(range=radius)
    estimators = {
        "sad": default,
        "sad visible": dataclasses.replace(default, template="visible"),
        "paper": paper,
        "paper visible": dataclasses.replace(paper, template="visible"),
        "fisher": Fisher(lidar),
        "scan": Scan(lidar),
        "fused": Fused(lidar),
    }
    return {name: FieldConfig(estimator) for name, estimator in estimators.items()}


def predictions(
    grid: OccupancyGrid,
    fields: Mapping[str, FieldConfig],
    points: Ints,
    *,
    threads: int | None = None,
) -> dict[Predictor, Floats]:
    """Values of each predictor at points of the lattice of the default stride, (n,).

    The configs' own strides are ignored. Several headings give the value of their mean
    information.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    fields : mapping of str to FieldConfig
        Settings of the fields by name, as returned by `configs`.
    points : (n, 2) array
        Rows and columns on the lattice of the default stride.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    """
    found: dict[Predictor, Floats] = {}
    for name, config in fields.items():
        config = dataclasses.replace(config, stride=FieldConfig.stride)
        covariance = covariances_at(grid, config, points, threads=threads)
        for each in ("e", "position_std", "heading_std"):
            found[Predictor(name, each)] = scalar(covariance, each)
    config = next(iter(fields.values()))
    cells = points * config.stride_cells(grid.resolution)
    found[Predictor("clearance", "")] = grid.clearance[tuple(cells.T)]
    found[Predictor("few occupied cells", "")] = -_occupied_about(
        grid, cells, config.estimator.reach / grid.resolution
    )
    return found


def _occupied_about(grid: OccupancyGrid, cells: Ints, radius: float) -> Floats:
    """Number of occupied cells within a radius [cells] of each cell, also behind walls, (n,)."""
    from scipy.spatial import cKDTree

    occupied = np.argwhere(grid.cells == OCCUPIED)
    if not len(occupied):
        return np.zeros(len(cells))
    counts = cKDTree(occupied).query_ball_point(cells, radius, return_length=True)
    return np.asarray(counts.astype(float))


PLANNED = {
    Predictor("fused", "position_std"): "with --lidar",
    Predictor("scan", "position_std"): "with --lidar and --estimator scan",
    Predictor("fisher", "position_std"): "with --lidar and --estimator fisher",
    Predictor("sad", "e"): "with --estimator sad, the default without a lidar",
    Predictor("sad visible", "e"): "with --estimator sad --template visible",
    Predictor("paper", "e"): "with --estimator sad --preset paper",
    Predictor("paper visible", "e"): "with --estimator sad --preset paper --template visible",
}
"""Predictors that `locplan plan` makes its cost of, and its options for them.

Those that real lasers speak for come first."""


def conclusion(
    places: Sequence[Places], agreement: Interval, ranks: Mapping[Predictor, Rank]
) -> list[str]:
    """Two sentences on what a user should do; one if the places are too few to tell.

    `agreement` is of the errors of half of the drives with those of the others, and `ranks` are of
    each predictor with the errors of the filter.
    """
    every = [each.sizes for each in places]
    found = {name: np.concatenate([sizes[name] for sizes in every]) for name in every[0]}
    lost, rmse = float(found["lost_rate"].mean()), float(np.quantile(found["tracking_rmse"], 0.9))
    if len(found["lost_rate"]) < 20:
        return [f"{len(found['lost_rate'])} places are too few to tell: take at least 20."]
    if rmse <= 0.1 and lost <= 0.005:  # the filter is good enough for any path
        share = f"{100 * lost:.1f} % of the drives were" if lost else "no drive was"
        return [
            f"The filter holds its position: at 90 % of the places its RMSE is at most"
            f" {in_metres(rmse)}, and {share} off by more than 1 m at some time.",
            "There is little to gain here, whether from other settings or from other paths.",
        ]
    failed = float((found["match_rmse"] > 0.25).mean())
    tracking, match = (float(np.median(found[f"{kind}_median"])) for kind in KINDS)
    return [_about_places(agreement, ranks), _about_deeds(tracking, match, rmse, lost, failed)]


def _about_places(agreement: Interval, every: Mapping[Predictor, Rank]) -> str:
    """Whether the errors depend on the place, and which field ranks them.

    The first field that ranks the places better than by chance is named: to name the greatest
    correlation of many would be to name chance.
    """
    ranks = {each: every[each] for each in PLANNED}
    for predictor, rank in ranks.items():
        if _excludes(rank.spearman, 0.0, 2 * len(ranks)):
            good = f"ranks the places ({short(rank.spearman)})"
        elif _excludes(rank.auc, 0.5, 2 * len(ranks)):
            good = f"finds the worst fifth of the places (AUC {short(rank.auc)})"
        else:
            continue
        return (
            f"Where the filter errs depends on the place, and `{predictor}` {good}: plan"
            f" {PLANNED[predictor]}."
        )
    why = "no interval excludes chance"
    wrong = [each for each in PLANNED if ranks[each].spearman.high < 0]
    if wrong:
        why = f"`{wrong[0]}` ranks them the wrong way round, {short(ranks[wrong[0]].spearman)}"
    halves = f"the errors of two halves of the drives correlate by {short(agreement)}"
    if agreement.low > 0:
        return (
            f"Where the filter errs depends on the place ({halves}), but no field that"
            f" `locplan plan` takes was shown to rank the places ({why}): with this filter a path"
            " by a field may not help; more places narrow the intervals."
        )
    none = f"No field that `locplan plan` takes ranks the errors of this filter ({why})"
    if math.isnan(agreement.low):
        return f"{none}."
    return f"{none}, and they come from the filter rather than from the places ({halves})."


def _excludes(interval: Interval, chance: float, looks: int) -> bool:
    """Whether an interval lies above chance, as wide as `looks` of them make it (Bonferroni)."""
    from scipy.special import ndtri

    wider = ndtri(1 - 0.025 / looks) / ndtri(0.975)
    return bool(interval.value - (interval.value - interval.low) * wider > chance)


def _about_deeds(tracking: float, match: float, rmse: float, lost: float, failed: float) -> str:
    """What to do: tune the filter, avoid places or mark them, or compare paths."""
    avoid = "avoid these with `locplan plan`, or add landmarks there"
    share = f"{100 * failed:.0f} % of the places" if failed else "no place"
    failing = f"fail (RMSE above 0.25 m) at {share}"
    medians = f"its median error is {in_metres(tracking)}, that of single scans {in_metres(match)}"
    many = failed > 0.05
    if tracking > 2 * match:
        tune = f"Tune the filter first with `locplan tune`: {medians}"
        if many:
            return f"{tune}; and single scans {failing}: {avoid}."
        return f"{tune}, and single scans {failing}."
    if many:
        return f"Single scans {failing}: {avoid}; the filter needs no tuning: {medians}."
    return (
        f"The filter is about as good as single scans ({medians}), but"
        f" {100 * lost:.1f} % of the drives were off by more than {LOST:g} m at some time, and at"
        f" 10 % of the places its RMSE exceeds {in_metres(rmse)}: compare paths with"
        " `locplan plan`."
    )
