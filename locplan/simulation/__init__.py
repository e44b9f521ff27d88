"""Simulated localization: drives with a particle filter, and what they say of the fields."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from locplan.simulation.calibration import Calibration, calibrate
    from locplan.simulation.drives import Drives, rmse_ratio
    from locplan.simulation.evaluation import Evaluation, evaluate
    from locplan.simulation.places import Places, choose_points, measure
    from locplan.simulation.routes import Routes, Simulation, simulate, simulate_queries
    from locplan.simulation.settings import Amcl, Reality
    from locplan.simulation.simulator import Simulator

_HOME = {
    "Amcl": "settings",
    "Calibration": "calibration",
    "Drives": "drives",
    "Evaluation": "evaluation",
    "Places": "places",
    "Reality": "settings",
    "Routes": "routes",
    "Simulation": "routes",
    "Simulator": "simulator",
    "calibrate": "calibration",
    "choose_points": "places",
    "evaluate": "evaluation",
    "measure": "places",
    "rmse_ratio": "drives",
    "simulate": "routes",
    "simulate_queries": "routes",
}

__all__ = [
    "Amcl",
    "Calibration",
    "Drives",
    "Evaluation",
    "Places",
    "Reality",
    "Routes",
    "Simulation",
    "Simulator",
    "calibrate",
    "choose_points",
    "evaluate",
    "measure",
    "rmse_ratio",
    "simulate",
    "simulate_queries",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"locplan.simulation.{_HOME[name]}"), name)
    raise AttributeError(f"module 'locplan.simulation' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
