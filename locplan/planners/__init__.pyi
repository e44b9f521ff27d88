from ._any_angle import AnyAngle as AnyAngle, any_angle_path as any_angle_path
from ._cost_to_go import (
    CostToGo as CostToGo,
    farthest_pairs as farthest_pairs,
    plan_field as plan_field,
)
from ._grid import (
    Bordered as Bordered,
    GridPlanner as GridPlanner,
    bordered_index as bordered_index,
    connected_parts as connected_parts,
)
from ._lattice import Lattice as Lattice
from ._map_info import MapInfo as MapInfo, describe_map as describe_map
from ._pareto import BudgetPlanner as BudgetPlanner, pareto_front as pareto_front
from ._path_check import (
    PathCheck as PathCheck,
    check_path as check_path,
    path_faults as path_faults,
)
from ._plan import (
    AWARE as AWARE,
    SHORTEST as SHORTEST,
    check_ends as check_ends,
    plan as plan,
    plan_beside_shortest as plan_beside_shortest,
    planned_near_paths as planned_near_paths,
    run_planner as run_planner,
)
from ._protocol import (
    LATTICE as LATTICE,
    MAX_SEED as MAX_SEED,
    Found as Found,
    Planner as Planner,
    Position as Position,
)
from ._queries import (
    Query as Query,
    Station as Station,
    check_random as check_random,
    queries_of as queries_of,
    random_queries as random_queries,
    read_queries as read_queries,
    read_stations as read_stations,
)
from ._registry import (
    DEFAULT as DEFAULT,
    PLANNERS as PLANNERS,
    Entry as Entry,
    known_name as known_name,
    named_planner as named_planner,
    names as names,
)
from ._request import (
    AnyPlanner as AnyPlanner,
    FunctionPlanner as FunctionPlanner,
    innermost as innermost,
    options_of as options_of,
    own_planner as own_planner,
    planner_for as planner_for,
    takes as takes,
    with_options as with_options,
)
from ._result import ParetoFront as ParetoFront, Plan as Plan
from ._robot_fit import default_planner as default_planner, needs_lattice as needs_lattice
from ._smoothing import smoothed as smoothed
from .ompl._planner import Ompl as Ompl
