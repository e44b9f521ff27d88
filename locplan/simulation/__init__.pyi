from ._calibration import Calibration as Calibration, calibrate as calibrate
from ._drives import Drives as Drives, rmse_ratio as rmse_ratio
from ._evaluation import Evaluation as Evaluation, evaluate as evaluate
from ._figures import (
    calibration_figure as calibration_figure,
    evaluation_figure as evaluation_figure,
    queries_figure as queries_figure,
    simulation_figure as simulation_figure,
)
from ._places import Places as Places, choose_points as choose_points, measure as measure
from ._routes import Routes as Routes, simulate_queries as simulate_queries
from ._simulate import Simulation as Simulation, simulate as simulate
from ._simulator import Simulator as Simulator
from .choice._choice import Candidate as Candidate, Choice as Choice
from .choice._choices import Choices as Choices, MapChoice as MapChoice
from .choice._choose import choose as choose
from .choice._choose_many import choose_many as choose_many
from .choice._figures import choice_figure as choice_figure
from .choice._planner import SimulatedChoice as SimulatedChoice
from .choice._verdict import Verdict as Verdict, verdict as verdict
from .tuning._figures import tuning_figure as tuning_figure
from .tuning._results import Tuning as Tuning
from .tuning._tune import tune as tune
