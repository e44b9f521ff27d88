from ._figures import (
    locate_figure as locate_figure,
    located_drive_figure as located_drive_figure,
    twins_figure as twins_figure,
)
from ._find import (
    PLACE_HEADINGS as PLACE_HEADINGS,
    PLACE_SPACING as PLACE_SPACING,
    find_twins as find_twins,
)
from ._locate import locate as locate, locate_drive as locate_drive
from ._location import LocatedDrive as LocatedDrive, Location as Location, Mode as Mode
from ._places import (
    LAYERS as LAYERS,
    GlobalMatches as GlobalMatches,
    Start as Start,
    Twin as Twin,
)
from ._symmetries import Symmetry as Symmetry
from ._twins import Twins as Twins
