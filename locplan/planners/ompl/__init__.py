"""OMPL's sampling-based planners on a costmap.

`locplan.plan` runs them by name. For an OMPL program of one's own there are the parts:

- `space_information` makes the state space with its bounds, validity checker and motion validator,
- `CostObjective` is the objective J, with the length as its admissible heuristic,
- `ClearMotionValidator` checks a whole motion in one call,
- `problem_definition` and `state_of` make a query,
- `grow_roadmap` keeps a PRM's roadmap for any number of queries,
- `KINDS` says what each of OMPL's planners can do here.

All take a `Motions`, which holds the costmap and the kind of motion. States are in the world's
metres and radians. OMPL's Python bindings are those of the package ompl, from 2.0.1.
"""

from locplan._util.public import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
