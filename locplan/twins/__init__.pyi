from ._figures import twins_figure as twins_figure
from ._find import (
    PLACE_HEADINGS as PLACE_HEADINGS,
    PLACE_SPACING as PLACE_SPACING,
    find_twins as find_twins,
)
from ._locate import locate as locate
from ._located_drive import LocatedDrive as LocatedDrive, locate_drive as locate_drive
from ._location import Location as Location, Mode as Mode
from ._location_figures import (
    locate_figure as locate_figure,
    located_drive_figure as located_drive_figure,
)
from ._places import LAYERS as LAYERS, Start as Start, Twin as Twin
from ._symmetries import Symmetry as Symmetry
from ._trials import GlobalMatches as GlobalMatches
from ._twins import Twins as Twins
