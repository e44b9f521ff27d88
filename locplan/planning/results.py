"""What planners return: a path with its metrics, or a Pareto front of paths."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from pathlib import Path as PathOf
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from locplan._support.kernels.arrays import Floats, Ints
from locplan._support.output import ResultFiles
from locplan._support.records import Result, Table, TableColumn
from locplan._support.saved import StoredResult
from locplan._support.tables import format_rounded_up, format_table, nan_to_none, write_csv
from locplan.errors import ConfigError
from locplan.planning.costmap import Costmap, summarize_costs
from locplan.planning.grid import make_path_through_centres
from locplan.planning.metrics import METRICS, PathMetrics, path_metrics
from locplan.planning.path import Path
from locplan.planning.protocol import PlannerResult, Position, Status
from locplan.planning.robot_fit import describe_ignored_constraints
from locplan.robots.robot import format_radius

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NO_DEGENERATE = 0.05
"""Degenerate metres below which a path has none for people [m]."""


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Result, StoredResult):
    """A path that a planner returned with its metrics, or the reason why there is none.

    `save` writes plan.json, which `load` reads, a picture, and path.csv. The costmap is not saved.
    """

    kind: ClassVar[str] = "plan"
    suffix: ClassVar[str] = ".json"
    files: ClassVar[ResultFiles] = ResultFiles("plan", ("plan.json", "plan.png", "path.csv"))

    status: Status
    """"solved"; "unreachable" if no path leads to the goal; "infeasible" if no path keeps the
    limits; "timeout" if none was found in time; "not found" if the planner's search was incomplete
    and found none."""
    planner: str
    """The planner's name, such as "any-angle"."""
    start: Position
    """Position of the start in the world [m], or its pose [m, rad]."""
    goal: Position
    """Position of the goal in the world [m], or its pose [m, rad]."""
    path: Path | None
    """The path from start to goal; None without one."""
    metrics: PathMetrics | None
    """The metrics of the path on `costs`; None without a path."""
    solve_time: float
    """Time spent planning, without compilation [s]."""
    via: tuple[Position, ...] = ()
    """Positions in the world that the path visits on the way [m], or poses [m, rad]."""
    max_e: float | None = None
    """The greatest e that was allowed [m^2 rad]; None if there was no limit."""
    budget: float | None = None
    """The greatest integral that was allowed, of u [m] or of e [m^2 rad m]; None if there was
    none."""
    footprint: tuple[Position, ...] | None = None
    """The corners (x, y) of the outline that had to stay clear of walls, about the robot's centre
    [m]; None if the robot's radius counted."""
    bound: float | None = None
    """Minimum length that a path within the budget can have [m]; None without a budget."""
    feasible_from: float | None = None
    """The `budget` or `max_e` below which there is no path, in its unit, if it is infeasible."""
    minimises: bool = True
    """True if the planner seeks the least J; some of OMPL's stop at the first path they find."""
    expanded: int | None = None
    """Number of cells that a grid planner's search expanded, over all legs; None for others."""
    history: tuple[tuple[float, float], ...] = ()
    """Time since a sampling planner began [s] and its best J [m], whenever that fell; there is
    none over waypoints."""
    note: str = ""
    """A text on why there is no path and what would help, or on what the path does not respect;
    otherwise empty."""
    costs: Costmap | None = field(default=None, compare=False)
    """The costmap that `metrics` were measured on; None if that is not known."""

    def __repr__(self) -> str:
        ends = " to ".join(",".join(f"{v:g}" for v in end) for end in (self.start, self.goal))
        if self.metrics is None:
            return f"Plan({self.status}, {self.planner}, {ends}: {self.note or 'no path'})"
        return (
            f"Plan({self.status}, {self.planner}, {ends}: {self.metrics.length:.2f} m long,"
            f" cost {self.metrics.cost:.2f} m, {self.solve_time:.3g} s)"
        )

    def table(self) -> Table:
        """Return the metrics of the path; no row without one."""
        return Table.from_records(METRICS, [self.metrics] if self.metrics else [])

    def report(self) -> str:
        """Return the metrics of the path as text, or why there is none."""
        note = f"\n{self.note}" if self.note else ""
        return f"{self.status}{note}\n{self.table()}" if self.metrics else f"{self.status}{note}"

    @property
    def is_drawable(self) -> bool:
        """True if the costmap is known: the path is drawn on it."""
        return self.costs is not None

    def _write(self, folder: PathOf, *_: object) -> None:
        if self.path is not None:
            self.path.save(folder / "path.csv")

    def with_costs(self, costs: Costmap) -> Plan:
        """Return a copy with the metrics on another costmap of the same map, without history.

        Parameters
        ----------
        costs : Costmap
            The costmap to measure the path on, such as one of another weight or estimator.
        """
        if self.path is None:
            return self
        metrics = path_metrics(costs, self.path)
        return dataclasses.replace(self, metrics=metrics, history=(), costs=costs)

    def figure(self) -> Figure:
        """Draw a plan's path over the degeneracy u of its costmap."""
        from locplan.planning.figures import path_figure

        return path_figure(self)


def make_plan(
    planner: str,
    costs: Costmap,
    start: Position,
    goal: Position,
    planner_result: PlannerResult,
    elapsed: float,
) -> Plan:
    """Make a plan from a planner's result, with the metrics of its path on a costmap."""
    note = planner_result.note
    if planner_result.status == "unreachable" and not note:
        radius = format_radius(costs.robot, costs.robot_radius)
        note = f"no path joins start and goal for a robot of radius {radius}"
    if planner_result.path is not None:
        note = "; ".join(filter(None, [note, costs.estimator_note]))
    metrics = None if planner_result.path is None else path_metrics(costs, planner_result.path)
    return Plan(
        status=planner_result.status,
        planner=planner,
        start=tuple(start),
        goal=tuple(goal),
        path=planner_result.path,
        metrics=metrics,
        solve_time=elapsed,
        bound=planner_result.bound,
        feasible_from=planner_result.feasible_from,
        expanded=planner_result.expanded,
        history=planner_result.history,
        note=note,
        costs=costs,
    )


POINT = TableColumn("length", "m", "length"), TableColumn("integral", title="integral")
"""Columns of a front's paths; the integral is in m of u, and in m^2 rad m of e."""


@dataclass(frozen=True, eq=False, repr=False)
class ParetoFront(Result, StoredResult):
    """Grid paths by rising length and falling integral, so that none is better in both.

    `save` writes front.npz, which `load` reads, and front.json, front.csv, a picture and, if there
    is a knee, the path at it.
    """

    kind: ClassVar[str] = "front"
    files: ClassVar[ResultFiles] = ResultFiles(
        "front",
        ("front.json", "front.npz", "front.csv", "front.png", "knee.csv"),
        purposes={
            "front.png": "the picture",
            "knee.csv": "the path at the knee",
            "front.csv": "length and degenerate metres of each path",
            "front.npz": "all paths, for Python",
        },
    )
    costs: Costmap
    """The costmap that the paths were planned on."""
    start: Position
    """Position of the start in the world [m]."""
    goal: Position
    """Position of the goal in the world [m]."""
    objective: str
    """The layer that is integrated, "u" or "e"."""
    length: Floats
    """Length of each path, (n,) [m]."""
    integral: Floats
    """Integral of u [m] or e [m^2 rad m] along each path, (n,)."""
    epsilon: float
    """A path of the front is at most 1 + epsilon times as long and uncertain as any grid path.
    Epsilon is 0 and the front exact, unless time or labels ran out; it is infinite if the time did
    not suffice for a single path."""
    labels: int
    """Number of partial paths that were kept."""
    solve_time: float
    """Time spent on the search, without compilation [s]."""
    cells: tuple[Ints, ...]
    """The cells of each path as (row, col), (n, 2); none of the straight line."""

    def __repr__(self) -> str:
        if self.status == "timeout":
            return f"ParetoFront(no path was found within the time limit, {self.solve_time:.3g} s)"
        if not len(self):
            return "ParetoFront(no path joins start and goal)"
        exact = "exact" if self.epsilon == 0 else f"within {self.epsilon:.2%}"
        knee = "no knee" if self.knee is None else f"knee at {self.length[self.knee]:.2f} m"
        return (
            f"ParetoFront({len(self)} paths of {self.length[0]:.2f} to {self.length[-1]:.2f} m,"
            f" {exact}, {knee})"
        )

    @property
    def is_drawable(self) -> bool:
        """True if there is a path."""
        return len(self) > 0

    def __len__(self) -> int:
        return len(self.length)

    @property
    def status(self) -> Status:
        """The status: "solved", "unreachable" or "timeout"."""
        if len(self):
            return "solved"
        return "timeout" if math.isinf(self.epsilon) else "unreachable"

    def plan(self, index: int | None) -> Plan:
        """Return one of the paths as a plan, with its metrics.

        Parameters
        ----------
        index : int or None
            Index of the path, 0 for the shortest; -1 for the longest, as in a list. `knee` is the
            index of a good compromise.

        Raises
        ------
        ConfigError
            If there is no such path, or None is the `knee` of a front without one.
        """
        self._check_paths()
        if index is None:
            raise ConfigError(
                "the front has no knee; plan(0) is the shortest path, plan(-1) the longest"
            )
        if not -len(self) <= index < len(self):
            raise ConfigError(f"the front has {len(self)} paths, from 0 on; there is no {index}")
        path = make_path_through_centres(self.costs, self.cells[index], self.start, self.goal)
        planner_result = PlannerResult(
            path, note=describe_ignored_constraints("pareto", self.costs.robot)
        )
        return make_plan(
            "pareto", self.costs, self.start, self.goal, planner_result, self.solve_time
        )

    def summary(self) -> dict[str, object]:
        """Return the front without its cells, fit for JSON."""
        names = "start", "goal", "objective", "status", "epsilon", "labels", "solve_time"
        record = {name: getattr(self, name) for name in names}
        record["knee"] = self.knee if len(self) else None
        record |= {column.name: getattr(self, column.name).tolist() for column in POINT}
        costs = summarize_costs(self.costs)
        del costs["weight"]  # it does not matter
        return {**costs, **nan_to_none(record)}

    def table(self) -> Table:
        """Return the length and integral of each path as a table."""
        return Table(
            POINT, tuple(zip(*(getattr(self, column.name) for column in POINT), strict=True))
        )

    def report(self) -> str:
        """Return a text of up to twelve paths, with the gain of each further metre."""
        if self.status == "timeout":
            within = f"{self.solve_time:.2f} s"
            return f"timeout: no path was found within {within}; raise the time limit"
        if not len(self):
            return "unreachable: no path leads to the goal"
        unit = "m" if self.objective == "u" else f"{self.costs.e_unit} m"
        lengths = np.linspace(self.length[0], self.length[-1], 12)
        indices = np.abs(self.length[:, None] - lengths).argmin(axis=0)
        rows = []
        knees = set() if self.knee is None else {self.knee}
        for index in sorted({*map(int, indices)} | knees):
            longer = self.length[index] / self.length[0] - 1
            texts = [str(index), f"{self.length[index]:.2f} m", f"+{longer:.1%}"]
            knee = "knee" if index in knees else ""
            rows.append([*texts, f"{format_rounded_up(self.integral[index])} {unit}", knee])
        precision = "exact" if self.epsilon == 0 else f"within {self.epsilon:.2%} of every path"
        count = f"{len(self)} path{'' if len(self) == 1 else 's'}"
        last = f"{count}, {precision}; {self.labels:,} labels, {self.solve_time:.2f} s"
        integral = "degenerate metres (∫u ds)" if self.objective == "u" else "∫e ds"
        lines = [str(format_table(["path", "length", "longer", integral, ""], rows)), last]
        return "\n".join(filter(None, [*lines, self._explain_missing_knee]))

    @property
    def _explain_missing_knee(self) -> str:
        """The sentence on a front of several paths without a knee; empty for any other."""
        if self.knee is not None or len(self) < 2:
            return ""
        longer = self.length[-1] / self.length[0] - 1
        unit = "degenerate metres" if self.objective == "u" else f"{self.costs.e_unit} m"
        gain = f"{self.integral[-1]:.2g} instead of {self.integral[0]:.2g} {unit}"
        if self.objective == "u" and self.integral[-1] < NO_DEGENERATE:
            gain = "no degenerate metres"
        return f"No knee: take the shortest path, or +{longer:.0%} length with {gain}."

    def _write(self, folder: PathOf, *_: object) -> None:
        self.write(folder / "front.npz")
        # All digits: a budget that is copied from here must not lie below the path's integral.
        points = np.column_stack([self.length, self.integral])
        write_csv(folder / "front.csv", points, ",".join(self.table().names), "%s")
        if len(self) and self.knee is not None:
            path = self.plan(self.knee).path
            assert path is not None
            path.save(folder / "knee.csv")

    @property
    def knee(self) -> int | None:
        """Index of the path that lies farthest below the chord between the front's ends, or None.

        Lengths and integrals count as shares of their range on the front: this is the knee of
        Das (1999), which depends on the front's shape alone, not on how much there is to save. It
        is None on a front that nowhere bends below its chord, such as one of two paths. On an empty
        front it is a ConfigError.

        References
        ----------
        Das, "On characterizing the 'knee' of the Pareto curve based on normal-boundary
        intersection", Structural Optimization 18 (1999), doi 10.1007/BF01195985. For curves of one
        variable Satopaa et al. give it in "Finding a 'kneedle' in a haystack", ICDCS Workshops
        (2011), doi 10.1109/ICDCSW.2011.20.
        """
        self._check_paths()
        spans = self.length[-1] - self.length[0], self.integral[0] - self.integral[-1]
        if not min(spans) > 0:
            return None
        longer = (self.length - self.length[0]) / spans[0]
        saved = (self.integral[0] - self.integral) / spans[1]
        below = saved - longer
        # The first of those that rounding alone sets apart.
        return int(np.argmax(below > below.max() - 1e-9)) or None

    def _check_paths(self) -> None:
        """Raise a ConfigError if there is no path."""
        if self.status == "timeout":
            raise ConfigError("the front is empty: no path was found in time; raise time_limit")
        if self.status == "unreachable":
            raise ConfigError("the front is empty: the goal is unreachable")

    def figure(self) -> Figure:
        """Draw a Pareto front and, over the map, its paths in the same colours, the knee's bold."""
        from locplan.planning.figures import front_figure

        return front_figure(self)
