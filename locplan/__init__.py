"""Plan paths along which a robot with a 2D lidar can still localize itself.

>>> import locplan
>>> grid = locplan.environments.make("two_corridors", resolution=0.1)
>>> field = locplan.covariance_field(grid, locplan.FieldConfig())
>>> costs = locplan.Costmap.from_field(grid, field, weight=4.0, robot_radius=0.25)
>>> plan = locplan.plan(costs, start=(2.0, 3.0), goal=(38.0, 3.0))
>>> plan.status
'solved'
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from locplan import environments, export, paper, plotting, simulation, template_matching
    from locplan.comparison import Comparison, PlannerSpec, Query, compare
    from locplan.config import FieldConfig
    from locplan.config_files import load_config, save_config
    from locplan.costmap import Costmap
    from locplan.errors import LocplanError
    from locplan.field import CovarianceField, covariance_field
    from locplan.footprint import Footprint
    from locplan.grid import OccupancyGrid
    from locplan.map_files import load_map, save_map
    from locplan.metrics import PathMetrics
    from locplan.path import Path
    from locplan.planners import Plan, plan
    from locplan.planners.cost_to_go import CostToGo, plan_field
    from locplan.planners.pareto import ParetoFront, pareto_front
    from locplan.search_window import SearchWindow
    from locplan.sensor import Sensor
    from locplan.store import load_or_compute

__version__ = "0.1.0"

# Imported when first used, so that the command line answers before NumPy has loaded.
_HOME = {
    "FieldConfig": "config",
    "load_config": "config_files",
    "save_config": "config_files",
    "Costmap": "costmap",
    "PathMetrics": "metrics",
    "LocplanError": "errors",
    "CovarianceField": "field",
    "covariance_field": "field",
    "OccupancyGrid": "grid",
    "load_map": "map_files",
    "save_map": "map_files",
    "Path": "path",
    "Plan": "planners",
    "plan": "planners",
    "Footprint": "footprint",
    "CostToGo": "planners.cost_to_go",
    "plan_field": "planners.cost_to_go",
    "ParetoFront": "planners.pareto",
    "pareto_front": "planners.pareto",
    "load_or_compute": "store",
    "Comparison": "comparison",
    "PlannerSpec": "comparison",
    "Query": "comparison",
    "compare": "comparison",
    "SearchWindow": "search_window",
    "Sensor": "sensor",
}
_SUBMODULES = ("environments", "export", "paper", "plotting", "simulation", "template_matching")

__all__ = [
    "Comparison",
    "CostToGo",
    "Costmap",
    "CovarianceField",
    "FieldConfig",
    "Footprint",
    "LocplanError",
    "OccupancyGrid",
    "ParetoFront",
    "Path",
    "PathMetrics",
    "Plan",
    "PlannerSpec",
    "Query",
    "SearchWindow",
    "Sensor",
    "compare",
    "covariance_field",
    "environments",
    "export",
    "load_config",
    "load_map",
    "load_or_compute",
    "paper",
    "pareto_front",
    "plan",
    "plan_field",
    "plotting",
    "save_config",
    "save_map",
    "simulation",
    "template_matching",
]


def __getattr__(name: str) -> Any:
    if name in _SUBMODULES:
        return import_module(f"locplan.{name}")
    if name in _HOME:
        return getattr(import_module(f"locplan.{_HOME[name]}"), name)
    raise AttributeError(f"module 'locplan' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
