"""Paths of least cost: costmaps, planners, Pareto fronts and path checks."""

from locplan.planning.any_angle import AnyAngle
from locplan.planning.cost_to_go import plan_field
from locplan.planning.costmap import Costmap
from locplan.planning.grid import GridPlanner
from locplan.planning.lattice import Lattice
from locplan.planning.map_info import MapInfo, describe_map
from locplan.planning.metrics import PathMetrics, path_cost, path_metrics
from locplan.planning.ompl.planner import Ompl
from locplan.planning.pareto import pareto_front
from locplan.planning.path import Path
from locplan.planning.path_check import PathCheck, check_path
from locplan.planning.plans import plan
from locplan.planning.protocol import Planner, PlannerResult
from locplan.planning.queries import Query, random_queries
from locplan.planning.registry import PLANNERS
from locplan.planning.results import ParetoFront, Plan

__all__ = [
    "PLANNERS",
    "AnyAngle",
    "Costmap",
    "GridPlanner",
    "Lattice",
    "MapInfo",
    "Ompl",
    "ParetoFront",
    "Path",
    "PathCheck",
    "PathMetrics",
    "Plan",
    "Planner",
    "PlannerResult",
    "Query",
    "check_path",
    "describe_map",
    "pareto_front",
    "path_cost",
    "path_metrics",
    "plan",
    "plan_field",
    "random_queries",
]
