from .kinds import KINDS as KINDS, PlannerKind as PlannerKind
from .motions import Motions as Motions
from .planner import Ompl as Ompl
from .roadmap import Roadmap as Roadmap, grow_roadmap as grow_roadmap
from .setup import (
    ClearMotionValidator as ClearMotionValidator,
    CostObjective as CostObjective,
    problem_definition as problem_definition,
    space_information as space_information,
    state_from_pose as state_from_pose,
    state_space as state_space,
)
from .stopping import SearchLimits as SearchLimits
