"""What is known of a place: its twins, how sure a match is, and whether to start a robot there."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from locplan._kernels.arrays import Bools, Floats
from locplan._util.intervals import Interval, wilson
from locplan._util.poses import wrapped
from locplan._util.records import POSE, POSITION, Column
from locplan._util.tables import finite
from locplan.maps import OCCUPIED, OccupancyGrid
from locplan.maps.environments import with_boundary_noise
from locplan.matching import (
    APART,
    AWAY,
    ENOUGH,
    MIN_RETURNS,
    TURNED,
    Database,
    Matching,
    ScanOnMap,
)
from locplan.robots import Disturbances

LAYERS = ("excess", "elsewhere", "modes", "turned", "stretch")
"""Names of what is known of each place, see the properties of `Twins`."""


class Twin(NamedTuple):
    """A pose that a robot can be mistaken for."""

    x: float
    """World x [m]."""
    y: float
    """World y [m]."""
    heading: float
    """Heading there [rad]."""
    excess: float
    """By how much it explains the scan worse [nats]; below 0 it explains it better."""
    here: float
    """Heading of the robot at its place [rad]."""


STARTS = (
    *POSITION,
    Column("excess", "nat", "least excess", 1),
    Column("elsewhere", "", "elsewhere", 1, "%"),
)
TWIN = (*POSE, Column("excess", "nat", "excess"), Column("here", "rad", "heading here", 0, "deg"))
PLACES = (
    *STARTS,
    Column("modes", "", "modes", 0),
    Column("turned", "", "turned", 0),
    Column("stretch", "m", "stretch", 1),
    *(dataclasses.replace(column, name=f"twin_{column.name}", title=None) for column in TWIN[:-1]),
    dataclasses.replace(TWIN[-1], title=None),
)
"""Columns of the places: x, y, `LAYERS`, and the best of the twins."""
SYMMETRIES = (
    Column("turn", "rad", "turn", 0, "deg", signed=True),
    Column("shift_x", "m", "middle moves x", 1, signed=True, value=lambda one: one.shift[0]),
    Column("shift_y", "m", "middle moves y", 1, signed=True, value=lambda one: one.shift[1]),
    Column("share", "", "places", 0, "%"),
    Column("middle_x", "m", value=lambda one: one.middle[0]),
    Column("middle_y", "m", value=lambda one: one.middle[1]),
)


THRESHOLD = 3.0
"""Excess up to which a pose counts as a twin: a match mistakes one in ten such [nats]."""
LISTED = 32
"""Number of twins that are kept of a pose."""


@dataclass(frozen=True, eq=False)
class Looks:
    """The other poses that explain the scan of one pose."""

    excess: float
    """Minimum excess of any pose more than 2 m away [nats]; infinite if there is none."""
    elsewhere: float
    """Share of the posterior more than 2 m away."""
    modes: int
    """Number of modes more than 2 m away with an excess of up to `THRESHOLD`."""
    turned: int
    """Number of modes within 2 m, turned by more than 60 deg, with such an excess."""
    stretch: float
    """Distance up to which the pose may slide without a rise of the loss [m]."""
    twins: Floats
    """x, y [cells], heading on the map and excess of the best twins, (k, 4)."""


def look_around(database: Database, ranges: Floats, home: Floats) -> Looks:
    """Match the scan of a pose, x, y [cells] and heading on the map, with the whole map."""
    scan = ScanOnMap(database, ranges)
    found = scan.modes(home)
    unseen = Looks(0.0, 1.0, 0, 0, 0.0, np.empty((0, 4)))
    if found.returns < MIN_RETURNS:
        return unseen
    resolution = database.grid.resolution
    away = np.hypot(*(found.poses[:, :2] - home[:2]).T) * resolution
    turn = np.abs(wrapped(found.poses[:, 2] - home[2]))
    own = np.flatnonzero((away < APART) & (turn < TURNED))
    if not own.size:  # the robot does not fit quite there
        return unseen
    excess = found.losses - found.losses[own[0]]
    weights = np.exp(-(found.losses - found.losses.min()))
    far = away > AWAY
    joined = scan.joined_to(found, int(own[0]))
    twins = np.flatnonzero(far & ~joined & (excess <= ENOUGH))[:LISTED]
    low = excess <= THRESHOLD
    slid = away[joined & far]
    # Turn from which on a mode in place is another one [rad].
    return Looks(
        excess=float(excess[far].min()) if far.any() else np.inf,
        elsewhere=float(weights[far].sum() / weights.sum()),
        modes=int((far & low).sum()),
        turned=int((~far & low & (turn > np.radians(60.0))).sum()),
        stretch=float(slid.max()) if slid.size else 0.0,
        twins=np.column_stack([found.poses[twins], excess[twins]]),
    )


@dataclass(frozen=True)
class Start:
    """A place from which a global match finds the robot."""

    x: float
    """World x [m]."""
    y: float
    """World y [m]."""
    excess: float
    """Minimum excess of any other place, of this place and its neighbours [nats]."""
    elsewhere: float
    """Maximum share of the posterior elsewhere, of this place and its neighbours, 0..1."""


def best_starts(
    places: Floats, excess: Floats, elsewhere: Floats, count: int, spacing: float, apart: float
) -> Sequence[Start]:
    """See `Twins.best_starts`; a robot never stands quite where it should."""
    from scipy.spatial import cKDTree

    # Factor on the spacing of the places within which they are neighbours.
    near = cKDTree(places).query_ball_point(places, 1.6 * spacing)
    least = np.array([excess[own].min() for own in near])
    most = np.array([elsewhere[own].max() for own in near])
    starts: list[Start] = []
    left = np.ones(len(places), bool)
    for n in np.lexsort([most, -least]):
        if len(starts) == count:
            break
        if left[n]:
            x, y = places[n].tolist()
            starts.append(Start(x, y, float(least[n]), float(most[n])))
            left &= np.hypot(*(places - places[n]).T) >= apart
    return starts


BINS = (0.0, 0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)
"""Edges of the bins in which shares elsewhere are compared with failures."""


@dataclass(frozen=True, eq=False, repr=False)
class GlobalMatches:
    """Noisy scans from n random poses, each matched with the whole map."""

    poses: Floats
    """World x, y and heading of the robot, (n, 3) [m, m, rad]."""
    matched: Floats
    """World x, y and heading of the best match, (n, 3) [m, m, rad]; NaN where too few beams
    returned."""
    excess: Floats
    """Excess of the nearest place, (n,) [nats]."""
    elsewhere: Floats
    """Share of the posterior elsewhere of the nearest place, (n,), 0..1."""
    named: Bools
    """True where the match lies within 1.5 m of a twin of the nearest place, or of its stretch,
    (n,)."""

    def __repr__(self) -> str:
        return f"GlobalMatches({len(self.poses)} scans, {self.failed.mean():.1%} failed)"

    @property
    def failed(self) -> Bools:
        """Whether the match is more than 2 m off, or there is none, (n,)."""
        return np.asarray(~(np.hypot(*(self.matched - self.poses)[:, :2].T) <= AWAY))

    @property
    def failure_rate(self) -> Interval:
        """Share of the matches that failed, with its 95 % interval."""
        return wilson(float(self.failed.mean()), len(self.failed))

    @property
    def auc(self) -> float:
        """Area under the ROC curve of foreseeing failures by `elsewhere`; NaN with one kind."""
        from scipy.stats import rankdata

        ones, others = int(self.failed.sum()), int((~self.failed).sum())
        if not ones or not others:
            return math.nan
        # A failure has the greater share so often; ties count half.
        ranks = float(rankdata(self.elsewhere)[self.failed].sum())
        return (ranks - ones * (ones + 1) / 2) / (ones * others)

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


def noisy_scans(
    grid: OccupancyGrid,
    matching: Matching,
    poses: Floats,
    disturbances: Disturbances,
    random: np.random.Generator,
    seed: int,
) -> Floats:
    """Ranges that are measured at poses x, y [cells] and heading on the map, (n, 96) [m].

    The worlds that differ from the map are taken in turn.
    """
    from locplan._kernels.lidar import measured_ends
    from locplan._kernels.rays import empty_squares

    lidar = matching.lidar
    beams = matching.beams(lidar.mount_x, lidar.mount_y)
    disturbed = disturbances.for_kernels()
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
