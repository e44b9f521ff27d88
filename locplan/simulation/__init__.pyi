from ._calibration import Calibration as Calibration
from ._calibration import calibrate as calibrate
from ._drives import Drives as Drives
from ._drives import rmse_ratio as rmse_ratio
from ._evaluation import Evaluation as Evaluation
from ._evaluation import evaluate as evaluate
from ._figures import calibration_figure as calibration_figure
from ._figures import evaluation_figure as evaluation_figure
from ._figures import queries_figure as queries_figure
from ._figures import simulation_figure as simulation_figure
from ._nav2 import read_amcl as read_amcl
from ._places import Places as Places
from ._places import choose_points as choose_points
from ._places import measure as measure
from ._routes import Routes as Routes
from ._routes import Simulation as Simulation
from ._routes import simulate as simulate
from ._routes import simulate_queries as simulate_queries
from ._settings import Amcl as Amcl
from ._settings import Disturbances as Disturbances
from ._simulator import Simulator as Simulator

__all__ = [
    "Amcl",
    "Calibration",
    "Disturbances",
    "Drives",
    "Evaluation",
    "Places",
    "Routes",
    "Simulation",
    "Simulator",
    "calibrate",
    "calibration_figure",
    "choose_points",
    "evaluate",
    "evaluation_figure",
    "measure",
    "queries_figure",
    "read_amcl",
    "rmse_ratio",
    "simulate",
    "simulate_queries",
    "simulation_figure",
]
