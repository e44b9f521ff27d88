from ._motions import Motions as Motions
from ._planner import Ompl as Ompl
from ._roadmap import Roadmap as Roadmap, grow_roadmap as grow_roadmap
from ._setup import (
    ClearMotionValidator as ClearMotionValidator,
    CostObjective as CostObjective,
    problem_definition as problem_definition,
    space_information as space_information,
    state_of as state_of,
    state_space as state_space,
)
from ._stopping import KINDS as KINDS, Kind as Kind, Limits as Limits
