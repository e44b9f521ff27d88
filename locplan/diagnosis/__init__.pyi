from . import trials as trials
from ._areas import degenerate_areas as degenerate_areas
from ._check import check as check
from ._figures import check_figure as check_figure
from ._limits import Limit as Limit
from ._outlines import DegenerateArea as DegenerateArea
from ._passages import Passage as Passage
from ._rates import (
    DriveRates as DriveRates,
    FixResult as FixResult,
    RouteResult as RouteResult,
)
from ._result import Check as Check
from ._weak_spots import WeakSpot as WeakSpot
