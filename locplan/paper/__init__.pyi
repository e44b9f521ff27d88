from . import template_matching as template_matching
from ._claims import (
    CLAIMS as CLAIMS,
    PLACES as PLACES,
    Slide as Slide,
    at_places as at_places,
    maps_of_places as maps_of_places,
    mismatch_at as mismatch_at,
    one_dimensional as one_dimensional,
    share_smaller_with_range as share_smaller_with_range,
    shares_of_claims as shares_of_claims,
)
from ._figures import (
    distribution_figure as distribution_figure,
    draw_models as draw_models,
    models_figure as models_figure,
    place_figure as place_figure,
    slides_figure as slides_figure,
)
