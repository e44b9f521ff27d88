"""Global matches of noisy scans: how often they fail, and whether that was foreseen."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import check_threads
from locplan._util.intervals import Interval, wilson
from locplan._util.poses import Numbers
from locplan._util.progress import ProgressCallback
from locplan._util.tables import finite
from locplan.errors import ConfigError
from locplan.maps import OCCUPIED, OccupancyGrid
from locplan.maps.environments import with_boundary_noise
from locplan.matching import AWAY, Matching, find_all_modes, make_database
from locplan.robots import FARTHEST_OBJECT, NEAREST_OBJECT, Disturbances

NAMED = 1.5
"""Distance from a twin of the nearest place up to which a match lies on it [m]."""
BINS = (0.0, 0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)
"""Edges of the bins in which shares elsewhere are compared with failures."""


@dataclass(frozen=True, eq=False, repr=False)
class GlobalMatches:
    """Noisy scans from n random poses, each matched with the whole map."""

    poses: Numbers
    """World x, y and heading of the robot, (n, 3) [m, m, rad]."""
    matched: Numbers
    """World x, y and heading of the best match, (n, 3) [m, m, rad]; NaN where too few beams
    returned."""
    excess: Numbers
    """Excess of the nearest place, (n,) [nats]."""
    elsewhere: Numbers
    """Share of the posterior elsewhere of the nearest place, (n,), 0..1."""
    named: NDArray[np.bool_]
    """True where the match lies within 1.5 m of a twin of the nearest place, or of its stretch,
    (n,)."""

    def __repr__(self) -> str:
        return f"GlobalMatches({len(self.poses)} scans, {self.failed.mean():.1%} failed)"

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Whether the match is more than 2 m off, or there is none, (n,)."""
        return np.asarray(~(np.hypot(*(self.matched - self.poses)[:, :2].T) <= AWAY))

    @property
    def failure_rate(self) -> Interval:
        """Share of the matches that failed, with its 95 % interval."""
        return wilson(float(self.failed.mean()), len(self.failed))

    @property
    def auc(self) -> float:
        """Area under the ROC curve of foreseeing failures by `elsewhere`; NaN with one kind."""
        return area_under_curve(self.elsewhere, self.failed)

    @property
    def named_share(self) -> float:
        """Share of the wrong matches that a twin or the stretch names; NaN without any."""
        return float(self.named[self.failed].mean()) if self.failed.any() else math.nan

    def reliability(self) -> list[tuple[int, float, float]]:
        """Number, mean share elsewhere, and share that failed, of the matches in each of `BINS`."""
        which = np.digitize(self.elsewhere, BINS[1:-1])
        return [
            (int(own.sum()), float(self.elsewhere[own].mean()), float(self.failed[own].mean()))
            for own in (which == n for n in range(len(BINS) - 1))
            if own.any()
        ]

    def summary(self) -> dict[str, object]:
        """What failed and what was foreseen, in numbers, fit for JSON."""
        return finite(
            {
                "matches": len(self.poses),
                "failed": list(self.failure_rate),
                "foreseen": float(self.elsewhere.mean()),
                "auc": self.auc,
                "named_share": self.named_share,
                "reliability": [list(row) for row in self.reliability()],
            }
        )


def area_under_curve(scores: Numbers, positive: NDArray[np.bool_]) -> float:
    """Probability that a positive one has a greater score than another; ties count half."""
    from scipy.stats import rankdata

    ones = int(positive.sum())
    others = len(positive) - ones
    if not ones or not others:
        return math.nan
    ranks = float(rankdata(scores)[positive].sum())
    return (ranks - ones * (ones + 1) / 2) / (ones * others)


def global_matches(
    grid: OccupancyGrid,
    matching: Matching,
    cells: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]],
    known: tuple[Numbers, Numbers, Numbers, Numbers, Numbers],
    count: int,
    disturbances: Disturbances,
    seed: int,
    threads: int | None,
    progress: ProgressCallback | None,
) -> GlobalMatches:
    """Match `count` noisy scans with the map; see `Twins.verify`.

    `cells` are the rows, columns and places of those that poses are drawn from; `known` of all
    places their positions, (n, 2), excess, share elsewhere, twins, (n, k, 4), and stretch.
    """
    rows, cols, near = cells
    if not rows.size:
        raise ConfigError("no cell of the map lies near a place whose twins are known")
    random = np.random.default_rng(seed)
    chosen = random.integers(0, rows.size, count)
    aside = random.random((2, count))
    at = cols[chosen] + aside[0], rows[chosen] + aside[1]
    poses = np.column_stack([*at, random.uniform(-math.pi, math.pi, count)])
    looked = [grid.world_to_cell(x, y) for x, y in known[0].tolist()]
    database = make_database(grid, matching, looked)
    scans = noisy_scans(grid, matching, poses, disturbances, random, seed)
    found = find_all_modes(database, scans, threads=check_threads(threads), progress=progress)
    nowhere = np.full(3, np.nan)
    best = np.array([each.poses[0] if len(each.poses) else nowhere for each in found])
    matched = database.in_world(best)
    places, excess, elsewhere, twins, stretch = (each[near[chosen]] for each in known)
    to_twins = np.hypot(*np.moveaxis(twins[:, :, :2] - matched[:, None, :2], -1, 0))
    on_twin = np.nan_to_num(to_twins, nan=np.inf).min(axis=1, initial=np.inf) <= NAMED
    slid = np.hypot(*(matched[:, :2] - places).T)
    on_stretch = (stretch > 0) & (slid <= stretch + NAMED)
    named = on_twin | on_stretch
    return GlobalMatches(database.in_world(poses), matched, excess, elsewhere, named)


def noisy_scans(
    grid: OccupancyGrid,
    matching: Matching,
    poses: Numbers,
    disturbances: Disturbances,
    random: np.random.Generator,
    seed: int,
) -> Numbers:
    """Ranges that are measured at poses x, y [cells] and heading on the map, (n, 96) [m].

    The worlds that differ from the map are taken in turn.
    """
    from locplan._kernels.lidar import BeamDisturbances, measured_ends
    from locplan._kernels.rays import empty_squares

    lidar = matching.lidar
    beams = matching.beams(lidar.mount_x, lidar.mount_y)
    disturbed = BeamDisturbances(
        outliers=disturbances.outliers,
        occlusion=disturbances.occlusion,
        width=math.radians(disturbances.occlusion_deg),
        nearest=NEAREST_OBJECT,
        farthest=FARTHEST_OBJECT,
    )
    ranges, ends = np.empty((len(poses), len(beams.angles))), np.empty((len(beams.angles), 2))
    lever = np.array([lidar.mount_x, lidar.mount_y]) / grid.resolution
    for first in range(disturbances.worlds):
        noise = disturbances.boundary_noise
        world = with_boundary_noise(grid, noise, seed=seed * disturbances.worlds + first)
        squares = empty_squares(world.cells == OCCUPIED)
        for n in range(first, len(poses), disturbances.worlds):
            pose = poses[n, [1, 0, 2]]
            measured_ends(random, squares, grid.resolution, pose, beams, disturbed, ends)
            ranges[n] = np.hypot(*(ends - lever).T) * grid.resolution
    ranges[np.isnan(ranges)] = np.inf
    ranges[:, ~matching.seen] = np.nan
    return ranges
