"""Simulated drives with a particle filter, their verdict, and the recommended path."""

from locplan.simulation.arrivals import Arrivals, ClosedLoopSettings
from locplan.simulation.driver import drive_closed, drive_open
from locplan.simulation.drives import Drives
from locplan.simulation.levels import LEVELS, NO_FAULT, Level, select_levels
from locplan.simulation.problem import RecommendationSettings
from locplan.simulation.recommendation import Recommendation
from locplan.simulation.recommendations import recommend_paths
from locplan.simulation.recommender import recommend_path
from locplan.simulation.simulations import Simulation, simulate
from locplan.simulation.simulator import Simulator
from locplan.simulation.verdict import Verdict

__all__ = [
    "LEVELS",
    "NO_FAULT",
    "Arrivals",
    "ClosedLoopSettings",
    "Drives",
    "Level",
    "Recommendation",
    "RecommendationSettings",
    "Simulation",
    "Simulator",
    "Verdict",
    "drive_closed",
    "drive_open",
    "recommend_path",
    "recommend_paths",
    "select_levels",
    "simulate",
]
