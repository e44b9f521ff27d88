"""The search for twins at all places of a map, and its report for people."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence

import numpy as np

from locplan._kernels.arrays import Floats, Ints
from locplan._util.checks import check_threads, position, positive, shown
from locplan._util.poses import wrapped
from locplan._util.progress import ProgressCallback, parts
from locplan._util.records import Table
from locplan.costs import Costmap
from locplan.errors import ConfigError
from locplan.field import equipped
from locplan.maps import OccupancyGrid, check_grid
from locplan.matching import (
    GLOBAL_EFFECTIVE_BEAMS,
    Database,
    Matching,
    ScanDatabase,
    checked_database,
    find_all_modes,
    in_batches,
    make_database,
    places_every,
)
from locplan.robots import Disturbances, Robot
from locplan.twins._places import (
    LAYERS,
    LISTED,
    STARTS,
    SYMMETRIES,
    THRESHOLD,
    TWIN,
    GlobalMatches,
    Looks,
    Start,
    look_around,
    noisy_scans,
)
from locplan.twins._symmetries import find_symmetries
from locplan.twins._twins import SHOWN, Twins

PLACE_SPACING = 0.8
"""Default distance between neighbouring places [m]."""
PLACE_HEADINGS = 8
"""Number of headings at each place where what the lidar sees depends on the heading."""


def find_twins(
    grid: OccupancyGrid,
    robot: Robot | None = None,
    *,
    places: Iterable[Sequence[float]] | None = None,
    spacing: float = PLACE_SPACING,
    global_effective_beams: float = GLOBAL_EFFECTIVE_BEAMS,
    count_missing: bool = False,
    database: ScanDatabase | None = None,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Twins:
    """Find the places that a robot can be mistaken for when one scan is matched with a whole map.

    The scan that the lidar would take at each place is compared with all places and turns, and the
    best ones are refined on the map's likelihood field. What is found foresees failures of global
    matching of single scans, and says where to start a robot. It does not foresee well where
    AMCL's own global localization fails, which scatters particles and drives: in 150 simulated
    drives each with an AUC of .77 in a warehouse, and of .51 in an office.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    robot : Robot, optional
        The robot with its lidar, by default one of 6 m that sees all round; its radius is the
        distance that it keeps from walls.
    places : iterable of (x, y), optional
        Places in the world [m]; by default all that the robot can reach, `spacing` apart.
    spacing : float, default 0.8
        Distance between neighbouring places [m], at least a cell. A smaller one misses less, and
        takes longer.
    global_effective_beams : float, default 36.0
        Number of independent beams that count as much as all round do, above 0, which makes losses
        nats. It is fitted to global matches; it is not the number of `locplan.Scan`, which is
        fitted to the uncertainty of a match near its place.
    count_missing : bool, default False
        True lets a beam without a return count against places where it would meet a wall in range.
        AMCL ignores such beams; set it for a matcher that does not.
    database : ScanDatabase, optional
        What the lidar sees on this map, if it is to be kept by the caller, as for `locate`; its
        clearance must be the robot's radius. By default the last four are kept.
    threads : int, optional
        Number of threads, at least 1; all cores by default. The result does not depend on it.
    progress : callable, optional
        Called with (done, total) poses, which are looked at for twins and then for symmetries.

    Returns
    -------
    Twins
        What each place can be mistaken for, and the symmetries of the map.

    Raises
    ------
    LocplanError
        If a value is out of its range, the robot cannot stand at a place, or fits nowhere, or the
        database is of another map, lidar or radius.

    Examples
    --------
    >>> import locplan
    >>> grid = locplan.maps.environments.make("places", resolution=0.1)
    >>> twins = find_twins(grid, locplan.Robot(locplan.Lidar(range=8.0)), spacing=2.0)
    >>> twins.elsewhere.shape == (len(twins),)
    True
    """
    check_grid(grid)
    robot = equipped(robot)
    lidar = robot.known_lidar
    matching = Matching(
        lidar=lidar,
        global_effective_beams=global_effective_beams,
        robot_radius=robot.radius,
        count_missing=count_missing,
    )
    positive("spacing", spacing, "m")
    if spacing < grid.resolution:
        raise ConfigError(
            f"spacing must be at least a cell of the map, {grid.resolution:g} m, not {spacing:g}"
        )
    workers = check_threads(threads)
    if places is None:
        seen = _seen_everywhere(grid, matching, (), database)
        positions = places_every(spacing, seen.fits, grid.resolution)
        xy = np.column_stack(grid.grid_to_world(positions[:, 1], positions[:, 0]))
    else:
        cells, xy = _checked(grid, places, robot.radius)
        seen = _seen_everywhere(grid, matching, cells, database)
        row, col = grid.world_to_grid(xy[:, 0], xy[:, 1])
        positions = np.column_stack([col, row])
    count = 1 if lidar.sees_alike_in_all_headings else PLACE_HEADINGS
    headings = np.arange(count, dtype=np.float64) * (2 * math.pi / count)
    homes = np.column_stack(
        [np.repeat(positions, count, axis=0), np.tile(headings, len(positions))]
    )
    ranges = seen.scans_at(homes)

    def look(some: Ints) -> list[Looks]:
        return [look_around(seen, ranges[n], homes[n]) for n in some]

    looking, moving = parts(progress, [len(homes), len(homes)])
    looks = in_batches(look, len(homes), workers, looking)
    symmetries, covered = find_symmetries(seen, homes, ranges, looks, workers, moving)
    shape = len(positions), count
    return Twins(
        grid=grid,
        matching=matching,
        spacing=float(spacing),
        places=xy,
        headings=wrapped(headings + grid.origin[2]),
        values={
            name: np.array([getattr(look, name) for look in looks], np.float64).reshape(shape)
            for name in LAYERS
        },
        twins=_listed(seen, looks).reshape(*shape, LISTED, 4),
        symmetries=tuple(symmetries),
        covered=np.array([each.reshape(shape).any(axis=1) for each in covered], bool).reshape(
            len(covered), len(positions)
        ),
    )


def _seen_everywhere(
    grid: OccupancyGrid,
    matching: Matching,
    cells: Sequence[tuple[int, int]],
    database: ScanDatabase | None,
) -> Database:
    """Ranges at all reachable places; cells (row, col) are reachable in regions however small."""
    shared = checked_database(grid, matching.lidar, matching.robot_radius, database)
    if shared.clearance != matching.robot_radius:
        raise ConfigError(
            f"the database has a clearance of {shared.clearance:g} m, not the robot's radius of"
            f" {matching.robot_radius:g} m; make ScanDatabase(grid, lidar,"
            f" clearance={matching.robot_radius:g})"
        )
    every = shared.everywhere
    if all(every.fits[cell] for cell in cells):
        return dataclasses.replace(every, matching=matching)
    return make_database(grid, matching, cells)


def _checked(
    grid: OccupancyGrid, places: Iterable[Sequence[float]], robot_radius: float
) -> tuple[list[tuple[int, int]], Floats]:
    """Cells (row, col) of places in the world, and their positions, (n, 2) [m]."""
    cells, xy = [], []
    if not isinstance(places, Iterable):
        raise ConfigError(f"places must be positions x, y in the world [m], not {shown(places)}")
    fits = grid.free & ~grid.closer_than(robot_radius - 1e-9)  # much smaller than a costmap
    for place in places:
        cell = grid.world_to_cell(*position(place, name="place"))
        if not (grid.contains(*cell) and fits[cell]):
            Costmap.blank(grid, robot=robot_radius).cell_of(place, "place")  # says why
        cells.append(cell)
        xy.append([float(value) for value in place])
    if not xy:
        raise ConfigError("there must be at least one place; leave places out for all")
    return cells, np.array(xy)


def _listed(database: Database, looks: Sequence[Looks]) -> Floats:
    """World x, y, heading and excess of the twins of each pose, (n, LISTED, 4)."""
    twins = np.full((len(looks), LISTED, 4), np.nan)
    for n, look in enumerate(looks):
        if len(look.twins):
            twins[n, : len(look.twins), :3] = database.in_world(look.twins[:, :3])
            twins[n, : len(look.twins), 3] = look.twins[:, 3]
    return twins


NAMED = 1.5
"""Distance from a twin of the nearest place up to which a match lies on it [m]."""


def global_matches(
    twins: Twins,
    count: int,
    disturbances: Disturbances,
    seed: int,
    threads: int | None,
    progress: ProgressCallback | None,
) -> GlobalMatches:
    """Match `count` noisy scans with the map; see `Twins.verify`."""
    grid, matching, (rows, cols, near) = twins.grid, twins.matching, twins.nearest_places
    if not rows.size:
        raise ConfigError("no cell of the map lies near a place whose twins are known")
    random = np.random.default_rng(seed)
    chosen = random.integers(0, rows.size, count)
    aside = random.random((2, count))
    at = cols[chosen] + aside[0], rows[chosen] + aside[1]
    poses = np.column_stack([*at, random.uniform(-math.pi, math.pi, count)])
    looked = [grid.world_to_cell(x, y) for x, y in twins.places.tolist()]
    database = make_database(grid, matching, looked)
    scans = noisy_scans(grid, matching, poses, disturbances, random, seed)
    found = find_all_modes(database, scans, threads=check_threads(threads), progress=progress)
    nowhere = np.full(3, np.nan)
    best = np.array([each.poses[0] if len(each.poses) else nowhere for each in found])
    matched = database.in_world(best)
    near = near[chosen]
    apart = twins.twins[near, ..., :2].reshape(count, -1, 2) - matched[:, None, :2]
    to_twins = np.nan_to_num(np.hypot(*np.moveaxis(apart, -1, 0)), nan=np.inf)
    on_twin = to_twins.min(axis=1, initial=np.inf) <= NAMED
    slid, stretch = np.hypot(*(matched[:, :2] - twins.places[near]).T), twins.stretch[near]
    named = on_twin | ((stretch > 0) & (slid <= stretch + NAMED))
    world = database.in_world(poses)
    return GlobalMatches(world, matched, twins.excess[near], twins.elsewhere[near], named)


def twins_report(
    twins: Twins, starts: Sequence[Start] | None = None, matches: GlobalMatches | None = None
) -> str:
    """What can be mistaken for what, the symmetries, the best starts, and what matches say.

    Of one place only, its twins instead.
    """
    starts = twins.best_starts() if starts is None else starts
    said = _of_place(twins) if len(twins) == 1 else _of_all(twins, starts)
    if matches:
        low, high = matches.failure_rate.low, matches.failure_rate.high
        said.append(
            f"{len(matches.poses)} noisy scans from random poses were matched:"
            f" {matches.failed.mean():.1%} [{low:.1%}, {high:.1%}] failed,"
            f" {matches.elsewhere.mean():.1%} was foreseen; {_foreseen(matches)}"
        )
    return "\n".join(said)


def _foreseen(matches: GlobalMatches) -> str:
    """How well failures were foreseen, where there are some, and named."""
    if not matches.failed.any():
        return "no match was wrong, so that nothing can be said of how well failures are foreseen"
    named = f"twins or stretches name {matches.named_share:.0%} of the wrong matches"
    return named if math.isnan(matches.auc) else f"AUC {matches.auc:.2f}; {named}"


def _of_all(twins: Twins, starts: Sequence[Start]) -> list[str]:
    alone = float((twins.stretch > 0).mean())
    said = [
        f"{twins.grid.name or 'map'}: {twins.share:.0%} of {len(twins)} places have a twin of"
        f" up to {THRESHOLD:g} nats more than 2 m away; on {alone:.0%} a match can slide"
    ]
    if twins.unseen > 0:
        said.append(f"on {twins.unseen:.0%} too few beams return to say anything")
    said.append(
        f"with {twins.matching.lidar.title}; about matches of single scans with the whole map;"
        " AMCL's own global localization, which scatters particles and drives, is not foreseen well"
    )
    if twins.symmetries:
        said.append(Table.of(SYMMETRIES, twins.symmetries, number="symmetry").text(SHOWN))
        more = len(twins.symmetries) - SHOWN
        said += [f"{more} more with fewer places"] if more > 0 else []
    else:
        said.append("no symmetry: no rigid move takes a tenth of the places to twins")
    if starts:
        said.append(str(Table.of(STARTS, starts, number="start")))
        # Share of the posterior elsewhere from which on a start is not safe.
        if starts[0].elsewhere > 0.1:
            said.append("no start is safe: give the robot its pose, or add a landmark")
    return said


def _of_place(twins: Twins) -> list[str]:
    x, y = twins.places[0]
    stretch, turned, found = twins.stretch[0], twins.turned[0], twins.of(0)
    said = [f"{x:.2f},{y:.2f}: {twins.elsewhere[0]:.1%} of the posterior lies more than 2 m away"]
    if stretch > 0:
        said.append(f"a match can slide {stretch:.1f} m without a rise of the loss")
    if turned:
        said.append(f"it looks alike in {turned:.0f} other headings")
    return [*said, Table.of(TWIN, found, number="twin").text(SHOWN) if found else "no twin"]
