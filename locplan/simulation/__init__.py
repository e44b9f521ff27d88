"""Simulated drives with a particle filter, their verdict, and the recommended path."""

from locplan.simulation.arrivals import Arrivals, Closed
from locplan.simulation.driver import drive_closed, drive_open
from locplan.simulation.drives import Drives
from locplan.simulation.levels import LEVELS, NO_FAULT, Level, select_levels
from locplan.simulation.recommendation import Choice
from locplan.simulation.recommendations import choose_many
from locplan.simulation.recommender import choose
from locplan.simulation.simulations import Simulation, simulate
from locplan.simulation.simulator import Simulator
from locplan.simulation.verdict import Verdict

__all__ = [
    "LEVELS",
    "NO_FAULT",
    "Arrivals",
    "Choice",
    "Closed",
    "Drives",
    "Level",
    "Simulation",
    "Simulator",
    "Verdict",
    "choose",
    "choose_many",
    "drive_closed",
    "drive_open",
    "select_levels",
    "simulate",
]
