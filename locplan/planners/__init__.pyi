from ._budget import shortest_within as shortest_within
from ._cost_to_go import CostToGo as CostToGo
from ._cost_to_go import plan_field as plan_field
from ._pareto import ParetoFront as ParetoFront
from ._pareto import pareto_front as pareto_front
from ._plan import check_ends as check_ends
from ._plan import check_request as check_request
from ._plan import names as names
from ._plan import plan as plan
from ._plan import plan_beside_shortest as plan_beside_shortest
from ._queries import Query as Query
from ._queries import random_queries as random_queries
from ._queries import read_queries as read_queries
from ._result import Plan as Plan

__all__ = [
    "CostToGo",
    "ParetoFront",
    "Plan",
    "Query",
    "check_ends",
    "check_request",
    "names",
    "pareto_front",
    "plan",
    "plan_beside_shortest",
    "plan_field",
    "random_queries",
    "read_queries",
    "shortest_within",
]
