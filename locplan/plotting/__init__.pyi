from ._fields import draw_ellipses as draw_ellipses
from ._fields import e_figure as e_figure
from ._fields import ellipses_figure as ellipses_figure
from ._fields import field_figure as field_figure
from ._fields import fields_figure as fields_figure
from ._fields import map_figure as map_figure
from ._maps import draw_ends as draw_ends
from ._maps import draw_field as draw_field
from ._maps import draw_map as draw_map
from ._maps import draw_path as draw_path
from ._maps import save_figure as save_figure
from ._plans import front_figure as front_figure
from ._plans import history_figure as history_figure
from ._plans import plan_figure as plan_figure

__all__ = [
    "draw_ellipses",
    "draw_ends",
    "draw_field",
    "draw_map",
    "draw_path",
    "e_figure",
    "ellipses_figure",
    "field_figure",
    "fields_figure",
    "front_figure",
    "history_figure",
    "map_figure",
    "plan_figure",
    "save_figure",
]
