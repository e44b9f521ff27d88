from . import trials as trials
from ._areas import degenerate_areas as degenerate_areas
from ._check import check as check
from ._figures import check_figure as check_figure
from ._limits import Limit as Limit
from ._outlines import DegenerateArea as DegenerateArea
from ._result import Check as Check, Cure as Cure, Rates as Rates, Trip as Trip
from ._weak_spots import WeakSpot as WeakSpot
