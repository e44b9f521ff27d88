from ._alternatives import alternatives as alternatives
from ._any_angle import AnyAngle as AnyAngle
from ._budget import BudgetPlanner as BudgetPlanner
from ._cost_to_go import CostToGo as CostToGo, plan_field as plan_field
from ._function import FunctionPlanner as FunctionPlanner, Guarded as Guarded
from ._grid import AStar as AStar, Dijkstra as Dijkstra, GridPlanner as GridPlanner
from ._map_info import MapInfo as MapInfo, describe_map as describe_map
from ._near_paths import planned_near_paths as planned_near_paths
from ._pareto import ParetoFront as ParetoFront, pareto_front as pareto_front
from ._plan import (
    check_ends as check_ends,
    plan as plan,
    plan_beside_shortest as plan_beside_shortest,
    run_planner as run_planner,
)
from ._protocol import (
    MAX_SEED as MAX_SEED,
    Found as Found,
    Planner as Planner,
    Position as Position,
)
from ._queries import (
    Query as Query,
    check_random as check_random,
    random_queries as random_queries,
    read_queries as read_queries,
)
from ._registry import DEFAULT as DEFAULT, PLANNERS as PLANNERS, names as names
from ._request import (
    AnyPlanner as AnyPlanner,
    innermost as innermost,
    options_of as options_of,
    planner_for as planner_for,
    takes as takes,
    with_options as with_options,
)
from ._result import Plan as Plan
from ._stations import Station as Station, read_stations as read_stations
from ._suggestions import NamedPlace as NamedPlace, PlacePair as PlacePair
from .ompl._planner import Ompl as Ompl
