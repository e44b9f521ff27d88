"""Cures that are tried: each makes of a site one on which the robot may localize better."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from locplan._util.progress import ProgressCallback, parts
from locplan.costs import Costmap, Path
from locplan.diagnosis._driving import Driver, Outcome, Site, contrast, keeps_more
from locplan.errors import ConfigError
from locplan.landmarks import Landmarks, Pole, place_landmarks, with_objects
from locplan.maps import MapFaults
from locplan.mending import mend
from locplan.robots import Amcl
from locplan.simulation import choose

POLES = 3
"""Number of poles that are placed where nothing else helps enough."""
ALPHAS = (0.05, 0.1, 0.2)
"""Noise of odometry of the settings that are tried, each with both laser models."""
WALLS, MEND, REACH = "walls", "map", "range"
SETTINGS, PATHS, LANDMARKS = "settings", "paths", "landmarks"
"""The kinds of cures."""
CHEAP = WALLS, MEND, REACH, SETTINGS
"""Kinds that take a file or a parameter, and neither metres nor objects."""
KINDS = (*CHEAP, PATHS, LANDMARKS)
"""All kinds, by effort; those that mend what is wrong come before those that make up for it."""


@dataclass(frozen=True)
class Remedy:
    """A cure, and what it makes of a site."""

    kind: str
    """One of the kinds above."""
    title: str
    """What is done, as a noun phrase for people."""
    effort: str
    """What has to be done at the site."""
    apply: Callable[[Site], Site]
    """Gives the site with it."""


def remedies(site: Site, found: MapFaults, seed: int, threads: int | None) -> Iterator[Remedy]:
    """The cures of the map and of the robot's file that suit a site."""
    if site.filter_map is not site.world:
        yield Remedy(
            *(WALLS, "mended thresholds of the map", "one number in the map's YAML"),
            lambda old: dataclasses.replace(old, filter_map=old.world),
        )
    if any(each.kind in ("solid walls", "specks") for each in found):
        mended = mend(site.world, site.robot, paths=1, drives=2, seed=seed, threads=threads)
        if mended.changed:
            yield Remedy(
                *(MEND, "the mended map for the filter", "a second map server"),
                lambda old: dataclasses.replace(old, filter_map=mended.filter_map),
            )
    own = site.robot.filter
    if isinstance(own, Amcl) and own.reach(site.robot.known_lidar) < site.robot.known_lidar.range:
        full: dict[str, Any] = {"laser_max_range": Amcl().laser_max_range}
        yield Remedy(
            *(REACH, f"the lidar's full {site.robot.known_lidar.range:g} m", "one parameter"),
            lambda old: _with_filter(old, dataclasses.replace(old.robot.amcl, **full)),
        )


def _with_filter(site: Site, own: Amcl) -> Site:
    return dataclasses.replace(site, robot=dataclasses.replace(site.robot, filter=own))


def settings(own: Amcl) -> dict[str, dict[str, object]]:
    """Changes of AMCL's settings that are tried, by how they are called."""
    found = {}
    for alpha in ALPHAS:
        changes: dict[str, object] = dict.fromkeys([f"alpha{n}" for n in range(1, 6)], alpha)
        for model in ("likelihood_field_prob", own.laser_model_type):
            changed = {**changes, "laser_model_type": model}
            if dataclasses.replace(own, **changed) != own:  # type: ignore[arg-type]
                short = ", " + model if model != own.laser_model_type else ""
                found[f"settings: alphas {alpha:g}{short}"] = changed
    return found


def tuned(site: Site, few: Outcome, drive: Callable[[Site], Outcome]) -> Remedy | None:
    """The best of a few settings that are good for most robots, by few drives.

    Parameters
    ----------
    site : Site
        What is driven.
    few : Outcome
        The drives of the site as it is.
    drive : callable
        Drives another site with the same numbers.
    """
    own = site.robot.filter
    if not isinstance(own, Amcl):
        return None
    tried: dict[str, float] = {}
    every = settings(own)
    for title, changes in every.items():
        after = drive(_with_filter(site, dataclasses.replace(own, **changes)))  # type: ignore[arg-type]
        tried[title] = contrast(few, after).score
    if not tried:
        return None
    best = min(tried, key=lambda each: tried[each])

    def apply(old: Site) -> Site:
        return _with_filter(old, dataclasses.replace(old.robot.amcl, **every[best]))  # type: ignore[arg-type]

    return Remedy(SETTINGS, best, "a parameter file", apply)


def chosen_paths(
    site: Site,
    costs: Costmap,
    few: Outcome,
    drives: int,
    seed: int,
    threads: int | None,
    progress: ProgressCallback | None,
) -> Remedy | None:
    """The paths that `choose` recommends on the trips that lose drives.

    Parameters
    ----------
    site : Site
        What is driven.
    costs : Costmap
        Costmap of the field.
    few : Outcome
        Drives of the site as it is.
    drives : int
        Maximum number of confirming drives of a path.
    seed, threads, progress
        See `locplan.choose`.
    """
    worst = [name for name, lost in zip(site.paths, few.lost, strict=True) if lost.any()]
    found: dict[str, Path] = {}
    own = None if site.filter_map is site.world else site.filter_map
    for name, step in zip(worst, parts(progress, [100] * len(worst)), strict=True):
        start, goal = map(tuple, site.paths[name].xy[[0, -1]].tolist())
        about: dict[str, Any] = {"costs": costs, "drives": drives, "rival": None, "filter_map": own}
        choice = choose(site.world, start, goal, site.robot, seed=seed, threads=threads, **about)
        if choice.path is not None and choice.best > 0:
            found[name] = choice.path
        step(100, 100)
    if not found:
        return None
    more = sum(path.length - site.paths[name].length for name, path in found.items())
    count = f"{len(found)} of {len(site.paths)} trips, {more / len(found):+.1f} m"

    def apply(old: Site) -> Site:
        return dataclasses.replace(old, paths={**old.paths, **found})

    return Remedy(PATHS, f"other paths on {count}", "routes for Nav2", apply)


def landmarks(site: Site, threads: int | None) -> tuple[Remedy, Landmarks] | None:
    """Three poles beside the trips; None where none may stand or none helps.

    Parameters
    ----------
    site : Site
        What is driven.
    threads : int or None
        Number of threads.
    """
    kind = Pole(max(0.2, 2 * site.world.resolution))
    try:
        made = place_landmarks(
            site.world, kind, POLES, paths=site.paths, robot=site.robot, threads=threads
        )
    except ConfigError:
        return None
    if not len(made):
        return None

    def apply(old: Site) -> Site:
        world, own = (with_objects(each, kind, made.poses) for each in (old.world, old.filter_map))
        same = old.filter_map is old.world
        return dataclasses.replace(old, world=world, filter_map=world if same else own)

    at = " and ".join(f"{x:.1f},{y:.1f}" for x, y in made.positions.tolist())
    title = f"{len(made)} poles at {at}"
    return Remedy(LANDMARKS, title, f"{len(made)} poles", apply), made


def joined(tried: Mapping[str, Remedy], kinds: tuple[str, ...], site: Site) -> Site:
    """A site with several cures, one after the other."""
    for kind in kinds:
        site = tried[kind].apply(site)
    return site


def combined(
    tried: Mapping[str, Remedy],
    order: list[str],
    site: Site,
    drive: Callable[[Site], Outcome],
) -> tuple[tuple[str, ...], Outcome, Outcome]:
    """The cures that are worth being done together, by fresh drives.

    Parameters
    ----------
    tried : mapping of str to Remedy
        The cures by kind.
    order : list of str
        Kinds of those that are clearly better alone, the best first.
    site : Site
        What is driven.
    drive : callable
        Drives a site with fresh numbers.

    Returns
    -------
    kinds, before, after
        The kinds, and the drives without and with all of them.
    """
    before = drive(site)
    taken: tuple[str, ...] = (order[0],)
    after = drive(joined(tried, taken, site))
    for kind in order[1:]:
        more = drive(joined(tried, (*taken, kind), site))
        said = contrast(after, more)
        if keeps_more(said.verdict, said.gain):  # a second is worth no lower error alone
            taken, after = (*taken, kind), more
    return taken, before, after


def driver_of(seed: int, threads: int | None, numbers: range) -> Callable[[Site], Outcome]:
    """A function that drives sites with the drives of some numbers."""
    return lambda site: Driver(site, seed, threads)(numbers)
