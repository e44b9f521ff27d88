"""Pictures of maps, fields, paths and matches.

The functions that begin with ``draw_`` draw on given Axes; the others make a whole figure.
"""

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

__all__ = [
    "distribution_figure",
    "draw_ellipses",
    "draw_ends",
    "draw_field",
    "draw_map",
    "draw_models",
    "draw_path",
    "e_figure",
    "ellipses_figure",
    "field_figure",
    "fields_figure",
    "front_figure",
    "history_figure",
    "models_figure",
    "plan_figure",
    "routes_figure",
    "save_figure",
    "slides_figure",
    "values_figure",
]
