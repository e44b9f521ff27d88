"""The verdict on a plan: its own path and the shortest one, driven in simulation."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import shown
from locplan._util.formats import digits_of
from locplan._util.progress import ProgressCallback
from locplan._util.tables import finite
from locplan.costs import Costmap, Path
from locplan.errors import ConfigError
from locplan.field import equipped
from locplan.planners import AWARE, SHORTEST, Plan
from locplan.robots import Amcl, Robot
from locplan.simulation._drives import Drives, check_drives
from locplan.simulation._motion import poses_along
from locplan.simulation._scores import (
    CLEARLY,
    CLEARLY_FEWER,
    SLIGHT,
    is_slight,
    log_errors,
    worst_error,
)
from locplan.simulation._simulator import Simulator
from locplan.simulation.choice._choice import MANY_LOST, UNTUNED
from locplan.simulation.choice._choose import FEW_DRIVES

ALIKE = 0.25
"""Distance up to which two paths are one [m]; headings that differ by 0.25 rad count as much."""
SPACING = 0.1
"""Distance between the points at which paths are compared [m]."""
NOTICEABLE = 1.0
"""Degenerate metres from which on a path has a weak spot [m]."""


@dataclass(frozen=True, eq=False, repr=False)
class Verdict:
    """The path that is recommended, and the simulated drives that say so."""

    recommended: str
    """Label of the path that is recommended: "shortest" or "localizability-aware"."""
    text: str
    """The reason in one line."""
    drives: Mapping[str, Drives]
    """Drives of both paths by label, in pairs of one world and seed; none if they are one path."""
    log_errors: Mapping[str, float]
    """Mean over the drives of the logarithm of the position's RMSE (m), by label [ln m]."""
    robot: Robot
    """The robot that was simulated."""
    seed: int
    """Seed of the worlds and the drives, of which the n-th of both paths have the same."""

    def __repr__(self) -> str:
        return f"Verdict({self.text})"

    @property
    def typical_errors(self) -> dict[str, float]:
        """Error of a typical drive by label: geometric mean of the position's RMSE [m]."""
        return {label: math.exp(each) for label, each in self.log_errors.items()}

    def summary(self) -> dict[str, object]:
        """What is recommended and why, with the errors and the settings, fit for JSON."""
        about: dict[str, object] = {
            "recommended": self.recommended,
            "text": self.text,
            "paths": {
                label: {
                    "typical_error_m": self.typical_errors[label],
                    "log_error": self.log_errors[label],
                    **each.summary(),
                }
                for label, each in self.drives.items()
            },
            "seed": self.seed,
            "robot": self.robot.summary(),
        }
        return finite(about)


def verdict(
    costs: Costmap,
    plans: Mapping[str, Plan],
    robot: Robot | None = None,
    *,
    drives: int = FEW_DRIVES,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Verdict | None:
    """Drive a plan's path and the shortest one in simulation, and recommend one of them.

    The localizability-aware path is recommended if the error of its typical drive is less by a
    tenth than the shortest path's, and it does not lose a quarter of the drives more; otherwise the
    shortest one. If both are one way, nothing is driven.

    Parameters
    ----------
    costs : Costmap
        Costmap on which the paths were planned.
    plans : mapping of str to Plan
        Both plans, as `locplan.planners.plan_beside_shortest` gives them.
    robot : Robot, optional
        The robot; by default one with Nav2's filter and a lidar of 6 m that sees all round. Give
        your own, such as `Robot.from_nav2` reads.
    drives : int, default 8
        Number of drives of each path, 2 to 100,000. Raise it where the verdict is close.
    seed : int, default 1
        Seed of all random numbers, >= 0.
    threads : int, optional
        Number of threads, at least 1; all cores by default. The verdict does not depend on it.
    progress : callable, optional
        Called with (done, total) drives.

    Returns
    -------
    Verdict or None
        None if one of the plans has no path.

    Raises
    ------
    LocplanError
        If a plan is missing, a setting is out of its range, or a path cannot be driven.

    Examples
    --------
    >>> import locplan
    >>> grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
    >>> field = locplan.load_or_compute(grid, locplan.Fisher(locplan.Lidar(range=6.0)))
    >>> costs = Costmap.from_field(grid, field)
    >>> plans = locplan.planners.plan_beside_shortest(costs, (2.0, 3.0), (38.0, 3.0))
    >>> verdict(costs, plans).recommended
    'localizability-aware'
    """
    check_drives(drives)
    for label in (SHORTEST, AWARE):
        if label not in plans:
            raise ConfigError(
                f"there is no plan {shown(label)}; give what plan_beside_shortest returns"
            )
    shortest, aware = plans[SHORTEST].path, plans[AWARE].path
    simulator = Simulator(
        costs.grid,
        equipped(robot, costs.settings.config if costs.settings else None),
        seed=seed,
        threads=threads,
    )
    if shortest is None or aware is None:
        return None
    if is_one_way(shortest, aware):
        metrics = plans[SHORTEST].metrics
        text = _of_one_way(metrics.integrated_u if metrics else math.nan)
        return Verdict(SHORTEST, text, {}, {}, simulator.robot, seed)
    lines = [poses_along(path, costs.grid) for path in (shortest, aware)]
    errors = simulator.drive_together(lines, drives, progress=progress)
    driven = {
        label: Drives(line, each)
        for label, line, each in zip((SHORTEST, AWARE), lines, errors, strict=True)
    }
    return _judged(
        driven, worst_error(costs.grid.shape, costs.grid.resolution), simulator.robot, seed
    )


def _judged(driven: Mapping[str, Drives], worst: float, robot: Robot, seed: int) -> Verdict:
    """Recommend one of two driven paths; `worst` is the error of a robot that is lost [m]."""
    scores = {
        label: float(log_errors(each.distance, each.errors, "rmse", worst).mean())
        for label, each in driven.items()
    }
    gained = scores[AWARE] - scores[SHORTEST]
    more_lost = driven[AWARE].lost.mean() - driven[SHORTEST].lost.mean() >= CLEARLY_FEWER
    recommended = AWARE if gained <= CLEARLY and not more_lost else SHORTEST
    worse = more_lost or gained >= -CLEARLY
    text = _of_drives(recommended, worse, scores, driven, robot.filter)
    before, after = (math.exp(scores[label]) for label in (SHORTEST, AWARE))
    if recommended == AWARE and is_slight(before, after, int(driven[SHORTEST].lost.sum())):
        text += SLIGHT
    return Verdict(recommended, text, driven, scores, robot, seed)


def is_one_way(path: Path, other: Path) -> bool:
    """Return whether no point of either path lies more than 0.25 m from the other.

    Parameters
    ----------
    path, other : Path
        The paths; headings that differ by 0.25 rad count as much, if both have some.
    """
    from scipy.spatial import cKDTree

    one, two = _points(path), _points(other)
    if one.shape[1] != two.shape[1]:
        return False
    pairs = ((one, two), (two, one))
    return all(cKDTree(near).query(points)[0].max() <= ALIKE for points, near in pairs)


def _points(path: Path) -> NDArray[np.float64]:
    """Points along a path, with the cosine and sine of its headings if it has some."""
    if path.length == 0:
        return path.xy[:1]
    fine = path.resampled(SPACING)
    if fine.heading is None:
        return fine.xy
    return np.column_stack([fine.xy, np.cos(fine.heading), np.sin(fine.heading)])


def _of_one_way(degenerate: float) -> str:
    """Verdict on two paths that are one; the degenerate metres are NaN without a field."""
    if degenerate >= NOTICEABLE:
        return (
            f"same path as the shortest: its weak spot of {degenerate:.1f} degenerate metres has no"
            " way around that costs less"
        )
    if math.isnan(degenerate):
        return "same path as the shortest"
    return "same path as the shortest: no weak spot on the way"


def _of_drives(
    recommended: str,
    worse: bool,
    scores: Mapping[str, float],
    drives: Mapping[str, Drives],
    amcl: Amcl,
) -> str:
    """Verdict on two paths that were driven; `worse` says that the aware one is."""
    errors = [math.exp(scores[label]) for label in (SHORTEST, AWARE)]
    before, after = (f"{error:.{digits_of(error)}f}" for error in errors)
    lost, still = (f"{100 * drives[label].lost.mean():.0f}" for label in (SHORTEST, AWARE))
    count = len(drives[AWARE].errors)
    typical = f"error of a typical drive {before} -> {after} m"
    numbers = f"{typical}, lost {lost} -> {still} % of {count} drives"
    driven = f"driven in simulation with {amcl.title}"
    untuned = f"; {UNTUNED}" if drives[recommended].lost.mean() >= MANY_LOST else ""
    if recommended == AWARE:
        return f"{driven}: {numbers}: the aware path is recommended{untuned}"
    how = "worse" if worse else "not clearly better"
    text = f"{driven}: the aware path is {how} here: {numbers}; the shortest is recommended"
    return text + untuned
