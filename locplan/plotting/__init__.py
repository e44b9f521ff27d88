"""Pictures of maps, fields, paths and matches.

The functions that begin with ``draw_`` draw on given Axes; the others make a whole figure.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from locplan.plotting.exports import routes_figure, values_figure
from locplan.plotting.fields import (
    draw_ellipses,
    e_figure,
    ellipses_figure,
    field_figure,
    fields_figure,
)
from locplan.plotting.maps import draw_ends, draw_field, draw_map, draw_path, save_figure
from locplan.plotting.matching import (
    distribution_figure,
    draw_models,
    models_figure,
    slides_figure,
)
from locplan.plotting.plans import front_figure, history_figure, plan_figure

if TYPE_CHECKING:
    from locplan.plotting.simulations import (
        calibration_figure,
        evaluation_figure,
        queries_figure,
        simulation_figure,
    )

__all__ = [
    "calibration_figure",
    "distribution_figure",
    "draw_ellipses",
    "draw_ends",
    "draw_field",
    "draw_map",
    "draw_models",
    "draw_path",
    "e_figure",
    "ellipses_figure",
    "evaluation_figure",
    "field_figure",
    "fields_figure",
    "front_figure",
    "history_figure",
    "models_figure",
    "plan_figure",
    "queries_figure",
    "routes_figure",
    "save_figure",
    "simulation_figure",
    "slides_figure",
    "values_figure",
]

# Of what most commands need not import.
_LATER = {
    "calibration_figure": "simulations",
    "evaluation_figure": "simulations",
    "queries_figure": "simulations",
    "simulation_figure": "simulations",
}


def __getattr__(name: str) -> Any:
    if name in _LATER:
        return getattr(import_module(f"locplan.plotting.{_LATER[name]}"), name)
    raise AttributeError(f"module 'locplan.plotting' has no attribute {name!r}")
