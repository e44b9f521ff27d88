from ._fields import (
    draw_ellipses as draw_ellipses,
    e_figure as e_figure,
    ellipses_figure as ellipses_figure,
    field_figure as field_figure,
    fields_figure as fields_figure,
    map_figure as map_figure,
)
from ._info import info_figure as info_figure
from ._maps import (
    draw_ends as draw_ends,
    draw_field as draw_field,
    draw_map as draw_map,
    draw_path as draw_path,
    save_figure as save_figure,
)
from ._plans import (
    costmap_figure as costmap_figure,
    front_figure as front_figure,
    history_figure as history_figure,
    path_figure as path_figure,
    plan_figure as plan_figure,
)
