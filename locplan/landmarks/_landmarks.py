"""The result of a placement: the landmarks, what each gains, and the map with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path as FilePath
from typing import ClassVar

import numpy as np

from locplan._kernels.arrays import Floats
from locplan._util.checks import keep
from locplan._util.output import Results
from locplan._util.records import POSE, Column, Result, Table
from locplan._util.tables import finite, wrapped
from locplan.costs import Costmap, Path
from locplan.errors import LocplanError
from locplan.landmarks._objects import LandmarkObject, outline_of, with_objects
from locplan.landmarks._search import Search
from locplan.landmarks._verification import Verification
from locplan.maps import OccupancyGrid, save_map
from locplan.planners import plan
from locplan.robots import Robot

PAYING_SHARE = 0.05
"""Share by which a landmark must lower what is expected to pay."""
EXPECTED = Column("expected_deviation", "m", "expected deviation", 3)
COLUMNS = (
    Column("number", title="landmark", digits=0),
    *POSE,
    Column("kind"),
    Column("length", "m"),
    Column("width", "m"),
    Column("gain"),
    EXPECTED,
)
"""Columns of landmarks; a pole's length and width are its diameter."""
ROUND_COLUMNS = tuple(
    replace(column, title=None) if column.name == "heading" else column for column in COLUMNS
)
"""Columns of poles, whose heading is in files only."""


@dataclass(frozen=True, eq=False)
class Setting:
    """What landmarks are placed for: the map, the routes, and the robot."""

    grid: OccupancyGrid
    """The map without the objects."""
    kind: LandmarkObject
    """The object, of which several are placed."""
    routes: Mapping[str, Path]
    """Routes of the robot by name."""
    planned: bool
    """True if the routes are shortest paths, to be planned again among the objects."""
    robot: Robot
    """The robot that was simulated."""

    def on(self, grid: OccupancyGrid) -> Mapping[str, Path]:
        """The routes that were given, or the shortest paths between their ends on a map.

        Parameters
        ----------
        grid : OccupancyGrid
            The map, with landmarks or without.

        Raises
        ------
        LocplanError
            If the landmarks close a way.
        """
        if not self.planned:
            return self.routes
        costs = Costmap.blank(grid, robot=self.robot)
        paths = {}
        for name, path in self.routes.items():
            (x0, y0), (x1, y1) = path.xy[[0, -1]].tolist()
            found = plan(costs, (x0, y0), (x1, y1)).path
            if found is None:
                raise LocplanError(
                    f"no path of the robot leads along {name} on the map"
                    f" {'with' if grid is not self.grid else 'without'} landmarks"
                )
            paths[name] = found
        return paths


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
            "verification.csv",
            "map_with_landmarks.yaml",
            "map_with_landmarks.pgm",
        ),
    )

    setting: Setting
    """The map, the routes and the robot that they are placed for."""
    poses: Floats
    """World x, y and heading of each, (k, 3) [m, m, rad]."""
    curve: Floats
    """Expected mean of P_xx + P_yy along the routes with 0, 1, ... landmarks, (k + 1,) [m^2]."""
    search: Search
    """The search, for places at random."""

    grid: OccupancyGrid = field(init=False)
    """The map with the landmarks."""

    def __post_init__(self) -> None:
        keep(self, grid=with_objects(self.setting.grid, self.setting.kind, self.poses))

    def __repr__(self) -> str:
        low, high = self.expected[-1], self.expected[0]
        return (
            f"Landmarks({len(self)} x {self.setting.kind.title} in {self.grid.name or 'map'},"
            f" {EXPECTED.title} {high:.3g} -> {low:.3g})"
        )

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def positions(self) -> Floats:
        """World x and y of each landmark, (k, 2) [m]."""
        return np.asarray(self.poses[:, :2])

    @property
    def gains(self) -> Floats:
        """What each landmark takes off the curve beside those before it, (k,) [m^2]."""
        return -np.diff(self.curve)

    @property
    def expected(self) -> Floats:
        """Expected deviation of the position along routes, the root of the curve, (k + 1,) [m]."""
        return np.asarray(self.curve**0.5)

    @property
    def paying(self) -> int:
        """Number of landmarks from which on no further one pays.

        Each one after lowers what is expected by less than 5 %.
        """
        steps = 1 - self.expected[1:] / np.maximum(self.expected[:-1], 1e-12)
        paying = np.flatnonzero(steps >= PAYING_SHARE)
        return int(paying[-1]) + 1 if paying.size else 0

    @property
    def advice(self) -> str:
        """The landmarks that hardly lower what is expected, in a sentence; empty if all pay."""
        little = f"lowers it by less than {PAYING_SHARE:.0%}"
        if self.paying == 0:
            return f"each {little}"
        if self.paying < len(self):
            return f"from number {self.paying + 1} on each {little}: {self.paying} may do"
        return ""

    def table(self) -> Table:
        """The landmarks in order of gain, and what is expected with each and those before it."""
        kind, shape = self.setting.kind, self.setting.kind.shape
        about = kind.word, 2 * shape.half_length, 2 * shape.half_width
        values = self.poses.tolist(), self.gains.tolist(), self.expected[1:].tolist()
        rows = enumerate(zip(*values, strict=True), 1)
        return Table(
            ROUND_COLUMNS if self.setting.kind.word == "pole" else COLUMNS,
            tuple((n, *pose, *about, gain, expected) for n, (pose, gain, expected) in rows),
        )

    def _write(self, folder: FilePath, verification: Verification | None = None) -> None:
        table = self.table()
        table.write_csv(folder / "landmarks.csv")
        outlines = (outline_of(self.setting.kind.shape, pose) for pose in self.poses)
        table.write_geojson(folder / "landmarks.geojson", outlines)
        if verification:
            verification.table().write_csv(folder / "verification.csv")
        save_map(self.grid, folder / "map_with_landmarks.yaml")

    def summary(self, verification: Verification | None = None) -> dict[str, object]:
        """Places, gains and settings in numbers, fit for JSON.

        Parameters
        ----------
        verification : Verification, optional
            The result of `verify_landmarks`.
        """
        setting = self.setting
        return finite(
            {
                "verification": verification
                and {
                    "verdict": verification.word,
                    "sentence": verification.verdict,
                    "ratio": list(verification.comparison.ratio),
                    "drives": verification.table().records(),
                    "seed": verification.seed,
                },
                "map": {"name": setting.grid.name, "digest": setting.grid.digest},
                "map_with_landmarks": {"digest": self.grid.digest},
                "object": {"kind": setting.kind.word, **vars(setting.kind)},
                "landmarks": self.table().records(),
                EXPECTED.name: self.expected.tolist(),
                "paying": self.paying,
                "routes": {name: path.length for name, path in setting.routes.items()},
                "robot": setting.robot.summary(),
            }
        )


def landmarks_report(made: Landmarks, verification: Verification | None = None) -> str:
    """What the drives say, then the landmarks in order of gain."""
    setting = made.setting
    verdict = [verification.verdict if verification else "not verified: nothing was driven"]
    verdict.append(f"with {setting.robot.title}")
    gains = [
        f"{len(made)} x {setting.kind.title}, in order of gain; {EXPECTED.heading} without any:"
        f" {made.expected[0]:.3f}"
    ]
    if made.advice:
        gains.append(made.advice)
    drives = [str(verification.table())] if verification else []
    return "\n".join([str(made.table()), *wrapped(gains), *drives, *wrapped(verdict)])
