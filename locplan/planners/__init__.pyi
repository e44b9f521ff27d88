from ._any_angle import AnyAngle as AnyAngle
from ._budget import BudgetPlanner as BudgetPlanner
from ._cost_to_go import CostToGo as CostToGo
from ._cost_to_go import plan_field as plan_field
from ._function import FunctionPlanner as FunctionPlanner
from ._function import Guarded as Guarded
from ._grid import GridPlanner as GridPlanner
from ._pareto import ParetoFront as ParetoFront
from ._pareto import pareto_front as pareto_front
from ._plan import check_ends as check_ends
from ._plan import plan as plan
from ._plan import plan_beside_shortest as plan_beside_shortest
from ._plan import run_planner as run_planner
from ._protocol import Found as Found
from ._protocol import Planner as Planner
from ._protocol import Position as Position
from ._queries import Query as Query
from ._queries import random_queries as random_queries
from ._queries import read_queries as read_queries
from ._registry import DEFAULT as DEFAULT
from ._registry import PLANNERS as PLANNERS
from ._registry import names as names
from ._request import AnyPlanner as AnyPlanner
from ._request import innermost as innermost
from ._request import options_of as options_of
from ._request import planner_for as planner_for
from ._request import takes as takes
from ._request import with_options as with_options
from ._result import Plan as Plan
from .ompl._planner import Ompl as Ompl

__all__ = [
    "DEFAULT",
    "PLANNERS",
    "AnyAngle",
    "AnyPlanner",
    "BudgetPlanner",
    "CostToGo",
    "Found",
    "FunctionPlanner",
    "GridPlanner",
    "Guarded",
    "Ompl",
    "ParetoFront",
    "Plan",
    "Planner",
    "Position",
    "Query",
    "check_ends",
    "innermost",
    "names",
    "options_of",
    "pareto_front",
    "plan",
    "plan_beside_shortest",
    "plan_field",
    "planner_for",
    "random_queries",
    "read_queries",
    "run_planner",
    "takes",
    "with_options",
]
