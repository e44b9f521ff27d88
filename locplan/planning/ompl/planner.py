"""OMPL's planners with their options; ompl itself is imported when one is used."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from locplan._support.checks import check_integer, short_repr
from locplan._support.kernels.arrays import Floats
from locplan._support.progress import ProgressCallback
from locplan.errors import ConfigError, LocplanError
from locplan.planning.any_angle import AnyAngle, straighten_path
from locplan.planning.costmap import Costmap
from locplan.planning.grid import (
    find_cheapest_cells,
    label_connected_parts,
    make_blank_costs,
    make_grid_path,
)
from locplan.planning.lattice import Lattice
from locplan.planning.metrics import path_metrics
from locplan.planning.ompl.kinds import KINDS
from locplan.planning.ompl.motions import Motions
from locplan.planning.ompl.stopping import OPTIMAL, SearchLimits, format_capable_planners
from locplan.planning.path import Path
from locplan.planning.protocol import CURVED, MAX_SEED, PlannerResult, Position, check_space
from locplan.robots.parts import Kinematics
from locplan.robots.robot import Robot


@dataclass(frozen=True)
class Ompl:
    """One of OMPL's sampling-based planners.

    In spaces with headings the outline of the costmap's robot also keeps clear of walls.
    RRT, RRTConnect, KPIECE1, BKPIECE1 and LBKPIECE1 do not look at costs and stop at the first
    path; all remaining planners seek the least J. FMT and BFMT do not revise early decisions, so
    they may miss the best path where the cost changes abruptly. Along curves a search is about ten
    times slower than in "R2": give it more time, or try PRMstar. OMPL's messages go to Python's
    logger ``locplan.ompl``.
    """

    name: str
    """OMPL's name of the planner, such as "RRTstar". ``locplan info`` lists all."""
    space: str = "R2"
    """Space to plan in: "R2"; "SE2", where turning on the spot is free; "Dubins", with curves
    driven forward; "ReedsShepp", with curves that may reverse. Take one of the latter for a robot
    that steers like a car."""
    turning_radius: float | None = None
    """Minimum radius of the curves [m], above 0; "Dubins" and "ReedsShepp" need it, others have
    none."""
    time_limit: float | None = None
    """Time after which the search ends [s], above 0; 5 unless `iterations` are given. Raise it
    where J still falls at its end, see `Plan.history`."""
    iterations: int | None = None
    """Iterations after which the search ends, at least 1; with the same seed it finds the same
    path, as no search with a time limit does. By default they are not limited."""
    convergence: float | None = None
    """The search ends when J fell by less than this share, such as 0.01, over the latter half of
    iterations; by default it goes on to its limit."""
    seed: int | None = None
    """Seed of OMPL's random numbers, 1 to 2^32 - 1; 1 by default."""
    from_grid: bool = False
    """True begins with another planner's path, so that the path costs no more. In "R2" it is the
    grid planner's: trees of RRTstar and its variants grow along it, roadmaps contain it. Of curves
    it is the lattice planner's, which is taken unless the search finds a cheaper one."""
    improve: bool = False
    """True straightens the path at last, as any-angle does it. In "R2" only."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """OMPL's own settings of the planner, such as ``{"range": 2.0}`` for its `setRange`; those that
    are left out have OMPL's or locplan's defaults."""
    progress: ProgressCallback | None = field(default=None, compare=False, repr=False)
    """Function called with the part of the limit used up and the limit, in ms or iterations; none
    by default."""

    @staticmethod
    def setting_names(name: str) -> list[str]:
        """Return the names of the settings that OMPL has for a planner, such as range.

        Parameters
        ----------
        name : str
            OMPL's name of the planner.
        """
        from locplan.planning.ompl.settings import find_setters

        return [*find_setters(name)]

    @property
    def minimises(self) -> str | None:
        """ "J", or None for planners that stop at the first path."""
        kind = KINDS.get(self.name)
        return "J" if kind and kind.minimises else None

    @property
    def limits(self) -> SearchLimits:
        """The limits of a search that begins now."""
        return SearchLimits(self.time_limit, self.iterations, self.convergence, self.progress)

    @property
    def seconds(self) -> float | None:
        """Time limit of the search [s]; its limit of iterations may end it earlier."""
        return self.limits.time_limit

    def check(self) -> None:
        """Raise a ConfigError unless the planner supports the options."""
        if self.name not in KINDS:
            raise ConfigError(
                f"OMPL's planners are {', '.join(KINDS)}, not {short_repr(self.name)}"
            )
        kind = KINDS[self.name]
        check_space(self.space, self.turning_radius)
        if self.space not in kind.spaces:
            can = format_capable_planners(lambda kind: self.space in kind.spaces)
            raise ConfigError(f"{self.name} cannot plan in {self.space}; {can} can")
        if self.from_grid and not (kind.from_grid and self.space in ("R2", *CURVED)):
            spaces = "R2, Dubins and ReedsShepp"
            can = format_capable_planners(lambda kind: kind.from_grid)
            raise ConfigError(f"from_grid is for {can}, in {spaces}")
        if self.improve and self.space != "R2":
            raise ConfigError("improve is for space R2: straight lines keep no turning radius")
        if self.progress is not None and not callable(self.progress):
            raise ConfigError(f"progress must be a function, not {short_repr(self.progress)}")
        _ = self.limits
        if self.convergence is not None and not kind.anytime:
            raise ConfigError(
                f"convergence is for {format_capable_planners(lambda kind: kind.anytime)}"
            )
        if self.seed is not None:
            check_integer("seed", self.seed, 1, MAX_SEED)
        if self.settings != {}:
            from locplan.planning.ompl.settings import check_settings

            check_settings(self.name, self.settings)

    def prepare(self) -> None:
        """Load OMPL and compile the kernels, so that the first plan is not timed with them."""
        from locplan.planning.ompl import roadmap as _roadmap  # noqa: F401 - it loads OMPL

        AnyAngle().prepare()
        # The kernels are the same for all spaces: one call compiles them for all.
        motions = Motions(make_blank_costs(3, 9), "Dubins", 1.0)
        poses = np.array([[0.5, 1.5, 0.0], [7.5, 1.5, 0.0]])
        motions.cost(*poses)
        motions.compute_motion_costs(poses, np.array([[0, 1]]))
        motions.path(poses)
        motions.is_free(*poses[0, :2])

    def solve(self, costs: Costmap, start: Position, goal: Position) -> PlannerResult:
        """Plan between positions [m], or poses [m, rad] in all spaces but "R2".

        See `locplan.planning.Planner.solve`. The status is "timeout" if no path was found in time,
        and "not found" if none was found within the iterations.
        """
        from locplan.planning.ompl.roadmap import grow_roadmap

        motions = Motions(costs, self.space, self.turning_radius)
        _, part = label_connected_parts(costs)
        path_candidate, goal_part = (part[costs.grid.cell(pose[:2])] for pose in (start, goal))
        if path_candidate != goal_part:
            return PlannerResult(
                status="unreachable"
            )  # what no path over the grid joins, no motion does
        for name, pose in (("start", start), ("goal", goal)):
            if motions.meets_wall(pose):
                note = f"the robot's outline meets a wall at the {name}; move or turn it"
                return PlannerResult(status="infeasible", note=note)
        direct = motions.path(np.array([start, goal]))
        if motions.cost(start, goal) <= direct.length * (1 + OPTIMAL) + OPTIMAL:
            return PlannerResult(direct, history=((0.0, path_metrics(costs, direct).cost),))
        grid_paths = self._plan_seed_path(costs, start, goal) if self.from_grid else []
        limits, ahead = self.limits, grid_paths[0].xy if grid_paths and self.space == "R2" else None
        began = time.perf_counter()
        if KINDS[self.name].roadmap:
            seed = self.seed or 1
            roadmap = grow_roadmap(
                motions,
                self.name,
                limits=limits,
                seed=seed,
                settings=self.settings,
                seed_path=ahead,
            )
            poses = roadmap.find_path_poses(start, goal)
        else:
            poses = _plan_by_tree(self, motions, start, goal, limits, ahead)
        paths = grid_paths if poses is None else [motions.path(poses), *grid_paths]
        if not paths:
            limits_text = limits.description()
            note = f"no path found within {limits_text}; more of it or another seed may find one"
            return PlannerResult(
                status="not found" if limits.time_limit is None else "timeout", note=note
            )
        path = min(paths, key=lambda path: path_metrics(costs, path).cost)
        history = (*limits.history, (time.perf_counter() - began, path_metrics(costs, path).cost))
        return PlannerResult(
            straighten_path(costs, path) if self.improve else path, history=history
        )

    def _plan_seed_path(self, costs: Costmap, start: Position, goal: Position) -> list[Path]:
        """Return the path of another planner that the search begins with, or none."""
        if self.space == "R2":
            cells, _ = find_cheapest_cells(costs, start, goal, allow_corner_cutting=False)
            assert cells is not None
            return [make_grid_path(costs, cells, start, goal)]
        kinematics = Kinematics(
            drive="car-like",
            turning_radius=self.turning_radius or 0.0,
            reverse=self.space == "ReedsShepp",
        )
        robot = costs.robot or Robot()
        robot = dataclasses.replace(robot, kinematics=kinematics, goal_tolerance=0.0)
        lattice_costs = dataclasses.replace(costs, robot=robot)
        path = Lattice(time_limit=self.seconds).solve(lattice_costs, start, goal).path
        if path is None:
            return []
        pose_errors = path.drive_poses[[0, -1]] - [start, goal]
        pose_errors[:, 2] = np.sin(pose_errors[:, 2] / 2)
        return (
            [path] if np.allclose(pose_errors, 0.0) else []
        )  # the lattice's ends may be off a little


def _plan_by_tree(
    planner: Ompl,
    motions: Motions,
    start: Position,
    goal: Position,
    limits: SearchLimits,
    seed_path: Floats | None,
) -> Floats | None:
    """Return the poses (n, 3) that the path's motions join, or None."""
    from locplan.planning.ompl.settings import base, log_messages, make_ompl_planner, util
    from locplan.planning.ompl.setup import (
        SingleGoalWithHints,
        make_pose_reader,
        problem_definition,
        space_information,
    )

    with log_messages():
        util.RNG.setSeed(planner.seed or 1)
        information = space_information(motions)
        problem = problem_definition(information, motions, start, goal)
        tree = make_ompl_planner(planner.name, information, planner.settings)
        tree.setProblemDefinition(problem)
        tree.setup()
        best_cost = (lambda: tree.bestCost().value()) if hasattr(tree, "bestCost") else None
        ends = limits.make_stop_condition(
            best_cost, settled_after=KINDS[planner.name].settled_after
        )
        if seed_path is not None:
            leading = SingleGoalWithHints(information, goal)
            problem.setGoal(leading)
            ends = leading.lead(tree, seed_path, ends)
        status = tree.solve(base.PlannerTerminationCondition(ends)).getStatus()
        kinds = base.PlannerStatus.PlannerStatusType
        if status in (kinds.INVALID_START, kinds.INVALID_GOAL):
            raise LocplanError(f"OMPL refuses {start} or {goal} as a state in {motions.space}")
        if status != kinds.EXACT_SOLUTION:
            return None
        path, pose = problem.getSolutionPath(), make_pose_reader(motions.space)
        poses = np.array([pose(path.getState(n)) for n in range(path.getStateCount())])
    poses[[0, -1], : len(start)] = start, goal
    return poses
