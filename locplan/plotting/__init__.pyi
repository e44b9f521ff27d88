from . import style as style
from ._cells import (
    coarse as coarse,
    draw_cells as draw_cells,
    drawn_size as drawn_size,
    map_around as map_around,
    map_axes as map_axes,
    map_size as map_size,
    shrunk as shrunk,
    zoomed_to as zoomed_to,
)
from ._fields import (
    field_figure as field_figure,
    fields_figure as fields_figure,
    info_figure as info_figure,
    map_figure as map_figure,
)
from ._maps import (
    along_norm as along_norm,
    draw_along as draw_along,
    draw_along_bar as draw_along_bar,
    draw_ends as draw_ends,
    draw_field as draw_field,
    draw_inset as draw_inset,
    draw_map as draw_map,
    draw_path as draw_path,
    end_handles as end_handles,
    faults_figure as faults_figure,
    save_figure as save_figure,
)
from ._picture import (
    Picture as Picture,
    draw_number as draw_number,
    label_plainly as label_plainly,
    lines_within as lines_within,
    make_logarithmic as make_logarithmic,
)
from ._plans import (
    costmap_figure as costmap_figure,
    draw_degeneracy as draw_degeneracy,
    draw_u_along as draw_u_along,
    front_figure as front_figure,
    history_figure as history_figure,
    path_check_figure as path_check_figure,
    path_figure as path_figure,
    plan_figure as plan_figure,
)
from .style import (
    FIELD_COLOURS as FIELD_COLOURS,
    MAP_COLOURS as MAP_COLOURS,
    PATH_STYLES as PATH_STYLES,
)
