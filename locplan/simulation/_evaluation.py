"""Evaluation of how well the fields predict where a robot is badly localized, on your own maps."""

from __future__ import annotations

import dataclasses
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from locplan._kernels.arrays import Floats
from locplan._util.checks import whole
from locplan._util.intervals import Interval, Rank, Resamples, digits_of, plain, rank, short
from locplan._util.progress import ProgressCallback, parts
from locplan._util.records import POSITION, Column, Result, Table
from locplan._util.results import Results
from locplan._util.tables import REPORT_WIDTH, finite, table
from locplan.field import equipped
from locplan.maps import OccupancyGrid
from locplan.robots import Robot
from locplan.simulation._drives import RATES
from locplan.simulation._places import KINDS, ErrorKind, Places, measure_maps
from locplan.simulation._predictors import Predictor, conclusion, configs, predictions
from locplan.simulation._worlds import about_filter


@dataclass(frozen=True, eq=False, repr=False)
class Evaluation(Result):
    """Errors at places of some maps, and the values of each predictor there."""

    _reported_by: ClassVar[str] = "locplan.simulation._evaluation:evaluation_report"
    _drawn_by: ClassVar[str] = "locplan.simulation:evaluation_figure"
    files: ClassVar[Results] = Results(
        "evaluation", ("evaluation.json", "evaluation.png", "places.csv")
    )

    places: Sequence[Places]
    """Places and errors of each map."""
    predictions: Sequence[dict[Predictor, Floats]]
    """Values of each predictor at the places of each map, (n,); a predictor names a field and its
    scalar, or a baseline, and greater values foresee greater errors."""
    robot: Robot
    """The robot that was simulated."""
    drives: int
    """Number of drives to each place."""
    scans: int
    """Number of single scans at each place."""
    seed: int
    """Seed of all random numbers."""
    filter_map: OccupancyGrid | None = None
    """The filter's map, where it is not the one that was driven in."""

    def __repr__(self) -> str:
        places = sum(len(each.points) for each in self.places)
        names = ", ".join(each.grid.name or "map" for each in self.places)
        return f"Evaluation({places} places of {names})"

    @cached_property
    def ranks(self) -> dict[tuple[Predictor, ErrorKind], Rank]:
        """Rank statistics of each predictor for each kind of error.

        Deviations of the heading are compared with the heading's error, all others with the
        position's.
        """
        return {
            (predictor, kind): rank(
                [found[predictor] for found in self.predictions],
                [self._errors(places, predictor, kind) for places in self.places],
                self._drawn,
            )
            for predictor in self.predictions[0]
            for kind in KINDS
        }

    @staticmethod
    def _errors(places: Places, predictor: Predictor, kind: ErrorKind) -> Floats:
        return places.heading_rmse(kind) if predictor.of_heading else places.position_rmse(kind)

    def of_map(self, number: int) -> Evaluation:
        """Evaluation of one map by itself.

        Parameters
        ----------
        number : int
            Index of the map in `places`, from 0 on.
        """
        return dataclasses.replace(
            self, places=[self.places[number]], predictions=[self.predictions[number]]
        )

    @property
    def agreement(self) -> Interval:
        """Rank correlation of the position RMSE of half of the drives with that of the others.

        It is over all places; about zero says that the errors do not depend on the place. NaN
        where each place has one drive only.
        """
        halves = [places.halves.T for places in self.places]
        if any(np.isnan(each).any() for each in halves):
            return Interval(np.nan, np.nan, np.nan)
        one, other = ([each[n] for each in halves] for n in (0, 1))
        return rank(one, other, self._drawn).spearman

    @property
    def conclusion(self) -> list[str]:
        """Two sentences: if the errors depend on the place, and what to do."""
        ranks = {each: rank for (each, kind), rank in self.ranks.items() if kind == "tracking"}
        return conclusion(self.places, self.agreement, ranks)

    def quantiles(self, number: int, size: str) -> list[float]:
        """Percentiles 10, 50 and 90 of the sizes of errors, over a map's places.

        Places where the size is not known are left out.

        Parameters
        ----------
        number : int
            Index of the map in `places`, from 0 on.
        size : str
            One of the names of `Places.sizes`.

        Returns
        -------
        list of float
            The three percentiles [m], or shares of "lost_rate"; NaN if no place is known.
        """
        values = self.places[number].sizes[size]
        known = values[~np.isnan(values)]
        return np.quantile(known, (0.1, 0.5, 0.9)).tolist() if known.size else [np.nan] * 3

    def lost_rate(self, number: int) -> float:
        """Share of the drives to a map's places that were off by more than 1 m at some time, 0..1.

        Parameters
        ----------
        number : int
            Index of the map in `places`, from 0 on.
        """
        return float(self.places[number].lost.mean())

    def rates(self, number: int) -> dict[str, float]:
        """Shares of the drives to a map's places that go wrong, 0..1, by the names of `RATES`.

        Parameters
        ----------
        number : int
            Index of the map in `places`, from 0 on.
        """
        return {each.name: float(self.places[number].sizes[each.name].mean()) for each in RATES}

    @cached_property
    def _drawn(self) -> Resamples:
        return Resamples.of([len(places.points) for places in self.places])

    def summary(self) -> dict[str, object]:
        """All ranks and settings, fit for JSON."""
        about: dict[str, object] = {
            "maps": [
                {"name": places.grid.name, "digest": places.grid.digest}
                | {"places": len(places.points)}
                | self.rates(n)
                | {
                    f"{each}_10_50_90": self.quantiles(n, each)
                    for each in places.sizes
                    if each not in self.rates(n)
                }
                for n, places in enumerate(self.places)
            ],
            "conclusion": self.conclusion,
            "agreement": list(self.agreement),
            "predictors": [
                {
                    "source": predictor.source,
                    "scalar": predictor.scalar or None,
                    "error": kind,
                    "of": "heading" if predictor.of_heading else "position",
                    **{name: list(getattr(found, name)) for name in ("spearman", "within", "auc")},
                }
                for (predictor, kind), found in self.ranks.items()
            ],
            "drives": self.drives,
            "scans": self.scans,
            "seed": self.seed,
            "robot": self.robot.summary(),
            **about_filter(self.filter_map),
        }
        return finite(about)

    def table(self) -> Table:
        """A row per place: where it is, its errors, and what each predictor foresaw."""
        rows: list[tuple[object, ...]] = []
        for places, found in zip(self.places, self.predictions, strict=True):
            headings = [places.heading_rmse(kind) for kind in KINDS]
            foreseen = [np.abs(each) for each in found.values()]  # counts of cells are negated
            values = np.column_stack([places.xy, *places.sizes.values(), *headings, *foreseen])
            rows += [(places.grid.name, *row) for row in values.tolist()]
        columns = (
            Column("map"),
            *POSITION,
            *(Column(size, "" if size in self.rates(0) else "m") for size in self.places[0].sizes),
            *(Column(f"{kind}_heading_rmse", "rad") for kind in KINDS),
            *(Column(each.column) for each in self.predictions[0]),
        )
        return Table(columns, tuple(rows))


def evaluation_report(evaluation: Evaluation) -> str:
    """Tables of how well each predictor ranks places, and of how large the errors were."""
    several = len(evaluation.places) > 1
    columns = ["predictor", "correlation", *(["in a map"] if several else []), "AUC"]
    parts = []
    for kind, label in KINDS.items():
        rows = []
        for predictor in evaluation.predictions[0]:
            found = evaluation.ranks[predictor, kind]
            within = [f"{found.within.value:.2f}"] if several else []
            name = f"{predictor}{' *' if predictor.of_heading else ''}"
            rows.append([name, short(found.spearman), *within, short(found.auc)])
        parts += [f"{label}:", table(columns, rows)]
    sizes, rated = [], [each.name for each in RATES]
    for n, places in enumerate(evaluation.places):
        cells = [places.grid.name]
        for size in places.sizes:
            if size not in rated:
                some = evaluation.quantiles(n, size)[1:]
                cells.append("/".join(plain(each, digits_of(each)) for each in some))
            elif size == rated[0]:
                cells.append("/".join(f"{each:.0%}" for each in evaluation.rates(n).values()))
        sizes.append(cells)
    columns = ["map", "median", "off", "RMSE,\nkept", "RMSE", "scan\nmedian", "scan\nRMSE"]
    parts += [
        "Spearman's correlation of e and the deviations with the RMSE of the position (*: of the",
        "heading) [95 %]; AUC: of finding the worst fifth of the places, by chance 0.5",
        table(columns, sizes),
        "errors of the position, 50/90 % of the places [m]; off: of the drives, by > 1 m at some"
        " time, and\nby > 0.5 m at the place; kept: those never off by > 1 m",
        f"{sum(len(each.points) for each in evaluation.places)} places, {evaluation.drives} drives"
        f" to each, {evaluation.scans} scans there; with {evaluation.robot.title}",
        "",
        textwrap.fill(" ".join(evaluation.conclusion), REPORT_WIDTH),
    ]
    return "\n".join(parts)


LARGEST_DISC = 30.0
"""Maximum radius of the templates of "sad" that the command takes of a lidar [m].

Their memory grows with its square: 0.3 GB a thread at 0.05 m a cell."""


def evaluate(
    grids: Sequence[OccupancyGrid] | OccupancyGrid,
    robot: Robot | None = None,
    *,
    places: int = 100,
    drives: int = 16,
    scans: int = 16,
    disc: float | None = None,
    filter_map: OccupancyGrid | None = None,
    seed: int = 1,
    threads: int | None = None,
    progress: ProgressCallback | None = None,
) -> Evaluation:
    """Measure errors at places of maps, and rank predictors by them.

    Parameters
    ----------
    grids : sequence of OccupancyGrid
        One map or several.
    robot : Robot, optional
        The robot; by default one with Nav2's filter and a lidar of 6 m that sees all round. Give
        your own, such as `Robot.from_nav2` reads.
    places : int, default 100
        Maximum number of random places on each map, at least 2, which are at least 1 m apart.
    drives, scans : int, default 16
        Number of drives to each place, and of single scans at each, 1 to 100,000. More of them
        narrow the errors of a place, more places the intervals.
    disc : float, optional
        Radius of the templates of "sad" [m]; by default the paper's 6 m. Take the lidar's range.
    filter_map : OccupancyGrid, optional
        The filter's map in the same frame, where it differs from the only one that is driven in;
        single scans are matched on the latter.
    seed : int, default 1
        Seed of all random numbers, >= 0; equal seeds give equal results.
    threads : int, optional
        Number of threads, at least 1; all cores by default.
    progress : callable, optional
        Called with (done, total) drives, places and fields of all maps.

    Returns
    -------
    Evaluation
        The errors, each predictor's ranks, and a conclusion in two sentences.

    Raises
    ------
    ConfigError
        If there is no map, a number is out of its range, or a robot has no room on a map.
    """
    grids = [grids] if isinstance(grids, OccupancyGrid) else list(grids)
    robot = equipped(robot)
    for name, value in (("drives", drives), ("scans", scans)):
        whole(name, value, 1)
    fields = configs(robot.known_lidar, disc)
    effort = len(grids) * places * (drives + 1)
    callbacks = parts(progress, [effort, *[max(1, effort // 50)] * len(grids)])
    counts: Any = {"places": places, "drives": drives, "scans": scans}
    own: Any = {"filter_map": filter_map, "seed": seed, "threads": threads}
    measured = measure_maps(grids, robot, **counts, **own, progress=callbacks[0])
    found = []
    for each, part in zip(measured, callbacks[1:], strict=True):
        found.append(predictions(each.grid, fields, each.points, threads=threads))
        part(max(1, effort // 50), 0)
    return Evaluation(measured, found, robot, drives, scans, seed, filter_map)
