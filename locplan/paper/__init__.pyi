from . import template_matching as template_matching
from ._claims import CLAIMS as CLAIMS
from ._claims import PLACES as PLACES
from ._claims import Slide as Slide
from ._claims import at_places as at_places
from ._claims import maps_of_places as maps_of_places
from ._claims import mismatch_at as mismatch_at
from ._claims import one_dimensional as one_dimensional
from ._claims import share_smaller_with_range as share_smaller_with_range
from ._claims import shares_of_claims as shares_of_claims
from ._figures import distribution_figure as distribution_figure
from ._figures import draw_models as draw_models
from ._figures import models_figure as models_figure
from ._figures import slides_figure as slides_figure

__all__ = [
    "CLAIMS",
    "PLACES",
    "Slide",
    "at_places",
    "distribution_figure",
    "draw_models",
    "maps_of_places",
    "mismatch_at",
    "models_figure",
    "one_dimensional",
    "share_smaller_with_range",
    "shares_of_claims",
    "slides_figure",
    "template_matching",
]
