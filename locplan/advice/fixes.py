"""Fixes that are tried: each makes of a site one on which the robot may localize better."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

from locplan._support.kernels.arrays import Floats
from locplan._support.progress import ProgressCallback
from locplan.advice.driving import Site, SiteRunner
from locplan.advice.landmark_objects import Pole, with_objects
from locplan.advice.landmarks import place_landmarks
from locplan.advice.map_reading import MapReading
from locplan.advice.preset_choice import PresetChoice
from locplan.advice.trials import WORTHWHILE, Outcome
from locplan.errors import ConfigError
from locplan.maps.grid import OccupancyGrid
from locplan.planning.costmap import Costmap
from locplan.planning.path import Path
from locplan.planning.plans import plan
from locplan.robots.amcl import Amcl
from locplan.robots.presets import with_preset
from locplan.simulation.recommendation import Recommendation

POLES = 3
"""Number of poles that are placed if no other fix helps enough."""
WALLS, MEND, REACH = "walls", "map", "range"
SETTINGS, PATHS, LANDMARKS = "settings", "paths", "landmarks"
"""The kinds of fixes."""
CHEAP = WALLS, MEND, REACH, SETTINGS
"""Kinds that take a file or a parameter, and neither metres nor objects."""
KINDS = (*CHEAP, PATHS, LANDMARKS)
"""All kinds, by effort; those that mend what is wrong come before those that make up for it."""


@dataclass(frozen=True)
class Fix:
    """A change that may help, and what it makes of a site."""

    kind: str
    """One of the kinds above."""
    title: str
    """The fix in a few words."""
    detail: str
    """What exactly is changed."""
    effort: str
    """What has to be done at the site."""
    apply: Callable[[Site], Site]
    """Returns the site with it."""
    is_sure: bool = False
    """True if it is to be done whatever drives show."""
    artifact: Any = None
    """What its files are made of: a mask's costmap, or landmarks."""


def list_fixes(site: Site, reading: MapReading, mended: OccupancyGrid) -> Iterator[Fix]:
    """Yield the fixes of the map and of the robot's file that suit a site.

    Parameters
    ----------
    site : Site
        What is driven.
    reading : Reading
        How the map's file should be read.
    mended : OccupancyGrid
        The map for the filter that `mend` makes.
    """
    if reading.reasons:
        yield Fix(
            *(WALLS, "corrected map file", reading.title, "the map's YAML"),
            lambda old: replace(old, filter_map=reading.grid, stretch=1.0),
            is_sure=reading.is_sure,
        )
    if mended not in (reading.grid, site.filter_map):
        yield Fix(
            *(MEND, "repaired map", "the repaired map for the filter", "a second map server"),
            lambda old: replace(old, filter_map=mended),
        )
    robot_filter = site.robot.filter
    if (
        isinstance(robot_filter, Amcl)
        and robot_filter.reach(site.robot.known_lidar) < site.robot.known_lidar.range
    ):
        full: dict[str, Any] = {"laser_max_range": Amcl().laser_max_range}
        far = f"laser_max_range {Amcl().laser_max_range:g}"
        yield Fix(
            *(REACH, "full lidar range", far, "one parameter"),
            lambda old: with_settings(old, replace(old.robot.amcl, **full)),
        )


def with_settings(site: Site, amcl: Amcl) -> Site:
    """Return a site whose filter has other settings.

    Parameters
    ----------
    site : Site
        The site.
    amcl : Amcl
        The settings.
    """
    return replace(site, robot=replace(site.robot, filter=amcl))


def preset_settings(choice: PresetChoice) -> Fix | None:
    """Return the fix of the preset to use; None if the user's settings stay.

    Parameters
    ----------
    choice : PresetChoice
        The choice among the presets. If a recording has decided, no simulation contradicts it.
    """
    if not choice.is_preset:
        return None
    return Fix(
        *(SETTINGS, f"{choice.name} settings", choice.changes, "a parameter file"),
        lambda old: with_settings(old, with_preset(old.robot.amcl, choice.name)),
        is_sure=bool(choice.recordings),
    )


def propose_paths(
    site: Site, recommendations: Mapping[str, Recommendation], score: Callable[[Site], float]
) -> Fix | None:
    """The recommended paths of routes, or a mask on which these or others are the cheapest.

    Parameters
    ----------
    site : Site
        What is driven.
    recommendations : mapping of str to Recommendation
        What was chosen for routes by their names, with costmaps.
    score : callable
        Drives a site, and gives what sites are ranked by; less is better.
    """
    useful_recommendations = {
        name: recommendation
        for name, recommendation in recommendations.items()
        if recommendation.path and recommendation.best > 0
    }
    paths_by_route = {
        name: recommendation.path
        for name, recommendation in useful_recommendations.items()
        if recommendation.path
    }
    if not paths_by_route:
        return None
    best = _make_paths_fix(site, paths_by_route, "other paths", "routes for Nav2")
    # A mask leads from everywhere to everywhere, and is worth a little more than routes.
    best_score = score(best.apply(site)) - math.log(WORTHWHILE)
    for recommendation in useful_recommendations.values():
        mask = recommendation.costmap()
        ways = {name: plan(mask, *path.xy[[0, -1]]).path for name, path in site.paths.items()}
        usable_paths = {name: path for name, path in ways.items() if path and path.length}
        if len(usable_paths) < len(ways):
            continue
        mask_fix = _make_paths_fix(
            site, usable_paths, "a keepout mask, other paths", "a mask for Nav2", mask
        )
        if (mask_score := score(mask_fix.apply(site))) < best_score:
            best, best_score = mask_fix, mask_score
    return best


def _make_paths_fix(
    site: Site, paths: Mapping[str, Path], subject: str, effort: str, mask: Costmap | None = None
) -> Fix:
    """The fix of other paths; those that are as long as they were count as the old ones."""
    longer = {name: path.length - site.paths[name].length for name, path in paths.items()}
    changed = {
        name: paths[name] for name, extra_length in longer.items() if abs(extra_length) > 0.01
    }
    extra_length = sum(longer.values()) / max(1, len(changed))
    detail = f"{subject} on {len(changed)} of {len(site.paths)} routes, {extra_length:+.1f} m"
    title = "keepout mask" if mask else "other paths"

    def apply(old: Site) -> Site:
        return replace(old, paths={**old.paths, **changed})

    return Fix(PATHS, title, detail, effort, apply, artifact=mask)


class Poles(NamedTuple):
    """Where poles go."""

    poses: Floats
    """World x, y and heading of each, (n, 3) [m, m, rad]."""
    grid: OccupancyGrid
    """The map with them."""


def place_poles(site: Site, threads: int | None) -> Fix | None:
    """Three poles beside the routes; None where none may stand or none helps.

    Parameters
    ----------
    site : Site
        What is driven.
    threads : int or None
        Number of threads.
    """
    kind = Pole(max(0.2, 2 * site.world.resolution))
    options: Any = {"paths": site.paths, "robot": site.robot, "threads": threads}

    try:
        poses = place_landmarks(site.world, kind, POLES, **options).poses
    except ConfigError:
        return None
    if not len(poses):
        return None

    def apply(old: Site) -> Site:
        world = with_objects(old.world, kind, poses)
        same = old.filter_map is old.world
        filter_map = world if same else with_objects(old.filter_map, kind, poses)
        return replace(old, world=world, filter_map=filter_map)

    poles = Poles(poses, with_objects(site.world, kind, poses))
    count = f"{len(poses)} poles"
    return Fix(LANDMARKS, count, f"{count} beside the routes", count, apply, artifact=poles)


def apply_fixes(fixes_by_kind: Mapping[str, Fix], kinds: tuple[str, ...], site: Site) -> Site:
    """A site with several fixes, one after the other: the mended map is that of the right file."""
    for kind in sorted(kinds, key=KINDS.index):
        site = fixes_by_kind[kind].apply(site)
    return site


class DriveOnce(Protocol):
    """Function that drives a site with the drives of some numbers."""

    def __call__(
        self, site: Site, numbers: range, progress: ProgressCallback | None = None
    ) -> Outcome: ...


def make_site_runner(seed: int, threads: int | None) -> DriveOnce:
    """Return a function that drives sites, but each drive only once."""
    outcomes: dict[str, dict[int, Outcome]] = defaultdict(dict)

    def drive(site: Site, numbers: range, progress: ProgressCallback | None = None) -> Outcome:
        site_outcomes = outcomes[site.digest]
        new = [number for number in numbers if number not in site_outcomes]
        if new:
            missing = range(new[0], new[-1] + 1)
            new_outcomes = SiteRunner(site, seed, threads)(missing, progress)
            for place, number in enumerate(missing):
                site_outcomes[number] = new_outcomes.select(drives=slice(place, place + 1))
        return Outcome.join([site_outcomes[number] for number in numbers])

    return drive
