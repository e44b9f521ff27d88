from ._motions import Motions as Motions
from ._planner import Ompl as Ompl
from ._roadmap import Roadmap as Roadmap
from ._roadmap import grow_roadmap as grow_roadmap
from ._setup import ClearMotionValidator as ClearMotionValidator
from ._setup import CostObjective as CostObjective
from ._setup import problem_definition as problem_definition
from ._setup import space_information as space_information
from ._setup import state_of as state_of
from ._setup import state_space as state_space
from ._stopping import Limits as Limits

__all__ = [
    "ClearMotionValidator",
    "CostObjective",
    "Limits",
    "Motions",
    "Ompl",
    "Roadmap",
    "grow_roadmap",
    "problem_definition",
    "space_information",
    "state_of",
    "state_space",
]
