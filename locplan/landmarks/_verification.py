"""Verification of landmarks: simulated drives before, after, and with random places."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from locplan._util.checks import whole
from locplan._util.progress import ProgressCallback, parts
from locplan._util.random_streams import random_of
from locplan._util.records import Table
from locplan.costs import Costmap, Path
from locplan.errors import LocplanError
from locplan.landmarks._fields import Profile, fields_along
from locplan.landmarks._objects import with_objects
from locplan.landmarks._outcomes import Outcome, outcomes_table
from locplan.landmarks._search import Search
from locplan.landmarks._setting import Setting
from locplan.maps import OccupancyGrid
from locplan.planners import plan
from locplan.simulation import Drives, Simulator, check_drives, drive_paths

FEW_LOST = 0.02
"""Share of lost drives up to which none counts as lost to begin with."""
RANDOM_PLACES = 100
"""Stream of random numbers of places at random, beside those of `Simulator`."""


@dataclass(frozen=True, eq=False, repr=False)
class Verification:
    """Drives without landmarks, with them, and with as many objects at random places."""

    before: Outcome
    """Drives without landmarks."""
    after: Outcome
    """Drives with them."""
    random: Outcome | None
    """Drives with random places; None where no object may stand at other ones."""
    profiles: Mapping[str, tuple[Drives, Drives]]
    """Drives of each route before and after."""
    fields: Mapping[str, tuple[Profile, Profile]]
    """Largest deviation of a single match along each route before and after, by `Fused`: rows of
    the distance driven and the deviation, (n, 2) [m]."""
    seed: int
    """Seed of all random numbers."""

    def __repr__(self) -> str:
        return f"Verification({self.verdict})"

    @property
    def helps(self) -> bool:
        """Whether fewer are lost after, or as few with clearly less error.

        The intervals do not touch, and the error falls by a tenth or more.
        """
        return self.after.better_than(self.before)

    @property
    def hurts(self) -> bool:
        """Whether more are lost after, or as many with clearly more error."""
        return self.before.better_than(self.after)

    @property
    def none_lost(self) -> bool:
        """Whether no drive was lost before and after, but for 2 %."""
        return max(self.before.lost_rate.value, self.after.lost_rate.value) <= FEW_LOST

    @property
    def nothing_to_gain(self) -> bool:
        """Whether no drive was lost to begin with, and the error is not clearly another after."""
        return self.none_lost and not self.helps and not self.hurts

    @property
    def verdict(self) -> str:
        """What the drives say, in one line."""
        before, after, random = self.before, self.after, self.random
        lost = before.lost_rate.value
        error = f"{before.rmse.value:.2f} -> {after.rmse.value:.2f} m"
        said = "they hurt" if self.hurts else "they help" if self.helps else "not shown to help"
        if self.none_lost:
            said = "nothing to gain" if self.nothing_to_gain else said
            few = f"{lost:.0%} of the drives were" if lost else "no drive was"
            said += f": {few} lost to begin with; error {error}"
            return said + (f", {random.rmse.value:.2f} m at random places" if random else "")
        said += f": {lost:.0%} of the drives lost before, {after.lost_rate.value:.0%} after"
        said += f", {random.lost_rate.value:.0%} at random places" if random else ""
        return f"{said}; error {error}"

    @property
    def match_deviations(self) -> NDArray[np.float64]:
        """Median and 95 % quantile [m] along the routes of `fields`, before and after, (2, 2)."""
        every = (np.concatenate([pair[n][:, 1] for pair in self.fields.values()]) for n in (0, 1))
        return np.array([np.nanquantile(values, [0.5, 0.95]) for values in every])

    def table(self) -> Table:
        """The drives on each map: how many were lost, and their errors."""
        named = {"none": self.before, "proposed": self.after}
        if self.random:
            named["as many at random"] = self.random
        return outcomes_table("landmarks", named)

    def summary(self) -> dict[str, object]:
        """The verdict, and the numbers behind it, fit for JSON."""
        return {
            "verdict": self.verdict,
            "nothing_to_gain": self.nothing_to_gain,
            "helps": self.helps,
            "hurts": self.hurts,
            "before": self.before.summary(),
            "after": self.after.summary(),
            "random": self.random.summary() if self.random else None,
            "match_deviation": {
                name: {"median": median, "quantile_95": high}
                for name, (median, high) in zip(
                    ("before", "after"), self.match_deviations.tolist(), strict=True
                )
            },
            "seed": self.seed,
        }


def verified(
    setting: Setting,
    maps: tuple[OccupancyGrid, OccupancyGrid],
    search: Search,
    count: int,
    drives: int,
    seed: int,
    random_sets: int,
    threads: int | None,
    progress: ProgressCallback | None,
) -> Verification:
    """Drive on the maps before and after, and with `count` objects at random places.

    See `Landmarks.verify`.
    """
    check_drives(drives)
    whole("random_sets", random_sets, 1, 1000)
    sets = _random_maps(setting, search, count, min(random_sets, drives // 2), seed)
    routes = len(setting.routes)
    shares = [drives // max(len(sets), 1)] * len(sets)
    callbacks = parts(progress, [routes * n for n in (drives, drives, *shares)])
    before = drive_on(setting, maps[0], drives, seed, threads, callbacks[0])
    after = drive_on(setting, maps[1], drives, seed, threads, callbacks[1])
    others: list[Drives] = []
    for grid, share, part in zip(sets, shares, callbacks[2:], strict=True):
        others += drive_on(setting, grid, share, seed, threads, part)
    ways = paths_on(setting, maps[0]), paths_on(setting, maps[1])
    return Verification(
        Outcome(tuple(before)),
        Outcome(tuple(after)),
        Outcome(tuple(others)) if others else None,
        dict(zip(setting.routes, zip(before, after, strict=True), strict=True)),
        fields_along(maps, ways, setting.robot.known_lidar, threads),
        seed,
    )


def drive_on(
    setting: Setting,
    grid: OccupancyGrid,
    drives: int,
    seed: int,
    threads: int | None,
    progress: ProgressCallback | None,
) -> Sequence[Drives]:
    """Drives of each route on a map that the robot's filter has, too."""
    simulator = Simulator(
        grid,
        robot=setting.robot,
        seed=seed,
        threads=threads,
    )
    return list(drive_paths(simulator, paths_on(setting, grid), drives, progress=progress).values())


def paths_on(setting: Setting, grid: OccupancyGrid) -> Mapping[str, Path]:
    """The routes that were given, or the shortest paths between their ends on a map."""
    if not setting.planned:
        return setting.routes
    costs = Costmap.blank(grid, robot_radius=setting.robot.radius)
    paths = {}
    for name, path in setting.routes.items():
        (x0, y0), (x1, y1) = path.xy[[0, -1]].tolist()
        found = plan(costs, (x0, y0), (x1, y1)).path
        if found is None:
            raise LocplanError(
                f"no path of the robot leads along {name} on the map"
                f" {'with' if grid is not setting.grid else 'without'} landmarks"
            )
        paths[name] = found
    return paths


def _random_maps(
    setting: Setting, search: Search, count: int, sets: int, seed: int
) -> list[OccupancyGrid]:
    """Maps with `count` objects at random places of those that are allowed."""
    maps = []
    for n in range(sets):
        chosen = search.at_random(count, random_of(seed, RANDOM_PLACES, n))
        if not chosen:
            return []
        poses = search.in_world(setting.grid, np.array(chosen, np.int64))
        maps.append(with_objects(setting.grid, setting.kind, poses))
    return maps
