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
