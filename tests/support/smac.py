"""Nav2's SmacPlanner2D on an exported mask, next to the grid planner."""

from __future__ import annotations

import math

import numpy as np
import yaml

from locplan.export import nav2_keepout
from locplan.export.masks import compute_mask_density
from locplan.planning import Costmap, Path, path_metrics, plan
from support import ros_readers

STACKS = ("main", "humble", "ros1")


def make_master_costs(costs):
    """What a costmap holds before the mask: walls, unknown space, and the robot's radius."""
    levels = np.select([costs.grid.free, costs.grid.cells == 0], [0, 100], -1).astype(np.int8)
    master = ros_readers.static_layer(levels, "main", track_unknown_space=True)
    near = costs.grid.free & (costs.grid.clearance < costs.robot_radius - 1e-9)
    master[near] = ros_readers.INSCRIBED
    return master


def apply_mask(folder, costs, stack="main"):
    mask = ros_readers.load(folder / "mask.yaml", stack)
    assert mask.origin[:2] == costs.grid.origin[:2]
    x, y, _ = costs.grid.origin
    return ros_readers.keepout(make_master_costs(costs), mask, mask.resolution, (x, y))


def make_roomy(costs):
    """The costmap that a mask stands for, which has a follower's room."""
    density = np.where(np.isfinite(costs.density), compute_mask_density(costs), np.inf)
    return Costmap.from_density(costs.grid, density)


def plan_by_smac(folder, costs, start, goal):
    """SmacPlanner2D's path on the costmap with the mask, in the world."""
    parameters = yaml.safe_load((folder / "nav2.yaml").read_text())
    own = parameters["planner_server"]["ros__parameters"]["GridBased"]
    master = apply_mask(folder, costs)
    cells, _ = ros_readers.grid_path(
        ros_readers.smac2d_multiplier(master, own["cost_travel_multiplier"]),
        ros_readers.smac_blocked(master, own["allow_unknown"]),
        costs.find_cell(start),
        costs.find_cell(goal),
    )
    return Path(np.array([costs.grid.position(*cell) for cell in cells]))


def compare_with_smac(folder, costs, start, goal, **settings):
    """J of Smac2D's path on the mask, and of the grid planner's, by the same measure."""
    conversion = nav2_keepout(folder, costs, **settings)
    centres = [costs.grid.position(*costs.find_cell(xy)) for xy in (start, goal)]
    path = plan_by_smac(folder, costs, start, goal)
    costs = make_roomy(costs)
    own = plan(costs, *centres, planner="grid", allow_corner_cutting=True)
    return path_metrics(costs, path), own.metrics, conversion


def find_far_ends(costs, seed):
    """Two positions that are joined, at least half of the map apart."""
    rng = np.random.default_rng(seed)
    free = np.argwhere(np.isfinite(costs.density))
    for _ in range(200):
        a, b = free[rng.integers(len(free), size=2)]
        if math.dist(a, b) > 0.5 * max(costs.grid.shape):
            ends = [costs.grid.position(*map(int, cell)) for cell in (a, b)]
            if plan(costs, *ends, planner="grid").status == "solved":
                return ends
    raise AssertionError("no pair found")
