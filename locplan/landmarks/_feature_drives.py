"""Drives in a world that lacks features which the robot's map still shows."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import whole
from locplan._util.progress import ProgressCallback, parts
from locplan._util.random_streams import random_of
from locplan._util.records import Table
from locplan.costs import Path
from locplan.landmarks._outcomes import Outcome, outcomes_table
from locplan.maps import FREE, OccupancyGrid
from locplan.robots import Robot
from locplan.simulation import Drives, Simulator, check_drives, drive_paths

SURE = 0.3
"""Width of the lost drives' intervals up to which drives without a difference tell something."""
RANDOM_FEATURES = 103
"""Stream of random numbers of features at random, beside those of places."""

Cells = NDArray[np.int64]
"""Rows and columns of a feature's cells, (k, 2)."""


@dataclass(frozen=True, eq=False, repr=False)
class FeatureDrives:
    """Drives with all features, without some, and without as many random ones in the world."""

    before: Outcome
    """Drives with all features."""
    without: Outcome
    """Drives without these features."""
    alone: Mapping[int, Outcome]
    """Drives without one of these features, by its number; empty where there is one only."""
    random: Outcome | None
    """Drives without random features; None where there are no others."""
    count: int
    """Number of features that are taken away."""
    profiles: Mapping[str, tuple[Drives, Drives]]
    """Drives of each route with all features, and without these."""
    seed: int
    """Seed of all random numbers."""

    def __repr__(self) -> str:
        return f"FeatureDrives({self.verdict})"

    @property
    def hurts(self) -> bool:
        """Whether more drives are lost without, or as many with clearly more error.

        The intervals do not touch, and the error rises by a tenth or more.
        """
        return self.before.better_than(self.without)

    @property
    def helps(self) -> bool:
        """Whether fewer are lost without, or as few with clearly less error."""
        return self.without.better_than(self.before)

    @property
    def verdict(self) -> str:
        """What the drives say, in one line."""
        before, without = self.before, self.without
        lost = f"{before.lost_rate.value:.0%} of the drives lost with all,"
        lost += f" {without.lost_rate.value:.0%} without the {self.count}"
        error = f"error {before.rmse.value:.2f} -> {without.rmse.value:.2f} m"
        if self.random is not None:
            lost += f", {self.random.lost_rate.value:.0%} without as many random ones"
            error += f" ({self.random.rmse.value:.2f} m without random ones)"
        low = min(each.lost_rate.low for each in (before, without))
        high = max(each.lost_rate.high for each in (before, without))
        said = "their absence is not shown to hurt"
        if high - low > SURE:
            said = f"too few drives to tell (lost drives {low:.0%} to {high:.0%}, with 95 %)"
        if self.hurts or self.helps:
            said = "their absence " + ("hurts" if self.hurts else "helps, against what is expected")
        return f"{said}: {lost}; {error}"

    def table(self) -> Table:
        """The drives in each world: how many were lost, and their errors."""
        named = {"all features": self.before}
        named |= {f"without {number}": each for number, each in self.alone.items()}
        named[f"without the {self.count}"] = self.without
        if self.random:
            named["without random ones"] = self.random
        return outcomes_table("in the world", named)

    def summary(self) -> dict[str, object]:
        """The verdict, and the numbers behind it, fit for JSON."""
        return {
            "verdict": self.verdict,
            "hurts": self.hurts,
            "helps": self.helps,
            "count": self.count,
            "before": self.before.summary(),
            "without": self.without.summary(),
            "alone": {str(number): each.summary() for number, each in self.alone.items()},
            "random": self.random.summary() if self.random else None,
            "seed": self.seed,
        }


def driven_without(
    grid: OccupancyGrid,
    routes: Mapping[str, Path],
    robot: Robot,
    taken: Mapping[int, Cells],
    others: Sequence[Cells],
    drives: int,
    seed: int,
    random_sets: int,
    threads: int | None,
    progress: ProgressCallback | None,
) -> FeatureDrives:
    """Drive with all features, without those taken, and without as many of the others.

    See `KeyFeatures.verify`.
    """
    check_drives(drives)
    whole("random_sets", random_sets, 1, 1000)
    count, sets = min(len(taken), len(others)), min(random_sets, drives // 2)
    random = [
        [others[k] for k in random_of(seed, RANDOM_FEATURES, n).permutation(len(others))[:count]]
        for n in range(sets if count else 0)
    ]
    alone = {number: [cells] for number, cells in taken.items()} if len(taken) > 1 else {}
    lacking = [[], list(taken.values()), *alone.values(), *random]
    numbers = [drives] * 2 + [max(drives // max(len(alone), 1), 2)] * len(alone)
    numbers += [drives // max(len(random), 1)] * len(random)
    callbacks = parts(progress, [len(routes) * n for n in numbers])
    made: list[tuple[Drives, ...]] = []
    for own, number, part in zip(lacking, numbers, callbacks, strict=True):
        simulator = simulator_without(grid, own, robot, seed, threads)
        made.append(tuple(drive_paths(simulator, routes, number, progress=part).values()))
    before, without, *rest = made
    singles, others_made = rest[: len(alone)], rest[len(alone) :]
    return FeatureDrives(
        Outcome(before),
        Outcome(without),
        {number: Outcome(each) for number, each in zip(alone, singles, strict=True)},
        Outcome(sum(others_made, ())) if others_made else None,
        len(taken),
        dict(zip(routes, zip(before, without, strict=True), strict=True)),
        seed,
    )


def simulator_without(
    grid: OccupancyGrid,
    lacking: Sequence[Cells],
    robot: Robot,
    seed: int,
    threads: int | None,
) -> Simulator:
    """Simulator whose worlds lack features that the robot's map shows."""

    def on(own: OccupancyGrid) -> Simulator:
        return Simulator(own, robot=robot, seed=seed, threads=threads)

    simulator = on(grid)
    if lacking:
        simulator.worlds = on(without_cells(grid, np.concatenate(lacking))).worlds
    return simulator


def without_cells(grid: OccupancyGrid, cells: Cells) -> OccupancyGrid:
    """Copy of a map in which some cells are free."""
    made = grid.cells.copy()
    made[tuple(cells.T)] = FREE
    return dataclasses.replace(grid, cells=made)
