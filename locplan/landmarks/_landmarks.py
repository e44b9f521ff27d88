"""The result of a placement: the landmarks, what each gains, and the map with them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np

from locplan._kernels.arrays import Floats, Ints
from locplan._util.checks import keep, whole
from locplan._util.intervals import random_of
from locplan._util.progress import ProgressCallback
from locplan._util.records import POSE, Column, Result, Table
from locplan._util.results import Results
from locplan._util.tables import finite, wrapped
from locplan.landmarks._objects import outline_of, with_objects
from locplan.landmarks._outcomes import DRIVES, Verification, compared
from locplan.landmarks._places import Rejected, counted
from locplan.landmarks._routes import Setting, fields_along
from locplan.landmarks._search import Regularity, Search, Shift, in_world, regularity
from locplan.maps import OccupancyGrid, save_map
from locplan.simulation import Simulator, check_drives

PAYING_SHARE = 0.05
"""Share by which a landmark must lower what is expected to pay."""
COLUMNS = (
    Column("number", title="landmark", digits=0),
    *POSE,
    Column("kind"),
    Column("length", "m"),
    Column("width", "m"),
    Column("gain"),
)
"""Columns of landmarks beside what is expected; a pole's length and width are its diameter."""


class Trial(NamedTuple):
    """A placement that was driven beside others."""

    chosen_by: str
    """How its places were chosen."""
    drives: int
    """Number of drives, along all routes together."""
    lost: int
    """Number of those that were lost at any time."""
    error: float
    """Geometric mean of the drives' root mean square position errors [m]."""


@dataclass(frozen=True, eq=False, repr=False)
class Landmarks(Result):
    """Places of equal objects, in order of gain."""

    _drawn_by: ClassVar[str] = "locplan.landmarks:landmarks_figure"
    _reported_by: ClassVar[str] = "locplan.landmarks._landmarks:landmarks_report"
    files: ClassVar[Results] = Results(
        "landmarks",
        (
            "landmarks.json",
            "landmarks.png",
            "landmarks.csv",
            "landmarks.geojson",
            "rejected.csv",
            "verification.csv",
            "map_with_landmarks.yaml",
            "map_with_landmarks.pgm",
        ),
    )

    setting: Setting
    """The map, the routes and the robot that they are placed for."""
    search: Search
    """The search, for other placements."""
    indices: Ints
    """Index of each place among those of the search, (k,); the existing objects' come first."""
    shifts: tuple[Shift, ...]
    """Landmarks that were taken out of regular rows."""
    rejected: tuple[Rejected, ...]
    """Places that were refused, and why."""
    before: OccupancyGrid
    """The map that was given."""
    existing: int
    """Number of existing objects that could be moved."""
    chosen_by: str
    """How the places were chosen: what was made small, and among which places."""
    trials: tuple[Trial, ...] = ()
    """Placements that were driven by `best_of_trials`, the best first, which is this one."""

    poses: Floats = field(init=False)
    """World x, y and heading of each, (k, 3) [m, m, rad]."""
    curve: Floats = field(init=False)
    """Objective with 0, 1, ... landmarks, (k + 1,).

    It is the expected mean of P_xx + P_yy along routes [m^2], or the mean degeneracy u in a region.
    """
    grid: OccupancyGrid = field(init=False)
    """The map with the landmarks."""

    def __post_init__(self) -> None:
        setting, search = self.setting, self.search
        poses = in_world(setting.grid, search.places[self.indices])
        curve = search.curve(self.indices.tolist())
        keep(self, poses=poses, curve=curve, grid=with_objects(setting.grid, setting.kind, poses))

    def __repr__(self) -> str:
        low, high = self.expected[-1], self.expected[0]
        return (
            f"Landmarks({len(self)} x {self.setting.kind.title} in {self.grid.name or 'map'},"
            f" {self.measure.title} {high:.3g} -> {low:.3g})"
        )

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def positions(self) -> Floats:
        """World x and y of each landmark, (k, 2) [m]."""
        return np.asarray(self.poses[:, :2])

    @property
    def gains(self) -> Floats:
        """What each landmark takes off the curve beside those before it, in its unit, (k,)."""
        return -np.diff(self.curve)

    @property
    def measure(self) -> Column:
        """What `expected` is."""
        return self.search.objective.column

    @property
    def expected(self) -> Floats:
        """Expected deviation of the position along routes [m], the root of the curve, (k + 1,).

        In a region it is the mean degeneracy u, the curve itself.
        """
        return np.asarray(self.curve**self.search.objective.power)

    @property
    def region_area(self) -> float | None:
        """Area of the region in which the robot may be [m^2]; None where it drives routes."""
        region = self.setting.region
        return None if region is None else float(region.sum()) * self.grid.resolution**2

    @property
    def kept(self) -> int:
        """Number of existing objects that stay where they are."""
        return int((self.indices < self.existing).sum())

    @property
    def paying(self) -> int:
        """Number of landmarks from which on no further one pays.

        Each one after lowers what is expected by less than 5 %.
        """
        steps = 1 - self.expected[1:] / np.maximum(self.expected[:-1], 1e-12)
        paying = np.flatnonzero(steps >= PAYING_SHARE)
        return int(paying[-1]) + 1 if paying.size else 0

    @cached_property
    def regular(self) -> Regularity | None:
        """A row of landmarks that the filter can mistake for one a step farther, or None."""
        return regularity(self.positions)

    def advice(self, *, driven: bool = False) -> list[str]:
        """What is doubtful about the places, a sentence each.

        Parameters
        ----------
        driven : bool, default False
            True where `verify` says whether they help.
        """
        little, found = f"lowers it by less than {PAYING_SHARE:.0%}", []
        if self.paying == 0:
            known = "whether they help is what the drives say" if driven else "drive them to know"
            found.append(f"each {little}: {known}")
        elif self.paying < len(self):
            may = f"{self.paying} may do; drive them to know"
            found.append(f"from number {self.paying + 1} on each {little}: {may}")
        found += map(str, self.shifts)
        if row := self.regular:
            found.append(
                f"careful: {row}, which a filter can mistake for a shift; move one of them"
            )
        return found

    def first(self, count: int) -> Floats:
        """World x, y and heading of the landmarks that gain most, (count, 3) [m, m, rad].

        Parameters
        ----------
        count : int
            Number of landmarks, such as `paying`; with more than there are, all are returned.
        """
        return self.poses[:count].copy()

    def reasons(self) -> dict[str, int]:
        """Number of places that were refused for each reason."""
        return dict(Counter(each.reason for each in self.rejected))

    def verify(
        self,
        drives: int = DRIVES,
        *,
        seed: int = 1,
        random_sets: int = 5,
        threads: int | None = None,
        progress: ProgressCallback | None = None,
    ) -> Verification:
        """Drive before, after, and with as many objects at random places.

        Routes that were planned between places are planned again among the objects.

        Parameters
        ----------
        drives : int, default 100
            Number of drives along each route, 2 to 100,000; as many are made in all sets of random
            places together. More narrow the intervals.
        seed : int, default 1
            Seed of all random numbers, >= 0.
        random_sets : int, default 5
            Number of sets of random places, 1 to 1000.
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
        setting, maps = self.setting, (self.before, self.grid)
        # Stream of random numbers of places at random, beside those of `Simulator`.
        draws = [random_of(seed, 100, n) for n in range(min(random_sets, drives // 2))]
        chosen = [self.search.at_random(len(self), draw) for draw in draws]
        poses = [in_world(setting.grid, self.search.places[each]) for each in chosen if all(chosen)]
        sets = [with_objects(setting.grid, setting.kind, each) for each in poses]
        run = partial(Simulator, robot=setting.robot, seed=seed, threads=threads)
        driven, _ = compared(
            lambda grid: (run(grid), setting.on(grid)), maps, sets, drives, setting.routes, progress
        )
        return Verification(*driven, seed, fields_along(setting, maps, threads))

    def table(self) -> Table:
        """The landmarks in order of gain, and what is expected with each and those before it."""
        kind, shape = self.setting.kind, self.setting.kind.shape
        about = kind.word, 2 * shape.half_length, 2 * shape.half_width
        values = self.poses.tolist(), self.gains.tolist(), self.expected[1:].tolist()
        rows = enumerate(zip(*values, strict=True), 1)
        return Table(
            (*COLUMNS, self.measure),
            tuple((n, *pose, *about, gain, expected) for n, (pose, gain, expected) in rows),
        )

    def _write(self, folder: Path, verification: Verification | None = None) -> None:
        table = self.table()
        table.write_csv(folder / "landmarks.csv")
        outlines = (outline_of(self.setting.kind.shape, pose) for pose in self.poses)
        table.write_geojson(folder / "landmarks.geojson", outlines)
        Table.of((*POSE, Column("reason")), self.rejected).write_csv(folder / "rejected.csv")
        if verification:
            verification.table().write_csv(folder / "verification.csv")
        save_map(self.grid, folder / "map_with_landmarks.yaml")

    def summary(self, verification: Verification | None = None) -> dict[str, object]:
        """Places, gains and settings in numbers, fit for JSON.

        Parameters
        ----------
        verification : Verification, optional
            What `verify` gave.
        """
        setting, regular = self.setting, self.regular
        return finite(
            {
                "verification": verification.summary() if verification else None,
                "map": {"name": self.before.name, "digest": self.before.digest},
                "map_with_landmarks": {"digest": self.grid.digest},
                "object": {"kind": setting.kind.word, **vars(setting.kind)},
                "landmarks": self.table().records(),
                "chosen_by": self.chosen_by,
                "trials": [each._asdict() for each in self.trials],
                self.measure.name: self.expected.tolist(),
                "paying": self.paying,
                "kept": self.kept,
                "advice": self.advice(driven=verification is not None),
                "regular": None if regular is None else regular._asdict(),
                "shifts": [each._asdict() for each in self.shifts],
                "rejected": self.reasons(),
                "routes": {name: path.length for name, path in setting.routes.items()},
                "region_area": self.region_area,
                "robot": setting.robot.summary(),
            }
        )


def landmarks_report(made: Landmarks, verification: Verification | None = None) -> str:
    """What the drives say, then the landmarks in order of gain, and what was refused."""
    setting = made.setting
    lines = ["not verified: nothing was driven"]
    if verification:
        (before, high), (later, high_after) = verification.match_deviations.tolist()
        lines = [
            verification.verdict,
            f"deviation of a match of one scan alone: median {before:.2f} -> {later:.2f} m,"
            f" 95 % of the way below {high:.2f} -> {high_after:.2f} m",
        ]
    lines.append(f"with {setting.robot.title}")
    after = [
        f"{len(made)} x {setting.kind.title}, in order of gain; {made.measure.heading} without any:"
        f" {made.expected[0]:.3f}"
    ]
    if made.region_area is not None:
        routes = f"{len(setting.routes)} routes lead across it"
        after.append(f"the robot can be in {made.region_area:.0f} m2 of the region, and {routes}")
    driven = [
        f"{each.chosen_by} ({each.lost} of {each.drives} off by more than 1 m,"
        f" error {each.error:.2f} m)"
        for each in made.trials
    ]
    if driven:
        after.append(f"of {len(driven)} placements that were driven, this one is kept: {driven[0]}")
        after += [f"beaten: {each}" for each in driven[1:]]
    else:
        after.append(f"chosen by: {made.chosen_by}")
    if made.existing:
        after.append(f"{made.kept} of {made.existing} existing objects stay where they are")
    after += made.advice(driven=verification is not None)
    if made.rejected:
        after.append(f"places refused: {counted(each.reason for each in made.rejected)}")
    parts = [str(verification.table())] if verification else []
    return "\n".join([*parts, *wrapped(lines), str(made.table()), *wrapped(after)])
