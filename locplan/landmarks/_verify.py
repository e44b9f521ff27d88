"""Simulated drives that verify landmarks."""

from __future__ import annotations

from locplan._util.checks import whole
from locplan._util.intervals import random_of
from locplan._util.progress import ProgressCallback, parts
from locplan.landmarks._landmarks import Landmarks
from locplan.landmarks._objects import with_objects
from locplan.landmarks._search import poses_in_world
from locplan.landmarks._verification import DRIVES, Outcome, Verification
from locplan.maps import OccupancyGrid
from locplan.simulation import Simulator, check_drives, drive_open


def verify_landmarks(
    landmarks: Landmarks,
    drives: int = DRIVES,
    *,
    random_sets: int = 5,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Verification:
    """Simulate drives without landmarks, with them, and with as many objects at random places.

    Routes that were planned between places are planned again among the objects.

    Parameters
    ----------
    landmarks : Landmarks
        The landmarks, with the map, the robot and the routes.
    drives : int, default 100
        Number of drives along each route, 2 to 100,000; all sets of random places together have
        as many. More narrow the intervals.
    random_sets : int, default 5
        Number of sets of random places, 1 to 1000.
    seed : int, default 1
        Seed of all random numbers, >= 0.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    progress : callable, optional
        Called with (done, total) drives.

    Returns
    -------
    Verification
        Share of lost drives and errors on each map, and a verdict.

    Raises
    ------
    ConfigError
        If a number is out of its range.
    """
    check_drives(drives)
    whole("random_sets", random_sets, 1, 1000)
    setting = landmarks.setting
    random_maps = _maps_with_random_objects(landmarks, min(random_sets, drives // 2), seed)
    n_random = drives // max(len(random_maps), 1)
    maps = [setting.grid, landmarks.grid, *random_maps]
    counts = [drives, drives, *[n_random] * len(random_maps)]
    callbacks = parts(progress, [count * len(setting.routes) for count in counts])
    outcomes = []
    for grid, count, report in zip(maps, counts, callbacks, strict=True):
        simulator = Simulator(grid, setting.robot, seed=seed, threads=threads)
        driven = drive_open(simulator, setting.on(grid), range(count), progress=report)
        outcomes.append(Outcome(tuple(driven.values())))
    before, after, *at_random = outcomes
    pooled = Outcome(tuple(each for outcome in at_random for each in outcome.drives))
    pairs = zip(before.drives, after.drives, strict=True)
    profiles = dict(zip(setting.routes, pairs, strict=True))
    return Verification(before, after, pooled if at_random else None, profiles, seed)


def _maps_with_random_objects(landmarks: Landmarks, n_sets: int, seed: int) -> list[OccupancyGrid]:
    """Return maps with objects at random places; none if too few places are allowed."""
    grid, kind, search = landmarks.setting.grid, landmarks.setting.kind, landmarks.search
    # Stream of random numbers of places at random, next to those of `Simulator`.
    choices = [search.at_random(len(landmarks), random_of(seed, 100, n)) for n in range(n_sets)]
    if not all(choices):
        return []
    poses = [poses_in_world(grid, search.places[choice]) for choice in choices]
    return [with_objects(grid, kind, each) for each in poses]
